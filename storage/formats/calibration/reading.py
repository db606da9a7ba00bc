"""Read the calibration of a capture, in any of the formats that labs have.

Which format a file has is seen from its content. The result is always the same: cameras in a
y-up world, in metres (`storage.formats.calibration.camera`).
"""

import math
import os
import unicodedata
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.calibration.camera import Camera, scale_world, turn_y_up
from storage.formats.calibration.matrices import WANTED as MATRIX_WANTED
from storage.formats.calibration.matrices import read_matrices
from storage.formats.calibration.opencv import read_easymocap, read_opencv_calibration
from storage.formats.calibration.others import read_colmap, read_panoptic, read_qualisys
from storage.formats.calibration.parts import MOST_CAMERAS, Calibration, numbers_in, parse_xml
from storage.formats.calibration.surrey import is_surrey, read_surrey
from storage.formats.calibration.toml import read_toml_calibration, write_calibration
from storage.formats.reading import decode_text, listed, read_bytes

__all__ = [
    "infer_unit",
    "infer_up",
    "load_calibration",
    "place_cameras",
    "read_calibration",
    "write_calibration",
]

WANTED = (
    "a Pose2Sim or Anipose .toml, EasyMocap's intri.yml and extri.yml, an OpenCV .yml or .xml, a "
    "Qualisys .qca.txt, a Panoptic .json, COLMAP's cameras.txt and images.txt, Surrey's "
    "calibration.txt, or a folder of 3x4 projection matrices"
)
SUFFIXES = (".toml", ".yml", ".yaml", ".xml", ".txt", ".json", ".dat", ".cal")
_MOST_BYTES = 1 << 22
"""Longest file of a calibration [bytes]. A thousand cameras have a few million, of any format."""
_MOST_BYTES_OF_IMAGES = 1 << 27
"""Longest images.txt of COLMAP [bytes]. It has a line with all points of each image."""
_UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001}
_USUAL_DISTANCE_M = 4.0  # of a camera from the middle of a studio


def read_calibration(
    path: Path,
    *,
    up: str | None = None,
    unit_m: float | None = None,
    center_m: Sequence[float] | None = None,
    distance_m: float = _USUAL_DISTANCE_M,
    count_seeing: Callable[[Sequence[Camera]], int] | None = None,
) -> tuple[list[Camera], list[str]]:
    """Read the cameras of a calibration, in the order of the file.

    Parameters
    ----------
    path : Path
        A file, one of a pair of files, or a folder.
    up : str, optional
        The axis that points up in the file: y, z, x, or -y ... If not given it is what the file
        says, what the cameras' own uprightness shows, the habit of the format, or y.
    unit_m : float, optional
        Metres in one unit of the file. If not given it is what the format says, or the one of
        metres, centimetres and millimetres that puts the cameras nearest to `distance_m`.
    center_m : sequence of float, optional
        Where the dancer is, y up: what that distance is measured from; otherwise the middle of
        the cameras.
    distance_m : float
        How far from there cameras usually stand.
    count_seeing : callable, optional
        Returns how many of some cameras, in metres, see what they should: a unit under which fewer
        of them do than under another is none.

    Returns
    -------
    cameras : list of Camera
        Metres, y up.
    notes : list of str
        What had to be assumed, a sentence each.

    Raises
    ------
    InputError
        It is no calibration, or a camera in it cannot be used; all faults at once.
    """
    found = load_calibration(Path(path))
    cameras, _, notes = place_cameras(
        path, found, up=up, unit_m=unit_m, center_m=center_m, distance_m=distance_m,
        count_seeing=count_seeing,
    )  # fmt: skip
    return cameras, notes


def load_calibration(path: Path, filmed: Collection[str] = ()) -> Calibration:
    """Read the cameras of a calibration in its own unit and axes; see `read_calibration`.

    Where a format has cameras that do not film, those called as one of `filmed` do.
    """
    return _read_folder(path, filmed) if path.is_dir() else _read_file(path, filmed)


