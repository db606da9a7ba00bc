"""Regions of labeled voxels: the largest region of a label, growing (3.4.1, 3.4.3).

Voxels are neighbors when they share a face. A frame's voxels are lines along z; a stretch is a part
of a line with one label. Stretches are joined to those that they touch in the columns before them,
so that regions are found without looking at voxels. Only voxels without a label are asked for their
neighbors.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.labels.nearest import fill_from_nearest
from tasks.engine.kernels import njit
from tasks.geometry.voxel_lines import FIRST, LENGTH, VoxelLines, X, Y, Z

NOBODY = -1
"""The region of a voxel that is in no region, and the neighbor where there is none."""

_X, _Y, _Z, _END, _VALUE, _VOXEL = range(6)
"""The numbers of a stretch: where it begins, the z after its last voxel, its label, and the place
of its first voxel in the list."""


def clean_labels(label: NDArray[np.integer], lines: VoxelLines) -> NDArray[np.uint8]:
    """Return labels of which each is one connected region (digitization paper, 3.4.3).

    Each label's largest region stays, of equally large ones the first, and every other voxel takes
    the nearest label that it is connected to, counted in steps from neighbor to neighbor; of
    equally near labels the first towards -z, +z, -y, +y, -x, +x. What is connected to no such
    region, a piece of the hull apart from the rest, takes the label of the nearest labeled voxel:
    only there a label has a second region.

    Parameters
    ----------
    label : (voxel,) int
        1 to 255; 0 is not decided.
    lines
        The voxels.

    Raises
    ------
    ValueError
        If labels and voxels do not fit, or a label is out of range.
    """
    label = np.asarray(label)
    if label.shape != (lines.voxels,):
        raise ValueError(
            f"{label.shape} labels and {lines.voxels} voxels do not fit; pass a label for each"
        )
    is_small = label.dtype == np.uint8 or not len(label)
    if not (is_small or (label.min() >= 0 and label.max() <= 255)):
        raise ValueError(
            f"labels from {label.min()} to {label.max()} are no labels; pass 0 (none) to 255"
        )
    clean = label.astype(np.uint8)
    left = _clean(clean, lines.table)
    if 0 < left < len(clean):
        fill_from_nearest(clean, lines)
    return clean


def find_regions_of(
    label: NDArray[np.uint8], lines: VoxelLines
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray]:
    """Return the connected regions of labels, as the kernels of this module know them.

    Parameters
    ----------
    label : (voxel,) uint8
        0 is in no region.
    lines
        The voxels, at least one.

    Returns
    -------
    stretch : (stretch, 6) int32
        x, y, z where each stretch of one label begins, the z after its last voxel, its label, and
        the place of its first voxel in the list.
    column : (column + 1,) int32
        The first stretch of each column, and their number.
    beside : (column, 4) int32
        The columns around each, -1 where there is none.
    region : (stretch,) int32
        -1 without a label.
    size : (region,) int64
        Voxels.
    """
    return _find_regions_of(label, lines.table)


@njit(cache=True, nogil=True)
def _find_regions_of(label: Any, lines: Any) -> Any:
    """Return stretches, columns, columns around, regions and their sizes."""
    stretch = _find_stretches(label, lines)
    column, beside = _find_columns(stretch)
    region, size = _find_regions(stretch, column, beside)
    return stretch, column, beside, region, size


@njit(cache=True, nogil=True)
def _clean(label: Any, lines: Any) -> Any:
    """Keep each label's largest region, let it grow; return how many voxels it does not reach."""
    stretch, column, beside, region, size = _find_regions_of(label, lines)
    largest = np.full(256, NOBODY, np.int64)
    seen = 0
    for s in range(len(stretch)):
        if region[s] == seen:  # its first stretch
            best = largest[stretch[s, _VALUE]]
            if best < 0 or size[seen] > size[best]:
                largest[stretch[s, _VALUE]] = seen
            seen += 1
    waiting = np.int64(0)
    for s in range(len(stretch)):
        if region[s] < 0 or region[s] != largest[stretch[s, _VALUE]]:
            count = stretch[s, _END] - stretch[s, _Z]
            label[stretch[s, _VOXEL] : stretch[s, _VOXEL] + count] = 0
            stretch[s, _VALUE] = 0
            waiting += count
    if waiting == 0:
        return 0
    voxel, around = _find_neighbors(stretch, column, beside, waiting)
    return _grow(label, voxel, around)


@njit(cache=True, nogil=True, inline="always")
def _find_stretches(label: Any, lines: Any) -> Any:
    """Return the stretches of one label along z, in order."""
    turn = np.empty(len(label) + 1, np.int32)  # voxels with another label than the one before
    turns = 0
    for n in range(1, len(label)):
        turn[turns] = n  # without a branch: one in twelve is kept
        turns += label[n] != label[n - 1]
    turn[turns] = len(label)
    stretch = np.empty((len(lines) + turns, 6), np.int32)
    s = t = 0
    for line in range(len(lines)):
        n, z = lines[line, FIRST], lines[line, Z] - lines[line, FIRST]
        end = n + lines[line, LENGTH]
        while n < end:
            here, n = n, min(turn[t], end)
            t += turn[t] == n
            stretch[s, _X], stretch[s, _Y] = lines[line, X], lines[line, Y]
            stretch[s, _Z], stretch[s, _END] = z + here, z + n
            stretch[s, _VALUE], stretch[s, _VOXEL] = label[here], here
            s += 1
    return stretch[:s]


