"""Calibrations of other programs: Qualisys, the Panoptic Studio, COLMAP."""

import json
import unicodedata
from collections.abc import Collection, Sequence
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.calibration.parts import (
    Calibration,
    Parts,
    array_of,
    as_shown,
    build_cameras,
    number,
    numbers_in,
    refuse,
)
from storage.formats.reading import listed

_SUBPIXEL = 64.0  # Qualisys counts in 64ths of a pixel
_HALF_TURN = np.diag([1.0, -1.0, -1.0])  # its cameras look along -z, with y up

_COLMAP_MODELS: dict[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": (
        *("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
        *("k3", "k4", "k5", "k6"),
    ),
}


def read_qualisys(path: Path, root: Element, filmed: Collection[str] = ()) -> Calibration:
    """Read the cameras of a Qualisys `.qca.txt`, those that film where some only see markers.

    Cameras that have a film count, and those of models that do nothing but film; where no films
    are known, those of all models that film.

    Focal lengths and centers are in 1/64 pixel (distortion has no unit), the rotation is written
    by column and goes from camera to world, positions are in millimetres.

    Parameters
    ----------
    path, root
        The file, and what it holds.
    filmed
        The names of the films there are, composed (NFC).

    Raises
    ------
    InputError
        A camera's numbers are missing or cannot be used.
    """
    notes: list[str] = []
    found = root.findall("./cameras/camera")
    with_film = {id(camera) for camera in found if _serial(camera) in set(filmed)}
    models = ("video", "none") if with_film else ("video", "hybrid", "none")
    filming = [camera for camera in found if id(camera) in with_film or _is_of(camera, models)]
    if filming and len(filming) < len(found):
        why = "have no film" if with_film else "see only markers"
        notes.append(f"{len(found) - len(filming)} of the {len(found)} cameras {why}: left out.")
    parts = [_qualisys_parts(camera, notes) for camera in filming or found]
    return Calibration(build_cameras(path, parts), 0.001, None, "z", notes)


def read_panoptic(path: Path, text: str) -> Calibration:
    """Read the cameras of a Panoptic Studio JSON: centimetres, y down.

    Raises
    ------
    InputError
        It is not JSON, has no list of cameras, or a camera's numbers cannot be used.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path} is not JSON ({error}); bring one with a list 'cameras'"
        ) from error
    cameras = data.get("cameras") if isinstance(data, dict) else None
    if not isinstance(cameras, list) or not all(isinstance(camera, dict) for camera in cameras):
        raise InputError(
            f"{path} has no list 'cameras' of tables with name, K, distCoef, R and t; bring a "
            "calibration of the Panoptic Studio, or in another format"
        )
    parts = [_panoptic_parts(index, camera) for index, camera in enumerate(cameras)]
    return Calibration(build_cameras(path, parts), 0.01, None, "-y")


def read_colmap(path: Path, cameras: str, images: str) -> Calibration:
    """Read the cameras of COLMAP's `cameras.txt` and `images.txt`, one an image.

    Its first pixel's center is at (.5, .5), here at (0, 0); its scale is arbitrary.

    Raises
    ------
    InputError
        A line cannot be read, a lens model cannot be used, or there is no image.
    """
    faults: list[str] = []
    lenses = dict(filter(None, (_lens(line, faults) for line in _lines(cameras))))
    # a line an image, then one of its points, which may be empty
    rows = [line for line in images.split("\n") if not line.startswith("#")]
    while rows and not rows[0].strip():
        rows.pop(0)
    parts = [_colmap_parts(line, lenses, faults) for line in rows[::2] if line.strip()]
    if faults:
        refuse(path, faults)
    found = [part for part in parts if part is not None]
    _name_by_folder(found)
    note = "COLMAP's scale is arbitrary: check that the dancer comes out as tall as in life."
    return Calibration(build_cameras(path, found), None, None, None, [note])


def _serial(camera: Element) -> str:
    return unicodedata.normalize("NFC", camera.get("serial") or "?")


def _is_of(camera: Element, models: Sequence[str]) -> bool:
    """Return whether a camera's model says one of some words."""
    return any(word in camera.get("model", "none").lower() for word in models)


