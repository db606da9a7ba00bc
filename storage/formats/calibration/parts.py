"""What every reader of calibrations does in the same way: numbers to cameras, faults to words."""

import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.calibration.camera import Camera, nearest_rotation, rotation_from_vector
from storage.formats.encodings import normalized
from storage.formats.reading import listed

_MOST_FAULTS = 8
"""How many faults a message lists. Chosen: they fit a screen."""
_LONGEST_FAULT = 3000
"""How many letters of a fault are shown. One that lists all names of a file needs so many."""
MOST_CAMERAS = 1000
"""How many cameras a calibration may have. The largest studio that we know has 521."""
_MOST_NUMBERS = 64
"""How many numbers of a distortion are read. Far more than any lens model has."""
_ROUNDED = 0.01  # a rotation written with two digits is still taken for one


@dataclass
class Parts:
    """The numbers of one camera as its file has them, not yet looked at; None where missing."""

    name: str
    size: Any = None
    intrinsics: Any = None
    distortion: Any = ()
    rotation: Any = None
    """A matrix, or a Rodrigues vector."""
    translation: Any = None
    fault: str = ""
    """Why there are no numbers, where the reader knows."""


@dataclass(frozen=True)
class Calibration:
    """The cameras of one calibration, in its own unit and axes."""

    cameras: list[Camera]
    unit_m: float | None = None
    """Metres in one unit, None where the format does not say."""
    up: str | None = None
    """The axis that points up, None where the format does not say."""
    habit: str | None = None
    """The axis that points up unless somebody says otherwise."""
    notes: list[str] = field(default_factory=list)


def build_cameras(path: Path, parts: Iterable[Parts]) -> list[Camera]:
    """Return the cameras, or say all that is wrong with all of them.

    Raises
    ------
    InputError
        With the file and the names of the cameras.
    """
    cameras: list[Camera] = []
    faults: list[str] = []
    parts = list(parts)
    if len(parts) > MOST_CAMERAS:
        refuse(path, [f"it has {len(parts):,} cameras, at most {MOST_CAMERAS:,} are read"])
    for part in parts:
        name = normalized(part.name)
        try:
            cameras.append(_build(replace(part, name=name)))
        except ValueError as error:
            faults.append(f"camera {name!r}: {error}")
    again = sorted(name for name, n in Counter(c.name for c in cameras).items() if n > 1)
    if again:
        faults.append(f"{listed(again)} is the name of more than one camera; rename one")
    if not cameras and not faults:
        faults.append("there is no camera in it")
    if faults:
        refuse(path, faults)
    return cameras


def refuse(path: Path, faults: Sequence[str]) -> None:
    """Raise the faults of a calibration as one sentence."""
    raise InputError(f"{path} cannot be used as a calibration: {'; '.join(some(faults))}")


def some(faults: Sequence[str]) -> list[str]:
    """Return the first of many faults, each of bearable length, and how many there are more."""
    shown = [
        fault if len(fault) <= _LONGEST_FAULT else f"{fault[:_LONGEST_FAULT]}..."
        for fault in faults[:_MOST_FAULTS]
    ]
    more = len(faults) - len(shown)
    return shown + ([f"and {more} more faults"] if more else [])


def array_of(value: Any, count: int | None = None) -> NDArray[np.float64] | None:
    """Return a value as a flat array, or None where it is not that many numbers."""
    try:
        array = np.asarray(value, np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        return None
    return array if count is None or array.size == count else None


def numbers_in(text: str | None) -> list[float]:
    """Return the numbers between spaces, commas, semicolons and brackets; NaN for other words."""
    for mark in ",;[]()":
        text = (text or "").replace(mark, " ")
    return [number(word) for word in (text or "").split()]


def number(word: str | None) -> float:
    """Return a word as a number, NaN where it is none."""
    try:
        return float(word or "")
    except ValueError:
        return math.nan


def parse_xml(path: Path, text: str, wanted: str) -> ElementTree.Element:
    """Return the root of an XML text."""
    try:
        return ElementTree.fromstring(text.strip())
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path} is not XML ({error}); bring {wanted}") from error


def as_shown(value: Any) -> str:
    """Return a value in few enough letters for a message."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    shown = repr(value)
    return shown if len(shown) <= 60 else f"{shown[:60]}..."


def _build(part: Parts) -> Camera:
    """Return a camera of the numbers of a file; a ValueError has all their faults."""
    if part.fault:
        raise ValueError(part.fault)
    faults: list[str] = []
    size = _size(part.size, faults)
    intrinsics = _intrinsics(part.intrinsics, faults)
    rotation = _rotation(part.rotation, faults)
    translation = _values("translation", part.translation, 3, faults)
    distortion = array_of(() if part.distortion is None else part.distortion)
    if distortion is None:
        faults.append(f"the distortion {as_shown(part.distortion)} is no row of numbers")
    elif distortion.size > _MOST_NUMBERS:
        faults.append(
            f"the distortion has {distortion.size} numbers, at most {_MOST_NUMBERS} are read"
        )
    if faults or distortion is None:
        raise ValueError("; ".join(faults))
    return Camera(part.name, size, intrinsics, distortion, rotation, translation)


def _size(value: Any, faults: list[str]) -> tuple[int, int] | None:
    if value is None:
        return None
    size = array_of(value, 2)
    if size is None or not np.isfinite(size).all() or (size != np.rint(size)).any():
        faults.append(f"the image size {as_shown(value)} is no width and height in whole pixels")
        return None
    return int(size[0]), int(size[1])


def _values(what: str, value: Any, count: int, faults: list[str]) -> NDArray[np.float64]:
    """Return so many finite numbers, or zeros and a fault."""
    if value is None:
        faults.append(f"it has no {what}")
        return np.zeros(count)
    values = array_of(value, count)
    if values is None or not np.isfinite(values).all():
        faults.append(f"its {what} {as_shown(value)} is not {count} finite numbers")
        return np.zeros(count)
    return values


def _intrinsics(value: Any, faults: list[str]) -> NDArray[np.float64]:
    """Return an intrinsic matrix whose last element is 1."""
    before = len(faults)
    matrix = _values("intrinsic matrix", value, 9, faults).reshape(3, 3)
    if len(faults) == before and matrix[2, 2] == 0:
        faults.append("the last element of its intrinsic matrix is 0, where 1 is wanted")
    with np.errstate(over="ignore"):
        return matrix if len(faults) > before else matrix / matrix[2, 2]


def _rotation(value: Any, faults: list[str]) -> NDArray[np.float64]:
    """Return a rotation of a matrix with rounded digits, or of a Rodrigues vector."""
    values = array_of(value)
    if value is not None and values is not None and values.size == 3:
        vector = _values("rotation", value, 3, faults)
        if max(abs(vector)) > 4 * math.pi:
            faults.append(
                f"its rotation {as_shown(value)} turns by more than two full turns; a "
                "Rodrigues vector in radians is wanted"
            )
            return np.eye(3)
        return rotation_from_vector(vector)
    before = len(faults)
    matrix = _values("rotation", value, 9, faults).reshape(3, 3)
    if len(faults) > before:
        return np.eye(3)
    if not abs(matrix).max() < 10 or abs(matrix @ matrix.T - np.eye(3)).max() > _ROUNDED:
        faults.append("its rotation matrix is no rotation: the rows are not at right angles")
        return np.eye(3)
    if np.linalg.det(matrix) < 0:
        faults.append("its rotation mirrors: the axes are left-handed")
        return np.eye(3)
    return nearest_rotation(matrix)
