"""Expect the performer in places before a backdrop without color, where gray is hardly told.

Before a gray wall a gray sleeve has the color of the wall in a shadow, and a hand nearly so. What
differs from the backdrop in any way, in brightness or a little in color, is the performer with all
shadows. But shadows lie on the floor: what differs to all cameras at a place well above it is the
performer. (The hull of the other cameras tells each camera where to look more closely.)
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.capture.backgrounds import Background, measure_gain, smooth
from tasks.engine.kernels import njit
from tasks.engine.progress import within
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection, camera_centers, nearest_pixels
from tasks.geometry.voxels import VoxelGrid, voxel_centers, voxel_index
from tasks.reconstruction.boxes.bits import read_bits
from tasks.reconstruction.boxes.carving import carve_boxes
from tasks.reconstruction.regions.differences import Planes, differ_in_color

_STEP = 6
"""From a pixel to the next one that tells color and noise of a picture, in rows and columns [px].
Two thousand of 320 x 240 pixels tell a median to some hundredths."""

_LEAST_COLORLESS = 0.1
"""How much of a backdrop has no color where the performer is looked for more closely [share]. A
gray wall is most of a picture, a screen of a color all of it; chosen, not measured."""

_NOISE_LEVELS = 6.0
"""How many times the noise of a frame a color differs at least [standard deviations]. 5 to 8 change
what is missing of a gray capture's silhouettes by 0.006, where they win 0.06."""

_LEAST_NOISE = 0.5
"""Noise that a frame has at least [levels]. Bytes round by so much."""

_BRIGHTER = 0.08
"""How much brighter or darker than the backdrop a pixel is at least that differs by brightness
alone [share]. It is several times the noise of a picture, and little beside a shadow; 0.06 to 0.1
change what is missing by 0.006."""

_NORMAL_RADIUS = 1.1774
"""Median of the length of two normal deviates [standard deviations]. It is the root of 2 ln 2; a
color has two directions beside the one of its brightness."""

_COARSE = 2
"""Edge of the voxels of the hull that tells where to look [voxels]. A limb is several thick."""

_SHADOW_HALF_M = 0.3
"""Half the width of what a shadow covers of the floor [m]. That of a trunk with its arms held to
the sides; chosen, not measured."""

_MIN_CAMERAS = 3
"""A place that fewer cameras see is not expected to be the performer's [cameras]. As for hulls."""


def has_no_color(background: Background, threshold: float) -> bool:
    """Return whether a good part of a backdrop is gray, white or black.

    Parameters
    ----------
    background
        Of a camera.
    threshold
        Distance of a color from all grays up to which it is one, levels.
    """
    color = background.color[::_STEP, ::_STEP]
    chroma = np.linalg.norm(color - color.mean(axis=-1, keepdims=True), axis=-1)
    return bool((chroma < threshold).mean() > _LEAST_COLORLESS)


def expect_performer(
    films: Sequence[NDArray[np.uint8]],
    backgrounds: Sequence[Background],
    projection: Projection,
    grid: VoxelGrid,
) -> NDArray[np.bool_]:
    """Return the pixels that are the performer's because all cameras see something there.

    Parameters
    ----------
    films : sequence of (time, row, column, 3) uint8
        RGB, of the same moments, an array a camera.
    backgrounds
        Of each camera.
    projection, grid
        The cameras, and what is carved.

    Returns
    -------
    (camera, time, row, column) bool
        As large as the largest image; on and near the floor nothing is expected.
    """
    columns, rows = projection.image_size.max(axis=0)
    differing = np.zeros((len(films), len(films[0]), rows, columns), np.bool_)

    def mark(camera: int) -> None:
        film = films[camera]
        into = differing[camera, :, : film.shape[1], : film.shape[2]]
        into[:] = what_differs(film, backgrounds[camera])

    with within(0.0, 0.5):
        side_by_side(mark, range(len(films)))
    coarse = _coarsen(grid)
    least_m = shadows_reach_m(projection, grid)

    def expect(frame: int) -> None:
        seen = differing[:, frame]
        seen &= _film_hull(seen, projection, coarse, least_m)

    with within(0.5, 1.0):
        side_by_side(expect, range(len(films[0])))
    return differing


