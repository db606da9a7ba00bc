"""Write markdown in which nothing that a user has brought is markup: titles, paths, reasons."""

import re
from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.formats.pictures.pictures import encode_drawing, encode_within

MOST_BYTES = 4_000
"""How long the file of a filmed or colored picture on a page may be [bytes].

Chosen by eye, as small as a body can still be judged in: the dashboard keeps every page twice in
its database.
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
    return _inside(said, *encode_within(image, MOST_BYTES))


def drawing(image: NDArray[np.uint8], said: str) -> str:
    """Return a drawing of few colors, as `picture` does, with its lines and letters sharp."""
    return _inside(said, encode_drawing(image), "image/webp")


def _inside(said: str, content: bytes, kind: str) -> str:
    """Return the content of a picture's file as a picture in the text."""
    return f"![{escaped(said)}](data:{kind};base64,{b64encode(content).decode()})"
