"""Color the surface of a visual hull from the images (digitization paper, section 2.3).

The cameras that see a surface voxel each have a candidate color for it, the pixel in which it
is filmed; the voxel takes the candidate nearest to the mean of its candidates.

Which cameras see a voxel is found in `tasks.reconstruction.sight.visibility`; the paper says
"observed in the image" only.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Block, Written, read_block, write_block
from storage.formats.capture.capture import capture_of
from storage.schema import NO_CAMERA
from tasks.capture.films import grid_of, projection_of
from tasks.engine.kernels import njit
from tasks.engine.settings import NotNegative, check_ranges
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection, camera_centers, nearest_pixels
from tasks.geometry.voxels import (
    VoxelGrid,
    VoxelRuns,
    find_surface,
    padded_crop,
    take_frame,
    voxel_centers,
)
from tasks.reconstruction.regions.pixels import number_pixels
from tasks.reconstruction.sight.visibility import REACH, hide_pixels

_COLORED = 2
"""What a crop has where a voxel has a color of its own; an occupied voxel without one has 1."""


@dataclass(frozen=True)
class ColoringSettings:
    """Everything that changes a color, and nothing that does not.

    Raises
    ------
    ValueError
        If the lift is not a finite number from 0.
    """

    lift_voxels: NotNegative = 2.0
    """How far above a voxel the lines to the cameras begin [voxels]. On generated dancers 0, 1, 1.5
    and 2 leave 14, 4.7, 2.2 and 0.7 % without color, 79, 90, 92 and 94 % have the right part's
    color of their own, and more than 2 adds nothing."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class SurfaceColors:
    """The colors of a frame's surface voxels, in the order of the voxels."""

    is_surface: NDArray[np.bool_]
    """(voxel,) which of the hull's voxels are on the surface: have an empty 6-neighbor."""

    index: NDArray[np.int32]
    """(surface voxel, 3) index in the grid."""

    color: NDArray[np.uint8]
    """(surface voxel, 3) RGB."""

    camera: NDArray[np.uint8]
    """(surface voxel,) the camera whose candidate was taken; `NO_CAMERA` where no camera sees the
    voxel, and the color is the nearest colored voxel's (black where there is none)."""


def color_surface(
    hull: VoxelRuns,
    grid: VoxelGrid,
    images: NDArray[np.uint8],
    silhouettes: NDArray[np.bool_],
    projection: Projection,
    settings: ColoringSettings,
) -> SurfaceColors:
    """Return the colors of the surface of one frame's hull.

    Of equally near candidates the first camera's is taken; of equally near colored voxels the
    first in order. Frames can be colored side by side in threads; one frame uses one.

    Parameters
    ----------
    hull
        One frame on the grid.
    grid
        What was carved.
    images : (camera, row, column, 3) uint8
        RGB, as filmed.
    silhouettes : (camera, row, column) bool
        As carved. A camera that films a voxel outside its silhouette has no candidate for it.
    projection
        The cameras, in the same order.
    settings
        How visibility is decided.

    Raises
    ------
    ValueError
        If the hull is not one frame on this grid, images and silhouettes are not of these
        cameras, or there are `NO_CAMERA` cameras or more.
    """
    _check(hull, grid, images, silhouettes, projection)
    rows, columns = np.minimum(images.shape[1:3], silhouettes.shape[1:]).tolist()
    inside = silhouettes[:, :rows, :columns]
    pixels = images[:, :rows, :columns][inside]
    return color_of_pixels(hull, grid, np.packbits(inside, axis=-1), pixels, projection, settings)


