"""Regions of a picture: remove what is too small, fill small holes, tell where a region is.

Connected pixels are found by joining the runs of each row with those of the row before (He, Chao
and Suzuki, "A run-based two-scan labeling algorithm", 2008), so that the cost is that of reading
the picture once, and a little for each run.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit


def clean_region(
    region: NDArray[np.uint8], least: tuple[float, float], cleaned: NDArray[np.bool_]
) -> None:
    """Write a region without its small components and with its small holes filled.

    Parameters
    ----------
    region : (row, column) uint8
        0 outside.
    least : (component, hole)
        Pixels that an 8-connected part must have to stay, and that a 4-connected hole must have
        to stay open. What reaches the border of the picture is no hole.
    cleaned : (row, column) bool
        Where it is written; every pixel is.
    """
    rows, columns = region.shape
    most = rows * (columns // 2 + 1)
    runs, area = np.empty((most, 4), np.int32), np.empty(most, np.int64)
    _remove_small_components(region, least[0], runs, area, cleaned)
    _fill_holes(least[1], runs, area, cleaned)


def box_around(region: NDArray[np.uint8], margin: int) -> tuple[slice, slice] | None:
    """Return the rows and columns of what is set, with a margin; None where nothing is."""
    rows = np.flatnonzero(np.bitwise_or.reduce(region, axis=1))
    if not len(rows):
        return None
    some = np.bitwise_or.reduce(region[rows[0] : rows[-1] + 1], axis=0)
    columns = np.flatnonzero(some)
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + 1 + margin),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + 1 + margin),
    )


@njit(cache=True, nogil=True)
def _remove_small_components(region: Any, least: Any, runs: Any, area: Any, cleaned: Any) -> None:
    """Write the parts of a region that have `least` pixels."""
    count = _find_runs(region, True, 1, runs)
    _measure(runs, count, area)
    cleaned[:] = False
    for n in range(count):
        if area[_root(runs, n)] >= least:
            cleaned[runs[n, 0], runs[n, 1] : runs[n, 2]] = True


@njit(cache=True, nogil=True)
def _fill_holes(least: Any, runs: Any, area: Any, cleaned: Any) -> None:
    """Set the holes of a region that have fewer than `least` pixels."""
    rows, columns = cleaned.shape
    count = _find_runs(cleaned, False, 0, runs)
    _measure(runs, count, area)
    for n in range(count):
        row, first, end = runs[n, 0], runs[n, 1], runs[n, 2]
        if row == 0 or row == rows - 1 or first == 0 or end == columns:
            area[_root(runs, n)] = rows * columns + 1  # the border of a picture closes no hole
    for n in range(count):
        if area[_root(runs, n)] < min(least, rows * columns + 1):
            cleaned[runs[n, 0], runs[n, 1] : runs[n, 2]] = True


@njit(cache=True, nogil=True)
def _find_runs(region: Any, inside: Any, reach: Any, runs: Any) -> Any:
    """Write row, first column, end and parent of each run of pixels; return how many.

    Runs of neighboring rows are joined where they overlap, with a reach of 1 also diagonally.
    """
    count = above = begin = np.int64(0)
    for row in range(region.shape[0]):
        above, above_end, begin = begin, count, count
        column = 0
        while column < region.shape[1]:
            if (region[row, column] != 0) != inside:
                column += 1
                continue
            first = column
            while column < region.shape[1] and (region[row, column] != 0) == inside:
                column += 1
            runs[count, 0], runs[count, 1], runs[count, 2] = row, first, column
            runs[count, 3] = count
            while above < above_end and runs[above, 2] + reach <= first:
                above += 1
            other = above
            while other < above_end and runs[other, 1] < column + reach:
                _join(runs, other, count)
                other += 1
            count += 1
    return count


@njit(cache=True, nogil=True, inline="always")
def _join(runs: Any, one: Any, other: Any) -> None:
    """Make two runs parts of the same."""
    a, b = _root(runs, one), _root(runs, other)
    runs[max(a, b), 3] = min(a, b)


@njit(cache=True, nogil=True)
def _root(runs: Any, run: Any) -> Any:
    """Return the run that stands for all that a run is connected with."""
    while runs[run, 3] != run:
        runs[run, 3] = runs[runs[run, 3], 3]
        run = runs[run, 3]
    return run


@njit(cache=True, nogil=True)
def _measure(runs: Any, count: Any, area: Any) -> None:
    """Write the pixels of each part, at the run that stands for it."""
    area[:count] = 0
    for n in range(count):
        area[_root(runs, n)] += runs[n, 2] - runs[n, 1]