@njit(cache=True, nogil=True, inline="always")
def _find_columns(stretch: Any) -> Any:
    """Return the first stretch of each column (one more at the end), and the columns around it."""
    column = np.empty(len(stretch) + 1, np.int32)
    count = 0
    for s in range(len(stretch)):
        if s == 0 or stretch[s, _Y] != stretch[s - 1, _Y] or stretch[s, _X] != stretch[s - 1, _X]:
            column[count] = s
            count += 1
    column[count] = len(stretch)
    beside = np.full((count, 4), NOBODY, np.int32)
    back = 0
    for c in range(count):
        x, y = stretch[column[c], _X], stretch[column[c], _Y]
        if c and stretch[column[c - 1], _X] == x and stretch[column[c - 1], _Y] == y - 1:
            beside[c, 0], beside[c - 1, 1] = c - 1, c
        while stretch[column[back], _X] < x - 1 or (
            stretch[column[back], _X] == x - 1 and stretch[column[back], _Y] < y
        ):
            back += 1
        if stretch[column[back], _X] == x - 1 and stretch[column[back], _Y] == y:
            beside[c, 2], beside[back, 3] = back, c
    return column[: count + 1], beside


@njit(cache=True, nogil=True, inline="always")
def _find_regions(stretch: Any, column: Any, beside: Any) -> Any:
    """Return the region of each stretch, -1 without label, and the regions' sizes."""
    first = np.arange(len(stretch)).astype(np.int32)  # of stretches that are joined
    for c in range(len(beside)):
        for k in (0, 2):
            if beside[c, k] >= 0:
                _join(stretch, column, c, beside[c, k], first)
    region = np.full(len(stretch), NOBODY, np.int32)
    size = np.zeros(len(stretch), np.int64)
    count = 0
    for s in range(len(stretch)):
        if stretch[s, _VALUE] == 0:
            continue
        if first[s] == s:
            region[s] = count
            count += 1
        else:  # it was joined to an earlier one, which has its region by now
            region[s] = region[first_of(first, s)]
        size[region[s]] += stretch[s, _END] - stretch[s, _Z]
    return region, size[:count]


@njit(cache=True, nogil=True, inline="always")
def _join(stretch: Any, column: Any, own: Any, other: Any, first: Any) -> None:
    """Join the stretches of two columns that touch and have one label."""
    begin, end = column[other], column[other + 1]
    for s in range(column[own], column[own + 1]):
        z, stop, value = stretch[s, _Z], stretch[s, _END], stretch[s, _VALUE]
        while begin < end and stretch[begin, _END] <= z:
            begin += 1
        t = begin
        while t < end and stretch[t, _Z] < stop:
            if value and stretch[t, _VALUE] == value and first[s] != first[t]:
                a, b = first_of(first, s), first_of(first, t)
                first[max(a, b)] = min(a, b)
            t += 1


@njit(cache=True, nogil=True)
def first_of(first: Any, one: Any) -> Any:
    """Return the first of the things that one was joined with, and shorten the way there."""
    while first[one] != one:
        first[one] = first[first[one]]
        one = first[one]
    return one


@njit(cache=True, nogil=True, inline="always")
def _find_neighbors(stretch: Any, column: Any, beside: Any, count: Any) -> Any:
    """Return the voxels without a label, and the neighbors of each in all six directions."""
    voxel, around = np.empty(count, np.int32), np.full((count, 6), NOBODY, np.int32)
    begin = 0
    for c in range(len(beside)):
        for s in range(column[c], column[c + 1]):
            if stretch[s, _VALUE]:
                continue
            size = stretch[s, _END] - stretch[s, _Z]
            for n in range(size):
                voxel[begin + n] = stretch[s, _VOXEL] + n
                around[begin + n, 0] = stretch[s, _VOXEL] + n - 1
                around[begin + n, 1] = stretch[s, _VOXEL] + n + 1
            if s == column[c] or stretch[s - 1, _END] != stretch[s, _Z]:
                around[begin, 0] = NOBODY
            if s == column[c + 1] - 1 or stretch[s + 1, _Z] != stretch[s, _END]:
                around[begin + size - 1, 1] = NOBODY
            for k in range(4):
                if beside[c, k] >= 0:
                    part = (column[beside[c, k]], column[beside[c, k] + 1])
                    _write_beside(stretch, s, part, around, begin, 2 + k)
            begin += size
    return voxel, around


@njit(cache=True, nogil=True, inline="always")
def _write_beside(stretch: Any, own: Any, part: Any, around: Any, begin: Any, way: Any) -> None:
    """Write which voxels of a column are beside those of a stretch."""
    z, end = stretch[own, _Z], stretch[own, _END]
    for t in range(part[0], part[1]):
        low = max(z, stretch[t, _Z])
        for n in range(min(end, stretch[t, _END]) - low):
            around[begin + low - z + n, way] = stretch[t, _VOXEL] + low - stretch[t, _Z] + n


@njit(cache=True, nogil=True, inline="always")
def _grow(label: Any, voxel: Any, around: Any) -> Any:
    """Write labels into voxels that have none, ring by ring; return how many are not reached."""
    waiting = np.arange(len(voxel))
    found = np.empty(len(voxel), np.uint8)
    left = len(voxel)
    changed = True
    while changed:
        changed = False
        for n in range(left):
            found[n] = 0
            for k in range(6):
                other = around[waiting[n], k]
                if other >= 0 and label[other]:
                    found[n] = label[other]
                    break
        still = 0
        for n in range(left):
            if found[n]:
                label[voxel[waiting[n]]] = found[n]
                changed = True
            else:
                waiting[still] = waiting[n]
                still += 1
        left = still
    return left
