"""Label the skin of the face and the hands (digitization paper, 3.4.1).

The regions of skin color that are nearest to where the face and the hands are known to be are
theirs. What the paper leaves open: where a region is nearest to more than one place, as when
hands touch, each of its voxels goes to the nearest of them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.skin import LEAST_RATIO, NO_CAMERA
from tasks.geometry.voxel_lines import FIRST, LENGTH, VoxelLines, X, Y, Z
from tasks.geometry.voxels import voxel_centers
from tasks.voxel_frames import VoxelFrames

SKIN_LABELS = (1, 5, 7)
"""The labels of the face, the right and the left hand: Head, RForeArm, LForeArm."""


@dataclass(frozen=True, eq=False)
class SkinRegions:
    """Where the face and the hands are in a frame."""

    label: NDArray[np.uint8]
    """(surface voxel,) label of the segment whose skin it is; 0 elsewhere."""

    place: NDArray[np.float64]
    """(3, 3) middle of the face, the right and the left hand, metres: the frame before's where
    none was found."""

    found: NDArray[np.bool_]
    """(3,) whether it was found."""


def track_skin(
    index: NDArray[np.integer],
    center: NDArray[np.floating],
    is_skin: NDArray[np.bool_],
    place: NDArray[np.floating],
    *,
    reach_m: float,
    least_voxels: int,
) -> SkinRegions:
    """Return the regions of skin color nearest to where face and hands were.

    Regions are voxels of skin color within two voxels of each other.

    Parameters
    ----------
    index : (surface voxel, 3) int
        In the grid, in order.
    center : (surface voxel, 3) float
        Metres.
    is_skin : (surface voxel,) bool
        True where the color is skin's.
    place : (3, 3) float
        Middle of the face, the right and the left hand in the frame before, metres.
    reach_m
        How far from there the nearest voxel of a region may be.
    least_voxels
        Smaller regions are none.
    """
    label = np.zeros(len(index), np.uint8)
    moved, found = np.array(place, np.float64), np.zeros(len(SKIN_LABELS), np.bool_)
    skin = np.flatnonzero(is_skin)
    if not len(skin):
        return SkinRegions(label, moved, found)
    region, size = _skin_regions(index[skin])
    large = size[region] >= max(least_voxels, 1)
    skin, region = skin[large], region[large]
    away = np.linalg.norm(np.asarray(place)[:, None] - center[skin], axis=2)
    chosen = np.full(len(SKIN_LABELS), -1)
    for k in range(len(SKIN_LABELS)):
        if len(skin) and away[k].min() <= reach_m:
            chosen[k] = region[away[k].argmin()]
    wanted = np.where(chosen[:, None] == region, away, np.inf)
    taken = np.isfinite(wanted).any(axis=0)
    owner = wanted.argmin(axis=0)
    for k, value in enumerate(SKIN_LABELS):
        own = skin[taken & (owner == k)]
        if len(own):
            label[own], found[k] = value, True
            moved[k] = center[own].mean(axis=0)
    return SkinRegions(label, moved, found)


def label_skin(
    frames: VoxelFrames,
    frame: int,
    lines: VoxelLines,
    fit: dict[str, NDArray],
    *,
    reach_m: float,
    least_m2: float,
) -> NDArray[np.uint8]:
    """Return the label of the face's and the hands' voxels of a frame, 0 elsewhere.

    Parameters
    ----------
    frames, frame
        The take, and which frame of it.
    lines
        The frame's voxels.
    fit
        Where face and hands were seen (`seen`), and the colors of skin, as `fit_take` has them.
    reach_m
        As `track_skin`.
    least_m2
        Smallest region of skin that counts, square metres.
    """
    label = np.zeros(lines.voxels, np.uint8)
    place = fit["seen"][frame]
    if not np.isfinite(place).all():
        return label
    is_surface, color, camera = frames.surface(frame)
    tables = (fit["skin_hand"], fit["skin_face"], LEAST_RATIO)
    voxel, index = _find_skin(lines.table, is_surface, color, camera, tables)
    regions = track_skin(
        index,
        voxel_centers(frames.grid, index),
        np.ones(len(index), np.bool_),
        place,
        reach_m=reach_m,
        least_voxels=round(least_m2 / frames.grid.voxel_m**2),
    )
    label[voxel] = regions.label
    return label


@njit(cache=True, nogil=True)
def _find_skin(lines: Any, is_surface: Any, color: Any, camera: Any, tables: Any) -> Any:
    """Return place in the list and index of the surface voxels whose own color is skin's."""
    hand, face, least = tables
    voxel, index = np.empty(len(color), np.int32), np.empty((len(color), 3), np.int32)
    seen = found = 0
    for line in range(len(lines)):
        for k in range(lines[line, LENGTH]):
            if not is_surface[lines[line, FIRST] + k]:
                continue
            r, g, b = color[seen, 0] >> 2, color[seen, 1] >> 2, color[seen, 2] >> 2
            if camera[seen] != NO_CAMERA and max(hand[r, g, b], face[r, g, b]) > least:
                voxel[found] = lines[line, FIRST] + k
                index[found, 0], index[found, 1] = lines[line, X], lines[line, Y]
                index[found, 2] = lines[line, Z] + k
                found += 1
            seen += 1
    return voxel[:found].copy(), index[:found].copy()


def _skin_regions(index: NDArray[np.integer]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the region of each voxel, of voxels within two of each other, and the sizes."""
    low, high = np.array(index[0], np.int64), np.array(index[0], np.int64)
    _stretch_box(index, low, high)
    sides = high - low + 5
    stride = np.array([sides[1] * sides[2], sides[2], 1])
    steps = np.arange(-2, 3)
    near = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    near = near[(near**2).sum(axis=1) <= 4]
    box = np.zeros(int(np.prod(sides)), np.int32)
    region = np.full(len(index), -1, np.int32)
    _spread(index, (low - 2, stride), near @ stride, box, region)
    return region, np.bincount(region)


@njit(cache=True, nogil=True)
def _spread(index: Any, frame: Any, step: Any, box: Any, region: Any) -> None:
    """Write the region of each voxel: what steps lead to from its first voxel."""
    stack = np.empty(len(index), np.int32)
    for n in range(len(index)):
        box[_place_of(index[n], frame)] = n + 1
    count = 0
    for seed in range(len(index)):
        if region[seed] >= 0:
            continue
        region[seed] = count
        stack[0], top = seed, 1
        while top:
            top -= 1
            place = _place_of(index[stack[top]], frame)
            for k in range(len(step)):
                other = box[place + step[k]] - 1
                if other >= 0 and region[other] < 0:
                    region[other] = count
                    stack[top] = other
                    top += 1
        count += 1


@njit(cache=True, nogil=True)
def _stretch_box(index: Any, low: Any, high: Any) -> None:
    """Move the corners of a box until all voxels are inside."""
    for n in range(len(index)):
        for k in range(3):
            low[k] = min(low[k], index[n, k])
            high[k] = max(high[k], index[n, k])


@njit(cache=True, nogil=True)
def _place_of(voxel: Any, frame: Any) -> Any:
    """Return where a voxel is in a box kept as a line."""
    low, stride = frame
    away = (voxel[0] - low[0]) * stride[0] + (voxel[1] - low[1]) * stride[1]
    return away + voxel[2] - low[2]
