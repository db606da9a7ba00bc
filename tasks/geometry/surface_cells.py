"""The surface of a frame, gathered into cells: sums in balls, ways along it, its ends.

An end is a place farther along the surface from the middle than all around it (the geodesic
extrema of Plagemann et al. 2010).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_RIM = 6


@dataclass(frozen=True, eq=False)
class Cells:
    """The surface, gathered into cells."""

    place: NDArray[np.int64]
    """(cell, 3) in `number`, which has a rim of empty cells."""
    number: NDArray[np.int32]
    """(x, y, z) which cell, -1: none."""
    size_m: float
    center: Floats
    """(cell, 3) mean of its voxels."""
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
    index = np.floor(place / size_m).astype(np.int64)
    index -= index.min(axis=0) - _RIM
    shape = tuple(int(n) for n in index.max(axis=0) + _RIM + 1)
    flat = np.ravel_multi_index(tuple(index.T), shape)
    number = np.full(int(np.prod(shape)), -1, np.int32)
    number[flat] = 0
    kept = np.flatnonzero(number == 0)
    number[kept] = np.arange(len(kept), dtype=np.int32)
    tables = len(ratio)
    center, count = np.zeros((len(kept), 3)), np.zeros(len(kept))
    mass, hot = np.zeros((2, tables, len(kept)))
    hot_center = np.zeros((tables, len(kept), 3))
    _add(number[flat], place, ratio, (count, center), (mass, hot, hot_center))
    return Cells(
        np.stack(np.unravel_index(kept, shape), axis=1),
        number.reshape(shape),
        size_m,
        center,
        count,
        mass,
        hot,
        hot_center,
    )


def sum_balls(
    cells: Cells,
    near: NDArray[np.intp],
    place: Floats,
    radius_m: float,
    weighed: tuple[Floats, Floats, Floats],
) -> tuple[Floats, Floats]:
    """Return mass in balls, and their weighted middles.

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
    wanted = (near, place, radius_m, cells.size_m, mass, middle)
    _sum_balls(cells.number, cells.place, *weighed, wanted)
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
    root = int(np.argmin(distances(cells.center, np.median(cells.center, axis=0))))
    way = np.full(len(cells.place), np.inf)
    _spread(cells.number, cells.place, cells.center, root, way)
    peaks = np.empty(len(way), np.bool_)
    _mark_peaks(cells.number, cells.place, way, peaks)
    peaks &= way > least_m
    found: list[int] = []
    for cell in np.flatnonzero(peaks)[np.argsort(-way[peaks], kind="stable")]:
        if (distances(cells.center[found], cells.center[cell]) > apart_m).all():
            found.append(int(cell))
        if len(found) == most:
            break
    return np.array(found, np.intp)


