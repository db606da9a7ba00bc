"""Planes through two camera centers that touch the performer: what two films tell of one moment.

Such a plane touches the silhouettes of both cameras, so that the lowest and the highest plane of
the pencil are two signals of time that both films show alike, each at its own time (Sinha and
Pollefeys, "Synchronization and calibration of camera networks from silhouettes", 2004). No hull,
no volume and no start value is needed.

A plane that touches a silhouette touches its convex hull, so a few pixels of each are looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection, camera_centers, viewing_rays

WIDTH_PX = 320.0
"""How wide the picture is that angles are counted in pixels of [px]. The numbers that tell how
sure an offset is were measured on such pictures."""

_WIDEST = 2.0
"""Between the planes of a pencil that touch a silhouette [radians]. Where they are farther apart
the baseline runs through the performer, and the pencil has no lowest plane."""


@dataclass(frozen=True, eq=False)
class Touches:
    """The planes that touch, of each pair of cameras."""

    cameras: int
    pairs: NDArray[np.int64]
    """(pair, 2) the cameras of each."""
    planes: NDArray[np.float32]
    """(pair, 2, 2, time) of the first and the second camera of a pair, the lowest and the highest
    plane: angles about the baseline, in pixels of a picture `WIDTH_PX` wide. NaN where it touches
    what is cut off at the border of a picture, and where nobody is seen."""

    @property
    def frames(self) -> int:
        """How many frames were looked at."""
        return self.planes.shape[-1]

    def part(self, start: int, end: int) -> "Touches":
        """Return those of the frames from `start` to before `end`."""
        return Touches(self.cameras, self.pairs, self.planes[..., start:end])


@dataclass(frozen=True, eq=False)
class Outline:
    """The corners of the convex hulls of a camera's silhouettes, frame after frame."""

    ray: NDArray[np.float64]
    """(corner, 3) the direction in the world in which its pixel looks."""
    is_cut_off: NDArray[np.bool_]
    """(corner,) whether it is at the border of the picture."""
    begin: NDArray[np.int64]
    """(time + 1,) the first corner of each frame, and the end of the last."""


def find_outline(packed: NDArray[np.uint8], projection: Projection, camera: int) -> Outline:
    """Return the corners of the convex hulls of a camera's silhouettes.

    Parameters
    ----------
    packed : (time, row, column / 8) uint8
        Packed along the columns as `numpy.packbits` does; rows and columns beyond the picture are
        passed over.
    projection, camera
        The cameras, and which one.
    """
    columns, rows = projection.image_size[camera]
    corner = np.empty((len(packed) * 2 * rows, 2), np.int32)
    begin = np.zeros(len(packed) + 1, np.int64)
    corner = corner[: _hull_corners(packed[:, :rows], columns, corner, begin)]
    is_cut_off = (corner == 0).any(axis=1) | (corner == (rows - 1, columns - 1)).any(axis=1)
    return Outline(viewing_rays(corner[:, ::-1], projection, camera), is_cut_off, begin)


def join_outlines(parts: Sequence[Outline]) -> Outline:
    """Return the corners of some frames after another as one."""
    ends = np.cumsum([0, *(part.begin[-1] for part in parts)])
    begins = [part.begin[:-1] + end for part, end in zip(parts, ends[:-1], strict=True)]
    return Outline(
        np.concatenate([part.ray for part in parts]),
        np.concatenate([part.is_cut_off for part in parts]),
        np.concatenate([*begins, ends[-1:]]),
    )


def find_touches(outlines: Sequence[Outline], projection: Projection) -> Touches:
    """Return the planes that touch the silhouettes of all cameras in some frames.

    Parameters
    ----------
    outlines
        Of each camera, of the same frames.
    projection
        The cameras, in the same order.
    """
    count, frames = len(outlines), len(outlines[0].begin) - 1
    centers = camera_centers(projection)
    scale = projection.intrinsics[:, 0, 0] * WIDTH_PX / projection.image_size[:, 0]
    axes = projection.camera_from_world[:, 2, :3]
    pairs = list(combinations(range(count), 2))
    planes = np.full((len(pairs), 2, 2, frames), np.nan, np.float32)
    for pair, both in zip(pairs, planes, strict=True):
        along = centers[pair[1]] - centers[pair[0]]
        length = np.linalg.norm(along)
        if length == 0:  # one place: every plane goes through both
            continue
        along = along / length
        ahead = axes[pair[0]] + axes[pair[1]]
        ahead = ahead - along * (ahead @ along)
        if not np.linalg.norm(ahead) > 0:
            continue
        ahead = ahead / np.linalg.norm(ahead)
        aside = np.cross(along, ahead)
        for camera, own in zip(pair, both, strict=True):
            ray = outlines[camera].ray
            _extremes(np.arctan2(ray @ aside, ray @ ahead), outlines[camera], own)
            own *= scale[camera]
    return Touches(count, np.array(pairs, np.int64).reshape(-1, 2), planes)


