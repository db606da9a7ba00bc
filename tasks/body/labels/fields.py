"""Distance from the voxels that a body began with, carried along by its bones.

Each bone keeps the signed distance from its voxels of the initial frame, negative inside. Two bones
that turned against each other both lie on some voxels, and both left others; such voxels are parted
half-way, as skin over a joint is. Distances are looked up and not interpolated, which changes the
labels of rendered captures by less than 0.1 %. Where two voxels of a line, at most eight apart, are
nearest to one bone, all voxels between them are taken to be.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from tasks.engine.kernels import njit
from tasks.engine.threads import side_by_side
from tasks.geometry.voxel_lines import FIRST, LENGTH, VoxelLines, X, Y, Z

_CUBE = 8
"""Side of a cube in which the near bones are the same [voxels]. So few bones are near, and a line
in a cube is short."""

_FULL = 127.0
"""The largest distance, as it is stored."""

_NONE = int(_FULL) << 8
"""The key of no bone. A key is a distance and after it a bone: the least key is the nearest bone,
of equally near ones the first."""

_SLACK = 2.5
"""What a bone may be nearer than its distance says [voxels]. Of two look-ups, each rounded, and of
distances from a voxel's center."""


@dataclass(frozen=True, eq=False)
class BoneFields:
    """The distance from each bone's voxels around them, in voxels of the initial frame."""

    begin: NDArray[np.int64]
    """(bone, 3) index in the grid of the first cell of a bone's box."""

    sides: NDArray[np.int64]
    """(bone, 3) cells of the box; 0 of a bone that has no voxels."""

    distance: NDArray[np.int8]
    """(cell,) the distance in 127ths of `most`, of one box after the other. Within a box the cells
    are in the order of voxels. No distance is larger than `most`."""

    most: int
    """How far from every bone a voxel is no bone's, in voxels."""


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
        How far from every bone a voxel is no bone's, in voxels.
    """
    begin, sides = np.zeros((bones, 3), np.int64), np.zeros((bones, 3), np.int64)

    def measure(k: int) -> NDArray[np.int8]:
        own = index[bone == k]
        if not len(own):
            return np.zeros(0, np.int8)
        begin[k] = own.min(axis=0) - most - 1
        sides[k] = own.max(axis=0) + 2 + most - begin[k]
        inside = np.zeros(sides[k], np.bool_)
        inside[tuple((own - begin[k]).T)] = True
        away = np.maximum(_distance(~inside) - 0.5, 0.0)
        near = tuple(slice(most, -most) for _ in range(3))  # a layer around the bone's voxels
        away[near] -= np.maximum(_distance(inside[near]) - 0.5, 0.0)
        return np.rint(_FULL * np.clip(away / most, -1.0, 1.0)).astype(np.int8).ravel()

    distance = side_by_side(measure, range(bones))
    return BoneFields(begin, sides, np.concatenate(distance), most)


def nearest_bones(
    lines: VoxelLines,
    fields: BoneFields,
    turn: NDArray[np.floating],
    shift: NDArray[np.floating],
    *,
    value: NDArray[np.generic] | None = None,
) -> NDArray:
    """Return the bone that each voxel is deepest in, or else nearest to.

    Parameters
    ----------
    lines
        The voxels.
    fields
        Of the initial frame.
    turn : (bone, 3, 3) float
        What turns a place of this frame back to the bone's initial frame.
    shift : (bone, 3) float
        What is added then, in voxels.
    value : (bone + 1,)
        What is returned for each bone, and for none: by default their numbers as int8, and -1.

    Returns
    -------
    (voxel,)
        The values. Of equally near bones the first is taken.
    """
    if value is None:
        value = np.append(np.arange(len(turn)), -1).astype(np.int8)
    nearest = np.empty(lines.voxels, value.dtype)
    if not len(nearest):
        return nearest
    local = np.asarray(shift, np.float64) - fields.begin + 0.5  # down to the nearest cell
    offset = np.concatenate([[0], np.cumsum(fields.sides.prod(axis=1))])
    _find_nearest(
        lines.table,
        np.concatenate([turn, local[:, :, None]], axis=2).reshape(-1, 12),
        np.column_stack([offset[:-1], fields.sides]),
        fields.distance,
        _FULL / fields.most,
        (value, nearest),
    )
    return nearest


def own_distance(
    lines: VoxelLines,
    voxel: NDArray[np.integer],
    fields: BoneFields,
    turn: NDArray[np.floating],
    shift: NDArray[np.floating],
    bone: int,
) -> NDArray[np.float64]:
    """Return (chosen,) how far some voxels of a frame are from the voxels of one bone, in voxels.

    Parameters
    ----------
    lines, fields, turn, shift
        As for `nearest_bones`.
    voxel : (chosen,) int
        The places of the voxels in the list.
    bone
        Which bone. None is farther than `fields.most`.
    """
    line = np.searchsorted(lines.table[:, FIRST], voxel, side="right") - 1
    index = lines.table[line][:, [X, Y, Z]].astype(np.int64)
    index[:, 2] += voxel - lines.table[line, FIRST]
    at = index @ np.asarray(turn[bone], np.float64).T + shift[bone] - fields.begin[bone] + 0.5
    sides = fields.sides[bone]
    cell = np.clip(np.floor(at).astype(np.int64), 0, sides - 1)
    begin = int(fields.sides[:bone].prod(axis=1).sum())
    number = (cell[:, 0] * sides[1] + cell[:, 1]) * sides[2] + cell[:, 2]
    return fields.distance[begin + number].astype(np.float64) * (fields.most / _FULL)


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
    """Return how far each True cell is from the nearest False one."""
    return np.asarray(distance_transform_edt(of))


@njit(cache=True, nogil=True)
def _find_nearest(lines: Any, back: Any, boxes: Any, distance: Any, unit: Any, values: Any) -> None:
    """Write the value of each voxel's nearest bone, cube after cube along each line.

    `boxes`: where the cells of each bone begin, and their sides.
    """
    value, nearest = values
    low, cubes = _cubes_around(lines)
    looked = np.zeros(cubes[0] * cubes[1] * cubes[2], np.int16)
    known = np.empty((len(looked), len(back)), np.int8)
    lower = np.empty(len(back))
    half = (_CUBE - 1) / 2
    for line in range(len(lines)):
        x, y, z = np.int64(lines[line, X]), np.int64(lines[line, Y]), np.int64(lines[line, Z])
        n = lines[line, FIRST]
        i, j = (x - low[0]) // _CUBE, (y - low[1]) // _CUBE
        stop = z + lines[line, LENGTH]
        while z < stop:
            k = (z - low[2]) // _CUBE
            cube = (i * cubes[1] + j) * cubes[2] + k
            if looked[cube] == 0:
                middle = (
                    low[0] + i * _CUBE + half, low[1] + j * _CUBE + half, low[2] + k * _CUBE + half,
                )  # fmt: skip
                _bound(middle, half * np.sqrt(3), back, boxes, distance, (unit, lower))
                looked[cube] = 1 + _choose(lower, known, cube)
            size = min(stop, low[2] + (k + 1) * _CUBE) - z
            near = (cube, looked[cube] - 1)
            first, last = _look((x, y, z, size - 1), near, known, back, boxes, distance)
            nearest[n], nearest[n + size - 1] = value[first], value[last]
            if first == last:
                for m in range(1, size - 1):
                    nearest[n + m] = value[first]
            else:
                for m in range(1, size - 1, 2):
                    pair = (x, y, z + m, np.int64(1))
                    one, other = _look(pair, near, known, back, boxes, distance)
                    nearest[n + m] = value[one]
                    if m + 1 < size - 1:
                        nearest[n + m + 1] = value[other]
            n += size
            z += size


@njit(cache=True, nogil=True)
def _look(ends: Any, near: Any, known: Any, back: Any, boxes: Any, distance: Any) -> Any:
    """Return the bones of a cube in which two voxels are deepest, or to which they are nearest.

    `ends`: the one, and how much farther along z the other is. Beyond its box a bone is as far as
    at the rim.
    """
    x, y, z, more = ends
    cube, bones = near
    best, best_more = _NONE, _NONE
    for n in range(bones):
        b = np.int64(known[cube, n])
        ni, nj, nk = boxes[b, 1], boxes[b, 2], boxes[b, 3]
        u = back[b, 0] * x + back[b, 1] * y
        v = back[b, 4] * x + back[b, 5] * y
        w = back[b, 8] * x + back[b, 9] * y
        i = min(max(int(u + back[b, 2] * z + back[b, 3]), 0), ni - 1)
        j = min(max(int(v + back[b, 6] * z + back[b, 7]), 0), nj - 1)
        k = min(max(int(w + back[b, 10] * z + back[b, 11]), 0), nk - 1)
        there = distance[boxes[b, 0] + (i * nj + j) * nk + k]
        best = min(best, np.int64(there) << 8 | b)
        i = min(max(int(u + back[b, 2] * (z + more) + back[b, 3]), 0), ni - 1)
        j = min(max(int(v + back[b, 6] * (z + more) + back[b, 7]), 0), nj - 1)
        k = min(max(int(w + back[b, 10] * (z + more) + back[b, 11]), 0), nk - 1)
        there = distance[boxes[b, 0] + (i * nj + j) * nk + k]
        best_more = min(best_more, np.int64(there) << 8 | b)
    return (
        -1 if best == _NONE else best & 255,
        -1 if best_more == _NONE else best_more & 255,
    )


@njit(cache=True, nogil=True, inline="always")
def _cubes_around(lines: Any) -> Any:
    """Return the first corner of the voxels' box, and how many cubes cover it."""
    low = (lines[0, X], lines[0, Y], lines[0, Z])
    high = low
    for n in range(len(lines)):
        x, y, z = lines[n, X], lines[n, Y], lines[n, Z]
        low = (min(low[0], x), min(low[1], y), min(low[2], z))
        high = (max(high[0], x), max(high[1], y), max(high[2], z + lines[n, LENGTH] - 1))
    return low, (
        (high[0] - low[0]) // _CUBE + 1,
        (high[1] - low[1]) // _CUBE + 1,
        (high[2] - low[2]) // _CUBE + 1,
    )


