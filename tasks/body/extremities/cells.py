"""Gather the surface of a frame into cells: sums in balls, ways along it, its ends.

An end is a place that is farther along the surface from the middle than all places around it (the
geodesic extrema of Plagemann et al. 2010).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

Floats = NDArray[np.float64]

_RIM = 6
"""Width of the rim of empty cells around the surface [cells]. Peaks are compared with cells two
beyond it; the rest is room for balls."""

_SHORTER = 1e-9
"""How much shorter a way must be to replace another [m]. It keeps rounding from looping."""


@dataclass(frozen=True, eq=False)
class Cells:
    """The surface, gathered into cells."""

    place: NDArray[np.int32]
    """(cell, 3) place in a box with a rim of empty cells. Cells are in order of x, then y, then
    z."""
    column: NDArray[np.int32]
    """(x, y + 1) how many cells are before a column along z. Columns side by side along y are
    together."""
    size_m: float
    center: Floats
    """(cell, 3) mean of its voxels, metres."""
    count: Floats
    """(cell,) how many voxels."""
    mass: Floats
    """(table, cell) sums of the ratios."""
    hot: Floats
    """(table, cell) sums of the ratios above 0."""
    hot_center: Floats
    """(table, cell, 3) mean of the voxels with a ratio above 0, each weighed with it."""


def gather_cells(place: Floats, ratio: Floats, size_m: float) -> Cells:
    """Gather surface voxels into cells.

    Parameters
    ----------
    place : (voxel, 3) float64
        Metres; at least one.
    ratio : (table, voxel) float64
        What is summed.
    size_m
        Edge of a cell.
    """
    place, ratio = np.ascontiguousarray(place, np.float64), np.ascontiguousarray(ratio, np.float64)
    cell, where, column = _divide(place, float(size_m))
    count, tables = len(where), len(ratio)
    center, voxels = np.zeros((count, 3)), np.zeros(count)
    mass, hot = np.zeros((2, tables, count))
    hot_center = np.zeros((tables, count, 3))
    _add(cell, place, center, voxels)
    for table in range(tables):
        _weigh(cell, place, ratio[table], mass[table], hot[table], hot_center[table])
    _divide_sums(center, voxels, hot, hot_center)
    return Cells(where, column, size_m, center, voxels, mass, hot, hot_center)


def sum_balls(
    cells: Cells,
    near: NDArray[np.intp],
    place: Floats,
    radius_m: float,
    weighed: tuple[Floats, Floats, Floats],
) -> tuple[Floats, Floats]:
    """Return the mass in balls, and the weighted middle of each.

    Parameters
    ----------
    cells
        The surface.
    near : (ball,) intp
        A cell near each ball's center.
    place : (ball, 3) float64
        The centers.
    radius_m
        Of all balls.
    weighed : (cell, 3), (cell,), (cell,) float64
        Centers, masses and weights of the cells.

    Returns
    -------
    (ball,) float64
        The mass in each.
    (ball, 3) float64
        The weighted middle; the center where nothing has weight.
    """
    mass, middle = np.empty(len(near)), np.empty((len(near), 3))
    where = cells.place[near] + (place - cells.center[near]) / cells.size_m
    _sum_balls(cells.column, weighed, place, where, (radius_m, cells.size_m), (mass, middle))
    return mass, middle


def find_ends(cells: Cells, least_m: float, apart_m: float, most: int) -> NDArray[np.intp]:
    """Return (end,) the last cells of the surface's ends, the farthest from the middle first.

    Parameters
    ----------
    cells
        The surface.
    least_m
        Least way from the middle.
    apart_m
        Least distance of two ends.
    most
        Most ends.
    """
    root = _find_middle(cells.center)
    beside, length, count = _find_neighbors(cells.place, cells.column, cells.center)
    way = _spread(beside, length, count, root)
    peaks = _mark_peaks(cells.place, cells.column, (beside, count), way)
    peaks &= way > least_m
    ends = np.flatnonzero(peaks)
    return ends[choose_apart(cells.center[ends], way[ends], apart_m, most)]


def choose_apart(place: Floats, likelihood: Floats, apart_m: float, most: int) -> NDArray[np.intp]:
    """Return which places are most likely and farther than `apart_m` from each other.

    At most `most` are chosen, the likeliest first, of equals the first.
    """
    chosen = np.empty(most, np.intp)
    order = np.argsort(-likelihood, kind="stable")
    return chosen[: _choose(np.ascontiguousarray(place), order, apart_m, chosen)]


@njit(cache=True, nogil=True)
def _choose(place: Any, order: Any, apart: Any, chosen: Any) -> Any:
    """Write the places that are apart from all before them; return how many they are."""
    found = 0
    for n in order:
        near = False
        for k in range(found):
            x, y, z = (
                place[chosen[k], 0] - place[n, 0],
                place[chosen[k], 1] - place[n, 1],
                place[chosen[k], 2] - place[n, 2],
            )
            near |= not np.sqrt(x * x + y * y + z * z) > apart
        if not near and found < len(chosen):
            chosen[found] = n
            found += 1
    return found


@njit(cache=True, nogil=True)
def _divide(place: Any, size: Any) -> Any:
    """Return each voxel's cell, the cells' places in their box, and the box's columns."""
    index = np.empty(place.shape, np.int32)
    low, high = np.full(3, 2**31 - 1), np.full(3, -(2**31))
    for v in range(len(place)):
        for k in range(3):
            index[v, k] = np.floor(place[v, k] / size)
            low[k], high[k] = min(low[k], index[v, k]), max(high[k], index[v, k])
    nx, ny, nz = high - low + 1  # without the rim
    number = np.full(nx * ny * nz, -1, np.int32)
    flat = np.empty(len(place), np.int32)
    for v in range(len(place)):
        x, y, z = index[v, 0] - low[0], index[v, 1] - low[1], index[v, 2] - low[2]
        flat[v] = (x * ny + y) * nz + z
        number[flat[v]] = 0
    column = np.zeros((nx + 2 * _RIM, ny + 2 * _RIM + 1), np.int32)
    where = np.empty((len(place), 3), np.int32)
    count = 0
    for x in range(nx):
        column[_RIM + x, :_RIM] = count
        for y in range(ny):
            column[_RIM + x, _RIM + y] = count
            begin = (x * ny + y) * nz
            for z in range(nz):
                if number[begin + z] == 0:
                    number[begin + z] = count
                    where[count, 0], where[count, 1] = _RIM + x, _RIM + y
                    where[count, 2] = _RIM + z
                    count += 1
        column[_RIM + x, _RIM + ny :] = count
    column[_RIM + nx :] = count
    for v in range(len(place)):
        flat[v] = number[flat[v]]
    return flat, where[:count].copy(), column


