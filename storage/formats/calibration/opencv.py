"""Calibrations that OpenCV's FileStorage wrote: EasyMocap's `intri.yml` and `extri.yml`, others.

Authors name their matrices as they like. The usual names are understood: in one file a camera,
in a table a camera, or with the camera's name behind each (`K_01`, as EasyMocap does).
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from storage.formats.calibration.camera import rotation_from_vector
from storage.formats.calibration.opencv_storage import parse_storage
from storage.formats.calibration.parts import Calibration, Parts, array_of, build_cameras, refuse
from storage.formats.reading import listed

_USUAL: dict[str, tuple[str, ...]] = {
    "intrinsics": (
        *("k", "cameramatrix", "intrinsic", "intrinsics", "intrinsicmatrix"),
        *("intrinsicsmatrix", "mtx", "camk", "intr"),
    ),
    "distortion": (
        *("dist", "d", "distortioncoefficients", "distcoeffs", "distcoeff", "distcoef"),
        *("distortion", "distortions", "distortioncoeffs", "distcoefficients"),
    ),
    "matrix": ("rot", "rotationmatrix", "rmat"),
    "rotation": ("r", "rotation", "rvec", "rvecs", "rodrigues", "rotationvector", "rotationvalues"),
    "translation": (
        *("t", "translation", "tvec", "tvecs", "translationvector", "trans"),
        "translationvalues",
    ),
    "pose": ("rt", "extrinsic", "extrinsics", "extrinsicmatrix", "pose", "w2c", "worldtocamera"),
    "size": ("imagesize", "size", "resolution", "imgsize"),
    "width": ("imagewidth", "width", "w"),
    "height": ("imageheight", "height", "h"),
}
"""The usual names of each field, without underscores and capitals."""

_FIELDS = {name: field for field, names in _USUAL.items() for name in names}
_WANTED = (
    "camera_matrix (or K), distortion_coefficients (or D), R (or rvec) and T (or tvec), in a file "
    "or a table a camera, or with the camera's name behind each, as in K_cam1"
)

_LONGEST_NAME = 200
"""How many letters a name has that is looked into. Chosen: more than any file's name may have."""
_MOST_NAMES = 64
"""How many names of a file are listed. Chosen: more than a file of one camera has."""

Fields = dict[str, Any]


def read_opencv_calibration(path: Path, texts: dict[str, str]) -> Calibration:
    """Read the cameras of files that OpenCV wrote.

    Parameters
    ----------
    path : Path
        What to name in an error.
    texts : dict of str
        By the name of the camera, should the file hold only one.

    Raises
    ------
    InputError
        A file cannot be read, no usual name fits (those found are listed), or a camera's numbers
        cannot be used.
    """
    cameras: dict[str, Fields] = {}
    faults: list[str] = []
    for stem, text in texts.items():
        entries = parse_storage(path, text)
        found = cameras_in(entries, stem)
        if not found:
            faults.append(
                f"in {stem} there is no intrinsic matrix under a usual name: found are "
                f"{_all_names(entries)}; wanted are {_WANTED}"
            )
        faults += _pose_faults(stem, found, entries)
        for name in found.keys() & cameras.keys():
            faults.append(f"camera {name!r} comes in more than one file")
        cameras |= found
    if faults:
        refuse(path, faults)
    return Calibration(_build(path, cameras))


def read_easymocap(path: Path, intri: str, extri: str) -> Calibration:
    """Read EasyMocap's pair of files; `R_<n>` is a vector and `Rot_<n>` a matrix, mostly.

    Raises
    ------
    InputError
        As `read_opencv_calibration`, or the two files name different cameras.
    """
    inner, outer = parse_storage(path, intri), parse_storage(path, extri)
    names = _names(inner) or _names(outer)
    lenses, poses = _by_suffix(inner, names), _by_suffix(outer, names)
    if not names:
        lenses = {name: fields for name, fields in lenses.items() if "intrinsics" in fields}
    faults = [
        f"{listed(sorted(some.keys() - others.keys()))} is in {here} but not in {there}"
        for some, others, here, there in (
            (lenses, poses, "intri.yml", "extri.yml"),
            (poses, lenses, "extri.yml", "intri.yml"),
        )
        if some.keys() - others.keys()
    ]
    if not lenses:
        faults.append(f"intri.yml has no K_<camera>: found are {_all_names(inner)}")
    if faults:
        refuse(path, faults)
    order = [name for name in names if name in lenses] or list(lenses)
    return Calibration(_build(path, {name: poses[name] | lenses[name] for name in order}))