def distances(points: Floats, point: Floats) -> Floats:
    """Return (point,) distances."""
    x, y, z = (points - point).T
    return np.sqrt(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def _add(cell: Any, place: Any, ratio: Any, plain: Any, weighed: Any) -> None:
    """Sum voxels into their cells, and divide to means: count and center; mass, hot, its center."""
    count, center = plain
    mass, hot, hot_center = weighed
    for v in range(len(cell)):
        c = cell[v]
        count[c] += 1.0
        for k in range(3):
            center[c, k] += place[v, k]
        for table in range(len(ratio)):
            mass[table, c] += ratio[table, v]
            if ratio[table, v] > 0.0:
                hot[table, c] += ratio[table, v]
                for k in range(3):
                    hot_center[table, c, k] += ratio[table, v] * place[v, k]
    for c in range(len(count)):
        for k in range(3):
            center[c, k] /= count[c]
            for table in range(len(ratio)):
                if hot[table, c] > 0.0:
                    hot_center[table, c, k] /= hot[table, c]
                else:
                    hot_center[table, c, k] = center[c, k]


@njit(cache=True, nogil=True)
def _sum_balls(number: Any, place: Any, center: Any, mass: Any, weight: Any, wanted: Any) -> None:
    """Sum the mass of the cells in balls, and find their weighted middle.

    `wanted`: a cell near each ball's center, the center, radius and size of a cell, and what is
    written: masses and middles, the center where there is no weight.
    """
    near, around, radius, size, total, middle = wanted
    reach = radius / size
    for s in range(len(near)):
        # a cell's middle is anywhere in it: it may be one cell nearer than its place says
        x0, y0, z0 = place[near[s]] + (around[s] - center[near[s]]) / size
        total[s] = 0.0
        sum_weight = mx = my = mz = 0.0
        x1, x2 = int(np.ceil(x0 - reach - 1.0)), int(x0 + reach + 1.0)
        for x in range(max(x1, 0), min(x2 + 1, number.shape[0])):
            left = np.sqrt(max(reach**2 - max(abs(x - x0) - 1.0, 0.0) ** 2, 0.0))
            y1, y2 = int(np.ceil(y0 - left - 1.0)), int(y0 + left + 1.0)
            for y in range(max(y1, 0), min(y2 + 1, number.shape[1])):
                rest = np.sqrt(max(left**2 - max(abs(y - y0) - 1.0, 0.0) ** 2, 0.0))
                z1, z2 = int(np.ceil(z0 - rest - 1.0)), int(z0 + rest + 1.0)
                for z in range(max(z1, 0), min(z2 + 1, number.shape[2])):
                    n = number[x, y, z]
                    if n < 0:
                        continue
                    dx = center[n, 0] - around[s, 0]
                    dy = center[n, 1] - around[s, 1]
                    dz = center[n, 2] - around[s, 2]
                    if dx * dx + dy * dy + dz * dz < radius * radius:
                        total[s] += mass[n]
                        sum_weight += weight[n]
                        mx += weight[n] * center[n, 0]
                        my += weight[n] * center[n, 1]
                        mz += weight[n] * center[n, 2]
        if sum_weight > 0.0:
            middle[s, 0] = mx / sum_weight
            middle[s, 1] = my / sum_weight
            middle[s, 2] = mz / sum_weight
        else:
            middle[s] = around[s]


@njit(cache=True, nogil=True)
def _spread(number: Any, place: Any, center: Any, root: Any, way: Any) -> None:
    """Write the length of the shortest way over neighboring cells from the root to each cell."""
    count = len(place)
    queue = np.empty(count, np.int32)
    waiting = np.zeros(count, np.bool_)
    queue[0] = root
    waiting[root] = True
    way[root] = 0.0
    first, length = 0, 1
    while length > 0:
        cell = queue[first]
        first = (first + 1) % count
        length -= 1
        waiting[cell] = False
        x0, y0, z0 = place[cell]
        for x in range(x0 - 1, x0 + 2):
            for y in range(y0 - 1, y0 + 2):
                for z in range(z0 - 1, z0 + 2):
                    n = number[x, y, z]
                    if n < 0 or n == cell:
                        continue
                    dx = center[n, 0] - center[cell, 0]
                    dy = center[n, 1] - center[cell, 1]
                    dz = center[n, 2] - center[cell, 2]
                    longer = way[cell] + np.sqrt(dx * dx + dy * dy + dz * dz)
                    if longer < way[n] - 1e-9:
                        way[n] = longer
                        if not waiting[n]:
                            waiting[n] = True
                            queue[(first + length) % count] = n
                            length += 1


@njit(cache=True, nogil=True)
def _mark_peaks(number: Any, place: Any, way: Any, peaks: Any) -> None:
    """Mark the cells that are reached and farther than each neighbor within two cells."""
    for cell in range(len(place)):
        peaks[cell] = np.isfinite(way[cell])
        x0, y0, z0 = place[cell]
        for x in range(x0 - 2, x0 + 3):
            if not peaks[cell]:
                break
            for y in range(y0 - 2, y0 + 3):
                for z in range(z0 - 2, z0 + 3):
                    n = number[x, y, z]
                    if n >= 0 and way[n] > way[cell] and np.isfinite(way[n]):
                        peaks[cell] = False
