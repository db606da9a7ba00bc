"""Tell what belongs to no segment: things in a hand, what stays, and pieces far from the body.

A voxel far from all that the bones carry along is cloth, or no part of the dancer. Cloth hangs from
trunk, arms and legs, and goes where they go. What is apart from the body is none; nor is what only
a hand touches: a sword, a fan, an umbrella; nor what stays in its place all through a take: the
legs of a chair that is sat on.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES
from tasks.body.labels.fields import BoneFields, own_distance
from tasks.body.labels.regions import find_regions_of
from tasks.engine.kernels import njit
from tasks.geometry.voxel_lines import VoxelLines
from tasks.geometry.voxels import VoxelRuns, voxel_numbers

_HANDS = (BONES.index("RHand"), BONES.index("LHand"))

_LEAST = 0.1
"""How large a thing in a hand is at least [cubes with the reach of a bone as their edge]. A tenth
of a liter for an adult: an eighth of a fist; chosen, not measured."""

_BY_HAND = 0.85
"""How much of what touches a thing in a hand is of hands, at least [share]. Of sleeves that hang
from the wrists it is .79 at most in a rendered capture; of a sword mostly 1."""

_NECK = 0.05
"""How many faces of voxels touch the body where a thing hangs on it by a thin neck, at most [share
of the thing's voxels]. Of a sword it is .04 at most, of sleeves .09 at least."""

_BY_NECK = 0.25
"""How many of these are of hands, at least [share]. Beside the hand is the wrist."""

_STAYS = 0.8
"""In how many frames what stays is there and far from all bones, at least [share]. Chosen, not
measured."""

_LEAST_FRAMES = 8
"""In how many frames at least [frames]."""

_OF_HAND = 0.3
"""How far from the voxels of a hand that holds a thing a voxel is the hand's [reaches of a bone].
Of 8 cm; fingers may be closed otherwise than in the initial frame."""


def find_things(
    lines: VoxelLines,
    bone: NDArray[np.int8],
    fields: BoneFields,
    turn: NDArray[np.floating],
    shift: NDArray[np.floating],
    stays: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Return (voxel,) which voxels of a frame belong to no segment.

    Parameters
    ----------
    lines
        The voxels.
    bone : (voxel,) int8
        The nearest bone of each voxel, -1 for none, as of `nearest_bones`.
    fields, turn, shift
        What bones carry along, as for `nearest_bones`.
    stays : (voxel,) bool, optional
        Which voxels are where something stays that is far from all bones, as of `find_staying`.
    """
    far = bone < 0
    thing = np.zeros(len(bone), np.bool_) if stays is None else far & stays
    if not far.any() or far.all():
        return thing
    stretch, column, beside, region, size = find_regions_of(far.view(np.uint8), lines)
    touched = np.zeros((len(size), len(BONES)), np.int64)
    _count_touched(stretch, column, beside, region, bone, touched)
    whole = touched.sum(axis=1)
    by_hand = touched[:, list(_HANDS)]
    least = np.where(whole <= _NECK * size, _BY_NECK, _BY_HAND)
    held = (size >= _LEAST * fields.most**3) & (by_hand.sum(axis=1) >= least * whole)
    chosen = held | (whole == 0)
    if not chosen.any():
        return thing
    _mark(stretch, region, chosen, thing)
    for hand in np.unique(by_hand[held & (whole > 0)].argmax(axis=1)):
        own = np.flatnonzero(bone == _HANDS[hand])
        if len(own):
            away = own_distance(lines, own, fields, turn, shift, _HANDS[hand])
            thing[own[away > _OF_HAND * fields.most]] = True
    return thing


def find_staying(
    hulls: Sequence[VoxelRuns], far: Sequence[NDArray[np.bool_]], shape: tuple[int, int, int]
) -> NDArray[np.bool_]:
    """Return (x, y, z) where something stays all through a take that is far from all bones.

    Parameters
    ----------
    hulls
        Of some frames all over the take, a single frame each.
    far : sequence of (voxel,) bool
        Which of their voxels are.
    shape
        Of their grid.
    """
    count = np.zeros(math.prod(shape), np.uint16)
    for hull, own in zip(hulls, far, strict=True):
        count[voxel_numbers(hull)[own]] += 1
    return (count >= max(_STAYS * len(hulls), _LEAST_FRAMES)).reshape(shape)


@njit(cache=True, nogil=True)
def _count_touched(
    stretch: Any, column: Any, beside: Any, region: Any, bone: Any, touched: Any
) -> None:
    """Add up, a region and bone, how many faces of voxels are between them."""
    for c in range(len(beside)):
        for s in range(column[c], column[c + 1]):
            if region[s] < 0:
                continue
            z, end, voxel = stretch[s, 2], stretch[s, 3], stretch[s, 5]
            own = touched[region[s]]
            if s > column[c] and stretch[s - 1, 3] == z:
                _add(bone[voxel - 1], own)
            if s < column[c + 1] - 1 and stretch[s + 1, 2] == end:
                _add(bone[voxel + end - z], own)
            for k in range(4):
                other = beside[c, k]
                if other < 0:
                    continue
                for t in range(column[other], column[other + 1]):
                    low, high = max(z, stretch[t, 2]), min(end, stretch[t, 3])
                    for n in range(low, high):
                        _add(bone[stretch[t, 5] + n - stretch[t, 2]], own)


@njit(cache=True, nogil=True)
def _add(bone: Any, own: Any) -> None:
    """Count a face with a bone; one with no bone is within a region."""
    if bone >= 0:
        own[bone] += 1


@njit(cache=True, nogil=True)
def _mark(stretch: Any, region: Any, chosen: Any, thing: Any) -> None:
    """Mark the voxels of the regions that are chosen."""
    for s in range(len(stretch)):
        if region[s] >= 0 and chosen[region[s]]:
            voxel = stretch[s, 5]
            thing[voxel : voxel + stretch[s, 3] - stretch[s, 2]] = True
