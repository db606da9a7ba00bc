"""Which cameras film a voxel inside their silhouettes, wherever the performer may be.

Carving keeps the voxels that all cameras film inside their silhouettes. To find out which camera
is inconsistent, all voxels are kept that a few cameras at most film outside, together with which
cameras these are. From that the visual hull of any set of cameras follows without looking into a
picture again. Boxes of voxels are halved from coarse to fine; one is left out when its whole image
is outside of too many silhouettes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection, camera_centers, project_points

_HALVINGS = 3
"""How often boxes are halved until they are voxels. Chosen, not measured."""
_MOST_BOXES = 500_000
"""How many boxes there may be before any is halved. It bounds the memory; chosen, not measured."""
_MOST_COLUMNS = 400
"""Widest silhouette that is compared as it is [px]. Larger ones are reduced: what is looked for is
centimetres."""
_VOXELS_ACROSS = 30
"""How many voxels lie across a standing performer's width and height together. Chosen, not
measured."""
_FILLED = 0.5
"""Of how much of it silhouette a reduced pixel is silhouette [share]. The majority."""
_UNSEEN = -1
"""Number of the pixel of a voxel that a camera does not see."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The silhouettes of some frames before their cameras, reduced where they are large."""

    silhouettes: NDArray[np.bool_]
    """(time, camera, row, column)."""
    projection: Projection
    voxel_m: float
    """Edge of a voxel: some 30 across a standing performer's width and height together, whatever
    the scale of the world."""


@dataclass(frozen=True, eq=False)
class VoxelConsistency:
    """The voxels of one frame that at most a few cameras film outside their silhouettes."""

    points: NDArray[np.float64]
    """(voxel, 3) centers, m."""
    seen: NDArray[np.uint64]
    """(voxel,) bit c is set where camera c sees it."""
    outside: NDArray[np.uint64]
    """(voxel,) bit c is set where camera c films it outside its silhouette."""
    pixel: NDArray[np.int64]
    """(camera, voxel) number of the pixel, -1 where the camera does not see it."""
    reach_px: NDArray[np.int64]
    """(camera,) half the width of a voxel's image, rounded."""


