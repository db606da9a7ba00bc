"""Write markdown in which nothing that a user has brought is markup: titles, paths, reasons."""

import re
from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.formats.pictures.pictures import encode_within

MOST_BYTES = 12_000
"""How long the file of a picture on a page may be [bytes].

Chosen by eye: a page of five is some 70 kB of letters, which the dashboard keeps twice in its
database. It shows no picture of many more than 30 kB.
"""

_ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})
_MARKUP = re.compile(r"([\\`*\[\]|~#]|(?<!\w)_|_(?!\w))")
_SCHEME = re.compile(r"^https?://[^\s<>()\"'\\|`]+$")


def escaped(text: Any) -> str:
    """Return a text as one line of markdown that shows these letters and does nothing else."""
    line = " ".join(str(text).split())
    line = "".join(each for each in line if each.isprintable())
    return _MARKUP.sub(r"\\\1", line.translate(_ENTITIES)).replace("://", ":&#47;&#47;")


def linked(text: Any, address: str) -> str:
    """Return a text as a link; as a mere text where the address is not of the web."""
    shown = escaped(text)
    return f"[{shown}]({address})" if _SCHEME.match(address) else shown


def table(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a table; cells are texts, or what `linked` made, which begins with "["."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(str(cell) for cell in line)} |" for line in lines)


def picture(image: NDArray[np.uint8], said: str) -> str:
    """Return an RGB picture (row, column, 3) with what it shows, inside the text itself."""
    content, kind = encode_within(image, MOST_BYTES)
    return f"![{escaped(said)}](data:{kind};base64,{b64encode(content).decode()})"
