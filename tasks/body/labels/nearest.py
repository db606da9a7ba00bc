"""The labeled voxel that is nearest to each of others, found column by column.

The voxel of a line along z that is nearest to a place is known at once. So columns are looked at
only as far as the nearest voxel found so far, however many voxels they hold. A place that is far
from all voxels is compared with boxes, each around some lines, the nearest box first.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.geometry.voxel_lines import FIRST, LENGTH, VoxelLines, X, Y, Z

_REACH = 10
"""How far around columns are looked at in the order of their distance [voxels]. Farther voxels are
few."""

_TOGETHER = 16
"""Lines in a box."""


def _columns_around() -> NDArray[np.int64]:
    """Return (column, 3) steps along x and y, and their squared length, the shortest first."""
    step = np.arange(-_REACH, _REACH + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(step, step, indexing="ij"))
    around = np.stack([x, y, x * x + y * y], axis=1)
    around = around[around[:, 2] <= _REACH**2]
    return around[np.argsort(around[:, 2], kind="stable")]


_AROUND = _columns_around()
"""(column, 3) the columns that are looked at."""

_BITS = 32
"""Bits of a key that hold the place in the list."""

_PLACE = 2**_BITS - 1
"""The bits of a key that hold the place."""

_FAR = 2**62
"""A key that is larger than every other."""


def copy_nearest(
    lines: VoxelLines, before: VoxelLines, label: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Return for each voxel the label of the nearest voxel of another frame.

    Of equally near voxels the first in order is taken.

    Parameters
    ----------
    lines
        The voxels.
    before
        The other frame's, at least one.
    label : (other voxel,) uint8
        1 to 255.
    """
    copied = np.empty(lines.voxels, np.uint8)
    _copy(lines.table, before.table, label, _AROUND, copied)
    return copied


def fill_from_nearest(label: NDArray[np.uint8], lines: VoxelLines) -> None:
    """Write the label of the nearest labeled voxel into each voxel with 0.

    Of equally near voxels the first in order is taken.

    Parameters
    ----------
    label : (voxel,) uint8
        0 on whole lines only, and not on all.
    lines
        The voxels.
    """
    _fill(lines.table, label, _AROUND)


@njit(cache=True, nogil=True)
def _copy(lines: Any, before: Any, label: Any, around: Any, copied: Any) -> None:
    """Write for each voxel the label of the nearest voxel of the other frame."""
    start, box = _columns_of(before)
    corners = _boxes_of(before)
    key = np.empty(_longest(lines), np.int64)
    for line in range(len(lines)):
        x, y, z = np.int64(lines[line, X]), np.int64(lines[line, Y]), np.int64(lines[line, Z])
        n = lines[line, FIRST]
        end = z + lines[line, LENGTH]
        old = last = 0
        if 0 <= x - box[0] < box[2] and 0 <= y - box[1] < box[3]:
            column = (x - box[0]) * box[3] + y - box[1]
            old, last = start[column], start[column + 1]
        while z < end:
            while old < last and before[old, Z] + before[old, LENGTH] <= z:
                old += 1
            stop = min(end, before[old, Z]) if old < last else end
            if z < stop:  # where nobody was
                size = stop - z
                voxel = (x, y, z, size)
                if not _find_nearest(voxel, before, start, box, around, key):
                    _find_far(voxel, before, corners, key)
                for k in range(size):
                    copied[n + k] = label[key[k] & _PLACE]
            else:
                stop = min(end, before[old, Z] + before[old, LENGTH])
                place = before[old, FIRST] + z - before[old, Z]
                for k in range(stop - z):
                    copied[n + k] = label[place + k]
            n += stop - z
            z = stop


@njit(cache=True, nogil=True)
def _fill(lines: Any, label: Any, around: Any) -> None:
    """Write the label of the nearest labeled voxel into each voxel of lines without labels."""
    is_lost = np.empty(len(lines), np.bool_)
    for line in range(len(lines)):
        is_lost[line] = label[lines[line, FIRST]] == 0
    labeled = lines[~is_lost]
    start, box = _columns_of(labeled)
    corners = _boxes_of(labeled)
    key = np.empty(_longest(lines), np.int64)
    for line in np.flatnonzero(is_lost):
        x, y, z = np.int64(lines[line, X]), np.int64(lines[line, Y]), np.int64(lines[line, Z])
        size, n = np.int64(lines[line, LENGTH]), lines[line, FIRST]
        voxel = (x, y, z, size)
        if not _find_nearest(voxel, labeled, start, box, around, key):
            _find_far(voxel, labeled, corners, key)
        for k in range(size):
            label[n + k] = label[key[k] & _PLACE]


