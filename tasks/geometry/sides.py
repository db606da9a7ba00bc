"""Which sides of a voxel grid a body touches: what is beyond them is missing."""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.voxel_lines import LENGTH, VoxelLines, Z

_STRAY_VOXELS = 3
"""How many voxels may touch a side. Those that noise left; chosen, not measured."""


def cut_off_at(index: NDArray[np.integer], shape: tuple[int, int, int]) -> list[tuple[int, int]]:
    """Return the sides of a grid that the voxels (voxel, 3) touch, but for the floor.

    Returns
    -------
    list of (axis, index)
        The axis that the side stands on, and its index there.
    """
    return [
        (axis, end) for axis, end in _sides(shape) if (index[:, axis] == end).sum() > _STRAY_VOXELS
    ]


def is_cut_off(lines: VoxelLines, shape: tuple[int, int, int]) -> bool:
    """Return whether the voxels touch a side of a grid but for the floor; as `cut_off_at`."""
    begin, end, length = lines.table[:, :3], lines.table[:, :3].copy(), lines.table[:, LENGTH]
    end[:, Z] += length - 1
    for axis, side in _sides(shape):
        touches = length if axis != Z else np.ones_like(length)
        found = (begin[:, axis] == side) | (end[:, axis] == side)
        if touches[found].sum() > _STRAY_VOXELS:
            return True
    return False


def _sides(shape: tuple[int, int, int]) -> list[tuple[int, int]]:
    """Return axis and index of each side of a grid but for the floor."""
    last = [count - 1 for count in shape]
    return [(0, 0), (0, last[0]), (1, last[1]), (2, 0), (2, last[2])]
