"""Carve a performer's visual hull out of a voxel grid (digitization paper, section 2.2).

A voxel is occupied when its center is filmed inside the silhouette of every camera that sees
it (shape from silhouette; Laurentini 1994). The center is projected with the lens' distortion
in float64 (`tasks.geometry.projection`) and belongs to the nearest pixel of the image as
filmed. A camera that does not see the center, behind it or outside its image, does not vote;
the paper's cameras see everything, here a voxel that too few cameras see is empty. Boxes are
decided as a whole where they can be (`tasks.reconstruction.boxes.carving`); the result is that of
testing each voxel.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Block, Written, read_block, write_block
from storage.formats.capture.capture import capture_of
from tasks.capture.films import grid_of, largest_image, projection_of
from tasks.engine.settings import Count, CountOrNone, check_ranges
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, join_runs
from tasks.reconstruction.boxes.bits import read_bits
from tasks.reconstruction.boxes.carving import MOST_CAMERAS, carve_boxes


@dataclass(frozen=True)
class CarvingSettings:
    """Everything that changes a hull, and nothing that does not.

    Raises
    ------
    ValueError
        If a number is negative, or `min_cameras` is 0.
    """

    misses_allowed: CountOrNone = 0
    """How many cameras that see a voxel may film it outside their silhouettes [cameras]. The paper
    allows none."""

    min_cameras: Count = 3
    """A voxel that fewer cameras see is empty [cameras]. Two silhouettes meet in more than a
    performer."""

    def __post_init__(self) -> None:
        check_ranges(self)


def carve_visual_hull(
    silhouettes: NDArray[np.bool_],
    projection: Projection,
    grid: VoxelGrid,
    settings: CarvingSettings,
) -> VoxelRuns:
    """Return the voxels of one frame whose centers lie inside the silhouettes.

    Frames can be carved side by side in threads; one frame uses one.

    Parameters
    ----------
    silhouettes : (camera, row, column) bool
        True where a pixel, as filmed, shows the performer. Where a camera's image is smaller
        than the array, the rest is not looked at.
    projection
        The cameras, in the same order.
    grid
        What to carve.
    settings
        How strictly.

    Returns
    -------
    VoxelRuns
        Of a single frame; without runs where nothing is left.

    Raises
    ------
    ValueError
        If the silhouettes are not of these cameras, or there are fewer than `min_cameras`
        or more than 62.
    """
    _check(silhouettes, projection, settings)
    axes: Any = tuple(
        grid.origin_m[k] + np.arange(grid.shape[k]) * float(grid.voxel_m) for k in range(3)
    )
    rule = (settings.misses_allowed, settings.min_cameras)
    words, begin = carve_boxes(silhouettes, projection, axes, rule)
    return read_bits(words, begin, grid.shape)


def _check(
    silhouettes: NDArray[np.bool_], projection: Projection, settings: CarvingSettings
) -> None:
    """Refuse silhouettes that are not of these cameras, and too few or too many cameras."""
    count = projection.cameras
    if silhouettes.dtype != np.bool_ or silhouettes.ndim != 3 or len(silhouettes) != count:
        raise ValueError(
            f"silhouettes are {silhouettes.dtype} of shape {silhouettes.shape}, but ({count}, "
            f"row, column) bool is wanted for {count} cameras"
        )
    columns, rows = projection.image_size.max(axis=0)
    if silhouettes.shape[1] < rows or silhouettes.shape[2] < columns:
        raise ValueError(
            f"silhouettes have {silhouettes.shape[1]} rows and {silhouettes.shape[2]} columns, "
            f"but the cameras' images up to {rows} and {columns}; film and calibrate at one size"
        )
    if not settings.min_cameras <= count <= MOST_CAMERAS:
        raise ValueError(
            f"there are {count} cameras, but at least min_cameras {settings.min_cameras} and at "
            f"most {MOST_CAMERAS} are wanted; lower min_cameras or leave out cameras"
        )


def carve_block(
    archive: str, capture: str, digest: str, silhouettes: Block, into: str,
    settings: CarvingSettings,
) -> Written:  # fmt: skip
    """Write the hulls of the frames of a block of silhouettes as a block.

    Parameters
    ----------
    capture, digest
        The folder with the calibration and the volume, and the digest of what is in it.
    silhouettes
        What `extract_block` wrote.
    into
        Path of the block in the archive.
    settings
        How strictly.

    Returns
    -------
    Written
        The arrays are those of `VoxelRuns`.
    """
    begun = time.monotonic()
    source = capture_of(capture, digest)
    place = open_archive(archive).place
    packed = read_block(place, silhouettes, ["silhouette"])["silhouette"]
    projection, grid = projection_of(source.cameras), grid_of(source)
    _, columns = largest_image(source.cameras)

    def carve(frame: int) -> VoxelRuns:
        silhouette = np.unpackbits(packed[frame], axis=-1, count=columns).view(np.bool_)
        return carve_visual_hull(silhouette, projection, grid, settings)

    runs = join_runs(side_by_side(carve, range(len(packed))))
    arrays = {"start": runs.start, "length": runs.length, "offset": runs.offset}
    return write_block(place, into, (silhouettes.start, silhouettes.end), arrays, begun)
