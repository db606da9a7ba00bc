"""Read where cameras are to hang: a calibration, or a few lines written by hand.

[volume]                       # optional
center_m = [0.0, 1.0, 0.0]
size_m = [2.0, 2.0, 2.0]

[[camera]]
position_m = [4.2, 1.5, 0.0]   # y up
look_at_m = [0.0, 1.0, 0.0]
field_of_view_deg = 50.0       # of the image's width
size_px = [1280, 720]          # columns, rows
"""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from storage.errors import InputError
from storage.files import check_regular
from storage.formats.calibration.camera import Camera
from storage.formats.calibration.parts import MOST_CAMERAS
from storage.formats.calibration.reading import read_calibration
from storage.formats.capture.capture_toml import Volume
from storage.formats.toml_text import read_toml

USUAL_VOLUME = Volume((0.0, 1.0, 0.0), (2.0, 2.0, 2.0), 0.01)

_WANTED = {
    "position_m": 3,
    "look_at_m": 3,
    "field_of_view_deg": 1,
    "size_px": 2,
}


def read_camera_plan(path: Path) -> tuple[list[Camera], Volume, list[str]]:
    """Return cameras, the volume that they are to see, and what had to be assumed.

    Parameters
    ----------
    path
        A TOML file with tables `camera`, or any calibration that a capture may have.

    Raises
    ------
    InputError
        If it is neither; every fault of the tables at once.
    """
    tables = _tables(path)
    faults: list[str] = []
    volume = _volume(tables.get("volume"), faults)
    if isinstance(tables.get("camera"), list):
        if len(tables["camera"]) > MOST_CAMERAS:
            raise InputError(
                f"{path} has {len(tables['camera']):,} cameras, at most {MOST_CAMERAS:,} are read"
            )
        cameras = [_camera(table, n, faults) for n, table in enumerate(tables["camera"], start=1)]
        if faults:
            raise InputError("\n".join([f"{path} is no plan:", *(f"- {each}" for each in faults)]))
        return [camera for camera in cameras if camera], volume, []
    if faults:
        raise InputError(f"{path} is no plan: {'; '.join(faults)}")
    cameras, notes = read_calibration(
        path, center_m=volume.center_m, count_seeing=partial(_count_seeing, volume=volume)
    )
    unsized = [camera.name for camera in cameras if camera.size is None]
    if unsized:
        raise InputError(f"{path} gives no image size for {', '.join(unsized)}; add it to plan")
    return cameras, volume, notes


def _tables(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file; none for another file."""
    if path.suffix.lower() != ".toml":
        return {}
    try:
        check_regular(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    return read_toml(path, "tables `camera`, or a calibration")


def _volume(table: Any, faults: list[str]) -> Volume:
    """Return the volume of a plan."""
    if table is None:
        return USUAL_VOLUME
    center, size = (_numbers(table, key, 3) for key in ("center_m", "size_m"))
    if center is None or size is None or min(size) <= 0:
        faults.append("[volume] needs center_m and size_m, three numbers of metres each")
        return USUAL_VOLUME
    return Volume((center[0], center[1], center[2]), (size[0], size[1], size[2]), 0.01)


def _camera(table: Any, number: int, faults: list[str]) -> Camera | None:
    """Return a camera that is described by hand."""
    name = str(table.get("name", f"cam{number}")) if isinstance(table, dict) else f"cam{number}"
    found = {key: _numbers(table, key, count) for key, count in _WANTED.items()}
    missing = [key for key, value in found.items() if value is None]
    if missing:
        wanted = ", ".join(f"{key} ({_WANTED[key]} numbers)" for key in missing)
        faults.append(f"camera {name!r} needs {wanted}")
        return None
    position, target = np.array(found["position_m"]), np.array(found["look_at_m"])
    angle, size = found["field_of_view_deg"], found["size_px"]
    assert angle is not None
    assert size is not None
    ahead = target - position
    if not np.linalg.norm(ahead) > 0 or not 1 <= angle[0] <= 170 or min(size) < 16:
        faults.append(
            f"camera {name!r} should look at another point than its own, with 1 to 170 degrees "
            "and 16 pixels or more"
        )
        return None
    ahead = ahead / np.linalg.norm(ahead)
    upright = np.array([0.0, 1.0, 0.0]) if abs(ahead[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
    right = np.cross(ahead, upright)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    columns, rows = (round(value) for value in size)
    focal = columns / 2 / math.tan(math.radians(angle[0]) / 2)
    inner = np.array(
        [[focal, 0.0, (columns - 1) / 2], [0.0, focal, (rows - 1) / 2], [0.0, 0.0, 1.0]]
    )
    try:
        return Camera(name, (columns, rows), inner, np.zeros(0), rotation, -rotation @ position)
    except ValueError as error:
        faults.append(f"camera {name[:40]!r}: {error}")
        return None


def _count_seeing(cameras: Sequence[Camera], volume: Volume) -> int:
    """Return how many cameras see the volume, 0 where that cannot be said without their sizes."""
    from storage.formats.capture.camera_views import count_seeing  # OpenCV: not for a plan by hand

    return 0 if any(camera.size is None for camera in cameras) else count_seeing(cameras, volume)


def _numbers(table: Any, key: str, count: int) -> list[float] | None:
    """Return `count` finite numbers of a table, or None."""
    value = table.get(key) if isinstance(table, dict) else None
    values = [
        float(v)
        for v in (value if isinstance(value, list) else [value])
        if isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v)
    ]
    return values if len(values) == count else None