@njit(cache=True, nogil=True)
def _longest(lines: Any) -> Any:
    """Return the length of the longest line."""
    most = 0
    for line in range(len(lines)):
        most = max(most, lines[line, LENGTH])
    return most


@njit(cache=True, nogil=True)
def _columns_of(lines: Any) -> Any:
    """Return the first line of each column of a box (one more at the end), and the box itself."""
    low, high = lines[0, Y], lines[0, Y]
    for line in range(len(lines)):
        low, high = min(low, lines[line, Y]), max(high, lines[line, Y])
    box = (lines[0, X], low, lines[-1, X] - lines[0, X] + 1, high - low + 1)
    start = np.empty(box[2] * box[3] + 1, np.int32)
    filled = 0
    for line in range(len(lines)):
        column = (lines[line, X] - box[0]) * box[3] + lines[line, Y] - box[1]
        while filled <= column:
            start[filled] = line
            filled += 1
    start[filled:] = len(lines)
    return start, box


@njit(cache=True, nogil=True)
def _boxes_of(lines: Any) -> Any:
    """Return (box, 6) the first and the last index along x, y and z of each group of lines."""
    corners = np.empty(((len(lines) - 1) // _TOGETHER + 1, 6), np.int32)
    corners[:, :3], corners[:, 3:] = 2**31 - 1, -(2**31)
    for line in range(len(lines)):
        own = corners[line // _TOGETHER]
        for k in range(3):
            last = lines[line, k] + (lines[line, LENGTH] - 1 if k == Z else 0)
            own[k], own[3 + k] = min(own[k], lines[line, k]), max(own[3 + k], last)
    return corners


@njit(cache=True, nogil=True)
def _find_nearest(voxels: Any, lines: Any, start: Any, box: Any, around: Any, key: Any) -> Any:
    """Write the keys of what is nearest to some voxels along z: the first, and how many.

    A key is the squared distance, then the place in the list: the least is the nearest, the first
    of equals. Return False where a line beyond the columns around may be as near.
    """
    x, y, z, size = voxels
    key[:size] = _FAR
    most = _FAR
    for k in range(len(around)):
        beside = around[k, 2] << _BITS
        if beside > most:
            return True
        i, j = x + around[k, 0] - box[0], y + around[k, 1] - box[1]
        if 0 <= i < box[2] and 0 <= j < box[3]:
            column = i * box[3] + j
            for line in range(np.int64(start[column]), np.int64(start[column + 1])):
                ahead = np.int64(z - lines[line, Z])
                gap = max(1 - ahead - size, ahead - lines[line, LENGTH] + 1)
                if gap <= 0 or beside + (gap * gap << _BITS) <= most:
                    most = _take_nearer(ahead, beside, lines, line, size, key)
    return False


@njit(cache=True, nogil=True)
def _find_far(voxels: Any, lines: Any, corners: Any, key: Any) -> None:
    """Write the keys of what is nearest to some voxels, as `_find_nearest`, among all lines."""
    x, y, z, size = voxels
    away = np.empty(len(corners), np.int64)
    for b in range(len(corners)):
        i = max(corners[b, X] - x, x - corners[b, 3 + X], 0)
        j = max(corners[b, Y] - y, y - corners[b, 3 + Y], 0)
        k = max(corners[b, Z] - z - size + 1, z - corners[b, 3 + Z], 0)
        away[b] = i * i + j * j + k * k
    nearest = np.argmin(away)
    most = _FAR
    for n in range(-1, len(corners)):
        b = nearest if n < 0 else n
        if away[b] << _BITS <= most:
            for line in range(b * _TOGETHER, min((b + 1) * _TOGETHER, len(lines))):
                i, j = np.int64(x - lines[line, X]), np.int64(y - lines[line, Y])
                ahead = np.int64(z - lines[line, Z])
                most = _take_nearer(ahead, (i * i + j * j) << _BITS, lines, line, size, key)


@njit(cache=True, nogil=True)
def _take_nearer(ahead: Any, beside: Any, lines: Any, line: Any, size: Any, key: Any) -> Any:
    """Write the keys of a line's voxels where they are less; return the largest key left."""
    most, last, place = np.int64(0), np.int64(lines[line, LENGTH] - 1), np.int64(lines[line, FIRST])
    for n in range(size):
        step = min(max(ahead + n, 0), last)
        away = ahead + n - step
        key[n] = min(key[n], beside + (away * away << _BITS) + place + step)
        most = max(most, key[n])
    return most