def place_cameras(
    path: Path,
    found: Calibration,
    *,
    up: str | None = None,
    unit_m: float | None = None,
    center_m: Sequence[float] | None = None,
    distance_m: float = _USUAL_DISTANCE_M,
    count_seeing: Callable[[Sequence[Camera]], int] | None = None,
) -> tuple[list[Camera], float, list[str]]:
    """Return the cameras in metres and y up, the metres in a unit, and notes.

    The arguments are those of `read_calibration`; `path` is what to name in an error.
    """
    notes = list(found.notes)
    axis = _choose_up(path, found, up, notes)
    cameras = [turn_y_up(camera, axis) for camera in found.cameras]
    unit_m = found.unit_m if unit_m is None else unit_m
    if unit_m is None:
        unit_m, note = infer_unit(cameras, center_m, distance_m, count_seeing)
        notes.append(note)
    return [scale_world(camera, unit_m) for camera in cameras], unit_m, notes


def infer_unit(
    cameras: Sequence[Camera],
    center_m: Sequence[float] | None,
    distance_m: float,
    count_seeing: Callable[[Sequence[Camera]], int] | None = None,
) -> tuple[float, str]:
    """Return the metres in one unit of a calibration that does not say them, and a note.

    Of the units under which most cameras see what they should, the one that puts them nearest to
    the usual distance.
    """
    centers = np.array([camera.center_m for camera in cameras])
    distances = {name: _distance(centers * unit_m, center_m) for name, unit_m in _UNITS.items()}
    candidates = list(_UNITS)
    if count_seeing is not None:
        seeing = {
            name: count_seeing([scale_world(camera, unit_m) for camera in cameras])
            for name, unit_m in _UNITS.items()
        }
        candidates = [name for name in _UNITS if seeing[name] == max(seeing.values())]
    name = min(candidates, key=lambda name: abs(math.log(distances[name] / distance_m)))
    middle = "the middle of the cameras" if center_m is None else "the volume's"
    if center_m is None and len(cameras) == 1:
        middle = "the origin"
    return _UNITS[name], (
        f"The calibration does not say its unit: read as {name}, which puts the cameras "
        f"{distances[name]:.3g} m from {middle}{' center' if center_m is not None else ''}."
    )


def infer_up(cameras: Sequence[Camera]) -> str | None:
    """Return the axis along which most of the images stand upright, None where none is clear."""
    upright = np.mean([-camera.rotation[1] for camera in cameras], axis=0)
    largest = int(np.argmax(abs(upright)))
    if abs(upright[largest]) < 0.7:
        return None
    return ("" if upright[largest] > 0 else "-") + "xyz"[largest]


def _distance(centers_m: NDArray[np.float64], center_m: Sequence[float] | None) -> float:
    """Return how far the median camera stands from the center, never 0."""
    if center_m is None:
        middle = centers_m.mean(axis=0) if len(centers_m) > 1 else np.zeros(3)
    else:
        middle = np.asarray(center_m, np.float64)
    with np.errstate(over="ignore"):
        distance = float(np.median(np.linalg.norm(centers_m - middle, axis=1)))
    return min(max(distance, 1e-9), 1e300)


def _choose_up(path: Path, found: Calibration, up: str | None, notes: list[str]) -> str:
    """Return the axis that points up in the file, and note where it had to be guessed."""
    if up is not None and found.up is not None and up != found.up:
        raise InputError(
            f"{path} says that {found.up} points up, and {up} is asked for; correct one of them"
        )
    stated = up or found.up
    shown = infer_up(found.cameras)
    if stated is None:
        axis = shown or found.habit or "y"
        why = "as the images stand upright along it" if shown else "as is usual"
        if axis != "y":
            notes.append(f"Nothing says which axis points up: {axis} was taken, {why}.")
        return axis
    if shown is not None and shown != stated:
        notes.append(
            f"The images stand upright along {shown}, though {stated} is said to point up: if "
            f'the floor comes out wrong, write up = "{shown}".'
        )
    return stated


def _read_file(path: Path, filmed: Collection[str] = ()) -> Calibration:
    """Read a file, and the one that belongs to it, by what it holds."""
    for pair in (("intri.yml", "extri.yml"), ("cameras.txt", "images.txt")):
        if path.name in pair:
            return _read_pair(path.parent, pair)
    text, notes = _text(path)
    bare = text.lstrip()
    if bare.startswith("{"):
        found = read_panoptic(path, text)
    elif bare.startswith("<"):
        found = _read_xml(path, text, filmed)
    elif _is_opencv(path, bare):
        found = read_opencv_calibration(path, {path.stem: text})
    elif path.suffix.lower() == ".toml":
        found = read_toml_calibration(path, text)
    elif is_surrey(text):
        found = read_surrey(path, text)
    else:
        raise InputError(
            f"{path} is no calibration that can be read: its name ends in {path.suffix!r} and it "
            f"begins with {bare[:20]!r}; bring {WANTED}"
        )
    found.notes.extend(notes)
    return found


