"""What a capture's files of a camera say of themselves: how large, how long, how fast; in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import NotRegularError, check_regular
from storage.formats.pictures.decoding import decode_picture
from storage.formats.pictures.video import (
    PICTURE_SUFFIXES,
    open_masks,
    open_video,
    read_frames,
)
from storage.formats.reading import listed


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
    pixel_aspect: float = 1.0
    """How many times as wide as high a pixel is shown."""
    timecode: str = ""
    """Of the first frame, by the clock of the camera, where the file says it."""
    created: str = ""
    """When it was made, where the file says it."""

    @property
    def shown(self) -> tuple[int, int]:
        """Width and height as players show them; other than `size` where pixels are not square."""
        return round(self.size[0] * self.pixel_aspect), self.size[1]


def look_at_footage(path: Path, *, masks: bool = False) -> Footage:
    """Return what a video, a folder of pictures or a picture says of itself.

    Masks are looked at as such: as in `storage.formats.pictures.masks`.

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
    video = open_masks(path) if masks else open_video(path)
    rows, columns = video.size
    return Footage(
        path,
        (columns, rows),
        video.frames,
        video.rate_hz,
        video.notes,
        video.pixel_aspect,
        video.timecode,
        video.created,
    )


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


def footage_notes(found: dict[str, dict[str, Footage]]) -> list[str]:
    """Return what is said of films, each once however many it is said of."""
    said: dict[str, dict[str, list[str]]] = {}
    for what, of_cameras in found.items():
        for name, footage in of_cameras.items():
            for note in footage.notes:
                said.setdefault(note, {}).setdefault(what, []).append(name)
    return [
        f"The {' and the '.join(_subject(what, names) for what, names in whose.items())}: {note}"
        for note, whose in said.items()
    ]


def _subject(what: str, names: Sequence[str]) -> str:
    return f"{what}{'s' if len(names) > 1 else ''} of {listed(names)}"


def why_unequal(video: Footage, wanted: tuple[int, int]) -> str:
    """Return what probably happened to an image of another size."""
    (width, height), (columns, rows) = video.size, wanted
    if (width, height) == (rows, columns):
        how = "".join(f" ({note})" for note in video.notes)
        return f"the video is turned (portrait){how}; turn it back, or calibrate the turned image"
    if _alike(video.size, wanted):
        return (
            f"the video is scaled by {width / columns:.3g}; scale the calibration with it, or "
            "bring the video as it was filmed"
        )
    if video.shown != video.size:
        sure = _alike(video.shown, wanted)
        return (
            f"the pixels of the video are not square, so that players show {by_px(video.shown)}"
            f"{'' if sure else ', or one of them was cut'}; calibrate with pictures as they are "
            "stored, or convert the video to square pixels"
        )
    return "of another shape, so one of them was cut; bring both for the same image"


def why_other_background(video: Footage, background: Footage) -> str:
    """Return what to do about a background of another size."""
    if video.shown != video.size and background.size == video.shown:
        return "the pixels of the video are not square; bring the background as a film of its own"
    return "film the background with the same settings"


def mask_faults(name: str, video: Footage | None, masks: Footage | None) -> list[str]:
    """Return where the masks of a camera are not of the frames of its film."""
    if video is None or masks is None:
        return []
    faults = []
    if masks.size != video.size:
        faults.append(
            f"camera {name!r}: its masks are {by_px(masks.size)}, its video {by_px(video.size)}; "
            "make them of the frames as they were filmed"
        )
    if masks.frames != video.frames:
        said = "".join(f" ({note})" for note in masks.notes)
        faults.append(
            f"camera {name!r} has {masks.frames} masks{said} for the {video.frames} frames of its "
            "video; bring one for each frame, an empty one where nobody is seen"
        )
    return faults


def by_px(size: tuple[int, int]) -> str:
    """Return a size in words."""
    return f"{size[0]}x{size[1]}"


def _alike(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Return whether both are of one shape, to a pixel."""
    return abs(size[0] / other[0] - size[1] / other[1]) * max(other) <= 1.0
