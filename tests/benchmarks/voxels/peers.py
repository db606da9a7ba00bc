"""What carving is measured against: a plain loop and whole arrays, voxel for voxel the same."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.projection import Projection, one_to_one_radius
from tasks.geometry.voxels import VoxelGrid

MIN_CAMERAS = 3


def lens_of(projection: Projection) -> tuple[NDArray[Any], ...]:
    """Return the arrays that the plain loop takes."""
    return (
        projection.camera_from_world,
        projection.intrinsics,
        projection.distortion,
        one_to_one_radius(projection),
        projection.image_size,
    )


@njit(error_model="numpy")
def visit_every_voxel(silhouettes: Any, lens: Any, origin: Any, voxel: Any, occupied: Any) -> None:
    """Test each voxel before one camera after another until one says no: plain numba."""
    poses, inner, distortion, radius, size = lens
    for i in range(occupied.shape[0]):
        x = origin[0] + i * voxel
        for j in range(occupied.shape[1]):
            y = origin[1] + j * voxel
            for k in range(occupied.shape[2]):
                z = origin[2] + k * voxel
                votes = 0
                for c in range(len(poses)):
                    m, q = poses[c], distortion[c]
                    d = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                    if d <= 0:
                        continue
                    a = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / d
                    b = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / d
                    s = a * a + b * b
                    if s > radius[c] * radius[c]:
                        continue
                    if radius[c] < np.inf:
                        f = 1 + s * (q[0] + s * (q[1] + s * q[4]))
                        f /= 1 + s * (q[5] + s * (q[6] + s * q[7]))
                        ab = a * b
                        u = a * f + (2 * q[2] * ab + q[3] * (s + 2 * a * a))
                        b = b * f + (q[2] * (s + 2 * b * b) + 2 * q[3] * ab)
                        a = u
                    column = np.floor(
                        inner[c, 0, 0] * a + inner[c, 0, 1] * b + inner[c, 0, 2] + 0.5
                    )
                    row = np.floor(inner[c, 1, 1] * b + inner[c, 1, 2] + 0.5)
                    if 0 <= column < size[c, 0] and 0 <= row < size[c, 1]:
                        votes += 1
                        if not silhouettes[c, int(row), int(column)]:
                            votes = -1
                            break
                occupied[i, j, k] = votes >= MIN_CAMERAS


def project_whole_arrays(
    silhouettes: NDArray[np.bool_], projection: Projection, grid: VoxelGrid
) -> NDArray[np.bool_]:
    """Take all centers through every camera, a tenth of the volume at a time: numpy."""
    x, y, z = (grid.origin_m[k] + np.arange(grid.shape[k]) * grid.voxel_m for k in range(3))
    radius = one_to_one_radius(projection)
    parts = []
    for some in np.array_split(x, 10):
        votes = np.zeros((len(some), len(y), len(z)), np.int8)
        misses = np.zeros_like(votes)
        for c, m in enumerate(projection.camera_from_world):
            place = [
                m[r, 0] * some[:, None, None] + m[r, 1] * y[:, None] + m[r, 2] * z + m[r, 3]
                for r in range(3)
            ]
            a, b = place[0] / place[2], place[1] / place[2]
            s = a * a + b * b
            if radius[c] < np.inf:
                k = projection.distortion[c]
                f = 1 + s * (k[0] + s * (k[1] + s * k[4]))
                f /= 1 + s * (k[5] + s * (k[6] + s * k[7]))
                ab = a * b
                a, b = (
                    a * f + (2 * k[2] * ab + k[3] * (s + 2 * a * a)),
                    b * f + (k[2] * (s + 2 * b * b) + 2 * k[3] * ab),
                )
            inner = projection.intrinsics[c]
            column = np.floor(inner[0, 0] * a + inner[0, 1] * b + inner[0, 2] + 0.5)
            row = np.floor(inner[1, 1] * b + inner[1, 2] + 0.5)
            columns, rows = projection.image_size[c]
            seen = (place[2] > 0) & (s <= radius[c] ** 2) & (column >= 0) & (column < columns)
            seen &= (row >= 0) & (row < rows)
            pixel = np.where(seen, row * columns + column, 0).astype(np.intp)
            votes += seen
            misses += seen & ~silhouettes[c, :rows, :columns].reshape(-1)[pixel]
        parts.append((votes >= MIN_CAMERAS) & (misses == 0))
    return np.concatenate(parts)