def color_of_pixels(
    hull: VoxelRuns,
    grid: VoxelGrid,
    packed: NDArray[np.uint8],
    pixels: NDArray[np.uint8],
    projection: Projection,
    settings: ColoringSettings,
) -> SurfaceColors:
    """Return what `color_surface` does, of the silhouettes' pixels alone.

    Parameters
    ----------
    packed : (camera, row, column / 8) uint8
        The silhouettes, packed along the columns; no bit is set beside an image.
    pixels : (pixel, 3) uint8
        RGB of the silhouettes' pixels in their order: camera by camera, row by row.
    """
    crop, begin = padded_crop(hull, 0, margin=REACH)
    is_surface, index = find_surface(hull, crop, begin)
    place = index - begin
    pixel = nearest_pixels(voxel_centers(grid, index), projection)
    _keep_inside(packed, pixel)
    cameras = (camera_centers(projection) - grid.origin_m) / grid.voxel_m - begin
    hide_pixels(crop, place, cameras, settings.lift_voxels, pixel)
    color = np.zeros((len(index), 3), np.uint8)
    camera = np.full(len(index), NO_CAMERA, np.uint8)
    _choose(pixels, number_pixels(packed, pixel), color, camera)
    _borrow(crop, place, camera, color)
    return SurfaceColors(is_surface, index, color, camera)


def _check(
    hull: VoxelRuns,
    grid: VoxelGrid,
    images: NDArray[np.uint8],
    silhouettes: NDArray[np.bool_],
    projection: Projection,
) -> None:
    """Refuse what does not fit together, every fault at once."""
    faults = []
    count = projection.cameras
    if hull.frames != 1 or hull.shape != grid.shape:
        faults.append(
            f"the hull has {hull.frames} frames on a grid of shape {hull.shape}, wanted is one "
            f"on {grid.shape}"
        )
    if count >= NO_CAMERA:
        faults.append(f"there are {count} cameras, wanted are fewer than {NO_CAMERA}")
    columns, rows = projection.image_size.max(axis=0)
    wanted = f"({count}, {rows} or more, {columns} or more"
    for name, array, kind, rest in (
        ("images", images, np.uint8, (3,)),
        ("silhouettes", silhouettes, np.bool_, ()),
    ):
        fits = array.ndim == 3 + len(rest) and array.shape[0] == count
        fits = fits and array.shape[1] >= rows and array.shape[2] >= columns
        if not fits or array.shape[3:] != rest or array.dtype != kind:
            last = ", 3)" if rest else ")"
            faults.append(
                f"{name} are {array.dtype} of shape {array.shape}, wanted is {wanted}{last} "
                f"{np.dtype(kind)}"
            )
    if faults:
        raise ValueError(f"this frame cannot be colored: {'; '.join(faults)}")


@njit(cache=True, nogil=True)
def _keep_inside(packed: Any, pixel: Any) -> None:
    """Write -1 for the pixels outside the silhouettes."""
    for c in range(len(pixel)):
        for n in range(pixel.shape[1]):
            row, column = pixel[c, n, 0], pixel[c, n, 1]
            if row >= 0 and not packed[c, row, column >> 3] >> (7 - (column & 7)) & 1:
                pixel[c, n, 0] = pixel[c, n, 1] = -1


@njit(cache=True, nogil=True)
def _choose(pixels: Any, number: Any, color: Any, camera: Any) -> None:
    """Write the candidate nearest to the mean of the candidates, and its camera."""
    for n in range(len(color)):
        count = red = green = blue = 0
        for c in range(len(number)):
            p = number[c, n]
            if p >= 0:
                count += 1
                red += np.int64(pixels[p, 0])
                green += np.int64(pixels[p, 1])
                blue += np.int64(pixels[p, 2])
        least = -1
        for c in range(len(number)):
            p = number[c, n]
            if p >= 0:
                r = count * np.int64(pixels[p, 0]) - red
                g = count * np.int64(pixels[p, 1]) - green
                b = count * np.int64(pixels[p, 2]) - blue
                distance = r * r + g * g + b * b
                if least < 0 or distance < least:
                    least = distance
                    camera[n] = c
        if count:
            for k in range(3):
                color[n, k] = pixels[number[camera[n], n], k]