def touches_of(packed: NDArray[np.uint8], projection: Projection) -> Touches:
    """Return the planes that touch the silhouettes (time, camera, row, column / 8), packed."""
    outlines = side_by_side(
        lambda camera: find_outline(packed[:, camera], projection, camera),
        range(projection.cameras),
    )
    return find_touches(outlines, projection)


def join_touches(parts: Sequence[Touches], gap: int = 0) -> Touches:
    """Return the planes of some frames after another as one, unknown frames between them."""
    unknown = np.full((*parts[0].planes.shape[:-1], gap), np.nan, np.float32)
    planes = [each for part in parts for each in (part.planes, unknown)][:-1]
    return Touches(parts[0].cameras, parts[0].pairs, np.concatenate(planes, axis=-1))


def usable_touches(touches: Touches, projection: Projection) -> Touches:
    """Return those of the pairs whose baselines run beside the performer in all frames."""
    scale = projection.intrinsics[:, 0, 0] * WIDTH_PX / projection.image_size[:, 0]
    wide = (touches.planes[:, :, 1] - touches.planes[:, :, 0]) / scale[touches.pairs][..., None]
    widest = np.where(np.isnan(wide), -1.0, wide).max(axis=-1, initial=-1.0)
    kept = ((widest >= 0) & (widest < _WIDEST)).all(axis=1)
    return Touches(touches.cameras, touches.pairs[kept], touches.planes[kept])


def _extremes(angle: NDArray[np.float64], outline: Outline, into: NDArray[np.float32]) -> None:
    """Write the least and the greatest angle of each frame, (2, time), but of what is cut off."""
    there = np.flatnonzero(np.diff(outline.begin))
    if not len(there):
        return
    first = outline.begin[there]
    for row, sign in enumerate((1.0, -1.0)):
        least = np.minimum.reduceat(sign * angle, first)
        beside = np.minimum.reduceat(np.where(outline.is_cut_off, sign * angle, np.inf), first)
        into[row, there] = np.where(beside <= least, np.nan, sign * least)


@njit(cache=True, nogil=True)
def _hull_corners(packed: Any, columns: Any, corner: Any, begin: Any) -> Any:
    """Write the corners (row, column) of each frame's convex hull one after another; count them.

    `begin` gets where those of each frame begin, and the end of the last. The first and the last
    pixel of each row are chained, those on the left and those on the right by themselves.
    """
    used = 0
    for n in range(len(packed)):
        for side in (-1, 1):
            base = used
            for i in range(packed.shape[1]):
                j = _first_bit(packed[n, i]) if side < 0 else _last_bit(packed[n, i])
                if j < 0:
                    continue
                j = min(j, columns - 1)
                while used - base >= 2:  # until the one before is outside of its neighbors
                    i0, j0 = corner[used - 2, 0], corner[used - 2, 1]
                    i1, j1 = corner[used - 1, 0], corner[used - 1, 1]
                    if side * ((j1 - j0) * (i - i0) - (j - j0) * (i1 - i0)) > 0:
                        break
                    used -= 1
                corner[used, 0], corner[used, 1] = i, j
                used += 1
        begin[n + 1] = used
    return used


@njit(cache=True, nogil=True, inline="always")
def _first_bit(row: Any) -> Any:
    """Return the number of the first bit that is set in some bytes; -1 where none is."""
    for b in range(len(row)):
        if row[b]:
            bit = 0
            while not row[b] >> (7 - bit) & 1:
                bit += 1
            return 8 * b + bit
    return -1


@njit(cache=True, nogil=True, inline="always")
def _last_bit(row: Any) -> Any:
    """Return the number of the last bit that is set in some bytes; -1 where none is."""
    for b in range(len(row) - 1, -1, -1):
        if row[b]:
            bit = 7
            while not row[b] >> (7 - bit) & 1:
                bit -= 1
            return 8 * b + bit
    return -1
