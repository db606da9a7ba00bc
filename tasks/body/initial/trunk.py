"""Measure head, spine and hips of a performer who stretches the arms.

The proportions of a body tell the height of the hips; so does the fork of the legs where it shows.
Both are weighted by how well they are known. Points are metres with y up.
"""

from dataclasses import dataclass, replace

import numpy as np

from tasks.body.anatomy.proportions import (
    HEAD_ABOVE_ARMS,
    HIPS_ABOVE_FORK,
    NECK_SHARE,
    SHOULDER_SHARE,
    SPAN_PER_STATURE,
    WAIST_SHARE,
    Points,
    hips_below_top,
)
from tasks.body.initial.arms import HEAD_AHEAD, HEAD_ASIDE, NECK_ASIDE, Arms

HIPS_SPREAD = 0.02
"""How far the hips of a body in its pose usually are from where proportions have them [statures].
Chosen by eye on the shared captures; not measured."""

HIGHER_SPREAD = 0.012
"""How much a fork of the legs that is higher than usual usually errs [statures]. Chosen by eye on
the shared captures; not measured."""

HIGHER_WITHIN = 0.07
"""How much higher than usual a fork of the legs may be [statures]. Chosen by eye on the shared
captures; not measured."""

LOWER_SPREAD = 0.02
"""How much a fork of the legs that is lower than usual usually errs [statures]. Thighs may touch,
and trousers hang."""

LOWER_WITHIN = 0.05
"""How much lower than usual a fork of the legs may be [statures]. What is lower is a skirt's
hem."""

HEAD_LEAST = 0.05
"""How far above the shoulders voxels of the head are at least [half spans]. Chosen by eye on the
shared captures; not measured."""

CAP = 0.05
"""Height of the cap of the head whose middle is the head's [half spans]. Chosen by eye on the
shared captures; not measured."""

HEAD_GUESS = 0.4
"""Height of the head above the shoulders where no head shows [half spans]. It is what
`USUAL_REACH` says, 0.417, roughly."""

NECK_SLAB = 0.03
"""How far above and below the neck the slab reaches that tells where the neck is [half spans].
Chosen by eye on the shared captures; not measured."""

NECK_AHEAD = 0.25
"""How far before or behind the arms' line a voxel of the neck is at most [half spans]. Chosen by
eye on the shared captures; not measured."""

TRUNK_SLAB = 0.06
"""How far above and below the hips the slab reaches that tells where the trunk is [half spans].
Chosen by eye on the shared captures; not measured."""

TRUNK_AROUND = 0.30
"""How far to each side of the hips a voxel of that slab is at most [half spans]. Chosen by eye on
the shared captures; not measured."""


@dataclass(frozen=True, eq=False)
class Trunk:
    """Head, spine and hips."""

    head: Points
    neck: Points
    waist: Points
    hips: Points
    """(3,) the middle of the hip joints, as the other three are points (3,)."""
    stature_m: float


def measure_trunk(point: Points, arms: Arms, voxel_m: float, stature_m: float | None) -> Trunk:
    """Return head, spine and hips of (voxel, 3) points, given the arms."""
    half = arms.half_span_m
    aside, ahead = (point - arms.middle) @ arms.left, (point - arms.middle) @ arms.front
    shoulders = np.mean([arms.along(side, SHOULDER_SHARE) for side in range(2)], axis=0)
    height, up = point[:, 1], np.array([0.0, 1.0, 0.0])
    column = (abs(aside) < HEAD_ASIDE * half) & (abs(ahead) < HEAD_AHEAD * half)
    column &= height > shoulders[1] + HEAD_LEAST * half
    top = height[column].max() if column.any() else shoulders[1] + HEAD_GUESS * half
    cap = column & (height > top - CAP * half)
    head = point[cap].mean(axis=0) if cap.any() else shoulders + up * HEAD_GUESS * half
    head[1] = top + voxel_m / 2
    above = head[1] - shoulders[1]
    neck = shoulders + NECK_SHARE * above * up
    section = (abs(height - neck[1]) < NECK_SLAB * half) & (abs(aside) < NECK_ASIDE * half)
    section &= abs(ahead) < NECK_AHEAD * half  # sleeves draw the arms' line forward, not the neck
    if section.any():
        neck += (np.mean(point[section] @ arms.front) - neck @ arms.front) * arms.front
    low = height.min() - voxel_m / 2
    extent = head[1] - low
    by_span, by_head = 2.0 * half / SPAN_PER_STATURE, above / HEAD_ABOVE_ARMS
    stature = stature_m or max(extent, min(by_span, (by_span + by_head) / 2.0))
    length = hips_below_top(stature) * stature - (head[1] - neck[1])
    hips = _follow_trunk(point, arms, neck, length, half)
    return Trunk(head, neck, neck + WAIST_SHARE * (hips - neck), hips, float(stature))


def lift_hips(trunk: Trunk, fork_m: float | None) -> Trunk:
    """Return the trunk with its hips where proportions and the fork of the legs together put them.

    Parameters
    ----------
    trunk
        The hips are where proportions put them.
    fork_m
        As `find_fork` returned it.
    """
    if fork_m is None:
        return trunk
    off = fork_m / trunk.stature_m + HIPS_ABOVE_FORK - (1.0 - hips_below_top(trunk.stature_m))
    if not -LOWER_WITHIN <= off <= HIGHER_WITHIN:
        return trunk
    spread = HIGHER_SPREAD if off > 0 else LOWER_SPREAD
    trusted = HIPS_SPREAD**2 / (HIPS_SPREAD**2 + spread**2)
    up = trunk.neck - trunk.hips
    hips = trunk.hips + trusted * off * trunk.stature_m * up / np.linalg.norm(up)
    return replace(trunk, hips=hips, waist=trunk.neck + WAIST_SHARE * (hips - trunk.neck))


def _follow_trunk(point: Points, arms: Arms, neck: Points, length: float, half: float) -> Points:
    """Return the middle of the hips: `length` down from the neck, where the trunk's slabs lead."""
    hips = neck - [0.0, length, 0.0]
    for _ in range(3):
        near = abs(point[:, 1] - hips[1]) < TRUNK_SLAB * half
        beside = point - hips
        near &= abs(beside @ arms.left) < TRUNK_AROUND * half
        near &= abs(beside @ arms.front) < TRUNK_AROUND * half
        if near.sum() < 8:
            break
        center = hips.copy()
        for axis in (arms.left, arms.front):
            low, high = np.percentile(point[near] @ axis, [2, 98])
            center += ((low + high) / 2 - center @ axis) * axis
        down = center - neck
        hips = neck + down * length / np.linalg.norm(down)
    return hips
