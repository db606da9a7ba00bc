"""From where on a straight line to a camera meets nothing of a hull.

The camera sees all of the line in one direction; so once the line is nearer to it than all of the
surface in and around that direction, nothing can block it. How near the surface is in each
direction is told by a depth buffer (Catmull 1974) as fine as the voxels; a cell of it knows the
nearest of itself and the eight around, which hold all of a voxel whose center is in the cell.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

_RADIUS = np.sqrt(0.75)
"""From a voxel's center to its corner [voxels]."""

_ROUNDING = 1e-2
"""Bound of the rounding errors of depths in single precision [voxels]. At a depth of 10,000 voxels
these are 0.001."""

_REACH = np.sqrt(2.75) + _ROUNDING
"""From a voxel's center to the farthest corner of a neighbor [voxels]. With rounding."""

_SAVED = _REACH - _RADIUS - _ROUNDING
"""How much later a line may be clear where neighbors of the surface do not matter [voxels]."""

_NEAREST = 2.0
"""How far before a camera a hull must be, for its directions to be told apart [voxels]. Chosen by
eye; not measured."""

_COARSER = 1.001
"""How much larger a cell is than a voxel's image at most [factor]. The 0.1 % are for rounding."""

_MARGIN = 2.0
"""How many cells are added on each side [cells]. The eight cells around each one are looked at, and
rounding takes less than another."""

_NOT_ZERO = 1e-9
"""What divides at least, where a divisor may be 0 [number]."""


