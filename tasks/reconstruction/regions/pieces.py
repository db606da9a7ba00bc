"""Tell the pieces of a hull apart, by cells of some voxels, from its runs alone."""

from typing import Any

import cc3d
import numpy as np
from numpy.typing import NDArray

from tasks.geometry.voxels import VoxelRuns, run_index


def pieces_of_runs(hull: VoxelRuns, edge: int) -> NDArray[np.integer]:
    """Return (run,) the number of the piece, from 1 on, that each run of a frame is of.

    Voxels are of one piece that are in the same cell, or in cells that touch.

    Parameters
    ----------
    hull
        Of a single frame.
    edge
        Of the cells, which begin at voxel (0, 0, 0) of the grid [voxels].
    """
    if not len(hull.start):
        return np.zeros(0, np.uint32)
    index = run_index(hull)
    first = index // edge
    last = (index[:, 2] + hull.length.astype(np.int64) - 1) // edge
    low = first.min(axis=0)
    first, last = first - low, last - low[2]
    sides = first[:, 0].max() + 1, first[:, 1].max() + 1, last.max() + 2
    changes = np.zeros(sides, np.int32)  # how many runs begin in a cell, less those that end before
    np.add.at(changes, tuple(first.T), 1)
    np.subtract.at(changes, (first[:, 0], first[:, 1], last + 1), 1)
    filled = (np.cumsum(changes, axis=2)[:, :, :-1] > 0).astype(np.uint8)
    pieces: Any = cc3d.connected_components(filled, connectivity=26)
    return np.asarray(pieces)[tuple(first.T)]
