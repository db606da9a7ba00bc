"""The voxels of one frame as lines along z: what goes through all voxels goes along these.

A line holds some twenty voxels, so what can be said of whole lines, and of whose voxels are beside
whose, costs a twentieth of what it costs voxel by voxel.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.geometry.voxels import VoxelGrid, VoxelRuns

X, Y, Z, LENGTH, FIRST = range(5)
"""What is known of a line: the index in the grid of its first voxel, how many voxels it has, and
the place of the first one in the list of voxels."""


@dataclass(frozen=True, eq=False)
class VoxelLines:
    """The voxels of one frame, in order: x-major, then y, then z."""

    table: NDArray[np.int32]
    """(line, 5) of each line, `X` to `FIRST`; no line goes on in the next. One array, for numba
    counts the references to each array of a tuple whenever it is taken apart."""

    @property
    def voxels(self) -> int:
        """How many voxels there are."""
        return int(self.table[-1, LENGTH] + self.table[-1, FIRST]) if len(self.table) else 0


def lines_of(runs: VoxelRuns) -> VoxelLines:
    """Return the voxels of a single frame.

    Raises
    ------
    ValueError
        If there is not one frame.
    """
    if runs.frames != 1:
        raise ValueError(
            f"runs of {runs.frames} frames were given where those of one are wanted; "
            "pass what take_frame returns"
        )
    table = np.empty((len(runs.start), 5), np.int32)
    _place(runs.start, runs.length, runs.shape[1], runs.shape[2], table)
    return VoxelLines(table)


def lines_of_index(index: NDArray[np.integer]) -> VoxelLines:
    """Return the voxels of a frame given by (voxel, 3) index in the grid, in order.

    Raises
    ------
    ValueError
        If the voxels are not in order.
    """
    index = np.ascontiguousarray(index, np.int32)
    table = np.empty((len(index), 5), np.int32)
    count = _part(index, table)
    if count < 0:
        raise ValueError(
            "the voxels are not in order or not each once; pass them as voxel_index gives them"
        )
    return VoxelLines(table[:count].copy())


def labeled_centers(
    grid: VoxelGrid, lines: VoxelLines, label: NDArray[np.uint8], wanted: tuple[int, ...]
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return (found, 3) centers, m, and (found,) labels of the voxels with labels that are wanted.

    A center is what `voxel_centers` gives.
    """
    count = sum(int(np.count_nonzero(label == own)) for own in wanted)
    is_wanted = np.zeros(256, np.bool_)
    is_wanted[list(wanted)] = True
    x, y, z = (
        np.float64(origin) + np.arange(count) * float(grid.voxel_m)
        for origin, count in zip(grid.origin_m, grid.shape, strict=True)
    )
    center, value = np.empty((count, 3)), np.empty(count, np.uint8)
    _pick(lines.table, label, is_wanted, (x, y, z), center, value)
    return center, value


def marked_centers(
    grid: VoxelGrid, runs: VoxelRuns, mark: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return (marked, 3) centers, m, of the (voxel,) marked voxels of a single frame.

    A center is what `voxel_centers` gives.
    """
    return labeled_centers(grid, lines_of(runs), mark.view(np.uint8), (1,))[0]


@njit(cache=True, nogil=True)
def _place(start: Any, length: Any, ny: Any, nz: Any, table: Any) -> None:
    """Write runs as lines."""
    first = 0
    for run in range(len(start)):
        number = np.int64(start[run])
        column = number // nz
        table[run, X], table[run, Y] = column // ny, column % ny
        table[run, Z] = number - column * nz
        table[run, LENGTH], table[run, FIRST] = length[run], first
        first += np.int64(length[run])


@njit(cache=True, nogil=True)
def _part(index: Any, table: Any) -> Any:
    """Write the lines of a list of voxels; return how many there are, -1: they have no order."""
    count = 0
    for n in range(len(index)):
        x, y, z = index[n, 0], index[n, 1], index[n, 2]
        if n:
            i, j, k = x - index[n - 1, 0], y - index[n - 1, 1], z - index[n - 1, 2]
            if i < 0 or (i == 0 and (j < 0 or (j == 0 and k <= 0))):
                return -1
            if i == 0 and j == 0 and k == 1:
                table[count - 1, LENGTH] += 1
                continue
        table[count, X], table[count, Y], table[count, Z] = x, y, z
        table[count, LENGTH], table[count, FIRST] = 1, n
        count += 1
    return count


@njit(cache=True, nogil=True)
def _pick(lines: Any, label: Any, is_wanted: Any, axes: Any, center: Any, value: Any) -> None:
    """Write center and label of the voxels with labels that are wanted.

    `axes`: the coordinates of voxels along x, y and z.
    """
    xs, ys, zs = axes
    voxel = np.empty(len(label), np.int32)
    found = line = 0
    for n in range(len(label)):
        voxel[found] = n  # without a branch: one in six is kept
        found += is_wanted[label[n]]
    for f in range(found):
        n = voxel[f]
        while n >= lines[line, FIRST] + lines[line, LENGTH]:
            line += 1
        center[f, 0], center[f, 1] = xs[lines[line, X]], ys[lines[line, Y]]
        center[f, 2] = zs[lines[line, Z] + n - lines[line, FIRST]]
        value[f] = label[n]
