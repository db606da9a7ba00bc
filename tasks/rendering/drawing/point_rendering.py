"""Point rendering: surface voxels drawn as balls, smoothed, projected, mixed where they overlap.

Each ball is moved so that all touch the smooth surface that the voxels are stairs of. The
nearest ball at a pixel decides its depth, and those just behind it are mixed in, so colors run
smoothly from voxel to voxel (compare surface splatting, Zwicker et al. 2001).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

BALL = 0.9
"""Radius of a ball [voxels]. A surface of voxels that leans in all axes has gaps up to 0.82."""
_REACH = 3
"""How far around a voxel the surface is looked at for its normal [voxels]. Chosen by eye; not
measured."""
_OUTSIDE = -2
"""Mark of an empty cell that is connected with the border of the grid."""
_INSIDE = -1
"""Mark of a cell that the surface encloses."""
_LEAST_NORMAL = 2.0
"""Sum of the ways to empty neighbors below which a voxel has no normal [voxels]. As much is empty
on one side as on the other; chosen, not measured."""
_LEAST_RADIUS_PX = 0.75
"""Least radius of a ball in the fine picture. Half a pixel's diagonal is 0.71: none lies between
two pixels."""


def smooth_surface(
    center: NDArray[np.floating], voxel_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return balls on the smooth surface that voxels are stairs of.

    Parameters
    ----------
    center : (voxel, 3) float
        Centers of the surface voxels on a grid along the axes, metres; what they enclose counts
        as occupied.
    voxel_m : float
        Edge of a voxel.

    Returns
    -------
    place : (voxel, 3) float64
        Centers of the balls, metres; balls of `BALL` voxels reach to where the voxels end.
    normal : (voxel, 3) float64
        Unit vectors outwards; 0 where the surface is too thin to have a direction.
    openness : (voxel,) float64
        Share of the neighborhood that is empty: about 0.4 on a plane, less in a hollow.
    """
    index = np.rint((center - center.min(axis=0)) / voxel_m).astype(np.int64) + _REACH + 1
    nx, ny, nz = index.max(axis=0).tolist()
    number = np.full((nx + _REACH + 2, ny + _REACH + 2, nz + _REACH + 2), _INSIDE, np.int32)
    number[tuple(index.T)] = np.arange(len(index))
    _flood(number)
    flat = number.ravel()
    at = np.ravel_multi_index(tuple(index.T), number.shape)
    normal = np.zeros((len(index), 3), np.float32)
    openness, lift, step = np.zeros((3, len(index)), np.float32)
    _find_normals(flat, at, _around(_REACH, number.shape), normal, lift, openness)
    _find_steps(flat, at, _around(_REACH - 1, number.shape), normal, lift, step)
    place = center + (voxel_m * (step + 0.5 - BALL))[:, None] * normal
    return place, normal.astype(np.float64), openness.astype(np.float64)


def _around(reach: int, shape: tuple[int, ...]) -> NDArray[np.int32]:
    """Return (neighbor, 4): offsets along x, y, z, and in the raveled grid."""
    span = np.arange(-reach, reach + 1)
    offset = np.stack(np.meshgrid(span, span, span, indexing="ij"), axis=-1).reshape(-1, 3)
    offset = offset[(offset**2).sum(axis=1) <= reach**2]
    raveled = offset @ np.array([shape[1] * shape[2], shape[2], 1])
    return np.column_stack([offset, raveled]).astype(np.int32)


@njit(cache=True, nogil=True)
def _flood(number: Any) -> None:
    """Mark as outside what a walk from the corner reaches; the outermost layer is empty."""
    nx, ny, nz = number.shape
    number[0, :, :] = number[-1, :, :] = _OUTSIDE
    number[:, 0, :] = number[:, -1, :] = _OUTSIDE
    number[:, :, 0] = number[:, :, -1] = _OUTSIDE
    direction = -1
    quiet = 0
    while quiet < 2:
        direction = -direction
        changed = False
        for i in range(1, nx - 1):
            x = i if direction > 0 else nx - 1 - i
            for j in range(1, ny - 1):
                y = j if direction > 0 else ny - 1 - j
                for k in range(1, nz - 1):
                    z = k if direction > 0 else nz - 1 - k
                    if number[x, y, z] == _INSIDE and (
                        number[x - direction, y, z] == _OUTSIDE
                        or number[x, y - direction, z] == _OUTSIDE
                        or number[x, y, z - direction] == _OUTSIDE
                    ):
                        number[x, y, z] = _OUTSIDE
                        changed = True
        quiet = 0 if changed else quiet + 1


@njit(cache=True, nogil=True)
def _find_normals(flat: Any, at: Any, around: Any, normal: Any, lift: Any, openness: Any) -> None:
    """Write which way is out, how high the surface nearby lies, and how much is empty there."""
    for voxel in range(len(at)):
        empty = surface = 0
        x = y = z = mean_x = mean_y = mean_z = 0
        for k in range(len(around)):
            there = flat[at[voxel] + around[k, 3]]
            if there == _OUTSIDE:
                empty += 1
                x += around[k, 0]
                y += around[k, 1]
                z += around[k, 2]
            elif there >= 0:
                surface += 1
                mean_x += around[k, 0]
                mean_y += around[k, 1]
                mean_z += around[k, 2]
        openness[voxel] = empty / len(around)
        length = math.sqrt(x * x + y * y + z * z)
        if length < _LEAST_NORMAL:
            continue
        normal[voxel, 0] = x / length
        normal[voxel, 1] = y / length
        normal[voxel, 2] = z / length
        lift[voxel] = (mean_x * x + mean_y * y + mean_z * z) / (length * surface)


