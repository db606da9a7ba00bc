"""Hulls without some of their voxels."""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.voxels import VoxelRuns, join_runs, take_frame, voxel_numbers


def are_of(number: NDArray[np.integer], things: VoxelRuns, frame: int) -> NDArray[np.bool_]:
    """Return which voxels of a frame, (voxel,) by their numbers, are of things.

    Parameters
    ----------
    things
        Of any frames.
    frame
        Which of these it is.
    """
    return np.isin(number, voxel_numbers(take_frame(things, frame)), assume_unique=True)


def leave_out(runs: VoxelRuns, kept: NDArray[np.bool_]) -> VoxelRuns:
    """Return the runs of frames without some of their voxels.

    Parameters
    ----------
    runs
        Any frames.
    kept : (voxel,) bool
        Which voxels stay, one frame after another.
    """
    parts, begin = [], 0
    for frame in range(runs.frames):
        number = voxel_numbers(take_frame(runs, frame))
        own = kept[begin : begin + len(number)]
        begin += len(number)
        number = number[own]
        begins = np.ones(len(number), np.bool_)
        begins[1:] = (np.diff(number) != 1) | (number[1:] % runs.shape[2] == 0)
        start = np.flatnonzero(begins)
        length = np.diff(np.append(start, len(number)))
        parts.append(
            VoxelRuns(
                number[start].astype(np.uint32),
                length.astype(np.uint16),
                np.array([0, len(start)]),
                runs.shape,
            )
        )
    return join_runs(parts)