def _qualisys_parts(camera: Element, notes: list[str]) -> Parts:
    """Return the numbers of a camera, turned and in pixels of its image."""
    name = _serial(camera)
    fov, inner, pose = (camera.find(tag) for tag in ("fov_video", "intrinsic", "transform"))
    if inner is None or pose is None:
        lacks = "intrinsic" if inner is None else "transform"
        return Parts(name, fault=f"there is no <{lacks}>")
    left, top, right, bottom = (
        (number(fov.get(side)) for side in ("left", "top", "right", "bottom"))
        if fov is not None
        else (0.0, 0.0, np.nan, np.nan)
    )
    size = None if fov is None else (right - left + 1, bottom - top + 1)
    fu, fv, cu, cv = (
        number(inner.get(key)) / _SUBPIXEL
        for key in ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV")
    )
    k1, k2, k3 = (number(inner.get(f"radialDistortion{n}", "0")) for n in (1, 2, 3))
    p1, p2 = (number(inner.get(f"tangentalDistortion{n}", "0")) for n in (1, 2))
    if size is not None and not _inside(cu - left, cv - top, size) and _inside(cv, cu, size):
        fu, fv, cu, cv, p1, p2 = fv, fu, cv, cu, p2, p1
        notes.append(f"Camera {name!r} is portrait: its U and V were exchanged.")
    if number(camera.get("viewrotation", "0")) % 360 != 0:
        notes.append(
            f"Camera {name!r} is shown turned by {camera.get('viewrotation')} degrees; its "
            "calibration is that of the image as it came from the sensor."
        )
    intrinsics = [[fu, 0.0, cu - left], [0.0, fv, cv - top], [0.0, 0.0, 1.0]]
    stored = np.array([number(pose.get(f"r{r}{c}")) for r in "123" for c in "123"]).reshape(3, 3)
    center = np.array([number(pose.get(axis)) for axis in "xyz"])
    rotation = _HALF_TURN @ stored  # by column: `stored` is the inverse already
    return Parts(name, size, intrinsics, (k1, k2, p1, p2, k3), rotation, -rotation @ center)


def _inside(u: float, v: float, size: tuple[float, float]) -> bool:
    return 0 <= u <= size[0] and 0 <= v <= size[1]


def _panoptic_parts(index: int, camera: dict[str, Any]) -> Parts:
    return Parts(
        str(camera.get("name", index)),
        camera.get("resolution"),
        camera.get("K"),
        camera.get("distCoef", ()),
        camera.get("R"),
        camera.get("t"),
    )


def _lines(text: str) -> list[str]:
    return [line for line in text.split("\n") if line.strip() and not line.startswith("#")]


def _lens(line: str, faults: list[str]) -> tuple[str, Parts] | None:
    """Return the number and the lens of a line of cameras.txt."""
    index, *rest = line.split()
    model = rest[0] if rest else ""
    if model not in _COLMAP_MODELS:
        faults.append(
            f"the lens model {as_shown(model)} cannot be used; undistort with COLMAP, or take "
            f"one of {', '.join(_COLMAP_MODELS)}"
        )
        return None
    names, values = _COLMAP_MODELS[model], numbers_in(" ".join(rest[1:]))
    if len(values) != 2 + len(names):
        faults.append(f"camera {index} has {len(values)} numbers, {2 + len(names)} are wanted")
        return None
    lens = dict(zip(names, values[2:], strict=True))
    fx, fy = (lens.get(key, lens.get("f")) for key in ("fx", "fy"))
    matrix = [[fx, 0, lens["cx"] - 0.5], [0, fy, lens["cy"] - 0.5], [0, 0, 1]]
    bent = [lens.get(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")]
    return index, Parts(index, tuple(values[:2]), matrix, bent)


def _colmap_parts(line: str, lenses: dict[str, Parts], faults: list[str]) -> Parts | None:
    """Return the camera of a line of images.txt."""
    words = line.split(maxsplit=9)
    quaternion = array_of(numbers_in(" ".join(words[1:5])), 4)
    if len(words) < 10 or quaternion is None or not 0.5 < np.linalg.norm(quaternion) < 2:
        faults.append(
            f"the line {as_shown(line)} of images.txt is not: id, qw, qx, qy, qz, tx, ty, tz, "
            "camera, name"
        )
        return None
    lens = lenses.get(words[8])
    if lens is None:
        faults.append(
            f"the image {as_shown(words[9])} was taken by camera {words[8]}, which cameras.txt "
            f"does not have ({listed([*lenses])})"
        )
        return None
    translation = numbers_in(" ".join(words[5:8]))
    return Parts(
        words[9].strip(), lens.size, lens.intrinsics, lens.distortion,
        _rotation(quaternion), translation,
    )  # fmt: skip


def _rotation(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _name_by_folder(parts: list[Parts]) -> None:
    """Name each camera as its image's folder where these differ, else as its image."""
    images = [PurePosixPath(part.name) for part in parts]
    folders = [image.parent.name for image in images]
    apart = all(folders) and len(set(folders)) == len(folders)
    for part, image in zip(parts, images, strict=True):
        part.name = image.parent.name if apart else image.stem