@njit(cache=True, nogil=True)
def _find_steps(flat: Any, at: Any, around: Any, normal: Any, lift: Any, step: Any) -> None:
    """Write how far along its normal each ball is moved, in voxels.

    The surface nearby lies low around a stair and high around a notch; around a bend it lies
    low everywhere, and that is what the mean of the neighbors takes away again.
    """
    for voxel in range(len(at)):
        x, y, z = normal[voxel, 0], normal[voxel, 1], normal[voxel, 2]
        total, weight = np.float32(0.0), 0
        for k in range(len(around)):
            there = flat[at[voxel] + around[k, 3]]
            if there < 0:
                continue
            if x * normal[there, 0] + y * normal[there, 1] + z * normal[there, 2] > 0.5:
                total += lift[there]
                weight += 1
        step[voxel] = min(max(lift[voxel] - total / max(weight, 1), -0.5), 0.5)


def project_balls(
    place: NDArray[np.float64], lens: NDArray[np.float64], radius_m: float, fine: int
) -> NDArray[np.float32]:
    """Return (voxel, 6): column, row and their radii in fine pixels, depth and its radius.

    Balls behind the camera or around it have depth 0.
    """
    depth = place[:, 2]
    ahead = depth > 2.0 * radius_m
    pixel = place @ lens.T / np.where(ahead, depth, 1.0)[:, None]
    scale = np.where(ahead, radius_m / np.where(ahead, depth, 1.0), 0.0)
    ball = np.empty((len(place), 6), np.float32)
    ball[:, :2] = (pixel[:, :2] + 0.5) * fine - 0.5
    ball[:, 2] = np.maximum(scale * lens[0, 0] * fine, _LEAST_RADIUS_PX)
    ball[:, 3] = np.maximum(scale * lens[1, 1] * fine, _LEAST_RADIUS_PX)
    ball[:, 4] = np.where(ahead, depth, 0.0)
    ball[:, 5] = radius_m
    return ball


def draw_balls(
    ball: NDArray[np.float32],
    color: NDArray[np.float32],
    shape: tuple[int, int],
    voxel_m: float,
    fine: int,
) -> tuple[NDArray[np.float32], tuple[int, int]] | None:
    """Return (row, column, 4) mixed color and coverage of the fine pixels, and where it begins.

    None where no ball is in the picture.
    """
    first = np.floor(ball[:, :2] - ball[:, 2:4]).astype(np.int64)
    last = np.ceil(ball[:, :2] + ball[:, 2:4]).astype(np.int64)
    seen = (ball[:, 4] > 0) & (last >= 0).all(axis=1)
    seen &= (first[:, 0] < shape[1]) & (first[:, 1] < shape[0])
    if not seen.any():
        return None
    left, top = np.maximum(first[seen].min(axis=0), 0) // fine * fine
    right, bottom = np.minimum(-(-(last[seen].max(axis=0) + 1) // fine) * fine, shape[::-1])
    ball = ball[seen] - np.array([left, top, 0, 0, 0, 0], np.float32)
    depth = np.full((bottom - top, right - left), np.inf, np.float32)
    _find_depth(ball, depth)
    mixed = np.zeros((*depth.shape, 4), np.float32)
    _mix(ball, color[seen], depth, np.float32(voxel_m), mixed)
    return mixed, (int(top), int(left))


@njit(cache=True, nogil=True)
def _find_depth(ball: Any, depth: Any) -> None:
    """Write the depth of the nearest ball at each pixel."""
    rows, columns = depth.shape
    for number in range(len(ball)):
        u, v, ru, rv, far, thick = ball[number]
        for row in range(max(math.ceil(v - rv), 0), min(math.floor(v + rv) + 1, rows)):
            across = np.float32(1.0) - ((row - v) / rv) ** 2
            for column in range(max(math.ceil(u - ru), 0), min(math.floor(u + ru) + 1, columns)):
                bulge = across - ((column - u) / ru) ** 2
                if bulge >= 0.0:
                    near = far - thick * math.sqrt(bulge)
                    if near < depth[row, column]:
                        depth[row, column] = near


@njit(cache=True, nogil=True)
def _mix(ball: Any, color: Any, depth: Any, slack: Any, mixed: Any) -> None:
    """Write the mean color of the balls at most `slack` behind the nearest, and coverage 1."""
    rows, columns = depth.shape
    for number in range(len(ball)):
        u, v, ru, rv, far, thick = ball[number]
        red, green, blue = color[number]
        for row in range(max(math.ceil(v - rv), 0), min(math.floor(v + rv) + 1, rows)):
            across = np.float32(1.0) - ((row - v) / rv) ** 2
            for column in range(max(math.ceil(u - ru), 0), min(math.floor(u + ru) + 1, columns)):
                bulge = across - ((column - u) / ru) ** 2
                if bulge >= 0.0 and far - thick <= depth[row, column] + slack:
                    near = far - thick * math.sqrt(bulge)
                    if near <= depth[row, column] + slack:
                        weight = bulge * bulge + np.float32(1e-4)
                        pixel = mixed[row, column]
                        pixel[0] += weight * red
                        pixel[1] += weight * green
                        pixel[2] += weight * blue
                        pixel[3] += weight
    for row in range(rows):
        for column in range(columns):
            pixel = mixed[row, column]
            if pixel[3] > 0.0:
                pixel /= pixel[3]