def cameras_in(entries: dict[str, Any], stem: str) -> dict[str, Fields]:
    """Return the fields of each camera that has an intrinsic matrix."""
    whole = _fields(entries.items())
    if "intrinsics" in whole:
        return {stem: whole}
    tables = {
        name: whole | _fields(table.items())
        for name, table in entries.items()
        if isinstance(table, dict)
    }
    behind = {name: whole | fields for name, fields in _by_suffix(entries, _names(entries)).items()}
    return {name: fields for name, fields in (tables | behind).items() if "intrinsics" in fields}


def _pose_faults(stem: str, cameras: dict[str, Fields], entries: dict[str, Any]) -> list[str]:
    """Return which cameras of a file have no rotation or translation, and the names there are."""
    faults: list[str] = []
    names = _all_names(entries)
    for name, fields in cameras.items():
        if "pose" in fields:
            continue
        lacking = [] if {"rotation", "matrix"} & fields.keys() else ["rotation"]
        lacking += [] if "translation" in fields else ["translation"]
        if lacking:
            faults.append(
                f"in {stem} camera {name!r} has no {' and no '.join(lacking)} under a usual name: "
                f"found are {names}; wanted are {_WANTED}"
            )
    return faults


def _all_names(entries: dict[str, Any]) -> str:
    """Return every name of a file, those of a table behind its own."""
    names: list[str] = []
    for name, value in entries.items():
        inside = [f"{name}/{each}" for each in value] if isinstance(value, dict) else []
        names += inside or [name]
    return listed([name[:40] for name in names], _MOST_NAMES) or "no names"


def _names(entries: dict[str, Any]) -> list[str]:
    """Return the cameras that the file lists, as it spells them."""
    names = entries.get("names", [])
    return [str(name) for name in (names if isinstance(names, list) else [names])]


def _fields(entries: Iterable[tuple[str, Any]]) -> Fields:
    """Return the values by field; where one comes under two names, the more usual counts."""
    fields: Fields = {}
    ranks: dict[str, int] = {}
    for key, value in entries:
        plain = key.replace("_", "").replace("-", "").replace(" ", "").lower()
        field = _FIELDS.get(plain)
        if field is None or isinstance(value, dict):
            continue
        rank = _USUAL[field].index(plain)
        if rank < ranks.get(field, 99):
            fields[field], ranks[field] = value, rank
    return fields


def _by_suffix(entries: dict[str, Any], names: list[str]) -> dict[str, Fields]:
    """Return the fields of each camera whose name stands behind its keys."""
    groups: dict[str, dict[str, Any]] = {}
    for key, value in entries.items():
        if len(key) > _LONGEST_NAME:
            continue
        ends = [at for at, letter in enumerate(key) if letter == "_" and 0 < at < len(key) - 1]
        for at in reversed(ends):
            head, name = key[:at], key[at + 1 :]
            known = head.replace("_", "").lower() in _FIELDS
            if known and (not names or name in names):
                groups.setdefault(name, {})[head] = value
                break
    return {name: _fields(group.items()) for name, group in groups.items()}


def _build(path: Path, cameras: dict[str, Fields]) -> list[Any]:
    faults: list[str] = []
    parts = [_parts(name, fields, faults) for name, fields in cameras.items()]
    if faults:
        refuse(path, faults)
    return build_cameras(path, parts)


def _parts(name: str, fields: Fields, faults: list[str]) -> Parts:
    """Return the numbers of a camera from its fields."""
    size = fields.get("size")
    if size is None and "width" in fields and "height" in fields:
        size = (fields["width"], fields["height"])
    rotation, translation = _rotation(name, fields, faults), fields.get("translation")
    pose = array_of(fields.get("pose", ()))
    if rotation is None and pose is not None and pose.size in (12, 16):
        rows = pose.reshape(-1, 4)
        rotation, translation = rows[:3, :3], rows[:3, 3]
    return Parts(
        name, size, fields.get("intrinsics"), fields.get("distortion"), rotation, translation
    )


def _rotation(name: str, fields: Fields, faults: list[str]) -> Any:
    """Return the matrix, or the vector, of a camera: some writers put either under either name."""
    given = [fields[key] for key in ("matrix", "rotation") if key in fields]
    if len(given) < 2:
        return given[0] if given else None
    turns = []
    for value in given:
        values = array_of(value)
        if values is None or not np.isfinite(values).all() or values.size not in (3, 9):
            return value
        turns.append(rotation_from_vector(values) if values.size == 3 else values.reshape(3, 3))
    if abs(turns[0] - turns[1]).max() > 0.01:
        faults.append(f"camera {name!r}: its two rotations, a matrix and a vector, differ")
    return given[0]
