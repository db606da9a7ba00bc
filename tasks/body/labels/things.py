"""Tell what belongs to no segment: things in a hand, what stays, and pieces far from the body.

A voxel far from all that the bones carry along is cloth, or no part of the dancer. Cloth hangs from
trunk, arms and legs, and goes where they go. What is apart from the body is none; nor is what only
a hand touches: a sword, a fan, an umbrella; nor what stays in its place all through a take: the
legs of a chair that is sat on.
"""

import math
from collections.abc import Sequence
from typing import Any

import cc3d
import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.body.anatomy.bones import BONES
from tasks.body.labels.fields import BoneFields, own_distance
from tasks.body.labels.regions import find_regions_of
from tasks.engine.kernels import njit
from tasks.geometry.voxel_lines import VoxelLines
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_numbers

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
"""In how many frames what stays is there and off the body, at least [share]. Chosen, not
measured."""

_LEAST_FRAMES = 8
"""In how many frames at least [frames]."""

_PIECE_M3 = 0.00015
"""How large a piece is at least that stays [m³]. Chosen on one real capture of four cameras, whose
hull has smaller ones at its rim; not measured."""

_LINES = (
    ("Head", "Neck", 0.13), ("Neck", "Waist", 0.14), ("Waist", "RHip", 0.14),
    ("Waist", "LHip", 0.14),
    *(
        (side + one, side + other, thick)
        for side in "RL"
        for one, other, thick in (
            ("Shoulder", "Elbow", 0.075), ("Elbow", "Wrist", 0.065), ("Wrist", "Fin", 0.07),
            ("Hip", "Knee", 0.085), ("Knee", "Ankle", 0.065), ("Heel", "Foot", 0.065),
        )
    ),
)  # fmt: skip
"""Lines of the body between two joints, and how far from them a body in its clothes may be
[statures]. Half as much again as an adult's limbs; chosen, not measured."""

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
        Which voxels are where something stays, as of `find_staying`.
    """
    far = bone < 0
    thing = np.zeros(len(bone), np.bool_) if stays is None else stays.copy()
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
    hulls: Sequence[VoxelRuns],
    position: NDArray[np.floating],
    grid: VoxelGrid,
    stature_m: float,
) -> NDArray[np.int64]:
    """Return the numbers of the voxels where something stays all through a take off the body.

    Parameters
    ----------
    hulls
        Of some frames all over the take, a single frame each.
    position : (time, 21, 3) float
        The joints in these frames, m, as in `storage.schema.JOINTS`; NaN where there is none.
    grid
        The grid of the hulls.
    stature_m
        The performer's height.
    """
    least = max(_STAYS * len(hulls), _LEAST_FRAMES)
    numbers = [voxel_numbers(hull) for hull in hulls]
    count = np.zeros(math.prod(grid.shape), np.uint16)
    for own in numbers:
        count[own] += 1
    staying = np.flatnonzero(count >= least)
    if not len(staying):
        return staying
    point = voxel_centers(grid, np.stack(np.unravel_index(staying, grid.shape), axis=1))
    off = np.zeros(len(staying), np.int64)
    for own, joints in zip(numbers, position, strict=True):
        off += np.isin(staying, own, assume_unique=True) & _off_the_body(point, joints, stature_m)
    staying = staying[off >= least]
    marks = np.zeros(grid.shape, np.uint8)
    marks.flat[staying] = 1
    piece = np.asarray(cc3d.connected_components(marks, connectivity=26)).ravel()[staying]
    return staying[np.bincount(piece)[piece] * grid.voxel_m**3 >= _PIECE_M3]


def _off_the_body(
    point: NDArray[np.float64], joints: NDArray[np.floating], stature_m: float
) -> NDArray[np.bool_]:
    """Return which points, m, are farther from all lines between joints than a body is thick."""
    off = np.ones(len(point), np.bool_)
    for one, other, thick in _LINES:
        begin, end = joints[JOINTS.index(one)], joints[JOINTS.index(other)]
        along = end - begin
        share = (point - begin) @ along / max(float(along @ along), 1e-12)
        foot = begin + np.clip(share, 0.0, 1.0)[:, None] * along
        off &= ~(((point - foot) ** 2).sum(axis=1) <= (thick * stature_m) ** 2)  # NaN is no line
    return off


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
