"""A take as a scene that any 3-D viewer plays: a skeleton of bones, or colored voxels."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from storage import open_archive
from storage.errors import InputError
from storage.formats.motion.glb import GlbMesh, GlbNode, GlbTrack, write_glb
from storage.places import told
from tasks.rendering.drawing.stick_figures import FIGURE_LINES

MOST_FRAMES = 120
"""How many frames of voxels a file has at most [frames]. Each is a mesh of its own of some 20,000
points, and viewers hold all of them."""
_BONE_M, _JOINT_M = 0.017, 0.027
"""Radii of bones and joints [m]. As the viewer draws them; chosen by eye."""
_BONE_PAINT, _JOINT_PAINT = (0.02, 0.1, 0.6), (0.05, 0.2, 0.75)
"""Linear red, green and blue of bones and joints [share of full light]. The viewer's blue."""
_LEAST_HZ = 30.0
"""A skeleton has at least so many poses a second [Hz]; of faster takes, frames are left out."""
_SIDES = 10
"""How many sides a bone has. Chosen by eye: it looks round."""
_GAMMA = 2.2
"""Video to linear light, in which the colors of a GLB file are."""


def write_joint_glb(
    path: Path, position: NDArray[np.floating], names: Sequence[str], rate_hz: float
) -> None:
    """Write a joint track as an animated skeleton.

    Parameters
    ----------
    position : (time, joint, 3) float, m
        NaN where a joint is missing; it and its bones have no size then.
    names
        Of the joints.
    """
    step = max(1, int(rate_hz // _LEAST_HZ))
    shown = np.asarray(position[::step], np.float64)
    time_s = (np.arange(len(shown)) * step / rate_hz).astype(np.float32)
    nodes = []
    place = {name: _filled(shown[:, k]) for k, name in enumerate(names)}
    seen = np.asarray(np.isfinite(shown).all(axis=2))
    there = {name: seen[:, k] for k, name in enumerate(names)}
    for name in names:
        tracks = [GlbTrack("translation", time_s, place[name].astype(np.float32))]
        if not there[name].all():
            size = np.repeat(there[name][:, None], 3, axis=1).astype(np.float32)
            tracks.append(GlbTrack("scale", time_s, size, steps=True))
        nodes.append(GlbNode(name, 1, tracks))
    for a, b in (("Neck", "Head"), *FIGURE_LINES):
        if a in place and b in place:
            tracks = _bone_tracks(place[a], place[b], there[a] & there[b], time_s)
            nodes.append(GlbNode(f"{a}-{b}", 0, tracks))
    write_glb(path, [_tube(), _ball()], nodes)


def export_voxel_clip(archive: str, take: str, file: str, clip: tuple[int, int]) -> list[str]:
    """Write the colored surface voxels of some frames as a GLB file; return what was written.

    Each frame is a cloud of points that has its size while it is shown, and none else.

    Raises
    ------
    UnknownNameError, ArchiveError, InputError, PlaceError
        If the take is not there or has no voxels, the frames are not within it or too many, or
        the file cannot be written.
    """
    opened = open_archive(archive).take(take)
    start, end = clip
    if end >= opened.record.frames:
        raise InputError(
            f"take {take!r} has the frames 0-{opened.record.frames - 1}; {start}-{end} goes beyond"
        )
    if end - start >= MOST_FRAMES:
        raise InputError(
            f"frames {start}-{end} are {end - start + 1}, and a file has {MOST_FRAMES} at most; "
            f"give fewer, such as --frames {start}-{start + MOST_FRAMES - 1}"
        )
    shape, origin, voxel_m = opened.grid
    meshes, nodes = [], []
    count = end - start + 1
    edges = (np.arange(count + 1) / opened.record.rate_hz).astype(np.float32)
    for number, (voxel, color, _) in enumerate(opened.surfaces(start, end + 1)):
        if not len(voxel):
            continue
        index = np.stack(np.unravel_index(voxel, shape), axis=1)
        linear = np.rint(255 * (color / 255.0) ** _GAMMA).astype(np.uint8)
        alpha = np.full((len(voxel), 1), 255, np.uint8)
        meshes.append(
            GlbMesh(
                (np.array(origin) + voxel_m * index).astype(np.float32),
                color=np.concatenate([linear, alpha], axis=1),
            )
        )
        size = np.zeros((count + 1, 3), np.float32)
        size[number] = 1.0
        tracks = [GlbTrack("scale", edges, size, steps=True)] if count > 1 else []
        nodes.append(GlbNode(f"frame {start + number}", len(meshes) - 1, tracks))
    if not meshes:
        raise InputError(f"in the frames {start}-{end} of take {take!r} no voxel is occupied")
    with told(f"write {file}"):
        write_glb(Path(file), meshes, nodes)
    return [f"{file}: the voxels of {count} frames"]


def _bone_tracks(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    there: NDArray[np.bool_],
    time_s: NDArray[np.float32],
) -> list[GlbTrack]:
    """Return how a bone of length 1 along Y is moved between two joints."""
    along = end - start
    length = np.linalg.norm(along, axis=1)
    unit = along / np.maximum(length, 1e-9)[:, None]
    # the turn from Y: about Y x unit, by the half-way quaternion (cross, 1 + cosine)
    cosine = unit[:, 1]
    quaternion = np.stack([unit[:, 2], np.zeros(len(unit)), -unit[:, 0], 1.0 + cosine], axis=1)
    quaternion[cosine < -1 + 1e-7] = [1.0, 0.0, 0.0, 0.0]
    turned = Rotation.from_quat(quaternion).as_quat().astype(np.float32)
    same_way = np.cumprod(np.sign(np.sum(turned[1:] * turned[:-1], axis=1) + 1e-12))
    turned[1:] *= same_way[:, None].astype(np.float32)  # the short way between two frames
    size = np.stack([np.ones(len(length)), length, np.ones(len(length))], axis=1)
    size = np.where(there[:, None], size, 0.0).astype(np.float32)
    return [
        GlbTrack("translation", time_s, start.astype(np.float32)),
        GlbTrack("rotation", time_s, turned),
        GlbTrack("scale", time_s, size, steps=not there.all()),
    ]


def _filled(position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a joint (time, 3) with a line over its gaps: a file has no missing numbers."""
    there = np.flatnonzero(np.isfinite(position).all(axis=1))
    if not len(there):
        return np.zeros_like(position)
    frames = np.arange(len(position))
    return np.stack([np.interp(frames, there, position[there, k]) for k in range(3)], axis=1)


def _tube() -> GlbMesh:
    """Return a tube of length 1 along Y."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    round_ = np.stack([np.cos(angle), np.zeros(_SIDES), np.sin(angle)], axis=1)
    low = round_ * _BONE_M
    position = np.concatenate([low, low + np.array([0.0, 1.0, 0.0])]).astype(np.float32)
    normal = np.concatenate([round_, round_]).astype(np.float32)
    here = np.arange(_SIDES)
    after = (here + 1) % _SIDES
    face = np.concatenate(
        [
            np.stack([here, here + _SIDES, after], axis=1),
            np.stack([after, here + _SIDES, after + _SIDES], axis=1),
        ]
    ).astype(np.uint32)
    return GlbMesh(position, face, normal, paint=_BONE_PAINT)


def _ball() -> GlbMesh:
    """Return a ball about the origin."""
    rings = _SIDES // 2 + 1
    polar = np.pi * np.arange(rings) / (rings - 1)
    around = 2 * np.pi * np.arange(_SIDES) / _SIDES
    p, a = np.meshgrid(polar, around, indexing="ij")
    normal = np.stack([np.sin(p) * np.cos(a), np.cos(p), np.sin(p) * np.sin(a)], axis=-1)
    normal = normal.reshape(-1, 3).astype(np.float32)
    face = []
    for ring in range(rings - 1):
        for side in range(_SIDES):
            here, after = ring * _SIDES + side, ring * _SIDES + (side + 1) % _SIDES
            face += [[here, after, here + _SIDES], [after, after + _SIDES, here + _SIDES]]
    return GlbMesh(normal * _JOINT_M, np.array(face, np.uint32), normal, paint=_JOINT_PAINT)
