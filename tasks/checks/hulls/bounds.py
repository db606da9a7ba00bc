"""How much room a hull takes, from the voxels of some frames."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from tasks.geometry.voxels import VoxelGrid

_SCRAP = 0.05
"""A part of a hull with fewer of its voxels is a scrap [share]. Chosen, not measured."""


def grid_corners(grid: VoxelGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and the highest corner (3,) of a grid, m."""
    low = np.array(grid.origin_m) - grid.voxel_m / 2
    return low, low + np.array(grid.shape) * grid.voxel_m


def is_inside(
    points: NDArray[np.float64], grid: VoxelGrid, beyond_m: float = 0.0
) -> NDArray[np.bool_]:
    """Return (point,) whether points (point, 3) lie in a grid, or so little beyond its sides."""
    low, high = grid_corners(grid)
    inside = (points >= low - beyond_m) & (points <= high + beyond_m)
    return np.asarray(inside.all(axis=1))


def main_parts(points: NDArray[np.float64], grid: VoxelGrid, voxel_m: float) -> NDArray[np.float64]:
    """Return the voxels (voxel, 3) of a hull without what silhouettes leave elsewhere.

    Parts nearer to each other than three voxels are one. Left out are scraps, of less than a
    twentieth, and what lies wholly outside the grid while the largest part does not: the
    performer is one body, and far from it the silhouettes of a few cameras meet by chance.
    """
    if not len(points):
        return points
    part = parts_of(points, voxel_m)
    size, inside = np.bincount(part), np.bincount(part, is_inside(points, grid))
    kept = (size >= _SCRAP * len(points)) & (inside > 0)
    kept[size.argmax()] = True
    return points[kept[part]]


def parts_of(points: NDArray[np.float64], voxel_m: float) -> NDArray[np.int32]:
    """Return (voxel,) the number of the part that each voxel (voxel, 3) of a hull is of.

    Parts nearer to each other than three voxels are one.
    """
    if not len(points):
        return np.zeros(0, np.int32)
    cells = tuple(np.rint((points - points.min(axis=0)) / voxel_m).astype(np.intp).T)
    filled = np.zeros([axis.max() + 1 for axis in cells], np.bool_)
    filled[cells] = True
    labeled: Any = ndimage.label(filled, np.ones((3, 3, 3)))
    piece = labeled[0][cells] - 1  # of voxels that touch; now pieces are joined
    rest = np.flatnonzero(piece != np.bincount(piece).argmax())
    near = KDTree(points).query_ball_point(points[rest], 3.1 * voxel_m)
    ends = piece[[n for each in near for n in each]] if len(rest) else rest
    starts = np.repeat(piece[rest], [len(each) for each in near])
    graph = coo_array((np.ones(len(ends)), (starts, ends)), [piece.max() + 1] * 2)
    part: Any = connected_components(graph, directed=False)[1]
    return part[piece]


def fitting_box(
    points: NDArray[np.float64], floor_m: float, margin_m: float
) -> tuple[list[float], list[float]]:
    """Return a box around voxels whose sides lie on tenths of a metre.

    Parameters
    ----------
    points : (voxel, 3) float64
        Centers, y up, m.
    floor_m
        Where the floor probably is: who stands on it needs no room below.
    margin_m
        Left on the other sides.

    Returns
    -------
    center_m, size_m : list of three float
    """
    low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    if low[1] < floor_m:
        low[1] = min(floor_m, points[:, 1].min())
    low, high = np.floor(low * 10 + 1e-6) / 10, np.ceil(high * 10 - 1e-6) / 10
    center, size = (low + high) / 2, high - low
    return [round(float(v), 2) + 0.0 for v in center], [round(float(v), 1) for v in size]
