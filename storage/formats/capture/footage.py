"""What a capture's files of a camera say of themselves: how large, how long, how fast."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import NotRegularError, check_regular
from storage.formats.pictures.decoding import decode_picture
from storage.formats.pictures.video import PICTURE_SUFFIXES, open_video, read_frames


@dataclass(frozen=True)
class Footage:
    """A video, a folder of pictures or a picture, as far as its first frame and packets say."""

    path: Path
    size: tuple[int, int]
    """Width and height, px, upright."""
    frames: int
    rate_hz: float | None
    """None where the file does not say, as pictures do not."""
    notes: tuple[str, ...] = ()
    """What the user should know, a sentence each."""


def look_at_footage(path: Path) -> Footage:
    """Return what a video, a folder of pictures or a picture says of itself.

    Raises
    ------
    InputError
        It cannot be opened or decoded, holds no frame, or its frames do not follow each other.
    """
    try:
        check_regular(path)
    except NotRegularError as error:
        raise InputError(f"{path} is no regular file, but {error.kind}; bring the file") from error
    if path.suffix.lower() in PICTURE_SUFFIXES and not path.is_dir():
        rows, columns, _ = read_picture(path).shape
        return Footage(path, (columns, rows), 1, None)
    video = open_video(path)
    rows, columns = video.size
    return Footage(path, (columns, rows), video.frames, video.rate_hz, video.notes)


def read_picture(path: Path) -> NDArray[np.uint8]:
    """Return a picture, or the first frame of a video.

    Returns
    -------
    (row, column, 3) uint8
        RGB.

    Raises
    ------
    InputError
        It cannot be opened or decoded.
    """
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        return read_frames(open_video(path), 0, 1)[0]
    return decode_picture(path)
