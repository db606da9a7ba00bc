"""A floor that fades out, with grid lines and the soft shadow of what stands on it."""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.rendering.drawing.canvas import Color, Image

_CELL_M = 0.02
"""Edge of a cell of the shadow. As fine as the voxels that are usual."""
_HALF_CELLS = 96
"""Cells of the shadow on each side of its middle. 1.9 m hold a performer with stretched arms."""


def cast_shadow(
    center: NDArray[np.floating], voxel_m: float, middle: NDArray[np.float64], floor_m: float
) -> NDArray[np.float32]:
    """Return how much of the light each cell of the floor loses, 0-1.

    What touches the floor casts a dark, narrow shadow, what is above it a wide, faint one.

    Parameters
    ----------
    center : (voxel, 3) float
        Metres.
    voxel_m : float
        Edge of a voxel.
    middle : (2,) float
        x and z of the middle of the shadow, metres.
    floor_m : float
        Height of the floor.

    Returns
    -------
    (x, z) float32
        Cells of 2 cm.
    """
    side = 2 * _HALF_CELLS + 1
    shadow = np.zeros((side, side), np.float32)
    cell = np.rint((center[:, [0, 2]] - middle) / _CELL_M).astype(np.int64) + _HALF_CELLS
    inside = ((cell >= 0) & (cell < side)).all(axis=1)
    number = cell[inside] @ np.array([side, 1])
    height = np.maximum(center[inside, 1] - floor_m, 0.0)
    foot = np.ones((2 * round(voxel_m / _CELL_M / 2) + 1,) * 2, np.uint8)
    for reach_m, blur_m, share in ((0.1, 0.035, 0.6), (0.9, 0.16, 0.6)):
        layer = np.zeros_like(shadow)
        np.maximum.at(layer.ravel(), number, np.exp(-height / reach_m).astype(np.float32))
        layer = cv2.dilate(layer, foot)
        shadow += share * cv2.GaussianBlur(layer, (0, 0), blur_m / _CELL_M)
    return np.minimum(shadow, 1.0)


def paint_floor(
    image: Image,
    image_from_world: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    shadow: NDArray[np.float32],
    middle: NDArray[np.float64],
    floor_m: float,
    *,
    line: Color,
    grid_m: float,
    radius_m: float,
) -> None:
    """Paint the floor into a picture, in place; seen from below there is none.

    Parameters
    ----------
    image : (row, column, 3) uint8
        RGB of the background.
    image_from_world : (3, 3), (3, 3), (3,) float
        Matrix, rotation and translation of the camera, x = K (R X + t).
    shadow : (x, z) float32
        Share of light lost, as `cast_shadow` gives it.
    middle : (2,) float
        x and z of the middle of the shadow and of the floor, metres.
    floor_m : float
        Height of the floor.
    line : (int, int, int)
        RGB of the grid lines, which go through the origin of the world.
    grid_m, radius_m : float
        Distance of the lines, and from the middle to where they have faded out.
    """
    matrix, rotation, translation = image_from_world
    eye = -rotation.T @ translation
    above = float(eye[1] - floor_m)
    if above <= 0.0:
        return
    ray = rotation.T @ np.linalg.inv(matrix)
    place = np.array([eye[0], above, eye[2], middle[0], middle[1], grid_m, radius_m])
    _paint(image, ray, place, shadow, np.array(line, np.float32))


@njit(cache=True, nogil=True)
def _paint(image: Any, ray: Any, place: Any, shadow: Any, line: Any) -> None:
    """Mix grid and shadow into each pixel whose ray meets the floor near the middle."""
    x_eye, above, z_eye, x_middle, z_middle, grid_m, radius_m = place
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            down = ray[1, 0] * column + ray[1, 1] * row + ray[1, 2]
            if down >= -1e-9:
                continue
            far = -above / down
            dx = ray[0, 0] * column + ray[0, 1] * row + ray[0, 2]
            dz = ray[2, 0] * column + ray[2, 1] * row + ray[2, 2]
            x, z = x_eye + far * dx, z_eye + far * dz
            away = math.hypot(x - x_middle, z - z_middle) / radius_m
            if away >= 1.0:
                continue
            faded = (1.0 - away * away) ** 2
            shade = 1.0 - _sample(shadow, (x - x_middle) / _CELL_M, (z - z_middle) / _CELL_M)
            tilt_u, tilt_v = ray[1, 0] / down, ray[1, 1] / down
            wide = abs(ray[0, 0] - dx * tilt_u) + abs(ray[0, 1] - dx * tilt_v)
            deep = abs(ray[2, 0] - dz * tilt_u) + abs(ray[2, 1] - dz * tilt_v)
            drawn = faded * max(_on_line(x, grid_m, far * wide), _on_line(z, grid_m, far * deep))
            for channel in range(3):
                paper = float(image[row, column, channel])
                mixed = shade * (paper + drawn * (line[channel] - paper))
                image[row, column, channel] = int(mixed + 0.5)


@njit(cache=True, nogil=True)
def _on_line(x: float, grid_m: float, pixel_m: float) -> float:
    """Return the share of a pixel on a line one pixel wide; lines closer than pixels fade."""
    away = abs(x - grid_m * math.floor(x / grid_m + 0.5))
    dense = min(max(1.5 - 6.0 * pixel_m / grid_m, 0.0), 1.0)
    return dense * min(max(1.2 - away / pixel_m, 0.0), 1.0)


@njit(cache=True, nogil=True)
def _sample(shadow: Any, x: float, z: float) -> float:
    """Return the shadow between four cells, 0 outside."""
    x, z = x + shadow.shape[0] // 2, z + shadow.shape[1] // 2
    i, k = math.floor(x), math.floor(z)
    if i < 0 or k < 0 or i >= shadow.shape[0] - 1 or k >= shadow.shape[1] - 1:
        return 0.0
    a, c = x - i, z - k
    low = (1.0 - c) * shadow[i, k] + c * shadow[i, k + 1]
    high = (1.0 - c) * shadow[i + 1, k] + c * shadow[i + 1, k + 1]
    return (1.0 - a) * low + a * high
