"""Put back what errors in silhouettes cut off a hull, from the frames around it.

A hole in one silhouette cuts all that is behind it off the visual hull: a foot, a hand. Such
errors come and go from frame to frame, and a pose that is held does not: what more than half of
the frames around one occupy was there in that one too.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tasks.geometry.voxels import VoxelRuns, padded_crop

OWN, PUT_BACK = 1, 2
"""In a crop: what the frame itself occupies, and what only the frames around it do."""
_TORN_M = 0.05  # a torn-off hand or leg is within the body's outline, seen from above, or
_SHANK, _THIGH_LENGTH, _SHIN_HEIGHT, _ON_FLOOR = 0.03, 0.245, 0.1, 0.06
# a shank with its foot, 0.061 of the body (Dempster 1955), of which half may be lost; it is at most
# a thigh away (Drillis and Contini 1966), taller than a foot, and stands on the floor; in heights


def frames_around(frame: int, frames: int, reach: int, *, count: int = 5) -> list[int]:
    """Return the numbers of at most `count` frames, evenly spread around one.

    Parameters
    ----------
    frame, frames
        The one, and how many there are.
    reach
        How many frames earlier and later they may be; 0 leaves the frame alone. Where the take
        begins or ends, later or earlier ones make up for those that there are not.
    """
    middle = max(min(frame, frames - 1 - reach), reach)
    ends = middle - reach, min(middle + reach, frames - 1)
    return np.unique(np.linspace(*ends, count).round().astype(int)).tolist()


def held_crop(
    runs: VoxelRuns, frame: int, around: Sequence[int]
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return the dense box around a frame's voxels with those put back that it has lost.

    Parameters
    ----------
    runs
        The hulls of a take.
    frame
        Which one. None of its own voxels is taken away.
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
    """Return how far from what a frame has of a body the farthest voxel is that was put back.

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
    """Return how much farther each frame's body is from others' parts than those are from its own.

    What moved is as far from one frame as from the other; what one has lost is far from that one
    alone. Only what two others have counts: one may have something too many.

    Parameters
    ----------
    bodies : sequence of (voxel, 3) int
        Index of the voxels of each frame.
    cell
        How many voxels long the cubes are that are compared.

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
    """Return (piece,) True for the largest piece, those above or below it, and torn-off shanks.

    What is beside the body is not taken for it (a thing, a ghost of two limbs), but for what stands
    on the floor like the end of a leg that has lost its thigh.

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
    margin = math.ceil(_TORN_M / voxel_m)
    low, high = main.min(axis=0) - margin, main.max(axis=0) + margin
    beside = ((index < low) | (index > high))[:, [0, 2]].any(axis=1)
    apart = np.bincount(piece, weights=beside, minlength=len(sizes)) > 0
    keeps = (sizes > 0.01 * sizes.max()) & ~apart
    height, floor = float(np.ptp(main[:, 1])), index[keeps[piece], 1].min()
    for number in np.flatnonzero(apart & (sizes > _SHANK * sizes.max())):
        part = index[piece == number]
        stands = part[:, 1].min() < floor + _ON_FLOOR * height
        if stands and np.ptp(part[:, 1]) > _SHIN_HEIGHT * height:
            keeps[number] = KDTree(main).query(part)[0].min() < _THIGH_LENGTH * height
    return keeps


def _box(begin: NDArray[np.integer], shape: Sequence[int]) -> tuple[slice, ...]:
    """Return the slices of a box in a larger one."""
    return tuple(slice(b, b + n) for b, n in zip(begin.tolist(), shape, strict=True))
