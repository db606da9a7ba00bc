"""Write GLB files (glTF 2.0, binary): meshes, points and how they move, for any 3-D viewer.

The text of the file says what the numbers behind it are; both parts are padded to four bytes.
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from storage.files import write_beside

_FLOAT, _UINT8, _UINT32 = 5126, 5121, 5125
_POINTS, _TRIANGLES = 0, 4
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_HEAD = struct.Struct("<4sII")
_PART = struct.Struct("<I4s")


@dataclass(frozen=True, eq=False)
class GlbMesh:
    """A shape that nodes show."""

    position: NDArray[np.float32]
    """(vertex, 3) m."""
    face: NDArray[np.uint32] | None = None
    """(triangle, 3) vertices; None for points."""
    normal: NDArray[np.float32] | None = None
    """(vertex, 3) unit vectors."""
    color: NDArray[np.uint8] | None = None
    """(vertex, 4) RGBA; None takes `paint`."""
    paint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear RGB, 0 to 1."""


@dataclass(frozen=True, eq=False)
class GlbTrack:
    """How one property of a node changes."""

    property: Literal["translation", "rotation", "scale"]
    time_s: NDArray[np.float32]
    value: NDArray[np.float32]
    """(time, 3), or (time, 4) x, y, z, w for a rotation."""
    steps: bool = False
    """Whether a value holds until the next one, instead of a line between them."""


@dataclass(frozen=True, eq=False)
class GlbNode:
    """A thing in the scene: one of the meshes, and how it moves."""

    name: str
    mesh: int
    tracks: Sequence[GlbTrack] = field(default_factory=tuple)


def write_glb(path: Path, meshes: Sequence[GlbMesh], nodes: Sequence[GlbNode]) -> None:
    """Write a scene as a GLB file, metres with y up, replaced when the whole has been written."""
    content = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    held: dict[int, tuple[NDArray[Any], int]] = {}  # with the arrays, so that no id is used twice

    def accessor(values: NDArray[Any], kind: int, target: int | None = None) -> int:
        """Add numbers to the file once; return their place in the list of them."""
        if id(values) in held:
            return held[id(values)][1]
        flat = np.ascontiguousarray(values)
        width = 1 if flat.ndim == 1 else flat.shape[1]
        view: dict[str, Any] = {
            "buffer": 0, "byteOffset": len(content), "byteLength": flat.nbytes,
        }  # fmt: skip
        if target is not None:
            view["target"] = target
        content.extend(flat.tobytes())
        content.extend(b"\0" * (-len(content) % 4))
        about: dict[str, Any] = {
            "bufferView": len(views), "componentType": kind, "count": len(flat),
            "type": _KINDS[width],
        }  # fmt: skip
        if kind == _UINT8:
            about["normalized"] = True
        elif kind == _FLOAT and len(flat):
            low, high = flat.min(axis=0), flat.max(axis=0)
            about["min"] = [float(v) for v in np.atleast_1d(low)]
            about["max"] = [float(v) for v in np.atleast_1d(high)]
        views.append(view)
        accessors.append(about)
        held[id(values)] = values, len(accessors) - 1
        return len(accessors) - 1

    table_of_meshes = [_mesh(mesh, number, accessor) for number, mesh in enumerate(meshes)]
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for number, node in enumerate(nodes):
        for track in node.tracks:
            channels.append(
                {"sampler": len(samplers), "target": {"node": number, "path": track.property}}
            )
            samplers.append(
                {
                    "input": accessor(track.time_s, _FLOAT),
                    "output": accessor(track.value, _FLOAT),
                    "interpolation": "STEP" if track.steps else "LINEAR",
                }
            )
    scene: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "shosa"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": [{"name": node.name, "mesh": node.mesh, **_first(node)} for node in nodes],
        "meshes": table_of_meshes,
        "materials": [_material(mesh) for mesh in meshes],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content)}],
    }
    if channels:
        scene["animations"] = [{"name": "dance", "channels": channels, "samplers": samplers}]
    text = json.dumps(scene, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = _HEAD.size + 2 * _PART.size + len(text) + len(content)
    parts = [
        _HEAD.pack(b"glTF", 2, size),
        _PART.pack(len(text), b"JSON"),
        text,
        _PART.pack(len(content), b"BIN\0"),
        bytes(content),
    ]
    write_beside(path, b"".join(parts))


def _mesh(mesh: GlbMesh, material: int, accessor: Any) -> dict[str, Any]:
    """Return a mesh as the file tells it."""
    attributes = {"POSITION": accessor(mesh.position, _FLOAT, 34962)}
    if mesh.normal is not None:
        attributes["NORMAL"] = accessor(mesh.normal, _FLOAT, 34962)
    if mesh.color is not None:
        attributes["COLOR_0"] = accessor(mesh.color, _UINT8, 34962)
    primitive: dict[str, Any] = {"attributes": attributes, "material": material}
    if mesh.face is None:
        primitive["mode"] = _POINTS
    else:
        primitive["mode"] = _TRIANGLES
        primitive["indices"] = accessor(mesh.face.reshape(-1), _UINT32, 34963)
    return {"primitives": [primitive]}


def _material(mesh: GlbMesh) -> dict[str, Any]:
    """Return what a mesh is painted with; points have their own colors, and no light."""
    paint = {"baseColorFactor": [*mesh.paint, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.7}
    return {"pbrMetallicRoughness": paint}


def _first(node: GlbNode) -> dict[str, Any]:
    """Return where a node is in the first frame, for viewers that play nothing."""
    return {track.property: [float(v) for v in track.value[0]] for track in node.tracks}