def what_differs(film: NDArray[np.uint8], background: Background) -> NDArray[np.bool_]:
    """Return (time, row, column) what differs in any way from a background, shadows too.

    The noise of a frame is that of its colors beside the background's brightness; the performer
    covers less than half of the picture.

    Parameters
    ----------
    film : (time, row, column, 3) uint8
        RGB, as filmed.
    background
        Of the same camera.
    """
    held, differs = Planes(background), np.empty(film.shape[:3], np.bool_)
    behind = background.color[::_STEP, ::_STEP]
    none = np.zeros_like(background.noise)
    for frame, into in zip(film, differs, strict=True):
        image = smooth(frame, held.planes)
        gain = measure_gain(image, background)
        seen = image[::_STEP, ::_STEP].astype(np.float32)
        there = gain * behind
        share = np.vecdot(seen, there) / np.maximum(np.vecdot(there, there), 1.0)
        off = seen - share[..., None] * there
        far = np.sqrt(np.vecdot(off, off))
        least = _NOISE_LEVELS * max(np.median(far) / _NORMAL_RADIUS, _LEAST_NOISE)
        limits = np.array([gain, least, 0.0, 1.0 - _BRIGHTER, 1.0 + _BRIGHTER], np.float32)
        differ_in_color(held.planes, held.behind, none, limits, held.seed)
        into[:] = held.seed
    return differs


def shadows_reach_m(projection: Projection, grid: VoxelGrid) -> float:
    """Return up to which height shadows on the floor may look like something above it, m.

    Two cameras that look from opposite sides see both a shadow behind a point that is lower than
    half the shadow's width times the tangent of their elevation.
    """
    middle = np.array(grid.origin_m) + (np.array(grid.shape) - 1) * grid.voxel_m / 2.0
    away = camera_centers(projection) - middle * [1.0, 0.0, 1.0]
    slope = away[:, 1] / np.maximum(np.hypot(away[:, 0], away[:, 2]), 1e-6)
    return float(_SHADOW_HALF_M * np.median(abs(slope)))


def _coarsen(grid: VoxelGrid) -> VoxelGrid:
    """Return the grid of larger voxels that covers a grid."""
    shape = tuple(-(-side // _COARSE) for side in grid.shape)
    return VoxelGrid(grid.origin_m, _COARSE * grid.voxel_m, (shape[0], shape[1], shape[2]))


def _film_hull(
    seen: NDArray[np.bool_], projection: Projection, grid: VoxelGrid, least_m: float
) -> NDArray[np.bool_]:
    """Return (camera, row, column) where the hull of what is seen is filmed, above a height."""
    x, y, z = (
        np.asarray(origin + np.arange(side) * grid.voxel_m, np.float64)
        for origin, side in zip(grid.origin_m, grid.shape, strict=True)
    )
    words, begin = carve_boxes(seen, projection, (x, y, z), (0, _MIN_CAMERAS))
    point = voxel_centers(grid, voxel_index(read_bits(words, begin, grid.shape), 0))
    point = point[point[:, 1] > least_m]
    filmed = np.zeros(seen.shape, np.uint8)
    if not len(point):
        return filmed.view(np.bool_)
    depth = np.linalg.norm(camera_centers(projection) - point.mean(axis=0), axis=1)
    apart = projection.intrinsics[:, 0, 0] * grid.voxel_m / depth
    for pixel, picture, gap in zip(nearest_pixels(point, projection), filmed, apart, strict=True):
        _mark(pixel, picture)
        side = 2 * int(np.ceil(gap / 2.0)) + 1
        picture[:] = cv2.morphologyEx(picture, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    return filmed.view(np.bool_)


@njit(cache=True, nogil=True)
def _mark(pixel: Any, picture: Any) -> None:
    """Set the pixels (point, 2) of a picture; those that are -1 are not filmed."""
    for n in range(len(pixel)):
        if pixel[n, 0] >= 0:
            picture[pixel[n, 0], pixel[n, 1]] = 1
