"""The films and pictures of a board that cameras are calibrated from, a camera by its name.

    FOLDER/<camera>.mp4, or FOLDER/<camera>/<picture>.png       moments of a board that is moved
    FOLDER/floor/<camera>.png or .mp4, or a picture `floor`     the board lying on the floor
    FOLDER/feet/<camera>.mp4, or FOLDER/feet/<camera>/...       somebody who walks about
    FOLDER/capture.toml                                         optional: offsets of films

Films that were started together show one moment at one time; pictures show one where they have
one name, the camera's own name in it left out.
"""

import re
import unicodedata
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.capture.offsets import read_offsets
from storage.formats.pictures.video import (
    PICTURE_SUFFIXES,
    VIDEO_SUFFIXES,
    Video,
    open_video,
    read_blocks,
)
from storage.formats.reading import listed
from storage.formats.toml_text import read_toml

FLOOR = "floor"
"""The name of the moment in which the board lies on the floor."""
FEET = "feet"
"""The folder of the films, or pictures, of somebody who walks about."""
COVERAGE = "coverage"
"""The folder that pictures of what was covered are written into."""
_WANTED = (
    "a film a camera (<camera>.mp4, .avi, .mkv, .mov, ...) or a folder of pictures a camera "
    "(<camera>/<picture>.png or .jpg)"
)
_BLOCK = 16
"""Frames of a film that are decoded at a time [frames]. Few, so that films of any size fit."""


@dataclass(frozen=True)
class BoardFootage:
    """What one camera filmed of a board."""

    name: str
    video: Video | None = None
    pictures: dict[str, Path] = field(default_factory=dict)
    """By moment: the name of the picture without its suffix and without the camera's name."""
    floor: Path | Video | None = None
    """The picture or film of the board on the floor, where it stands apart."""
    offset_s: float = 0.0
    """How much later than the others the film began."""


def find_board_footage(folder: Path) -> tuple[list[BoardFootage], list[str]]:
    """Return what each camera filmed, in the order of their names, and notes.

    Raises
    ------
    InputError
        All that is wrong with the folder and its films, a line each.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; name one with {_WANTED}")
    faults: list[str] = []
    notes: list[str] = []
    found: dict[str, list[BoardFootage]] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name in (FLOOR, FEET, COVERAGE):
            continue
        footage = _footage_of(path, faults, notes)
        if footage is not None:
            found.setdefault(footage.name, []).append(footage)
    faults += [
        f"camera {name!r} has several films or folders; keep one of them"
        for name, several in found.items()
        if len(several) > 1
    ]
    if not found and not faults:
        faults.append(f"{folder} holds no film and no pictures; put there {_WANTED}")
    offsets = _offsets(folder / "capture.toml", found, faults)
    floors = _floors(folder / FLOOR, found, faults)
    if faults:
        raise InputError("\n".join(faults))
    return [
        replace(each, floor=floors.get(each.name), offset_s=offsets.get(each.name, 0.0))
        for [each] in found.values()
    ], notes


def read_frames_at(video: Video, frames: Sequence[int]) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield some frames of a film, in ascending order, read through once: number and RGB picture.

    Raises
    ------
    InputError
        A frame cannot be decoded.
    """
    wanted = set(frames)
    for start, (block,) in read_blocks([video], block=_BLOCK, end=max(wanted, default=-1) + 1):
        for number, frame in enumerate(block, start):
            if number in wanted:
                yield number, frame


def _footage_of(path: Path, faults: list[str], notes: list[str]) -> BoardFootage | None:
    """Return what a camera filmed, None where a path is of no camera or cannot be read."""
    # a Mac, or a share from one, writes a letter and its mark as two codes
    name = unicodedata.normalize("NFC", path.name if path.is_dir() else path.stem)
    if path.is_dir():
        pictures = _pictures(path, name, faults)
        if pictures:
            return BoardFootage(name, pictures=pictures)
        notes.append(f"The folder {path.name!r} holds no pictures: passed over.")
        return None
    if path.suffix.lower() not in VIDEO_SUFFIXES:
        return None
    video = _opened(path, faults)
    if video is None:
        return None
    notes += [f"Camera {name!r}: {note}" for note in video.notes]
    return BoardFootage(name, video)


def _pictures(folder: Path, camera: str, faults: list[str]) -> dict[str, Path]:
    """Return the pictures of a folder by what they are called, the camera's own name left out."""
    pictures: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in PICTURE_SUFFIXES or path.name.startswith("."):
            continue
        stem = unicodedata.normalize("NFC", path.stem)
        own = re.escape(camera)
        moment = re.sub(rf"^{own}[_\-. ]+(?=.)|(?<=.)[_\-. ]+{own}$", "", stem)
        if moment in pictures:
            faults.append(
                f"{pictures[moment]} and {path} would be one moment ({moment!r}); rename one"
            )
        pictures[moment] = path
    return pictures


def _floors(
    folder: Path, found: dict[str, list[BoardFootage]], faults: list[str]
) -> dict[str, Path | Video]:
    """Return the picture or film of the board on the floor of each camera that has one."""
    floors: dict[str, Path | Video] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        name, suffix = unicodedata.normalize("NFC", path.stem), path.suffix.lower()
        if path.name.startswith(".") or suffix not in (*PICTURE_SUFFIXES, *VIDEO_SUFFIXES):
            continue
        if name not in found:
            faults.append(f"{path} is of no camera: {listed([*found])} are; rename it")
            continue
        opened = path if suffix in PICTURE_SUFFIXES else _opened(path, faults)
        if opened is not None:
            floors[name] = opened
    return floors


def _opened(path: Path, faults: list[str]) -> Video | None:
    try:
        return open_video(path)
    except InputError as error:
        faults.append(str(error))
        return None


def _offsets(path: Path, known: Collection[str], faults: list[str]) -> dict[str, float]:
    """Return how late each film began, in seconds, as capture.toml says."""
    if not path.exists():
        return {}
    table: Any = read_toml(path, "a capture.toml").get("video", {})
    found = read_offsets(table, known, str(path), faults) if isinstance(table, dict) else None
    return found or {}
