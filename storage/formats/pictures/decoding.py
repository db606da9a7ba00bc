"""Decode a picture that anybody may have brought, once its header says that it is not too large."""

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.reading import read_bytes

MOST_PIXELS = 100_000_000
"""Largest picture that is decoded [px]. Cameras of films have up to 80 million; 400 million cost
2.3 GB and half a minute, from a file of 50 kB."""
_MOST_BYTES = 1 << 29
"""Longest file of a picture [bytes]. The largest picture, not compressed, in 16 bits a channel."""

_WANTED = "a picture as PNG or JPEG"
_PBM = re.compile(rb"P([14])(?:\s+|#[^\n]*\n)+(\d{1,9})(?:\s+|#[^\n]*\n)+(\d{1,9})\s")
"""Kind, columns and rows of a portable bitmap: digits (1) or eight pixels a byte (4)."""
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_SIZED = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""The markers of JPEG behind which the size stands: every kind of frame (ITU T.81, table B.1)."""


def decode_picture(path: Path) -> NDArray[np.uint8]:
    """Return a picture (row, column, 3) uint8, RGB.

    Raises
    ------
    InputError
        It cannot be read, is neither PNG nor JPEG, is too large, or is damaged.
    """
    return decode_data(path, read_picture_bytes(path, _WANTED), _WANTED)


def read_picture_bytes(path: Path, wanted: str) -> bytes:
    """Return the content of a file that should be a picture, and `wanted`.

    Raises
    ------
    InputError
        It cannot be read, or is longer than any picture.
    """
    return read_bytes(path, wanted, most=_MOST_BYTES)


def decode_data(path: Path, data: bytes, wanted: str, *, as_stored: bool = False) -> NDArray[Any]:
    """Return a picture from the content of its file.

    Parameters
    ----------
    path, data
        The file and what is in it.
    wanted
        What should have been brought, for messages.
    as_stored
        Whether channels and bits stay as they are, opacity included, and bitmaps count as pictures;
        else it becomes (row, column, 3) uint8, RGB.

    Raises
    ------
    InputError
        As `decode_picture`.
    """
    import cv2  # here, because only who reads a picture should wait for it

    columns, rows = header_size(data) or (as_stored and _bitmap_size(data)) or (0, 0)
    if not columns or not rows:
        raise InputError(f"{path} cannot be decoded: it is damaged or no picture; bring {wanted}")
    if columns * rows > MOST_PIXELS:
        raise InputError(
            f"{path} is a picture of {columns:,} x {rows:,} pixels, more than the "
            f"{MOST_PIXELS:,} that are read; bring one of the size of the film"
        )
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        how = cv2.IMREAD_UNCHANGED if as_stored else cv2.IMREAD_COLOR_RGB
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), how)
    except cv2.error:
        picture = None
    if picture is None:
        raise InputError(f"{path} cannot be decoded: it is damaged or no picture; bring {wanted}")
    return np.asarray(picture)


def _bitmap_size(data: bytes) -> tuple[int, int] | None:
    """Return the columns and rows of a portable bitmap whose pixels are all there."""
    found = _PBM.match(data)
    if not found:
        return None
    columns, rows = int(found[2]), int(found[3])
    least = rows * columns if found[1] == b"1" else rows * -(-columns // 8)
    return (columns, rows) if len(data) - found.end() >= least else None


def header_size(data: bytes) -> tuple[int, int] | None:
    """Return the columns and rows that the header of a PNG or JPEG names, None where it is none."""
    if data.startswith(_PNG) and data[12:16] == b"IHDR" and len(data) >= 24:
        columns, rows = struct.unpack(">II", data[16:24])
        return columns, rows
    if data.startswith(_JPEG):
        return _jpeg_size(data)
    return None


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return the columns and rows of a JPEG, from segment to segment."""
    at = 2
    while (at := data.find(b"\xff", at)) >= 0:
        while data[at : at + 1] == b"\xff":  # any number of them may fill
            at += 1
        if at + 8 > len(data):
            return None
        marker = data[at]
        if marker in _SIZED:
            rows, columns = struct.unpack(">HH", data[at + 4 : at + 8])
            return columns, rows
        if marker in (0x00, 0x01) or 0xD0 <= marker <= 0xD8:  # without a length
            at += 1
            continue
        at += 1 + struct.unpack(">H", data[at + 1 : at + 3])[0]
    return None
