"""Read capture.toml: what was recorded, the volume that is observed, how it was filmed."""

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from storage.archive import take_name
from storage.errors import InputError
from storage.formats.calibration.camera import Y_UP_FROM
from storage.formats.calibration.parts import as_shown
from storage.formats.reading import METERS, listed
from storage.formats.toml_text import plain_metadata, read_toml

MARK = "capture.toml"

_WANTED = "a capture.toml with the tables [take], [volume] and [video]"
_KEYS = {"volume": ("center_m", "size_m", "voxel_m"), "video": ("fps", "up", "unit", "offset_s")}
_MOST_VOXELS = 2**34


@dataclass(frozen=True)
class Volume:
    """The box that is observed, y up."""

    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    voxel_m: float

    @property
    def diagonal_m(self) -> float:
        """From corner to corner."""
        return float(np.linalg.norm(self.size_m))


@dataclass(frozen=True)
class CaptureSettings:
    """What capture.toml says; None where it says nothing, or nothing that can be used."""

    take: str
    metadata: dict[str, Any]
    stature_m: float | None
    volume: Volume | None
    fps: float | None
    up: str | None
    """The axis that points up in the calibration."""
    unit_m: float | None
    """Metres in one unit of the calibration."""
    video: dict[str, Any] = field(default_factory=dict)
    """The table [video] as it stands; `offset_s` is checked where the cameras are known."""


def read_capture_toml(folder: Path, faults: list[str], notes: list[str]) -> CaptureSettings:
    """Return what the capture.toml of a folder says; add what is wrong to faults and notes.

    Raises
    ------
    InputError
        There is none, or it is not TOML.
    """
    tables = _tables(folder)
    take, metadata, stature_m = _take(folder, tables, faults)
    volume = _volume(tables.get("volume", {}), faults)
    fps, up, unit_m = _video(tables.get("video", {}), faults)
    notes += _unknown_keys(tables)
    return CaptureSettings(
        take, metadata, stature_m, volume, fps, up, unit_m, tables.get("video", {})
    )


def _tables(folder: Path) -> dict[str, Any]:
    """Return capture.toml, which nothing can be said without."""
    path = folder / MARK
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; bring one with {_WANTED}")
    if not os.path.lexists(path):
        raise InputError(f"{folder} has no {MARK}, so it is no capture; put there {_WANTED}")
    tables = read_toml(path, _WANTED)
    wrong = [name for name in ("take", *_KEYS) if not isinstance(tables.get(name, {}), dict)]
    if wrong:
        raise InputError(f"{path} has {listed(wrong)} as a value, not as a table; bring {_WANTED}")
    return tables


def _unknown_keys(tables: dict[str, Any]) -> list[str]:
    """Return a note on what capture.toml says and nobody reads."""
    unknown = [name for name in tables if name not in ("take", *_KEYS)]
    for table, keys in _KEYS.items():
        unknown += [f"{table}.{key}" for key in tables.get(table, {}) if key not in keys]
    return [f"{MARK} has {listed(unknown)}, which means nothing here."] if unknown else []


def _take(
    folder: Path, tables: dict[str, Any], faults: list[str]
) -> tuple[str, dict[str, Any], float | None]:
    """Return the take's name, its metadata and the stature."""
    try:
        table = plain_metadata(tables.get("take", {}), f"[take] of {MARK}")
    except InputError as error:
        faults.append(str(error))
        table = {}
    stature_m = table.pop("stature_m", None)
    name = str(table.pop("id", "")) or folder.resolve().name
    if stature_m is not None and not _between(stature_m, 0.3, 3.0):
        faults.append(
            f"stature_m = {as_shown(stature_m)} under [take] is no number of metres between 0.3 "
            "and 3"
        )
        stature_m = None
    try:
        name = take_name(name)
    except InputError as error:
        faults.append(f"{error}; give it a name by id under [take]")
    return name, table, stature_m


def _volume(table: dict[str, Any], faults: list[str]) -> Volume | None:
    """Return the volume that capture.toml gives."""
    before = len(faults)
    center, size, voxel = (table.get(key) for key in _KEYS["volume"])
    if not _numbers(center, -1000.0, 1000.0):
        faults.append(
            f"center_m = {as_shown(center)} under [volume] should be three metres, such as "
            "[0.0, 1.0, 0.0]"
        )
    if not _numbers(size, 0.01, 100.0):
        faults.append(
            f"size_m = {as_shown(size)} under [volume] should be three metres from 0.01 to 100, "
            "such as [2.0, 2.0, 2.0]"
        )
    if not _between(voxel, 0.0005, 1.0):
        faults.append(
            f"voxel_m = {as_shown(voxel)} under [volume] should be metres from 0.0005 to 1, such "
            "as 0.01"
        )
    if len(faults) > before or center is None or size is None or voxel is None:
        return None
    if not voxel <= min(size) or math.prod(side / voxel for side in size) > _MOST_VOXELS:
        faults.append(
            f"a volume of {size} m has no or far too many voxels of {voxel} m; change voxel_m"
        )
    x, y, z = map(float, center)
    width, height, depth = map(float, size)
    return Volume((x, y, z), (width, height, depth), float(voxel))


def _video(
    table: dict[str, Any], faults: list[str]
) -> tuple[float | None, str | None, float | None]:
    """Return the frame rate, the axis up and the unit that capture.toml gives."""
    fps, up, unit = (table.get(key) for key in ("fps", "up", "unit"))
    if fps is not None and not _between(fps, 0.1, 10_000.0):
        faults.append(
            f"fps = {as_shown(fps)} under [video] should be frames a second, such as 30.0"
        )
        fps = None
    if up is not None and not (isinstance(up, str) and up in Y_UP_FROM):
        faults.append(f"up = {as_shown(up)} under [video] is no axis; {', '.join(Y_UP_FROM)} are")
        up = None
    unit_m = METERS.get(unit) if isinstance(unit, str) else unit
    if unit is not None and not _between(unit_m, 1e-6, 1000.0):
        faults.append(
            f"unit = {as_shown(unit)} under [video] is not known; write m, cm, mm, or metres in a "
            "unit"
        )
        unit_m = None
    return fps, up, unit_m


def _between(value: Any, low: float, high: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high


def _numbers(value: Any, low: float, high: float) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(_between(number, low, high) for number in value)
    )
