"""Read masks: pictures or frames that were made elsewhere and say where the performer is.

White or opaque is the performer. Where a picture has pixels that can be seen through, opacity
counts and its colors do not: it is the performer cut out. What lies between, a soft edge, is kept.
"""

from pathlib import Path
from typing import Any

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.pictures.decoding import decode_data, read_picture_bytes
from storage.formats.pictures.film_decoding import RgbReader

MASK_SUFFIXES = (".png", ".pbm", ".jpg", ".jpeg")
"""How the names of pictures of masks end, in small letters."""

_WANTED = "a mask as PNG, PBM or JPEG"
_OPAQUE = 255


def decode_mask(path: Path) -> NDArray[np.uint8]:
    """Return how much each pixel of a picture is the performer: (row, column), 255 wholly.

    Raises
    ------
    InputError
        It cannot be read, is no PNG, PBM or JPEG, is too large, or is damaged.
    """
    data = read_picture_bytes(path, _WANTED)
    picture = decode_data(path, data, _WANTED, as_stored=True)
    if picture.dtype != np.uint8:
        picture = _to_bytes(picture)
    colors = picture.reshape(*picture.shape[:2], -1)
    opacity = colors[..., 3] if colors.shape[2] == 4 else None
    mask = _mask(_gray(colors), opacity)
    if path.suffix.lower() == ".png" and mask.max() == 1:  # a program's 0 and 1, not 0 and 255
        return mask * np.uint8(_OPAQUE)
    return mask


class MaskReader:
    """Turns the frames of a film into masks; it is kept for the film, which is faster."""

    def __init__(self) -> None:
        self._read = RgbReader()

    def __call__(self, frame: VideoFrame) -> NDArray[np.uint8]:
        """Return (row, column) how much each pixel is the performer, as the film holds it."""
        return _mask(_gray(self._read(frame)), self._read.opacity(frame))


def _mask(gray: NDArray[np.uint8], opacity: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    """Return the opacity where something can be seen through, else how white it is."""
    return gray if opacity is None or opacity.min() == _OPAQUE else np.ascontiguousarray(opacity)


def _gray(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the mean (row, column) of the channels of a picture, of one channel that itself."""
    if colors.shape[2] == 1:
        return colors[..., 0]
    total = colors[..., 0].astype(np.uint16) + colors[..., 1] + colors[..., 2]
    return (total // np.uint16(3)).astype(np.uint8)


def _to_bytes(picture: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a picture of 16 bits a channel in 8 bits."""
    if picture.dtype != np.uint16:
        raise InputError(f"a picture of {picture.dtype} is no mask; bring {_WANTED}")
    if picture.max() == 1:
        return picture.astype(np.uint8)
    return (picture // 257).astype(np.uint8)