@njit(cache=True, nogil=True)
def _add(cell: Any, place: Any, center: Any, voxels: Any) -> None:
    """Sum voxels into their cells: places, and how many."""
    for v in range(len(cell)):
        c = cell[v]
        for k in range(3):
            center[c, k] += place[v, k]
        voxels[c] += 1.0


@njit(cache=True, nogil=True)
def _divide_sums(center: Any, voxels: Any, hot: Any, hot_center: Any) -> None:
    """Turn sums into means. A cell without a ratio above 0 gets the mean of all its voxels."""
    for c in range(len(center)):
        for k in range(3):
            center[c, k] /= voxels[c]
            for table in range(len(hot)):
                if hot[table, c] > 0.0:
                    hot_center[table, c, k] /= hot[table, c]
                else:
                    hot_center[table, c, k] = center[c, k]


@njit(cache=True, nogil=True)
def _weigh(cell: Any, place: Any, ratio: Any, mass: Any, hot: Any, hot_place: Any) -> None:
    """Sum ratios into cells, those above 0, and places weighed with these."""
    for v in range(len(cell)):
        c, own = cell[v], ratio[v]
        mass[c] += own
        if own > 0.0:
            hot[c] += own
            for k in range(3):
                hot_place[c, k] += own * place[v, k]


@njit(cache=True, nogil=True)
def _sum_balls(column: Any, weighed: Any, wanted: Any, where: Any, sizes: Any, sums: Any) -> None:
    """Sum the mass of the cells in balls, and find their weighted middle.

    `weighed`: centers, masses and weights of the cells; `wanted` and `where`: each ball's center,
    and where in the box of cells that is; `sizes`: radius of balls and size of a cell. Written are
    masses and middles, the center where there is no weight.
    """
    center, mass, weight = weighed
    total, middle = sums
    radius, size = sizes
    reach = radius / size
    inside = np.empty(len(center), np.int32)
    for s in range(len(wanted)):
        # a cell's middle is anywhere in it: it may be one cell nearer than its place says
        x0, y0 = where[s, 0], where[s, 1]
        whole = sum_weight = mx = my = mz = 0.0
        x1, x2 = int(np.ceil(x0 - reach - 1.0)), int(x0 + reach + 1.0)
        for x in range(max(x1, 0), min(x2 + 1, len(column))):
            left = np.sqrt(max(reach**2 - max(abs(x - x0) - 1.0, 0.0) ** 2, 0.0))
            y1 = max(int(np.ceil(y0 - left - 1.0)), 0)
            y2 = min(int(y0 + left + 1.0) + 1, column.shape[1] - 1)
            near = 0
            for n in range(column[x, min(y1, y2)], column[x, max(y2, 0)]):
                dx = center[n, 0] - wanted[s, 0]
                dy = center[n, 1] - wanted[s, 1]
                dz = center[n, 2] - wanted[s, 2]
                inside[near] = n  # without a branch: one in four is kept
                near += dx * dx + dy * dy + dz * dz < radius * radius
            for n in inside[:near]:
                whole += mass[n]
                sum_weight += weight[n]
                mx += weight[n] * center[n, 0]
                my += weight[n] * center[n, 1]
                mz += weight[n] * center[n, 2]
        total[s] = whole
        for k in range(3):
            middle[s, k] = wanted[s, k]
        if sum_weight > 0.0:
            middle[s, 0] = mx / sum_weight
            middle[s, 1] = my / sum_weight
            middle[s, 2] = mz / sum_weight