def make_scene(
    silhouettes: NDArray[np.bool_],
    projection: Projection,
    center_m: tuple[float, float, float],
    usable: Sequence[int],
) -> Scene:
    """Return silhouettes at the size in which they are compared.

    Parameters
    ----------
    silhouettes : (time, camera, row, column) bool
        At least one of the usable is not empty.
    projection
        The cameras.
    center_m
        About where the performer is; only the fineness depends on it.
    usable
        The cameras that count; for the others the silhouette is the whole picture.
    """
    factor = max(1, -(-silhouettes.shape[3] // _MOST_COLUMNS))
    if factor > 1:
        silhouettes, projection = _reduced(silhouettes, projection, factor)
    usable_cameras = np.zeros(projection.cameras, np.bool_)
    usable_cameras[list(usable)] = True
    area = silhouettes.sum(axis=(2, 3)) * usable_cameras
    away = np.linalg.norm(camera_centers(projection) - center_m, axis=1)
    width = np.sqrt(area) * away / projection.intrinsics[:, 0, 0]
    shown = silhouettes | ~usable_cameras[:, None, None]
    return Scene(shown, projection, float(np.median(width[area > 0])) / _VOXELS_ACROSS)


def _reduced(
    silhouettes: NDArray[np.bool_], projection: Projection, factor: int
) -> tuple[NDArray[np.bool_], Projection]:
    """Return silhouettes smaller by a whole factor (a pixel is what most of it was)."""
    time, cameras, rows, columns = silhouettes.shape
    size = -(-projection.image_size // factor)
    high, wide = -(-rows // factor), -(-columns // factor)
    small = np.empty((time, cameras, high, wide), np.bool_)
    padded = np.zeros((cameras, high * factor, wide * factor), np.bool_)
    for frame, silhouette in enumerate(silhouettes):  # of large pictures not all at once
        padded[:, :rows, :columns] = silhouette
        blocks = padded.reshape(cameras, high, factor, wide, factor)
        small[frame] = blocks.mean(axis=(2, 4)) >= _FILLED
    inner = projection.intrinsics.copy()
    inner[:, :2] /= factor
    inner[:, :2, 2] += 0.5 / factor - 0.5
    return small, Projection(projection.camera_from_world, inner, projection.distortion, size)


def measure_voxel_consistency(
    scene: Scene,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    *,
    most_outside: int = 2,
    min_cameras: int = 3,
) -> list[VoxelConsistency]:
    """Return the voxels of a box that few cameras film outside their silhouettes, frame by frame.

    Parameters
    ----------
    scene
        The silhouettes; where a camera has none in a frame, all that it sees is outside.
    low, high : (3,) float64
        Corners of the box, m.
    most_outside
        A voxel that more cameras film outside their silhouettes is left out.
    min_cameras
        So is one that fewer cameras film inside, or, where a camera films it outside, fewer than
        half.
    """
    edge = scene.voxel_m * 2**_HALVINGS
    while np.prod(np.ceil((high - low) / edge)) > _MOST_BOXES:
        edge *= 2
    sides = [np.arange(low[k] + edge / 2, high[k] + edge / 2, edge) for k in range(3)]
    boxes = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    images = _image_numbers(boxes, scene.projection)
    seen = (images[0] != _UNSEEN).sum(axis=0) >= min_cameras
    boxes, images = boxes[seen], (images[0][:, seen], images[1][:, seen])
    return side_by_side(
        lambda frame: _halved(scene, frame, boxes, images, edge, most_outside, min_cameras),
        list(scene.silhouettes),
    )


def hull_of(
    voxels: VoxelConsistency, cameras: Iterable[int], min_cameras: int
) -> NDArray[np.bool_]:
    """Return (voxel,) whether a voxel is in the visual hull of some of the cameras.

    Parameters
    ----------
    voxels
        Of a frame.
    cameras
        Their numbers.
    min_cameras
        A voxel that fewer of them see is not; or all, where they are fewer.
    """
    chosen = list(cameras)
    bits = np.asarray(sum(1 << c for c in chosen), np.uint64)
    seen = np.bitwise_count(voxels.seen & bits)
    return (voxels.outside & bits == 0) & (seen >= min(min_cameras, len(chosen)))


def draw_hull(voxels: VoxelConsistency, hull: NDArray[np.bool_], camera: int, scene: Scene) -> Any:
    """Return (row, column) bool what a camera films of a hull, which may be drawn a bit large."""
    rows, columns = scene.silhouettes.shape[2:]
    number = voxels.pixel[camera, hull]
    image = np.zeros(rows * columns, np.uint8)
    image[number[number != _UNSEEN]] = 1
    side = 2 * int(voxels.reach_px[camera]) + 1
    drawn: Any = cv2.dilate(image.reshape(rows, columns), np.ones((side, side), np.uint8))
    return drawn.astype(np.bool_)


def compare_hull(
    scene: Scene,
    voxels: Sequence[VoxelConsistency],
    cameras: Sequence[int],
    camera: int,
    min_cameras: int,
) -> tuple[float, float]:
    """Return how the hull of some cameras, over all frames, fits the silhouettes of one.

    Returns
    -------
    explained : float
        Share of the silhouettes that the hull covers.
    overlap : float
        Intersection over union.
    """
    both = either = total = 0
    for each, silhouettes in zip(voxels, scene.silhouettes, strict=True):
        drawn = draw_hull(each, hull_of(each, cameras, min_cameras), camera, scene)
        both += int((drawn & silhouettes[camera]).sum())
        either += int((drawn | silhouettes[camera]).sum())
        total += int(silhouettes[camera].sum())
    return both / max(total, 1), both / max(either, 1)


def _image_numbers(
    points: NDArray[np.float64], projection: Projection
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the number of the pixel (camera, point) of an image as wide as the widest; depth."""
    pixel, depth = project_points(points, projection)
    unseen = np.isnan(pixel[..., 0])
    pixel[unseen] = 0.0
    column, row = np.moveaxis(np.floor(pixel + 0.5).astype(np.int64), -1, 0)
    number = row * int(projection.image_size[:, 0].max()) + column
    number[unseen] = _UNSEEN
    return number, depth


def _halved(
    scene: Scene,
    silhouettes: NDArray[np.bool_],
    boxes: NDArray[np.float64],
    images: tuple[NDArray[np.int64], NDArray[np.float64]],
    edge: float,
    most_outside: int,
    min_cameras: int,
) -> VoxelConsistency:
    """Return what is kept of a frame, from boxes that are halved until they are voxels."""
    away = np.stack([_distance(silhouette) for silhouette in silhouettes])
    corner = np.stack(np.meshgrid(*[[-0.25, 0.25]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    while True:
        number, depth = images
        last = edge < 1.5 * scene.voxel_m
        reach = 0.0 if last else _reach(scene.projection, depth, edge * np.sqrt(3))
        seen = number != _UNSEEN
        outside = seen & (np.take_along_axis(away, np.maximum(number, 0), axis=1) > reach)
        outsiders = outside.sum(axis=0)
        inside = seen.sum(axis=0) - outsiders
        # else a few cameras that look past each other would keep half of the room
        least = np.where(outsiders > 0, max(min_cameras, len(seen) // 2), min_cameras)
        keep = (outsiders <= most_outside) & (inside >= least)
        if last:
            break
        boxes = (boxes[keep][:, None] + corner * edge).reshape(-1, 3)
        edge /= 2
        images = _image_numbers(boxes, scene.projection)
    bits = np.uint64(1) << np.arange(len(silhouettes), dtype=np.uint64)[:, None]
    near = [d[ahead] for d, ahead in zip(depth[:, keep], seen[:, keep], strict=True)]
    middle = np.array([[np.median(d) if len(d) else np.inf] for d in near])
    return VoxelConsistency(
        boxes[keep],
        np.where(seen[:, keep], bits, np.uint64(0)).sum(axis=0, dtype=np.uint64),
        np.where(outside[:, keep], bits, np.uint64(0)).sum(axis=0, dtype=np.uint64),
        number[:, keep],
        np.rint(_reach(scene.projection, middle, edge)[:, 0]).astype(np.int64) - 1,
    )


def _reach(projection: Projection, depth: NDArray[np.float64], width_m: float) -> Any:
    """Return half of how wide something is filmed at a depth, and a pixel for rounding."""
    focal = projection.intrinsics[:, [0, 1], [0, 1]].max(axis=1)[:, None]
    ahead = np.maximum(depth - width_m / 2, width_m / 4)
    return focal * (width_m / 2) / ahead + 1.0


def _distance(silhouette: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return (pixel,) how far each pixel is from the silhouette, px."""
    if not silhouette.any():
        return np.full(silhouette.size, np.inf, np.float32)
    outside = (~silhouette).view(np.uint8)
    distance: Any = cv2.distanceTransform(outside, cv2.DIST_L2, 5)
    return distance.reshape(-1)
