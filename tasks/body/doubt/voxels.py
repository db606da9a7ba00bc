"""Ask the voxels of a frame what the posed limbs leave unexplained.

The posed body is laid back into what the cameras saw: a hull is what all silhouettes allow, and the
colors on it are theirs. A limb in the wrong place leaves voxels far from every bone, colors on it
that are not its own, and skin or socks beside a hand or foot.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES
from tasks.engine.kernels import njit

Floats = NDArray[np.float64]

OWN = 0.06
"""How near its line a bone's own voxels are [statures]. It is a thigh's thickness; chosen, not
measured."""

FAR = 0.08
"""How far from every line a voxel is no part of a body [statures]. No limb is so thick. Of 0.1 and
0.08 the second told more of legs that were lost, in rendered captures."""

AROUND = 0.14
"""How far from the middle of a hand or foot its color is looked for [statures]. A little more than
its length; chosen, not measured."""

BESIDE = 0.032
"""How far from the line of a hand or foot its color is beside it [statures]. Half as wide as a
foot; chosen, not measured."""

_LIKELY = 0.5
"""A color that is so much likelier on a bone than anywhere is of that bone [logarithm]. Chosen, not
measured."""

_FEW = 3.0
"""What is added to the number of voxels of a color before it divides [voxels]. Of a few voxels one
beside a hand tells little."""

_NOWHERE = 1e9
"""Squared distance that is farther than all [m**2]."""


@dataclass(frozen=True, eq=False)
class VoxelReport:
    """What the voxels of a frame say of the bones."""

    own: Floats
    """(bone,) how many of the voxels looked at are a bone's own."""

    strangeness: Floats
    """(bone,) how unlikely the colors of its own voxels are there [mean logarithm]; 0 of none."""

    far: Floats
    """(bone,) share of all voxels that are far from every line, and nearest to this bone."""

    beside: Floats
    """(bone,) share of the voxels of its color around a bone that are beside it."""

    outside: Floats
    """(point,) how far points of the body are from the nearest voxel, m."""

    bone: NDArray[np.int8]
    """(voxel,) the bone that each voxel looked at is of, -1 for none."""


def report_voxels(
    points: Floats, cell: NDArray[np.integer], log_looks: NDArray[np.float32],
    lines: tuple[Floats, Floats], middle: Floats, body_points: Floats, stature_m: float,
) -> VoxelReport:  # fmt: skip
    """Return what a frame's voxels say of a pose.

    Parameters
    ----------
    points : (voxel, 3) float64
        An even sample of the frame's voxels, m; at least one.
    cell : (voxel,) int
        Row of `log_looks` that belongs to each voxel's color, -1 for none.
    log_looks : (cell, bone) float32
        How much likelier a color is on a bone than anywhere [logarithm].
    lines : (line, 3) and (line, 3) float64
        Where the line of each bone begins and ends, m; after them lines of cloth between limbs,
        near which no voxel is far.
    middle : (bone, 3) float64
        The middle of each bone, m.
    body_points : (point, 3) float64
        Points that are inside the body, m.
    stature_m
        The performer's height.
    """
    bones = len(BONES)
    sums = np.zeros((bones, 6))
    outside = np.full(len(body_points), _NOWHERE)
    bone = np.full(len(points), -1, np.int8)
    _sum_up(
        points, cell, log_looks, (*lines, middle, body_points),
        (OWN * stature_m, FAR * stature_m, AROUND * stature_m, BESIDE * stature_m),
        (sums, outside, bone),
    )  # fmt: skip
    own, known, log_look, far, colored, beside = sums.T
    return VoxelReport(
        own=own,
        strangeness=-log_look / np.maximum(known, 1.0),
        far=far / len(points),
        beside=beside / (colored + _FEW),
        outside=np.sqrt(outside),
        bone=bone,
    )


@njit(cache=True, nogil=True)
def _sum_up(points: Any, cell: Any, looks: Any, body: Any, within: Any, sums: Any) -> None:
    """Add up what each voxel says of the bones.

    body : begin and end of lines, those of the bones first, the bones' middles (bone, 3), and
        points (point, 3)
    within : own, far, around and beside, m
    sums : (bone, 6) own voxels, those of known color, their logarithms, far ones, those of its
        color around, and those of them beside it; (point,) squared distances; (voxel,) the bone
        that each is of; all written
    """
    begin, end, middle, inside = body
    own, far, around, beside = within
    table, outside, bone = sums
    squared = np.empty(len(middle))
    for n in range(len(points)):
        point, known = points[n], cell[n] >= 0
        for k in range(len(middle)):
            squared[k] = _from_line(point, begin[k], end[k])
            colored = known and looks[cell[n], k] > _LIKELY
            if colored and _apart(point, middle[k]) < around * around:
                table[k, 4] += 1.0
                table[k, 5] += squared[k] > beside * beside
        nearest = squared.argmin()
        if squared[nearest] < own * own:
            bone[n] = nearest
            table[nearest, 0] += 1.0
            if known:
                table[nearest, 1] += 1.0
                table[nearest, 2] += looks[cell[n], nearest]
        if squared[nearest] > far * far:
            in_cloth = False
            for k in range(len(middle), len(begin)):
                in_cloth |= _from_line(point, begin[k], end[k]) <= far * far
            table[nearest, 3] += not in_cloth
        for i in range(len(inside)):
            outside[i] = min(outside[i], _apart(point, inside[i]))


@njit(cache=True, nogil=True)
def _apart(point: Any, other: Any) -> float:
    """Return the squared distance of two points."""
    return (point[0] - other[0]) ** 2 + (point[1] - other[1]) ** 2 + (point[2] - other[2]) ** 2


@njit(cache=True, nogil=True)
def _from_line(point: Any, begin: Any, end: Any) -> float:
    """Return the squared distance of a point from the line between two others."""
    along, length = 0.0, 1e-12
    for a in range(3):
        along += (point[a] - begin[a]) * (end[a] - begin[a])
        length += (end[a] - begin[a]) ** 2
    share = min(max(along / length, 0.0), 1.0)
    away = 0.0
    for a in range(3):
        away += (point[a] - begin[a] - share * (end[a] - begin[a])) ** 2
    return away
