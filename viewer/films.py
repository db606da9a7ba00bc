"""The films of a take's capture, small, all cameras in one picture: in step with the body.

A capture stays where it was brought from. Where it is still there, its frames are decoded some at
a time, because a film is read from one frame that stands alone to the next.
"""

import math
import unicodedata
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.archive import Take
from storage.errors import InputError
from storage.formats.capture.capture_files import files_of
from storage.formats.pictures.pictures import encode_jpeg
from storage.formats.pictures.video import Video, open_video, read_frames
from tasks.engine.threads import THREADS

BLOCK = 8
"""How many frames are decoded at a time [frames]. Chosen: only the first is
waited for."""
_WIDE_PX = 320
"""How wide a camera's picture is among the others [px]. Chosen: half of a panel on a
dense screen."""
_ALONE_PX = 960
"""How wide it is alone [px]."""
_QUALITY = 82
"""Quality of JPEG, of 100. Chosen by eye."""


@dataclass(frozen=True)
class Films:
    """The films of a capture, in the order of the names of their cameras."""

    cameras: tuple[str, ...]
    videos: tuple[Video, ...]
    first_frames: tuple[int, ...]
    """The frame of each that is frame 0 of the take."""

    @property
    def columns(self) -> int:
        """How many cameras stand beside each other in the picture of all."""
        return 1 if len(self.cameras) < 3 else 2


def open_films(take: Take) -> Films:
    """Look through the films of a take's capture.

    Raises
    ------
    InputError
        If it is of no capture, that is not where it was, or a film cannot be read.
    """
    source = take.record.source
    if source["kind"] != "capture":
        raise InputError(f"take {take.name!r} is from a {source['kind'].upper()} file, not filmed")
    folder = Path(source["path"])
    if not folder.is_dir():
        raise InputError(
            f"The films are not here: the capture was at {folder} when it was taken in, and is "
            "there no more. Put it back to see them."
        )
    faults: list[str] = []
    found = files_of("video", folder, faults) or {}
    if faults or not found:
        raise InputError("; ".join(faults) or f"the capture {folder} has no films")
    return Films(
        tuple(found),
        tuple(open_video(paths[0]) for paths in found.values()),
        tuple(_first_frames(take).get(name, 0) for name in found),
    )


def _first_frames(take: Take) -> dict[str, int]:
    """Return the frame of each camera's film that is frame 0 of the take.

    As it was digitized, whatever capture.toml says now; of takes of before, there are none.
    """
    cameras = take.cameras
    if "first_frame" not in cameras:
        return {}
    return {
        unicodedata.normalize("NFC", str(name)): int(first)
        for name, first in zip(cameras.attrs["cameras"], cameras["first_frame"].values, strict=True)
    }


def film_pictures(films: Films, start: int, camera: str | None) -> list[bytes]:
    """Return pictures (JPEG) of `BLOCK` frames from `start`, fewer at the end.

    Parameters
    ----------
    camera
        Which one alone; None for all of them.

    Raises
    ------
    InputError
        If there is no such camera, the films have no such frames, or one cannot be decoded.
    """
    if camera is not None and camera not in films.cameras:
        raise InputError(f"there is no camera {camera!r}; there are {', '.join(films.cameras)}")
    chosen = [
        (video, first)
        for name, video, first in zip(films.cameras, films.videos, films.first_frames, strict=True)
        if camera in (None, name)
    ]
    end = min(start + BLOCK, *(video.frames - first for video, first in chosen), math.inf)
    if not 0 <= start < end:
        raise InputError(f"the films have no frame {start}")
    wide = _WIDE_PX if camera is None else _ALONE_PX

    def read(film: tuple[Video, int]) -> NDArray[np.uint8]:
        video, first = film
        return _small(video, first + start, first + int(end), wide)

    with ThreadPoolExecutor(THREADS) as pool:
        frames = list(pool.map(read, chosen))
    columns = films.columns if camera is None else 1
    return [
        encode_jpeg(_side_by_side([each[n] for each in frames], columns), _QUALITY)
        for n in range(int(end) - start)
    ]


def _small(video: Video, start: int, end: int, wide: int) -> NDArray[np.uint8]:
    """Return frames of a film (time, row, column, 3), at most `wide` px wide."""
    import cv2

    rows, columns = video.size
    across = min(wide, columns)
    size = (across, max(1, round(rows * across / (columns * video.pixel_aspect))))
    return np.stack(
        [
            cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
            for frame in read_frames(video, start, end)
        ]
    )


def _side_by_side(pictures: Sequence[NDArray[np.uint8]], columns: int) -> NDArray[np.uint8]:
    """Return pictures in rows of so many, on black where they are smaller than the largest."""
    high, wide = (max(each.shape[axis] for each in pictures) for axis in (0, 1))
    rows = -(-len(pictures) // columns)
    whole = np.zeros((rows * high, columns * wide, 3), np.uint8)
    for number, each in enumerate(pictures):
        top, left = (number // columns) * high, (number % columns) * wide
        whole[top : top + each.shape[0], left : left + each.shape[1]] = each
    return whole
