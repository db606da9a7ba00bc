"""Label the skin of the face and the hands (digitization paper, 3.4.1).

The regions of skin color that are nearest to where the face and the hands are known to be are
theirs. What the paper leaves open: where a region is nearest to more than one place, as when
hands touch, each of its voxels goes to the nearest of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.skin import LEAST_RATIO
from tasks.body.labels.regions import first_of
from tasks.engine.kernels import njit
from tasks.geometry.voxel_lines import FIRST, LENGTH, VoxelLines, X, Y, Z
from tasks.geometry.voxels import voxel_centers
from tasks.reconstruction.voxel_frames import VoxelFrames

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
    owner = np.empty(len(skin), np.int8)
    limits = (float(reach_m), max(least_voxels, 1))
    _choose_regions(center[skin], np.array(place, np.float64), region, size, limits, owner)
    for k, value in enumerate(SKIN_LABELS):
        own = skin[owner == k]
        if len(own):
            label[own], found[k] = value, True
            moved[k] = center[own].mean(axis=0)
    return SkinRegions(label, moved, found)


def skin_table(fit: Mapping[str, NDArray]) -> NDArray[np.bool_]:
    """Return (64, 64, 64) which colors, by the upper six bits of R, G and B, are skin's.

    `fit` has the colors of skin as `fit_take` has them.
    """
    return np.maximum(fit["skin_hand"], fit["skin_face"]) > LEAST_RATIO


def label_skin(
    frames: VoxelFrames,
    frame: int,
    lines: VoxelLines,
    place: NDArray[np.floating],
    is_skin: NDArray[np.bool_],
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
    place : (3, 3) float
        Where the face, the right and the left hand were seen, metres; NaN where unseen.
    is_skin
        As `skin_table` gives it.
    reach_m
        As `track_skin`.
    least_m2
        Smallest region of skin that counts, square metres.
    """
    label = np.zeros(lines.voxels, np.uint8)
    if not np.isfinite(place).all():
        return label
    voxel, index = _find_skin(lines.table, *frames.surface(frame), is_skin)
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
def _find_skin(lines: Any, is_surface: Any, color: Any, camera: Any, is_skin: Any) -> Any:
    """Return the surface voxels whose own color is skin's: place in the list, and index."""
    voxel, index = np.empty(len(is_surface), np.int32), np.empty((len(color), 3), np.int32)
    seen = found = line = 0
    for n in range(len(is_surface)):
        voxel[seen] = n  # without a branch: one in six is kept
        seen += is_surface[n]
    for s in range(seen):
        own = is_skin[color[s, 0] >> 2, color[s, 1] >> 2, color[s, 2] >> 2]
        if own and camera[s] != NO_CAMERA:
            n = voxel[s]
            while n >= lines[line, FIRST] + lines[line, LENGTH]:
                line += 1
            voxel[found] = n
            index[found, 0], index[found, 1] = lines[line, X], lines[line, Y]
            index[found, 2] = lines[line, Z] + n - lines[line, FIRST]
            found += 1
    return voxel[:found].copy(), index[:found].copy()


@njit(cache=True, nogil=True)
def _choose_regions(
    center: Any, place: Any, region: Any, size: Any, limits: Any, owner: Any
) -> None:
    """Write each voxel's place, -1 for none; a place has the region that is nearest to it.

    `limits`: how far from its place a region may be, and how many voxels it has at least.
    """
    reach, fewest = limits
    away = np.empty((len(place), len(center)))
    chosen = np.full(len(place), -1)
    for k in range(len(place)):
        least = np.inf
        for n in range(len(center)):
            x, y, z = (
                place[k, 0] - center[n, 0],
                place[k, 1] - center[n, 1],
                place[k, 2] - center[n, 2],
            )
            away[k, n] = np.sqrt(x * x + y * y + z * z)
            if away[k, n] < least and away[k, n] <= reach and size[region[n]] >= fewest:
                least, chosen[k] = away[k, n], region[n]
    for n in range(len(center)):
        owner[n] = -1
        for k in range(len(place)):
            nearer = owner[n] < 0 or away[k, n] < away[owner[n], n]
            if chosen[k] == region[n] and nearer:
                owner[n] = k


def _skin_regions(index: NDArray[np.integer]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the region of each voxel and the sizes; a region's voxels are within two voxels."""
    first = np.arange(len(index), dtype=np.int32)
    _join_near(np.ascontiguousarray(index, np.int32), first)
    count = _number(first)
    return first, np.bincount(first, minlength=count)


@njit(cache=True, nogil=True)
def _join_near(index: Any, first: Any) -> None:
    """Write for each voxel the one that stands for its region; neighbors are within two voxels."""
    low = high = index[0, 1]
    for n in range(len(index)):
        low, high = min(low, index[n, 1]), max(high, index[n, 1])
    sides = high - low + 1
    column = np.zeros((index[-1, 0] - index[0, 0] + 1) * sides + 1, np.int32)  # voxels before it
    for n in range(len(index)):
        column[(index[n, 0] - index[0, 0]) * sides + index[n, 1] - low + 1] += 1
    for c in range(1, len(column)):
        column[c] += column[c - 1]
    for n in range(len(index)):
        x, y, z = index[n, 0] - index[0, 0], index[n, 1], index[n, 2]
        for i in range(max(x - 2, 0), x + 1):
            most = 4 - (x - i) ** 2
            for j in range(max(y - 2, low), min(y + 2, high) + 1):
                c = i * sides + j - low
                for m in range(column[c], min(column[c + 1], n)):
                    if (y - j) ** 2 + (z - index[m, 2]) ** 2 <= most:
                        a, b = first_of(first, n), first_of(first, m)
                        first[max(a, b)] = min(a, b)


@njit(cache=True, nogil=True)
def _number(first: Any) -> Any:
    """Write the number of its region for each voxel, by their first voxels; return how many."""
    count = 0
    for n in range(len(first)):
        if first[n] == n:
            first[n] = count
            count += 1
        else:  # it was joined to an earlier one, which has its number by now
            first[n] = first[first[n]]
    return count
