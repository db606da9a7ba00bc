"""Voxel grids, and occupied voxels kept as runs (the voxel space of digitization paper, 2.2).

Voxels are ordered as `numpy.argwhere` gives them: x-major, then y, then z. The number of a
voxel is `(x * ny + y) * nz + z`. A run is a stretch of occupied voxels along z within one
column (x, y), as long as it can be; a frame's runs are in the order of their first voxels.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

_MOST_VOXELS = 2**32  # the number of a voxel is stored in 32 bits
_LONGEST_SIDE = 2**16 - 1  # the length of a run in 16


@dataclass(frozen=True)
class VoxelGrid:
    """A box of cubic voxels along the world's axes.

    Raises
    ------
    ValueError
        If a number is not finite, the voxel is not larger than 0 m, or a side has no voxel,
        more than 65,535, or the box 2**32 voxels or more.
    """

    origin_m: tuple[float, float, float]
    """Center of voxel (0, 0, 0)."""

    voxel_m: float
    """Edge of a voxel."""

    shape: tuple[int, int, int]
    """Number of voxels along x, y and z."""

    def __post_init__(self) -> None:
        faults = []
        if len(self.origin_m) != 3 or not np.isfinite(self.origin_m).all():
            faults.append(f"origin_m {self.origin_m} must be three finite numbers")
        if not (math.isfinite(self.voxel_m) and self.voxel_m > 0):
            faults.append(f"voxel_m {self.voxel_m} must be larger than 0")
        if len(self.shape) != 3 or not all(1 <= n <= _LONGEST_SIDE for n in self.shape):
            faults.append(f"shape {self.shape} must be three numbers from 1 to {_LONGEST_SIDE}")
        elif math.prod(self.shape) >= _MOST_VOXELS:
            faults.append(f"shape {self.shape} must have fewer than 2**32 voxels")
        if faults:
            raise ValueError(f"this is no voxel grid: {'; '.join(faults)}; change the volume")


@dataclass(frozen=True, eq=False)
class VoxelRuns:
    """The occupied voxels of consecutive frames, as runs along z.

    Raises
    ------
    ValueError
        If the lengths of the arrays do not fit each other, or a run leaves its column.
    """

    start: NDArray[np.uint32]
    """(run,) number of a run's first voxel."""

    length: NDArray[np.uint16]
    """(run,) voxels in a run, at least 1."""

    offset: NDArray[np.int64]
    """(frame + 1,) a frame's runs are `offset[frame]:offset[frame + 1]`."""

    shape: tuple[int, int, int]
    """Number of voxels of the grid along x, y and z."""

    def __post_init__(self) -> None:
        runs = len(self.start)
        ends = (int(self.offset[0]), int(self.offset[-1])) if len(self.offset) else None
        if len(self.length) != runs or ends != (0, runs):
            raise ValueError(
                f"{runs} starts, {len(self.length)} lengths and offsets from and to {ends} do "
                "not fit: pass a start and a length for each run, and offsets from 0 to the "
                "number of runs"
            )
        last = self.start.astype(np.int64) % self.shape[2] + self.length
        bad = (self.length == 0) | (last > self.shape[2]) | (self.start >= math.prod(self.shape))
        if bad.any():
            raise ValueError(
                f"{int(bad.sum())} of {runs} runs are empty or leave their column of a grid of "
                f"shape {self.shape}, the first is run {int(bad.argmax())}; carve this take again"
            )

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return len(self.offset) - 1


def volume_grid(center_m: Sequence[float], size_m: Sequence[float], voxel_m: float) -> VoxelGrid:
    """Return the grid whose middle is the volume's center and that covers the volume.

    A side that is not a whole number of voxels (to a millionth of one) is rounded up.

    Raises
    ------
    ValueError
        As `VoxelGrid`.
    """
    if not (math.isfinite(voxel_m) and voxel_m > 0 and np.isfinite(size_m).all()):
        raise ValueError(
            f"a volume of {tuple(size_m)} m in voxels of {voxel_m} m is no grid: pass finite "
            "sizes larger than 0"
        )
    shape = [math.ceil(size / voxel_m - 1e-6) for size in size_m]
    origin = [middle - (n - 1) / 2 * voxel_m for middle, n in zip(center_m, shape, strict=True)]
    return VoxelGrid((origin[0], origin[1], origin[2]), voxel_m, (shape[0], shape[1], shape[2]))


