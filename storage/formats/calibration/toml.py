"""Calibrations as TOML: Pose2Sim's and Anipose's, and our own, which both of them can read.

A table a camera: `name`, `size` (width, height), `matrix`, `distortions`, `rotation` (a
Rodrigues vector), `translation`, `fisheye`. Ours says `unit` and `up` under [metadata] too.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from storage.errors import InputError
from storage.files import write_beside
from storage.formats.calibration.camera import Y_UP_FROM, Camera, vector_from_rotation
from storage.formats.calibration.parts import (
    Calibration,
    Parts,
    as_shown,
    build_cameras,
    refuse,
)
from storage.formats.reading import METERS, listed
from storage.formats.toml_text import parse_toml

_WANTED = "a table a camera with size, matrix, distortions, rotation and translation"

_CAMERA_KEYS = {"matrix", "distortions", "rotation", "translation"}
"""A table with one of them is a camera, whole or not; one with none of them is something else."""


def read_toml_calibration(path: Path, text: str) -> Calibration:
    """Read the cameras of a TOML file, in the order of its tables.

    Raises
    ------
    InputError
        It is not TOML, has no camera, or a camera's numbers cannot be used.
    """
    tables = parse_toml(path, text, _WANTED)
    metadata = tables.pop("metadata", {})
    found = {
        name: table
        for name, table in tables.items()
        if isinstance(table, dict) and not _CAMERA_KEYS.isdisjoint(table)
    }
    if not any("matrix" in table for table in found.values()):
        names = listed([*tables]) if tables else "nothing"
        raise InputError(f"{path} has no camera: found are {names}; wanted is {_WANTED}")
    faults, unit_m, up = _stated(metadata if isinstance(metadata, dict) else {})
    faults += [
        f"camera {name!r}: its lens is a fisheye, which cannot be used; calibrate it with "
        "OpenCV's ordinary model"
        for name, table in found.items()
        if table.get("fisheye")
    ]
    if faults:
        refuse(path, faults)
    others = [name for name, table in tables.items() if isinstance(table, dict | list)]
    others = [name for name in others if name not in found]
    notes = [f"The calibration has {listed(others)}, which is no camera: passed over."]
    cameras = build_cameras(path, map(_parts, found, found.values()))
    return Calibration(cameras, unit_m, up, notes=notes if others else [])


def write_calibration(
    path: Path, cameras: Sequence[Camera], *, error_px: float | None = None
) -> None:
    """Write cameras as our own TOML: beside its place, then renamed.

    Parameters
    ----------
    path : Path
        One that is there is replaced.
    cameras : sequence of Camera
        Metres, y up; no two with one name.
    error_px : float, optional
        The mean reprojection error, where they were adjusted to what was filmed.

    Raises
    ------
    ValueError
        There is no camera, or two have one name.
    OSError
        The file cannot be written; what was there before is still there.
    """
    names = [camera.name for camera in cameras]
    if not names or len(set(names)) < len(names):
        raise ValueError(
            f"the cameras are called {listed(names) or 'nothing'}; give each a name of its own"
        )
    text = "\n".join(_table(camera) for camera in cameras)
    adjusted = "false" if error_px is None else "true"
    text += f"\n[metadata]\nadjusted = {adjusted}\nerror = {float(error_px or 0.0)}\n"
    text += 'unit = "m"\nup = "y"\n'
    write_beside(Path(path), text.encode())


def _stated(metadata: dict[str, Any]) -> tuple[list[str], float | None, str | None]:
    """Return the faults, the unit and the axis that [metadata] names."""
    faults = []
    unit, up = metadata.get("unit"), metadata.get("up")
    if unit is not None and not (isinstance(unit, str) and unit in METERS):
        faults.append(f"the unit {as_shown(unit)} is not known; write m, cm or mm")
    if up is not None and not (isinstance(up, str) and up in Y_UP_FROM):
        faults.append(f"up = {as_shown(up)} is no axis; write one of {', '.join(Y_UP_FROM)}")
    return faults, None if faults or unit is None else METERS[unit], up


def _parts(key: str, table: dict[str, Any]) -> Parts:
    name = table.get("name", key)
    return Parts(
        str(name),
        table.get("size"),
        table.get("matrix"),
        table.get("distortions", ()),
        table.get("rotation"),
        table.get("translation"),
    )


def _table(camera: Camera) -> str:
    """Return a camera's table; repr gives back every bit of a number."""
    name = json.dumps(camera.name, ensure_ascii=False)
    distortion = camera.distortion.tolist() or [0.0] * 4
    size = "" if camera.size is None else f"size = {[float(side) for side in camera.size]}\n"
    return (
        f"[{name}]\nname = {name}\n{size}matrix = {camera.intrinsics.tolist()}\n"
        f"distortions = {distortion}\n"
        f"rotation = {vector_from_rotation(camera.rotation).tolist()}\n"
        f"translation = {camera.translation.tolist()}\nfisheye = false\n"
    )