@njit(cache=True, nogil=True)
def _borrow(crop: Any, place: Any, camera: Any, color: Any) -> None:
    """Give voxels that no camera sees the color of the nearest one that some camera sees."""
    colored = 0
    for n in range(len(place)):
        if camera[n] != NO_CAMERA:
            crop[place[n, 0], place[n, 1], place[n, 2]] = _COLORED
            colored += 1
    if colored == 0:
        return
    for n in range(len(place)):
        if camera[n] == NO_CAMERA:
            lender = _find_voxel(place, _find_nearest(crop, place[n, 0], place[n, 1], place[n, 2]))
            for k in range(3):
                color[n, k] = color[lender, k]


@njit(cache=True, nogil=True, inline="always")
def _find_nearest(crop: Any, x: Any, y: Any, z: Any) -> Any:
    """Return the place of the colored voxel nearest to a place, shell by shell."""
    nearest, least, reach = (0, 0, 0), -1, 1
    while least < 0 or reach * reach <= least:
        for i in range(max(x - reach, 0), min(x + reach, crop.shape[0] - 1) + 1):
            for j in range(max(y - reach, 0), min(y + reach, crop.shape[1] - 1) + 1):
                shell = abs(i - x) == reach or abs(j - y) == reach
                step = 1 if shell else 2 * reach
                for k in range(z - reach, z + reach + 1, step):
                    if not 0 <= k < crop.shape[2] or crop[i, j, k] != _COLORED:
                        continue
                    distance = (i - x) ** 2 + (j - y) ** 2 + (k - z) ** 2
                    if least < 0 or distance < least or (distance == least and (i, j, k) < nearest):
                        least, nearest = distance, (i, j, k)
        reach += 1
    return nearest


@njit(cache=True, nogil=True, inline="always")
def _find_voxel(place: Any, wanted: Any) -> Any:
    """Return the number of the voxel at a place, of voxels in order."""
    first, end = 0, len(place)
    while end - first > 1:
        middle = (first + end) // 2
        if (place[middle, 0], place[middle, 1], place[middle, 2]) <= wanted:
            first = middle
        else:
            end = middle
    return first


def color_block(
    archive: str, capture: str, digest: str, silhouettes: Block, hulls: Block,
    into: str, settings: ColoringSettings,
) -> Written:  # fmt: skip
    """Write the colors of the surfaces of a block of hulls as a block.

    Parameters
    ----------
    capture, digest
        The folder with the calibration, and the digest of what is in it.
    silhouettes, hulls
        What `extract_block` and `carve_block` wrote.
    into
        Path of the block in the archive.
    settings
        How visibility is decided.

    Returns
    -------
    Written
        The arrays are `is_surface` (voxel,) bool, `color`
        (surface voxel, 3), `camera` (surface voxel,) and `offset` (frame + 1,) of a frame's
        surface voxels.
    """
    begun = time.monotonic()
    source = capture_of(capture, digest)
    place = open_archive(archive).place
    filmed = read_block(place, silhouettes)
    packed, pixels = filmed["silhouette"], filmed["color"]
    counts = [int(np.bitwise_count(each).sum(dtype=np.int64)) for each in packed]
    edges = np.cumsum([0, *counts])
    projection, grid = projection_of(source.cameras), grid_of(source)
    runs = VoxelRuns(**read_block(place, hulls), shape=grid.shape)

    def color(frame: int) -> tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.uint8]]:
        seen = packed[frame], pixels[edges[frame] : edges[frame + 1]]
        found = color_of_pixels(take_frame(runs, frame), grid, *seen, projection, settings)
        return found.is_surface, found.color, found.camera

    is_surface, colors, cameras = zip(*side_by_side(color, range(runs.frames)), strict=True)
    arrays = {
        "is_surface": np.concatenate(is_surface),
        "color": np.concatenate(colors),
        "camera": np.concatenate(cameras),
        "offset": np.cumsum([0, *map(len, colors)]).astype(np.int64),
    }
    return write_block(place, into, (silhouettes.start, silhouettes.end), arrays, begun)
