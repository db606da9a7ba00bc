"""Tell in which encoding the names of a file are written, and never guess in doubt.

Programs write names in UTF-8, in UTF-16 with its mark, or in what Windows calls ANSI: cp932 in
Japan, near to Latin-1 in the west of Europe. Any bytes can be read as Latin-1, and many as cp932,
so that one of these is believed only where the text that comes out looks like written by a person.
"""

import re
import unicodedata

UTF_16_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""What a text in UTF-16 begins with."""
_JAPANESE = re.compile("[\u3000-\u30ff\u4e00-\u9fff\uf900-\ufaff\uff01-\uff9f]+")
"""Runs of kana, kanji and the wide letters that stand among them."""
_HALF_WIDTH = re.compile("[\uff61-\uff9f]")
_NO_LETTERS = re.compile("[\x80-\x9f\xa2-\xa6\xa8\xab-\xad\xaf\xb4\xb6\xb8\xbb-\xbe\xd7\xf7]")
"""Signs of Latin-1 that stand in no name and no remark; ordinals, degrees and the like may."""
_LATIN_RUN = re.compile("[À-ÿ]{3}|(?<![A-Za-z])[À-ÿ]{2}(?![A-Za-z])")
"""What no word of a western language holds: three accented letters in a row, or two alone."""


def find_encoding(data: bytes) -> str | None:
    """Return the encoding of a text, or None where it cannot be told.

    Returns
    -------
    str or None
        "utf-8-sig" (plain ASCII and UTF-8, with or without a mark), "utf-16", "cp932", or
        "latin-1".
    """
    if data.isascii():
        return "utf-8-sig"
    if data.startswith(UTF_16_MARKS):
        return "utf-16" if _decoded(data, "utf-16") is not None else None
    if _decoded(data, "utf-8") is not None:
        return "utf-8-sig"
    # Kana and the usual kanji begin with a byte that stands for no letter elsewhere.
    if re.search(rb"[\x81-\x9f]", data) and _is_japanese(_decoded(data, "cp932")):
        return "cp932"
    return "latin-1" if _is_western(data.decode("latin-1")) else None


def normalized(name: str) -> str:
    """Return a name with letters and their marks composed (NFC), as all names are compared.

    Macs and shares from Macs write a voiced kana or an accented letter as two characters.
    """
    return unicodedata.normalize("NFC", name)


def _decoded(data: bytes, encoding: str) -> str | None:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        return None


def _is_japanese(text: str | None) -> bool:
    """Tell whether a text is Japanese, rather than another language read as cp932.

    Another language gives single signs amid letters, half-width kana, or signs of no language.
    """
    if text is None or re.search("[\x80-\xa0\ue000-\uf8ff]", text):
        return False
    runs = list(_JAPANESE.finditer(text))
    half = sum(len(_HALF_WIDTH.findall(run[0])) for run in runs)
    if 2 * half > sum(len(run[0]) for run in runs):
        return False
    amid = [
        run
        for run in runs
        if len(run[0]) == 1 and re.search("[A-Za-z]", text[max(run.start() - 1, 0) : run.end() + 1])
    ]
    return bool(runs) and len(runs) >= 2 * len(amid)


def _is_western(text: str) -> bool:
    """Tell whether a text read as Latin-1 could be of a western language."""
    return not _NO_LETTERS.search(text) and not _LATIN_RUN.search(text)
