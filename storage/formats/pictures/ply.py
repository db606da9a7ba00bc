"""Write PLY files: colored points with labels, or a colored closed surface.

Binary, little-endian PLY 1.0 (Turk 1994), with a header of ASCII lines:

    ply
    format binary_little_endian 1.0
    comment meters, right-handed, Y up, floor at y = 0
    element vertex 3
    property float x
    property float y
    property float z
    property uchar red
    property uchar green
    property uchar blue
    property uchar label
    element face 1
    property list uchar int vertex_indices
    end_header

Points have a label, the body segment 1-11 or 0 for none, and no faces; surfaces have faces and
no label. Vertices follow the header without gaps, then the faces: the number 3 and the vertices
of a triangle, counterclockwise seen from outside.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import write_beside

_PLACE = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
_COLOR = [("red", "u1"), ("green", "u1"), ("blue", "u1")]
_FACE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])
_TYPES = {"<f4": "float", "|u1": "uchar"}


def write_points(
    path: str | Path,
    center: NDArray[np.floating],
    color: NDArray[np.uint8],
    label: NDArray[np.uint8],
) -> None:
    """Write voxels as colored points: beside the place, then renamed, so never half a file.

    Parameters
    ----------
    path : str or Path
        A file that ends in ".ply"; one that is there is replaced.
    center : (voxel, 3) float
        Metres.
    color : (voxel, 3) uint8
        RGB.
    label : (voxel,) uint8
        Segment, 1-11, or 0.

    Raises
    ------
    InputError
        Where the name does not end in ".ply", or the place cannot be written.
    ValueError
        Where the arrays do not fit each other, or a number is not finite.
    """
    faults = _vertex_faults(center, color)
    if label.shape != (len(center),) or label.dtype != np.uint8:
        faults.append(f"label is {label.dtype} {label.shape}, uint8 ({len(center)},) is wanted")
    _refuse(faults)
    point = _vertices(center, color, [("label", "u1")])
    point["label"] = label
    _write(Path(path), _header(point.dtype, len(point)), point.tobytes())


def write_surface(
    path: str | Path,
    vertex: NDArray[np.floating],
    color: NDArray[np.uint8],
    face: NDArray[np.integer],
) -> None:
    """Write a surface of colored triangles: beside the place, then renamed.

    Parameters
    ----------
    path : str or Path
        A file that ends in ".ply"; one that is there is replaced.
    vertex : (vertex, 3) float
        Metres.
    color : (vertex, 3) uint8
        RGB.
    face : (face, 3) int
        Vertices of each triangle, counterclockwise seen from outside.

    Raises
    ------
    InputError
        Where the name does not end in ".ply", or the place cannot be written.
    ValueError
        Where the arrays do not fit each other, or a number is not finite.
    """
    faults = _vertex_faults(vertex, color)
    if face.ndim != 2 or face.shape[1] != 3 or not np.issubdtype(face.dtype, np.integer):
        faults.append(f"face is {face.dtype} {face.shape}, integers (face, 3) are wanted")
    elif face.size and not 0 <= face.min() <= face.max() < len(vertex):
        faults.append(
            f"faces have vertices {face.min()} to {face.max()}, "
            f"but there are only {len(vertex)} vertices"
        )
    _refuse(faults)
    triangles = np.zeros(len(face), _FACE)
    triangles["count"] = 3
    triangles["vertices"] = face
    vertices = _vertices(vertex, color, [])
    header = _header(vertices.dtype, len(vertices), faces=len(face))
    _write(Path(path), header, vertices.tobytes() + triangles.tobytes())


def _vertex_faults(place: NDArray[np.floating], color: NDArray[np.uint8]) -> list[str]:
    """Return what is wrong with places and their colors."""
    if place.ndim != 2 or place.shape[1] != 3:
        return [f"points have shape {place.shape}, (point, 3) is wanted"]
    faults = []
    if not np.isfinite(place).all():
        faults.append("a point is not finite; leave such points out")
    if color.shape != place.shape or color.dtype != np.uint8:
        faults.append(f"color is {color.dtype} {color.shape}, uint8 {place.shape} is wanted")
    return faults


def _refuse(faults: list[str]) -> None:
    """Say all faults at once, if there are any."""
    if faults:
        raise ValueError(f"no PLY file can be written of this: {'; '.join(faults)}")


def _vertices(
    place: NDArray[np.floating], color: NDArray[np.uint8], more: list[tuple[str, str]]
) -> np.ndarray:
    """Return records as they stand in the file."""
    records = np.zeros(len(place), np.dtype(_PLACE + _COLOR + more))
    for axis, (name, _) in enumerate(_PLACE):
        records[name] = place[:, axis]
    for channel, (name, _) in enumerate(_COLOR):
        records[name] = color[:, channel]
    return records


def _header(record: np.dtype, vertices: int, *, faces: int | None = None) -> bytes:
    """Return the lines before the records."""
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += ["comment meters, right-handed, Y up, floor at y = 0", f"element vertex {vertices}"]
    lines += [f"property {_TYPES[record[name].str]} {name}" for name in record.names or ()]
    if faces is not None:
        lines += [f"element face {faces}", "property list uchar int vertex_indices"]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def _write(path: Path, header: bytes, records: bytes) -> None:
    """Write the file, or say why not."""
    if path.suffix.lower() != ".ply":
        raise InputError(f"{path} does not end in .ply; name the file so")
    try:
        write_beside(path, header + records)
    except OSError as error:
        raise InputError(
            f"the file {path} cannot be written ({error.strerror}); "
            "choose a folder that exists, has room and may be written"
        ) from error
