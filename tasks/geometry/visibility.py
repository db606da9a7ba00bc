"""Which cameras see the voxels of a hull's surface.

A camera sees a voxel when it films it inside its silhouette and the straight line from the camera
to a point above the voxel, along the outward normal, is not blocked by a voxel (a walk through
the grid, to where the line is clear; Amanatides and Woo 1987). Cameras behind the surface count
only where none in front sees the voxel: at its horizon, and on the edges of cloth. From the voxel's
own center the line would graze its neighbors, for a hull's surface is where lines of sight touch
it: a fixed tolerance in depth leaves 13 % of a dancer without color, and the walk from the center
just as many; from two voxels above it 1 %. The normal points from what is occupied within two
voxels to what is empty; where that is symmetric, as on thin cloth, there is none, and every camera
is in front.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.clear_lines import clear_shares

REACH = 2
"""Voxels around a voxel that its normal is taken from."""


def hide_pixels(
    crop: NDArray[np.uint8],
    place: NDArray[np.int64],
    cameras: NDArray[np.float64],
    lift: float,
    pixel: NDArray[np.int32],
) -> None:
    """Write -1 for the pixels of the cameras that do not see a voxel.

    Parameters
    ----------
    crop : (x, y, z) uint8
        1 where occupied, with at least `REACH` empty layers on each side.
    place : (voxel, 3) int64
        Index in the crop of the voxels of the surface.
    cameras : (camera, 3) float64
        Where the cameras are, in the crop, in voxels.
    lift
        How far above a voxel the lines to the cameras begin, in voxels.
    pixel : (camera, voxel, 2) int32
        Where the cameras film the voxels; row and column are -1 where they do not. Changed in
        place, the row only.
    """
    normal = np.empty((len(place), 3))
    _find_normals(crop, place, normal)
    start = place + lift * normal
    share = clear_shares(place, start, cameras, crop.shape)
    seen = np.zeros(len(place), np.bool_)
    for hide in (_hide_in_front, _hide_behind):
        for c, camera in enumerate(cameras):  # lines that go the same way take the same branches
            hide(crop, (place, start, normal), camera, share[c], pixel[c, :, 0], seen)


@njit(cache=True, nogil=True)
def _find_normals(crop: Any, place: Any, normal: Any) -> None:
    """Write the outward unit normal of each voxel; 0 where what is around is symmetric.

    Away from what is occupied is toward what is empty, for the voxels around have the mean 0.
    """
    for n in range(len(place)):
        x, y, z = place[n, 0], place[n, 1], place[n, 2]
        a = b = c = 0
        for i in range(-REACH, REACH + 1):
            for j in range(-REACH, REACH + 1):
                line = crop[x + i, y + j, z - REACH : z + REACH + 1]
                count = 0
                for k in range(2 * REACH + 1):
                    count += np.int64(line[k])
                    c -= (k - REACH) * np.int64(line[k])
                a, b = a - i * count, b - j * count
        length = max(np.sqrt(a * a + b * b + c * c), 1.0)
        normal[n, 0], normal[n, 1], normal[n, 2] = a / length, b / length, c / length


@njit(cache=True, nogil=True)
def _hide_in_front(crop: Any, surface: Any, camera: Any, share: Any, row: Any, seen: Any) -> None:
    """Write -1 for the rows that a camera before the surface does not see; mark what it sees.

    Those that it would see from behind are written as -2 less the row, for they wait.
    """
    place, start, normal = surface
    grid = (crop.ravel(), crop.shape)
    for n in range(len(place)):
        if row[n] < 0:
            continue
        x, y, z = start[n, 0], start[n, 1], start[n, 2]
        way = (camera[0] - x, camera[1] - y, camera[2] - z)
        if way[0] * normal[n, 0] + way[1] * normal[n, 1] + way[2] * normal[n, 2] < 0:
            row[n] = -2 - row[n]
            continue
        own = (place[n, 0] * crop.shape[1] + place[n, 1]) * crop.shape[2] + place[n, 2]
        if _blocked(grid, (x, y, z), way, own, share[n]):
            row[n] = -1
        else:
            seen[n] = True


@njit(cache=True, nogil=True)
def _hide_behind(crop: Any, surface: Any, camera: Any, share: Any, row: Any, seen: Any) -> None:
    """Write the rows that wait, or -1 where another camera sees the voxel or this one does not."""
    place, start, _ = surface
    grid = (crop.ravel(), crop.shape)
    for n in range(len(place)):
        waiting = -2 - row[n]
        if waiting < 0:
            continue
        row[n] = -1
        if not seen[n]:
            x, y, z = start[n, 0], start[n, 1], start[n, 2]
            way = (camera[0] - x, camera[1] - y, camera[2] - z)
            own = (place[n, 0] * crop.shape[1] + place[n, 1]) * crop.shape[2] + place[n, 2]
            if not _blocked(grid, (x, y, z), way, own, share[n]):
                row[n] = waiting


@njit(cache=True, nogil=True, error_model="numpy")
def _blocked(grid: Any, start: Any, way: Any, own: Any, share: Any) -> Any:
    """Return whether a line meets an occupied voxel of a grid, other than its own.

    `share`: from which share of its way on it does not.
    """
    occupied, (nx, ny, nz) = grid
    x, y, z = start
    dx, dy, dz = way
    i, j, k = int(np.floor(x + 0.5)), int(np.floor(y + 0.5)), int(np.floor(z + 0.5))
    if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
        return False
    at = (i * ny + j) * nz + k
    if share <= 0:
        return occupied[at] and at != own
    step_x, far_x, tx, end_x = _steps(x, dx, i, nx)
    step_y, far_y, ty, end_y = _steps(y, dy, j, ny)
    step_z, far_z, tz, end_z = _steps(z, dz, k, nz)
    step_x, step_y = step_x * ny * nz, step_y * nz
    end = min(min(end_x, end_y), min(end_z, 1.0)) * (
        1 - 1e-9
    )  # rounding never walks out of the grid
    end = min(end, np.float64(share))
    while not occupied[at] or at == own:
        if tx < ty and tx < tz:
            if tx >= end:
                return False
            at, tx = at + step_x, tx + far_x
        elif ty < tz:
            if ty >= end:
                return False
            at, ty = at + step_y, ty + far_y
        else:
            if tz >= end:
                return False
            at, tz = at + step_z, tz + far_z
    return True


@njit(cache=True, nogil=True)
def _steps(x: Any, dx: Any, i: Any, count: Any) -> Any:
    """Return a line's direction along an axis, its share from plane to plane, to the first, out."""
    if dx == 0:
        return 1, np.inf, np.inf, np.inf
    share = 1 / dx
    if dx > 0:
        return 1, share, (i + 0.5 - x) * share, (count - 0.5 - x) * share
    return -1, -share, (i - 0.5 - x) * share, (-0.5 - x) * share
