"""Put back what errors in silhouettes cut off a hull, from the frames around it.

A hole in one silhouette cuts all that is behind it off the visual hull: a foot, a hand. Such errors
come and go from frame to frame, while the performer holds the pose. So a voxel that more than half
of the frames around one occupy was there in that one too.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tasks.body.anatomy.proportions import PUBLISHED_THIGH
from tasks.geometry.voxels import VoxelRuns, padded_crop

OWN = 1
"""In a crop, a voxel that the frame itself occupies."""

PUT_BACK = 2
"""In a crop, a voxel that only the frames around it occupy."""

TORN_M = 0.05
"""How far outside the body's outline, seen from above, a torn-off hand or leg may be. Chosen by eye
on the shared captures; not measured."""

SPECK = 0.01
"""Voxels of a piece up to which it is a speck and no part of a body [share of the largest piece].
Chosen by eye on the shared captures; not measured."""

SHANK_VOLUME = 0.03
"""Voxels of a torn-off shank with its foot at least [share of the largest piece]. They are 0.061 of
a body (Dempster 1955), of which half may be lost."""

SHIN_TALL = 0.1
"""How tall a torn-off shank is at least [heights of the body]. It is taller than a foot; chosen by
eye on the shared captures, not measured."""

ON_FLOOR = 0.06
"""How far above the floor a torn-off shank ends at most [heights of the body]. Chosen by eye on the
shared captures; not measured."""


def frames_around(frame: int, frames: int, reach: int, *, count: int = 5) -> list[int]:
    """Return the numbers of at most `count` frames, evenly spread around one.

    Parameters
    ----------
    frame, frames
        The one, and how many there are.
    reach
        How many frames earlier and later they may be; 0 leaves the frame alone. Where the take
        begins or ends, as many more are later or earlier.
    """
    middle = max(min(frame, frames - 1 - reach), reach)
    ends = middle - reach, min(middle + reach, frames - 1)
    return np.unique(np.linspace(*ends, count).round().astype(int)).tolist()


def held_crop(
    runs: VoxelRuns, frame: int, around: Sequence[int]
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return the dense box around a frame's voxels, with the voxels put back that it has lost.

    Parameters
    ----------
    runs
        The hulls of a take.
    frame
        The frame. It keeps all its own voxels.
    around
        Frames in which the performer stands as in that one. A voxel that more than half of them
        occupy is put back.

    Returns
    -------
    crop : (x, y, z) uint8
        `OWN`, `PUT_BACK` or 0, with an empty layer of voxels on each side.
    begin : (3,) int64
        Index in the grid of the crop's voxel (0, 0, 0), as `padded_crop`.

    Raises
    ------
    ValueError
        If there is no such frame.
    """
    parts = [padded_crop(runs, number) for number in (frame, *around)]
    begin = np.min([first for _, first in parts], axis=0)
    end = np.max([first + crop.shape for crop, first in parts], axis=0)
    votes = np.zeros(end - begin, np.uint8)
    boxes = [_box(first - begin, crop.shape) for crop, first in parts]
    for (crop, _), box in zip(parts[1:], boxes[1:], strict=True):
        votes[box] += crop
    held = np.where(votes > len(around) // 2, np.uint8(PUT_BACK), np.uint8(0))
    held[boxes[0]][parts[0][0] > 0] = OWN
    return held, begin


def farthest_lost(body: NDArray[np.integer], is_own: NDArray[np.bool_]) -> float:
    """Return how far the farthest voxel that was put back is from a frame's own voxels.

    Parameters
    ----------
    body : (voxel, 3) int
        Index of the voxels.
    is_own : (voxel,) bool
        True where the frame itself has them.

    Returns
    -------
    float
        In voxels; infinite where the frame has nothing of it.
    """
    if is_own.all():
        return 0.0
    if not is_own.any():
        return math.inf
    tree = KDTree(body[is_own], compact_nodes=False, balanced_tree=False)  # asked a few times only
    return float(tree.query(body[~is_own])[0].max())


def beyond_others(bodies: Sequence[NDArray[np.integer]], cell: int) -> NDArray[np.float64]:
    """Return how far from each frame's body something is that the frame has lost.

    A part that moved is as far from the body of one frame as the other way round. A part that one
    frame has lost is far from that frame's body alone, so that the difference of the two distances
    tells it. Two other frames must have the part, for a single one may have something too many.

    Parameters
    ----------
    bodies : sequence of (voxel, 3) int
        Index of the voxels of each frame.
    cell
        Edge of the cubes that are compared, in voxels.

    Returns
    -------
    (frame,) float64
        In voxels; 0 where there are fewer than two others.
    """
    if len(bodies) < 3:
        return np.zeros(len(bodies))
    shape = np.max([body.max(axis=0) for body in bodies], axis=0) // cell + 1
    number = [np.unique(np.ravel_multi_index(tuple(body.T // cell), shape)) for body in bodies]
    place = [np.stack(np.unravel_index(one, shape), axis=1) for one in number]
    apart = np.zeros((len(bodies), len(bodies)))
    for i, own in enumerate(place):
        tree = KDTree(own)
        for j, other in enumerate(place):
            new = other[~np.isin(number[j], number[i])]
            if len(new):
                apart[i, j] = tree.query(new)[0].max()
    return cell * np.sort(np.clip(apart - apart.T, 0.0, None), axis=1)[:, -2]


def pieces_of_body(
    index: NDArray[np.integer], piece: NDArray[np.integer], voxel_m: float
) -> NDArray[np.bool_]:
    """Return which pieces are the body's (piece,): the largest, those above or below it, shanks.

    A piece beside the body is not taken for a part of it: it is a thing, or a ghost of two limbs.
    Only a piece that stands on the floor like the end of a leg without its thigh is.

    Parameters
    ----------
    index : (voxel, 3) int
    piece : (voxel,) int
        Number of the connected piece of each voxel, from 1.
    voxel_m
        A voxel's edge.
    """
    sizes = np.bincount(piece)
    sizes[0] = 0
    main = index[piece == np.argmax(sizes)]
    margin = math.ceil(TORN_M / voxel_m)
    low, high = main.min(axis=0) - margin, main.max(axis=0) + margin
    beside = ((index < low) | (index > high))[:, [0, 2]].any(axis=1)
    apart = np.bincount(piece, weights=beside, minlength=len(sizes)) > 0
    keeps = (sizes > SPECK * sizes.max()) & ~apart
    height, floor = float(np.ptp(main[:, 1])), index[keeps[piece], 1].min()
    for number in np.flatnonzero(apart & (sizes > SHANK_VOLUME * sizes.max())):
        part = index[piece == number]
        stands = part[:, 1].min() < floor + ON_FLOOR * height
        if stands and np.ptp(part[:, 1]) > SHIN_TALL * height:
            keeps[number] = KDTree(main).query(part)[0].min() < PUBLISHED_THIGH * height
    return keeps


def _box(begin: NDArray[np.integer], shape: Sequence[int]) -> tuple[slice, ...]:
    """Return the slices of a box in a larger one."""
    return tuple(slice(b, b + n) for b, n in zip(begin.tolist(), shape, strict=True))
