"""Measure head, spine and hips of a performer who stretches the arms.

The height of the hips is told by the proportions of a body and, where it shows, by the fork of the
legs; both are weighted by how well they are known. Points are metres with y up.
"""

from dataclasses import dataclass, replace

import numpy as np

from tasks.body.anatomy.proportions import Points
from tasks.body.initial.arms import (
    HEAD_ABOVE_ARMS,
    HIGHER_SPREAD,
    HIGHER_WITHIN,
    HIPS_ABOVE_FORK,
    HIPS_BELOW_TOP,
    HIPS_SPREAD,
    LOWER_SPREAD,
    LOWER_WITHIN,
    NECK_SHARE,
    SHOULDER_SHARE,
    SPAN_PER_STATURE,
    WAIST_SHARE,
    Arms,
)


@dataclass(frozen=True, eq=False)
class Trunk:
    """Head, spine and hips."""

    head: Points
    neck: Points
    waist: Points
    hips: Points
    """(3,) each; `hips` is the middle of the hip joints."""
    stature_m: float


def measure_trunk(point: Points, arms: Arms, voxel_m: float, stature_m: float | None) -> Trunk:
    """Return head, spine and hips of (voxel, 3) points, given the arms."""
    half = arms.half_span_m
    aside, ahead = (point - arms.middle) @ arms.left, (point - arms.middle) @ arms.front
    shoulders = np.mean([arms.along(side, SHOULDER_SHARE) for side in range(2)], axis=0)
    height, up = point[:, 1], np.array([0.0, 1.0, 0.0])
    column = (abs(aside) < 0.2 * half) & (abs(ahead) < 0.35 * half)
    column &= height > shoulders[1] + 0.05 * half
    top = height[column].max() if column.any() else shoulders[1] + 0.4 * half
    cap = column & (height > top - 0.05 * half)
    head = point[cap].mean(axis=0) if cap.any() else shoulders + up * 0.4 * half
    head[1] = top + voxel_m / 2
    above = head[1] - shoulders[1]
    neck = shoulders + NECK_SHARE * above * up
    section = (abs(height - neck[1]) < 0.03 * half) & (abs(aside) < 0.12 * half)
    section &= abs(ahead) < 0.25 * half  # sleeves draw the arms' line forward, not the neck
    if section.any():
        neck += (np.mean(point[section] @ arms.front) - neck @ arms.front) * arms.front
    low = height.min() - voxel_m / 2
    extent = head[1] - low
    by_span, by_head = 2.0 * half / SPAN_PER_STATURE, above / HEAD_ABOVE_ARMS
    stature = stature_m or max(extent, min(by_span, (by_span + by_head) / 2.0))
    length = HIPS_BELOW_TOP * stature - (head[1] - neck[1])
    hips = _follow_trunk(point, arms, neck, length, half)
    return Trunk(head, neck, neck + WAIST_SHARE * (hips - neck), hips, float(stature))


def lift_hips(trunk: Trunk, fork_m: float | None) -> Trunk:
    """Return the trunk with its hips where proportions and the fork of the legs say together.

    Parameters
    ----------
    trunk
        With its hips by the proportions.
    fork_m
        As `find_fork` returned it.
    """
    if fork_m is None:
        return trunk
    off = fork_m / trunk.stature_m + HIPS_ABOVE_FORK - (1.0 - HIPS_BELOW_TOP)
    if not -LOWER_WITHIN <= off <= HIGHER_WITHIN:
        return trunk
    spread = HIGHER_SPREAD if off > 0 else LOWER_SPREAD
    trusted = HIPS_SPREAD**2 / (HIPS_SPREAD**2 + spread**2)
    up = trunk.neck - trunk.hips
    hips = trunk.hips + trusted * off * trunk.stature_m * up / np.linalg.norm(up)
    return replace(trunk, hips=hips, waist=trunk.neck + WAIST_SHARE * (hips - trunk.neck))


def _follow_trunk(point: Points, arms: Arms, neck: Points, length: float, half: float) -> Points:
    """Return the middle of the hips: so far down from the neck, where the trunk's slabs lead."""
    hips = neck - [0.0, length, 0.0]
    for _ in range(3):
        near = abs(point[:, 1] - hips[1]) < 0.06 * half
        beside = point - hips
        near &= abs(beside @ arms.left) < 0.30 * half
        near &= abs(beside @ arms.front) < 0.30 * half
        if near.sum() < 8:
            break
        center = hips.copy()
        for axis in (arms.left, arms.front):
            low, high = np.percentile(point[near] @ axis, [2, 98])
            center += ((low + high) / 2 - center @ axis) * axis
        down = center - neck
        hips = neck + down * length / np.linalg.norm(down)
    return hips