def clear_shares(
    place: NDArray[np.int64],
    start: NDArray[np.float64],
    cameras: NDArray[np.float64],
    shape: tuple[int, ...],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return from which share of its way on a line to a camera surely meets nothing.

    That is, no voxel that is on the surface or, where the line leaves one, beside it; of those on
    the surface alone it meets none from a little earlier on.

    Parameters
    ----------
    place : (surface voxel, 3) int64
        Index in a crop of all voxels of the surface.
    start : (line, 3) float64
        Where the lines begin, in the crop, in voxels.
    cameras : (camera, 3) float64
        Where they end.
    shape
        Of the crop.

    Returns
    -------
    share : (camera, line) float32
        0 or less where all of the line does; 1 where nothing is known. Of a line that begins
        outside the crop it says nothing.
    saved : (camera,) float32
        What may be taken from the shares of known lines, where they need not tell of voxels
        beside the surface.
    """
    voxels, starts = (np.ascontiguousarray(each.T, np.float64) for each in (place, start))
    share = np.ones((len(cameras), len(start)), np.float32)
    saved = np.zeros(len(cameras), np.float32)
    for c, camera in enumerate(cameras):
        axes, cells, deepest = _look_at(camera, np.array(shape, np.float64))
        if cells[2] > 0.0:
            _find_shares(voxels, starts, camera, (axes, cells), share[c])
            saved[c] = _SAVED / deepest
    return share, saved


@njit(cache=True, nogil=True)
def _look_at(camera: Any, shape: Any) -> Any:
    """Return axes (3, 3), the last one towards a crop; and what divides what is seen of it.

    These are where cells begin in both directions, how many go to a slope of 1 (0: the camera is
    not before the crop), and how many there are in both directions. And how deep the crop goes.
    """
    axes = np.zeros((3, 3))
    for k in range(3):
        axes[2, k] = (shape[k] - 1.0) / 2.0 - camera[k]
    _shorten(axes[2])
    least = 0
    for k in range(1, 3):
        if abs(axes[2, k]) < abs(axes[2, least]):
            least = k
    away = np.zeros(3)
    away[least] = 1.0
    _put_across(axes[2], away, axes[0])
    _shorten(axes[0])
    _put_across(axes[2], axes[0], axes[1])
    nearest, deepest, wide = np.inf, 0.0, -np.inf  # wide: the slope at which a voxel covers most
    low, high = np.empty(2), np.empty(2)
    low[0] = low[1] = np.inf
    high[0] = high[1] = -np.inf
    for corner in range(8):
        seen = np.zeros(3)
        for k in range(3):
            side = shape[k] - 0.5 if corner >> k & 1 else -0.5
            for a in range(3):
                seen[a] += axes[a, k] * (side - camera[k])
        nearest, deepest = min(nearest, seen[2]), max(deepest, seen[2])
        for k in range(2):
            slope = seen[k] / max(seen[2], _NEAREST)
            low[k], high[k] = min(low[k], slope), max(high[k], slope)
            wide = max(wide, -slope, slope)
    if nearest < _NEAREST:
        return axes, (0.0, 0.0, 0.0, 0, 0), deepest
    fine = (nearest - _RADIUS) / (_COARSER * _RADIUS * np.sqrt(1.0 + wide**2))
    left, top = low[0] * fine - _MARGIN, low[1] * fine - _MARGIN
    right, bottom = high[0] * fine + _MARGIN, high[1] * fine + _MARGIN
    return axes, (left, top, fine, int(right - left), int(bottom - top)), deepest


@njit(cache=True, nogil=True)
def _shorten(vector: Any) -> None:
    """Make the length of a vector (3,) 1."""
    length = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    for k in range(3):
        vector[k] /= max(length, _NOT_ZERO)


@njit(cache=True, nogil=True)
def _put_across(one: Any, other: Any, across: Any) -> None:
    """Write (3,) what is at right angles to two vectors, as numpy's cross, which compiles long."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        across[k] = one[i] * other[j] - one[j] * other[i]


@njit(cache=True, nogil=True)
def _find_shares(place: Any, start: Any, camera: Any, view: Any, share: Any) -> None:
    """Write from which share on the lines to a camera are clear."""
    rows, columns = view[1][3:]
    cells = rows * columns
    most = max(place.shape[1], start.shape[1])
    cell, depth = np.empty(most, np.int32), np.empty(most, np.float32)
    nearest = np.full(cells, np.float32(np.inf))
    _see(place, camera, view, cell, depth)
    for n in range(place.shape[1]):
        if depth[n] < nearest[cell[n]]:
            nearest[cell[n]] = depth[n]
    beside = np.full(cells, np.float32(np.inf))
    _take_least(nearest, columns, beside)
    _take_least(beside, 1, nearest)
    _see(start, camera, view, cell, depth)
    for n in range(start.shape[1]):
        there = nearest[min(max(cell[n], 0), cells - 1)]
        share[n] = np.float32(1.0) - (there - np.float32(_REACH)) / depth[n]


@njit(cache=True, nogil=True)
def _take_least(values: Any, step: Any, least: Any) -> None:
    """Write the least of each value and those a step before and after, but at the ends."""
    before, middle, after = values[: -2 * step], values[step:-step], values[2 * step :]
    inner = least[step:-step]
    for n in range(len(inner)):  # without a branch, so that it is vectorized
        one = before[n] if before[n] < after[n] else after[n]
        inner[n] = middle[n] if middle[n] < one else one


@njit(cache=True, nogil=True, error_model="numpy")
def _see(point: Any, camera: Any, view: Any, cell: Any, depth: Any) -> None:
    """Write in which cell points, (3, point), are seen, and how deep."""
    axes, (row, column, fine, _, columns) = view
    a, b, c = axes[0, 0] * fine, axes[0, 1] * fine, axes[0, 2] * fine
    d, e, f = axes[1, 0] * fine, axes[1, 1] * fine, axes[1, 2] * fine
    g, h, i = axes[2, 0], axes[2, 1], axes[2, 2]
    left, below, behind = camera[0], camera[1], camera[2]
    for n in range(point.shape[1]):
        x, y, z = point[0, n] - left, point[1, n] - below, point[2, n] - behind
        deep = g * x + h * y + i * z
        near = 1.0 / deep
        u, v = (a * x + b * y + c * z) * near - row, (d * x + e * y + f * z) * near - column
        cell[n] = np.int32(u) * columns + np.int32(v)
        depth[n] = deep