@njit(cache=True, nogil=True)
def _find_middle(center: Any) -> Any:
    """Return the cell that is nearest to the median of all."""
    middle = (np.median(center[:, 0]), np.median(center[:, 1]), np.median(center[:, 2]))
    root, least = 0, np.inf
    for cell in range(len(center)):
        x, y, z = (
            center[cell, 0] - middle[0],
            center[cell, 1] - middle[1],
            center[cell, 2] - middle[2],
        )
        way = np.sqrt(x * x + y * y + z * z)
        if way < least:
            root, least = cell, way
    return root


@njit(cache=True, nogil=True)
def _find_neighbors(where: Any, column: Any, center: Any) -> Any:
    """Return each cell's neighbors in order (cell, 26), how far they are, and how many it has.

    Each pair is found once, from the cell that comes first.
    """
    beside, length = np.empty((len(where), 26), np.int32), np.empty((len(where), 26))
    count = np.zeros(len(where), np.int32)
    begin = np.zeros(4, np.int32)  # in each column, the first cell that is not far below
    for cell in range(len(where)):
        x, y, z = where[cell, 0], where[cell, 1], where[cell, 2]
        if cell == column[x, y]:
            begin[0] = column[x, y + 1]
            for k in range(3):
                begin[1 + k] = column[x + 1, y - 1 + k]
        if cell + 1 < column[x, y + 1] and where[cell + 1, 2] == z + 1:
            _join(cell, cell + 1, center, beside, length, count)
        for k in range(4):
            n, end = begin[k], column[x, y + 2] if k == 0 else column[x + 1, y + k - 1]
            while n < end and where[n, 2] < z - 1:
                n += 1
            begin[k] = n
            while n < end and where[n, 2] <= z + 1:
                _join(cell, n, center, beside, length, count)
                n += 1
    return beside, length, count


@njit(cache=True, nogil=True)
def _join(cell: Any, other: Any, center: Any, beside: Any, length: Any, count: Any) -> None:
    """Write two cells into each other's lists."""
    dx = center[other, 0] - center[cell, 0]
    dy = center[other, 1] - center[cell, 1]
    dz = center[other, 2] - center[cell, 2]
    own, its = count[cell], count[other]
    beside[cell, own], beside[other, its] = other, cell
    length[cell, own] = length[other, its] = np.sqrt(dx * dx + dy * dy + dz * dz)
    count[cell], count[other] = own + 1, its + 1


@njit(cache=True, nogil=True)
def _spread(beside: Any, length: Any, count: Any, root: Any) -> Any:
    """Return the length of the shortest way over neighboring cells from the root to each cell."""
    cells = len(count)
    way = np.full(cells, np.inf)
    queue = np.empty(cells, np.int32)
    waiting = np.zeros(cells, np.bool_)
    queue[0] = root
    waiting[root] = True
    way[root] = 0.0
    begin, left = 0, 1
    while left > 0:
        cell = queue[begin]
        begin = begin + 1 if begin + 1 < cells else 0
        left -= 1
        waiting[cell] = False
        for k in range(count[cell]):
            n = beside[cell, k]
            longer = way[cell] + length[cell, k]
            if longer < way[n] - _SHORTER:
                way[n] = longer
                if not waiting[n]:
                    waiting[n] = True
                    queue[(begin + left) % cells] = n
                    left += 1
    return way


@njit(cache=True, nogil=True)
def _mark_peaks(where: Any, column: Any, neighbors: Any, way: Any) -> Any:
    """Return which cells are reached and farther along the surface than all within two cells."""
    beside, count = neighbors
    peaks = np.empty(len(where), np.bool_)
    for cell in range(len(where)):
        own = way[cell]
        is_peak = np.isfinite(own)
        for k in range(count[cell]):  # most are no peak beside these
            is_peak &= not (way[beside[cell, k]] > own and np.isfinite(way[beside[cell, k]]))
        if is_peak:
            x0, y0, z0 = where[cell, 0], where[cell, 1], where[cell, 2]
            for x in range(x0 - 2, x0 + 3):
                for n in range(column[x, y0 - 2], column[x, y0 + 3]):
                    near = abs(where[n, 2] - z0) <= 2
                    is_peak &= not (near and way[n] > own and np.isfinite(way[n]))
        peaks[cell] = is_peak
    return peaks
