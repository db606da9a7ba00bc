"""Distance from the voxels that a body began with, carried along by its bones.

Each bone keeps the signed distance from its voxels of the initial frame: negative inside. Where
two bones turned against each other, what they both lie on or both left is parted half-way, as
skin over a joint is. Distances are looked up, not interpolated: that changes the labels of
rendered captures by less than 0.1 %; and between two voxels of one bone, at most eight apart on
a line, all are taken to be its.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

_CUBE = 8  # voxels of a side: so that few bones are near, and a line in it is short
_SLACK = 2.5  # voxels: of two look-ups, each rounded, and of distances from a voxel's center


@dataclass(frozen=True, eq=False)
class BoneFields:
    """The distance from each bone's voxels around them, in voxels of the initial frame."""

    begin: NDArray[np.int64]
    """(bone, 3) index in the grid of the first cell of a bone's box."""

    sides: NDArray[np.int64]
    """(bone, 3) cells of the box; 0 of a bone that has no voxels."""

    distance: NDArray[np.int8]
    """(cell,) 127ths of `most`, the boxes' cells one box after the other, each in the order of
    voxels; farther and deeper than `most` is not told apart."""

    most: int
    """Voxels from which a voxel is no bone's."""


def make_fields(
    index: NDArray[np.integer], bone: NDArray[np.integer], bones: int, most: int
) -> BoneFields:
    """Return the fields of a frame whose voxels have bones.

    Parameters
    ----------
    index : (voxel, 3) int
        In the grid.
    bone : (voxel,) int
        From 0; -1 for none.
    bones
        How many bones there are.
    most
        Voxels from which a voxel is no bone's.
    """
    begin, sides = np.zeros((bones, 3), np.int64), np.zeros((bones, 3), np.int64)
    distance = [np.zeros(0, np.int8)]
    for k in range(bones):
        own = index[bone == k]
        if not len(own):
            continue
        begin[k] = own.min(axis=0) - most - 1
        sides[k] = own.max(axis=0) + 2 + most - begin[k]
        inside = np.zeros(sides[k], np.bool_)
        inside[tuple((own - begin[k]).T)] = True
        outward = np.maximum(_distance(~inside) - 0.5, 0.0)
        inward = np.maximum(_distance(inside) - 0.5, 0.0)
        share = np.clip((outward - inward) / most, -1.0, 1.0)
        distance.append(np.rint(127.0 * share).astype(np.int8).ravel())
    return BoneFields(begin, sides, np.concatenate(distance), most)


def nearest_bones(
    index: NDArray[np.integer],
    fields: BoneFields,
    turn: NDArray[np.floating],
    shift: NDArray[np.floating],
) -> NDArray[np.int8]:
    """Return the bone that each voxel is deepest in, or else nearest to.

    Parameters
    ----------
    index : (voxel, 3) int
        In the grid, in order.
    fields
        Of the initial frame.
    turn : (bone, 3, 3) float
        What turns a place of this frame back to the bone's initial frame.
    shift : (bone, 3) float
        What is added then, in voxels.

    Returns
    -------
    (voxel,) int8
        -1 where no bone is near. Of equally near bones the first is taken.
    """
    nearest = np.full(len(index), -1, np.int8)
    if not len(index):
        return nearest
    local = np.asarray(shift, np.float64) - fields.begin + 0.5  # down to the nearest cell
    offset = np.concatenate([[0], np.cumsum(fields.sides.prod(axis=1))])
    _find_nearest(
        np.ascontiguousarray(index, np.int32),
        np.concatenate([turn, local[:, :, None]], axis=2).reshape(-1, 12),
        (fields.sides, offset, fields.distance, 127.0 / fields.most),
        nearest,
    )
    return nearest