@njit(cache=True, nogil=True, inline="always")
def _bound(middle: Any, radius: Any, back: Any, boxes: Any, distance: Any, bounds: Any) -> None:
    """Write how near a ball each bone may be; infinity for a bone that is nowhere the nearest."""
    unit, lower = bounds
    x, y, z = middle
    least = _FULL
    change = unit * (radius + _SLACK) + 1.0  # and of rounding to a 127th
    for b in range(len(back)):
        lower[b] = np.inf
        u = back[b, 0] * x + back[b, 1] * y + back[b, 2] * z + back[b, 3]
        v = back[b, 4] * x + back[b, 5] * y + back[b, 6] * z + back[b, 7]
        w = back[b, 8] * x + back[b, 9] * y + back[b, 10] * z + back[b, 11]
        nu, nv, nw = boxes[b, 1], boxes[b, 2], boxes[b, 3]
        if min(u, v, w) < -radius or max(u - nu, v - nv, w - nw) > radius or nw == 0:
            continue
        i = min(max(int(u), 0), nu - 1)
        j = min(max(int(v), 0), nv - 1)
        k = min(max(int(w), 0), nw - 1)
        there = distance[boxes[b, 0] + (i * nv + j) * nw + k]
        lower[b] = there - change
        least = min(least, there + change)
    for b in range(len(back)):
        if lower[b] > least:
            lower[b] = np.inf


@njit(cache=True, nogil=True, inline="always")
def _choose(lower: Any, known: Any, cube: Any) -> Any:
    """Write the bones that may be the nearest somewhere in a cube; return how many they are."""
    near = 0
    for b in range(len(lower)):
        if lower[b] < np.inf:
            known[cube, near] = b
            near += 1
    return near