def voxel_centers(grid: VoxelGrid, index: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return (voxel, 3) centers in the world, m, of voxels given by (voxel, 3) index.

    A coordinate is `origin_m + index * voxel_m` in float64: the very number that is carved.
    """
    center = np.empty(index.shape)
    for axis, origin in enumerate(grid.origin_m):  # three numbers at a time take six times as long
        np.multiply(index[..., axis], float(grid.voxel_m), out=center[..., axis])
        center[..., axis] += origin
    return center


def encode_runs(occupied: NDArray[np.bool_]) -> VoxelRuns:
    """Return the runs of (frame, x, y, z) occupied voxels.

    Raises
    ------
    ValueError
        If there are not four axes, or the grid is none (as `VoxelGrid`).
    """
    if occupied.ndim != 4:
        raise ValueError(
            f"occupied has shape {occupied.shape}, but (frame, x, y, z) is wanted: add an axis "
            "to a single frame"
        )
    shape = (occupied.shape[1], occupied.shape[2], occupied.shape[3])
    VoxelGrid((0.0, 0.0, 0.0), 1.0, shape)
    columns = np.ascontiguousarray(occupied, np.bool_).reshape(-1, shape[2])
    edges = np.zeros((len(columns), shape[2] + 1), np.bool_)
    edges[:, 0], edges[:, -1] = columns[:, 0], columns[:, -1]
    np.not_equal(columns[:, 1:], columns[:, :-1], out=edges[:, 1:-1])
    column, z = np.nonzero(edges)
    number = (column % (shape[0] * shape[1]) * shape[2] + z)[0::2]
    length = z[1::2] - z[0::2]
    frame_of_run = column[0::2] // (shape[0] * shape[1])
    offset = np.searchsorted(frame_of_run, np.arange(len(occupied) + 1)).astype(np.int64)
    return VoxelRuns(number.astype(np.uint32), length.astype(np.uint16), offset, shape)


def join_runs(parts: Sequence[VoxelRuns]) -> VoxelRuns:
    """Return the frames of all parts, one part after another.

    Raises
    ------
    ValueError
        If there is no part, or the grids differ.
    """
    shapes = {part.shape for part in parts}
    if len(shapes) != 1:
        raise ValueError(
            f"runs on grids of shape {sorted(shapes)} cannot be joined: pass one or more on "
            "the same grid"
        )
    sizes = np.concatenate([[0], *(np.diff(part.offset) for part in parts)])
    return VoxelRuns(
        np.concatenate([part.start for part in parts]),
        np.concatenate([part.length for part in parts]),
        np.cumsum(sizes, dtype=np.int64),
        parts[0].shape,
    )


def take_frame(runs: VoxelRuns, frame: int) -> VoxelRuns:
    """Return one frame's runs, as runs of a single frame.

    Raises
    ------
    ValueError
        If there is no such frame.
    """
    if not 0 <= frame < runs.frames:
        raise ValueError(f"frame {frame} is not one of the frames 0 to {runs.frames - 1}")
    first, end = int(runs.offset[frame]), int(runs.offset[frame + 1])
    offset = np.array([0, end - first], np.int64)
    own = copy(runs)  # without the checks, which all of the runs have passed
    vars(own).update(start=runs.start[first:end], length=runs.length[first:end], offset=offset)
    return own


def count_voxels(runs: VoxelRuns) -> NDArray[np.int64]:
    """Return (frame,) the number of occupied voxels of each frame."""
    total = np.concatenate([[0], np.cumsum(runs.length, dtype=np.int64)])
    return np.diff(total[runs.offset])


def decode_runs(runs: VoxelRuns, frame: int) -> NDArray[np.bool_]:
    """Return the dense view of a frame, (x, y, z).

    Raises
    ------
    ValueError
        If there is no such frame.
    """
    occupied = np.zeros(math.prod(runs.shape), np.bool_)
    occupied[voxel_numbers(take_frame(runs, frame))] = True
    return occupied.reshape(runs.shape)


def voxel_index(runs: VoxelRuns, frame: int, *, first: int = 0, step: int = 1) -> NDArray[np.int32]:
    """Return (voxel, 3) the index of each occupied voxel of a frame, in order.

    With a step only of every so many, from the `first` on.

    Raises
    ------
    ValueError
        If there is no such frame.
    """
    one = take_frame(runs, frame)
    _, ny, nz = runs.shape
    voxels = int(one.length.sum(dtype=np.int64))
    index = np.empty((len(range(first, voxels, step)), 3), np.int32)
    _write_index(one.start, one.length, (ny, nz), (first, step), index)
    return index


def run_index(one: VoxelRuns) -> NDArray[np.int64]:
    """Return (run, 3) the index of the first voxel of each run of a single frame."""
    return np.stack(np.unravel_index(one.start.astype(np.int64), one.shape), axis=1)


def padded_crop(
    runs: VoxelRuns, frame: int, *, margin: int = 1
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return the dense box around a frame's voxels, and where it begins.

    Returns
    -------
    crop : (x, y, z) uint8
        1 where occupied. The box has `margin` empty layers of voxels on each side, which may
        lie outside the grid: what lies outside counts as empty.
    begin : (3,) int64
        Index in the grid of the crop's voxel (0, 0, 0), negative outside the grid.

    Raises
    ------
    ValueError
        If there is no such frame.
    """
    one = take_frame(runs, frame)
    _, ny, nz = runs.shape
    if not len(one.start):
        return np.zeros((2 * margin,) * 3, np.uint8), np.full(3, -margin, np.int64)
    column, z = np.divmod(one.start.astype(np.int64), nz)
    x, y = np.divmod(column, ny)
    begin = np.array([x[0], y.min(), z.min()]) - margin
    end = np.array([x[-1], y.max(), (z + one.length).max() - 1]) + 1 + margin
    crop = np.zeros(end - begin, np.uint8)
    _paint(one.start, one.length, (ny, nz), begin, crop)
    return crop, begin


def surface_voxels(runs: VoxelRuns, frame: int) -> NDArray[np.bool_]:
    """Return (voxel,) True for the occupied voxels, in order, with an empty 6-neighbor.

    What lies outside the grid counts as empty.

    Raises
    ------
    ValueError
        If there is no such frame.
    """
    one = take_frame(runs, frame)
    return find_surface(one, *padded_crop(one, 0))[0]


def surface_index(runs: VoxelRuns, frame: int) -> NDArray[np.int32]:
    """Return (surface voxel, 3) the index of the voxels of a frame with an empty 6-neighbor.

    They are `voxel_index` where `surface_voxels` is True.

    Raises
    ------
    ValueError
        If there is no such frame.
    """
    one = take_frame(runs, frame)
    return find_surface(one, *padded_crop(one, 0))[1]


def find_surface(
    one: VoxelRuns, crop: NDArray[np.uint8], begin: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
    """Return which voxels of a single frame are on the surface, and their index.

    Parameters
    ----------
    one
        Runs of a single frame.
    crop, begin
        As `padded_crop` returned them for it.

    Returns
    -------
    is_surface : (voxel,) bool
        As `surface_voxels`.
    index : (surface voxel, 3) int32
        As `surface_index`.
    """
    voxels = int(one.length.sum(dtype=np.int64))
    is_surface, index = np.empty(voxels, np.bool_), np.empty((voxels, 3), np.int32)
    _, ny, nz = one.shape
    found = _find_surface(one.start, one.length, (ny, nz, begin), crop, (is_surface, index))
    return is_surface, index[:found].copy()


def voxel_numbers(runs: VoxelRuns) -> NDArray[np.int64]:
    """Return the number of each voxel of all runs, in order."""
    length = runs.length.astype(np.int64)
    before = np.cumsum(length) - length
    return np.repeat(runs.start.astype(np.int64) - before, length) + np.arange(length.sum())


@njit(cache=True, nogil=True)
def _write_index(start: Any, length: Any, sides: Any, wanted: Any, index: Any) -> None:
    """Write the index of the wanted voxels of the runs (the first one, and a step), in order."""
    ny, nz = sides
    ahead, step = wanted  # voxels from the run's first to the next that is wanted
    voxel = 0
    for run in range(len(start)):
        count = np.int64(length[run])
        if ahead < count:
            number = np.int64(start[run])
            column = number // nz
            x, y, z = column // ny, column % ny, number % nz
            for k in range(ahead, count, step):
                index[voxel, 0], index[voxel, 1], index[voxel, 2] = x, y, z + k
                voxel += 1
            ahead += -(-(count - ahead) // step) * step
        ahead -= count


@njit(cache=True, nogil=True)
def _paint(start: Any, length: Any, sides: Any, begin: Any, crop: Any) -> None:
    """Write 1 into the crop for each voxel of the runs."""
    ny, nz = sides
    for run in range(len(start)):
        number = np.int64(start[run])
        column = number // nz
        x, y, z = column // ny - begin[0], column % ny - begin[1], number % nz - begin[2]
        for k in range(np.int64(length[run])):
            crop[x, y, z + k] = 1


@njit(cache=True, nogil=True)
def _find_surface(start: Any, length: Any, place: Any, crop: Any, into: Any) -> Any:
    """Write whether each voxel has an empty 6-neighbor in the padded crop, and where; count these.

    The loop over a run's neighbors has no branches, so that it is vectorized.
    """
    ny, nz, begin = place
    is_surface, index = into
    voxel = found = 0
    for run in range(len(start)):
        number = np.int64(start[run])
        column = number // nz
        x, y, z = column // ny, column % ny, number % nz
        i, j, first = x - begin[0], y - begin[1], z - begin[2]
        count = np.int64(length[run])
        end = first + count
        before, behind = crop[i - 1, j, first:end], crop[i + 1, j, first:end]
        under, above = crop[i, j - 1, first:end], crop[i, j + 1, first:end]
        flags = is_surface[voxel : voxel + count]
        for k in range(count):
            flags[k] = (before[k] & behind[k] & under[k] & above[k]) == 0
        flags[0] = flags[count - 1] = True
        for k in range(count):
            if flags[k]:
                index[found, 0], index[found, 1], index[found, 2] = x, y, z + k
                found += 1
        voxel += count
    return found
