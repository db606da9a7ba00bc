"""What makes a pose doubtful, whoever fitted it: voxels left over, a performer cut off."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.geometry.voxel_lines import LENGTH, VoxelLines, Z

_SPECKS = 3  # voxels that may touch a side


def unexplained_share(
    center: NDArray[np.floating],
    mean: NDArray[np.floating],
    inverse: NDArray[np.floating],
    *,
    beyond: float = 4.0,
) -> float:
    """Return the share of voxels that are far from everything that was fitted.

    Parameters
    ----------
    center : (voxel, 3) float
        Metres; some thousands, evenly from a frame's, tell a share of 0.03 to 0.003.
    mean : (blob, 3) float
        Of each blob, metres.
    inverse : (blob, 3, 3) float
        Inverse of each blob's covariance, 1 / square metres.
    beyond
        How many standard deviations are far.

    Returns
    -------
    float
        0 to 1; 0 where there is no voxel.
    """
    if not len(center):
        return 0.0
    return _count_far(center, mean, inverse, beyond**2) / len(center)


@njit(cache=True, nogil=True)
def _count_far(points: Any, mean: Any, inverse: Any, beyond: float) -> int:
    """Return how many points are farther from every blob, in squared standard deviations."""
    far, b = 0, 0
    for point in points:
        for _ in range(len(mean)):  # the blob that was near the point before comes first
            x, y, z = point[0] - mean[b, 0], point[1] - mean[b, 1], point[2] - mean[b, 2]
            squared = inverse[b, 0, 0] * x * x + inverse[b, 1, 1] * y * y
            squared += inverse[b, 2, 2] * z * z + 2 * inverse[b, 1, 2] * y * z
            squared += 2 * x * (inverse[b, 0, 1] * y + inverse[b, 0, 2] * z)
            if squared <= beyond:
                break
            b = (b + 1) % len(mean)
        else:
            far += 1
    return far


def cut_off_at(index: NDArray[np.integer], shape: tuple[int, int, int]) -> list[tuple[int, int]]:
    """Return the sides of a grid that the voxels (voxel, 3) touch, but for the floor.

    Returns
    -------
    list of (axis, index)
        The axis that the side stands on, and its index there.
    """
    return [(axis, end) for axis, end in _sides(shape) if (index[:, axis] == end).sum() > _SPECKS]


def is_cut_off(lines: VoxelLines, shape: tuple[int, int, int]) -> bool:
    """Return whether the voxels touch a side of a grid but for the floor; as `cut_off_at`."""
    begin, end, length = lines.table[:, :3], lines.table[:, :3].copy(), lines.table[:, LENGTH]
    end[:, Z] += length - 1
    for axis, side in _sides(shape):
        touches = length if axis != Z else np.ones_like(length)
        found = (begin[:, axis] == side) | (end[:, axis] == side)
        if touches[found].sum() > _SPECKS:
            return True
    return False


def _sides(shape: tuple[int, int, int]) -> list[tuple[int, int]]:
    """Return axis and index of each side of a grid but for the floor."""
    last = [count - 1 for count in shape]
    return [(0, 0), (0, last[0]), (1, last[1]), (2, 0), (2, last[2])]
