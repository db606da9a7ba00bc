"""What makes a pose doubtful, whoever fitted it: voxels left over, a performer cut off."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

_LOOKED_AT = 3000  # voxels of a frame: a share of 0.03 is known to 0.003
_SPECKS = 3  # voxels that may touch a side


def unexplained_share(
    center: NDArray[np.floating],
    mean: NDArray[np.floating],
    inverse: NDArray[np.floating],
    *,
    beyond: float = 4.0,
) -> float:
    """Return the share of a frame's voxels that are far from everything that was fitted.

    Parameters
    ----------
    center : (voxel, 3) float
        Metres.
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
    some = center[:: max(1, len(center) // _LOOKED_AT)]
    if not len(some):
        return 0.0
    return _count_far(some, mean, inverse, beyond**2) / len(some)


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
    last = np.array(shape) - 1
    sides = [(0, 0), (0, int(last[0])), (1, int(last[1])), (2, 0), (2, int(last[2]))]
    return [(axis, end) for axis, end in sides if (index[:, axis] == end).sum() > _SPECKS]