def carry_back(
    joint: NDArray[np.floating],
    rotation: NDArray[np.floating],
    origin: NDArray[np.floating],
    origin_m: NDArray[np.floating],
    voxel_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return `turn` and `shift` of `nearest_bones` for poses.

    Parameters
    ----------
    joint : (..., bone, 3) float
        What each bone turns about, m.
    rotation : (..., bone, 3, 3) float
        World rotation since the initial pose.
    origin : (bone, 3) float
        The joints in the initial pose, m.
    origin_m, voxel_m
        Of the grid.
    """
    turn = np.swapaxes(np.asarray(rotation, np.float64), -1, -2)
    shift = (turn @ (origin_m - joint)[..., None])[..., 0] + origin - origin_m
    return turn, shift / voxel_m


def _distance(of: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the distance of True cells from the nearest False one."""
    return np.asarray(distance_transform_edt(of))


@njit(cache=True, nogil=True)
def _find_nearest(index: Any, back: Any, fields: Any, nearest: Any) -> None:
    """Write the nearest bone of each voxel, stretch after stretch along z in a cube."""
    low, cubes = _cubes_around(index)
    looked = np.zeros(cubes[0] * cubes[1] * cubes[2], np.int16)
    known = np.empty((len(looked), len(back)), np.int8)
    lower = np.empty(len(back))
    begin = 0
    while begin < len(index):
        x, y, z = index[begin, 0], index[begin, 1], index[begin, 2]
        i, j, k = (x - low[0]) // _CUBE, (y - low[1]) // _CUBE, (z - low[2]) // _CUBE
        cube = (i * cubes[1] + j) * cubes[2] + k
        if looked[cube] == 0:
            half = (_CUBE - 1) / 2
            corner = (low[0] + i * _CUBE, low[1] + j * _CUBE, low[2] + k * _CUBE)
            ball = (corner[0] + half, corner[1] + half, corner[2] + half, half * np.sqrt(3.0))
            looked[cube] = 1 + _choose(ball, back, fields, lower, known[cube])
        last = low[2] + (k + 1) * _CUBE
        end = begin + 1
        while end < len(index) and index[end, 2] < last and _follows(index, end):
            end += 1
        near = (known, cube, looked[cube] - 1)
        nearest[begin] = _look(x, y, z, near, back, fields)
        nearest[end - 1] = _look(x, y, index[end - 1, 2], near, back, fields)
        if nearest[begin] == nearest[end - 1]:
            for n in range(begin + 1, end - 1):
                nearest[n] = nearest[begin]
        else:
            for n in range(begin + 1, end - 1):
                nearest[n] = _look(x, y, index[n, 2], near, back, fields)
        begin = end


@njit(cache=True, nogil=True)
def _look(x: Any, y: Any, z: Any, near: Any, back: Any, fields: Any) -> Any:
    """Return which of the bones of a cube a voxel is deepest in or nearest to."""
    sides, offset, distance, _ = fields
    known, cube, bones = near
    best, nearest = 127, -1
    for n in range(bones):
        b = known[cube, n]
        i = int(back[b, 0] * x + back[b, 1] * y + back[b, 2] * z + back[b, 3])
        j = int(back[b, 4] * x + back[b, 5] * y + back[b, 6] * z + back[b, 7])
        k = int(back[b, 8] * x + back[b, 9] * y + back[b, 10] * z + back[b, 11])
        if 0 <= i < sides[b, 0] and 0 <= j < sides[b, 1] and 0 <= k < sides[b, 2]:
            there = distance[offset[b] + (i * sides[b, 1] + j) * sides[b, 2] + k]
            if there < best:
                best, nearest = there, b
    return nearest


@njit(cache=True, nogil=True)
def _cubes_around(index: Any) -> Any:
    """Return the first corner of the voxels' box, and how many cubes cover it."""
    low = (index[0, 0], index[0, 1], index[0, 2])
    high = low
    for n in range(1, len(index)):
        x, y, z = index[n, 0], index[n, 1], index[n, 2]
        low = (min(low[0], x), min(low[1], y), min(low[2], z))
        high = (max(high[0], x), max(high[1], y), max(high[2], z))
    return low, (
        (high[0] - low[0]) // _CUBE + 1,
        (high[1] - low[1]) // _CUBE + 1,
        (high[2] - low[2]) // _CUBE + 1,
    )


@njit(cache=True, nogil=True)
def _follows(index: Any, n: Any) -> Any:
    """Return whether a voxel stands a step along z from the one before it."""
    beside = index[n, 0] == index[n - 1, 0] and index[n, 1] == index[n - 1, 1]
    return beside and index[n, 2] == index[n - 1, 2] + 1


@njit(cache=True, nogil=True)
def _choose(ball: Any, back: Any, fields: Any, lower: Any, known: Any) -> Any:
    """Write which bones may be the nearest somewhere in a ball; return how many they are."""
    sides, offset, distance, unit = fields
    x, y, z, r = ball
    least = 127.0
    change = unit * (r + _SLACK) + 1.0  # and of rounding to a 127th
    for b in range(len(back)):
        lower[b] = np.inf
        u = back[b, 0] * x + back[b, 1] * y + back[b, 2] * z + back[b, 3]
        v = back[b, 4] * x + back[b, 5] * y + back[b, 6] * z + back[b, 7]
        w = back[b, 8] * x + back[b, 9] * y + back[b, 10] * z + back[b, 11]
        nu, nv, nw = sides[b, 0], sides[b, 1], sides[b, 2]
        if min(u, v, w) < -r or max(u - nu, v - nv, w - nw) > r or nw == 0:
            continue
        i = min(max(int(u), 0), nu - 1)
        j = min(max(int(v), 0), nv - 1)
        k = min(max(int(w), 0), nw - 1)
        there = distance[offset[b] + (i * nv + j) * nw + k]
        lower[b] = there - change
        least = min(least, there + change)
    near = 0
    for b in range(len(back)):
        if lower[b] <= least:
            known[near] = b
            near += 1
    return near