def _read_xml(path: Path, text: str, filmed: Collection[str]) -> Calibration:
    root = parse_xml(path, text, WANTED)
    if root.tag == "opencv_storage":
        return read_opencv_calibration(path, {path.stem: text})
    if root.find("./cameras/camera") is not None:
        return read_qualisys(path, root, filmed)
    if not len(root):
        raise InputError(
            f"{path} holds one camera; bring a folder with such a file a camera: {MATRIX_WANTED}"
        )
    raise InputError(f"{path} has a root <{root.tag[:40]}>, which is not known; bring {WANTED}")


def _read_pair(folder: Path, pair: tuple[str, str]) -> Calibration:
    """Read two files that belong together."""
    lacking = [name for name in pair if not os.path.lexists(folder / name)]
    if lacking:
        raise InputError(
            f"{folder} has no {' and no '.join(lacking)}; {' and '.join(pair)} belong together"
        )
    (first, notes), (second, more) = (_text(folder / name) for name in pair)
    read = read_easymocap if pair[0] == "intri.yml" else read_colmap
    found = read(folder, first, second)
    found.notes.extend(dict.fromkeys(notes + more))
    return found


def _read_folder(folder: Path, filmed: Collection[str]) -> Calibration:
    """Read a folder: of a pair of files, of one file, or of a file a camera."""
    try:
        files = sorted(
            file
            for file in folder.iterdir()
            if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
        )
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror}); allow it") from error
    names = {file.name for file in files}
    for pair in (("intri.yml", "extri.yml"), ("cameras.txt", "images.txt")):
        if names & set(pair):
            return _read_pair(folder, pair)
    if not files:
        raise InputError(f"the folder {folder} holds no calibration; put there {WANTED}")
    if len(files) > MOST_CAMERAS:
        raise InputError(
            f"the folder {folder} holds {len(files):,} files, where at most {MOST_CAMERAS:,} "
            "cameras are read; keep there the files of one calibration only"
        )
    texts = {file: _text(file)[0] for file in files}
    opencv = [file for file in files if _is_opencv(file, texts[file].lstrip())]
    stems = [file.stem for file in files]
    if len(set(stems)) < len(stems):
        raise InputError(
            f"the folder {folder} holds more than one file of a name ({listed(stems)}); keep one "
            "a camera"
        )
    if len(opencv) == len(files):
        return read_opencv_calibration(folder, {file.stem: texts[file] for file in files})
    [first, *_] = texts.values()
    if len(files) == 1 and (is_surrey(first) or not _is_matrix(files[0], first)):
        return _read_file(files[0], filmed)
    others = [file.name for file in files if not _is_matrix(file, texts[file])]
    if others:
        raise InputError(
            f"the folder {folder} holds {listed(others)}, which is not {MATRIX_WANTED}; keep "
            "there the files of one calibration only"
        )
    return read_matrices(folder, {file.stem: _matrix_text(file, texts[file]) for file in files})


def _text(path: Path) -> tuple[str, list[str]]:
    most = _MOST_BYTES_OF_IMAGES if path.name == "images.txt" else _MOST_BYTES
    text, notes = decode_text(path, read_bytes(path, WANTED, most=most), WANTED)
    # programs write one letter of a camera's name as one code or as two
    return unicodedata.normalize("NFC", text), [note for note in notes if "UTF-8" in note]


def _is_opencv(path: Path, bare: str) -> bool:
    if bare.startswith("<"):
        return "<opencv_storage" in bare
    return bare.startswith("%YAML") or path.suffix.lower() in (".yml", ".yaml")


def _matrix_text(path: Path, text: str) -> str:
    """Return the text around a matrix's numbers taken off."""
    if text.lstrip().startswith("<"):
        return " ".join(parse_xml(path, text, MATRIX_WANTED).itertext())
    return text.lstrip().removeprefix("CONTOUR")


def _is_matrix(path: Path, text: str) -> bool:
    numbers = numbers_in(_matrix_text(path, text))
    return bool(numbers) and not any(math.isnan(number) for number in numbers)
