"""A body of usual proportions, as blobs that can be fitted to any frame.

It stands with the arms stretched sideways, looks along z and has its left at x. Capsules around
its bones are filled with points, which are labeled and made into blobs as the voxels of an initial
frame are. It wears nothing and has no color.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.body.anatomy.bones import BONE_NUMBER, Floats, Pose, carry, place_bones
from tasks.body.anatomy.nearest_bones import bones_of_voxels, label_points
from tasks.body.anatomy.proportions import (
    ANKLE_FROM_HEEL,
    ANKLE_HEIGHT,
    FOOT_LENGTH,
    HIP_SHARE,
    SOLE_HEIGHT,
    THIGH_SHARE,
    complete_joints,
    hips_below_top,
    leg_share,
)
from tasks.body.blobs.model import FitModel, make_model
from tasks.body.poses.joint import RIDES_ON

FRONT = np.array([0.0, 0.0, 1.0])
"""Where the body looks."""

NECK_BELOW_TOP = 0.15
"""From the top of the head down to the base of the neck [statures]. `HEAD_ABOVE_ARMS` less
`NECK_SHARE` of it; 0.143 to 0.157 in the shared captures."""

SHOULDER_ASIDE = 0.103
"""From the middle to a shoulder's joint [statures]. `SHOULDER_SHARE` of half of
`SPAN_PER_STATURE`."""

SHOULDER_BELOW_NECK = 0.05
"""From the base of the neck down to the shoulders' height [statures]. `NECK_SHARE` of
`HEAD_ABOVE_ARMS`."""

ARM = {"Elbow": 0.165, "Wrist": 0.317, "Fin": 0.394}
"""From the shoulder along the arm [statures]. By `UPPER_ARM_SHARE` and `FOREARM_SHARE` of a span
that is 0.03 shorter than the usual one, for fingers are bent when nobody asks to stretch them."""

WAIST_UP = 0.44
"""From the hips up to the waist [distances from hips to neck]. What `WAIST_SHARE` leaves."""

CAPSULES = (
    ("Hips", "Waist", 0.088, 0.075, 0.7),
    ("Waist", "Neck", 0.075, 0.085, 0.7),
    ("Neck", "Throat", 0.038, 0.038, 1.0),
    *((s + "Shoulder", s + "Elbow", 0.036, 0.028, 1.0) for s in "RL"),
    *((s + "Elbow", s + "Wrist", 0.028, 0.020, 1.0) for s in "RL"),
    *((s + "Wrist", s + "Fin", 0.024, 0.016, 1.0) for s in "RL"),
    *((s + "Hip", s + "Knee", 0.056, 0.036, 1.0) for s in "RL"),
    *((s + "Knee", s + "Ankle", 0.036, 0.026, 1.0) for s in "RL"),
    *((s + "Heel", s + "Foot", 0.024, 0.018, 1.0) for s in "RL"),
)
"""First and last joint, the radius at both [statures], and the depth over the width. From the
girths of adults over their statures, as `THICK_BONES`."""

HULL_THICKER = 0.004
"""How much thicker than the body a hull is [statures]. About half a voxel of 1 cm."""

SKULL = (0.052, 0.42, 0.062)
"""Half the breadth of a head [statures], half its height [distances from neck to top], half its
depth [statures]. Chosen by eye on the shared captures; not measured."""

THROAT = 0.4
"""How far up the neck reaches [distances from its base to the top of the head]. Chosen by eye on
the shared captures; not measured."""

POINTS_APART = 0.0075
"""How far apart the points are that fill the body [statures]. About a voxel of 1 cm; chosen by eye
on the shared captures, not measured."""

AROUND = 0.15
"""How far around the joints points are looked for [statures]. More than any radius."""


@dataclass(frozen=True, eq=False)
class UsualBody:
    """Blobs and joints of a body of usual proportions."""

    blobs: FitModel
    """In the pose that it stands in."""

    joints: Mapping[str, Floats]
    """(3,) by name, m, in that pose; its feet are at height 0."""

    stature_m: float

    def place(self, pose: Pose) -> dict[str, Floats]:
        """Return the joints (3,) by name, m, in a pose."""
        bone = np.array([BONE_NUMBER[RIDES_ON[name]] for name in JOINTS])
        offset = np.array([self.joints[name] for name in JOINTS]) - self.blobs.origin[bone]
        at = carry(pose, place_bones(pose, self.blobs.origin), bone, offset)
        return dict(zip(JOINTS, at, strict=True))

    def with_head(self, head: Floats) -> "UsualBody":
        """Return the body with the top of its head at another place (3,), m."""
        return replace(self, joints={**self.joints, "Head": head})


def usual_joints(stature_m: float) -> dict[str, Floats]:
    """Return the joints (3,), m, of a body of usual proportions with stretched arms."""
    hips, neck = 1.0 - hips_below_top(stature_m), 1.0 - NECK_BELOW_TOP
    heel = -ANKLE_FROM_HEEL * FOOT_LENGTH
    share = {"Head": (0.0, 1.0, 0.005), "Neck": (0.0, neck, 0.0)}
    share["Waist"] = (0.0, hips + WAIST_UP * (neck - hips), 0.0)
    for side, out in (("R", -1.0), ("L", 1.0)):
        height, hip = neck - SHOULDER_BELOW_NECK, out * HIP_SHARE
        share[side + "Shoulder"] = (out * SHOULDER_ASIDE, height, 0.0)
        for name, away in ARM.items():
            share[side + name] = (out * (SHOULDER_ASIDE + away), height, 0.0)
        share[side + "Hip"] = (hip, hips, 0.0)
        share[side + "Knee"] = (hip, hips - leg_share(stature_m) * THIGH_SHARE, 0.004)
        share[side + "Ankle"] = (hip, ANKLE_HEIGHT, 0.0)
        share[side + "Heel"] = (hip, SOLE_HEIGHT, heel)
        share[side + "Foot"] = (hip, SOLE_HEIGHT, heel + FOOT_LENGTH)
    return {name: stature_m * np.array(share[name]) for name in JOINTS}


def make_usual_body(stature_m: float) -> UsualBody:
    """Return a body of usual proportions of a height, m."""
    joints = usual_joints(stature_m)
    ends = {**joints, "Hips": (joints["RHip"] + joints["LHip"]) / 2.0}
    ends["Throat"] = joints["Neck"] + THROAT * (joints["Head"] - joints["Neck"])
    point = _fill(ends, stature_m)
    bone = bones_of_voxels(point, label_points(point, complete_joints(joints)), ends, FRONT)
    return UsualBody(make_model(point, bone, ends, FRONT), joints, stature_m)


def _fill(ends: Mapping[str, Floats], stature_m: float) -> Floats:
    """Return points (point, 3), m, evenly in the body around its joints."""
    every = np.array(list(ends.values()))
    step = POINTS_APART * stature_m
    low = every.min(axis=0) - AROUND * stature_m
    shape = np.ceil((np.ptp(every, axis=0) + 2.0 * AROUND * stature_m) / step).astype(int)
    inside = np.zeros(shape, np.bool_)

    def fill(middle: Floats, reach: Floats, holds: Callable[[Floats], NDArray[np.bool_]]) -> None:
        """Mark the points that a part holds, which are all in a box."""
        first = np.clip(((middle - reach - low) / step).astype(int), 0, shape)
        last = np.clip(np.ceil((middle + reach - low) / step).astype(int) + 1, 0, shape)
        box = np.stack(np.meshgrid(*map(np.arange, first, last), indexing="ij"), axis=-1)
        inside[tuple(map(slice, first, last))] |= holds(low + box * step)

    for name, other, *sizes in CAPSULES:
        a, b = ends[name], ends[other]
        reach = abs(b - a) / 2.0 + (max(sizes[:2]) + HULL_THICKER) * stature_m
        fill((a + b) / 2.0, reach, lambda p, a=a, b=b, s=sizes: _in_capsule(p, a, b, s, stature_m))
    broad, tall, deep = SKULL
    tall *= ends["Head"][1] - ends["Neck"][1]
    half = np.array([(broad + HULL_THICKER) * stature_m, tall, (deep + HULL_THICKER) * stature_m])
    middle = ends["Head"] - [0.0, tall, 0.0]
    fill(middle, half, lambda p: (((p - middle) / half) ** 2).sum(axis=-1) < 1.0)
    point = low + np.argwhere(inside) * step
    return point[(point[:, 1] > 0.0) & (point[:, 1] <= ends["Head"][1])]


def _in_capsule(
    point: Floats, first: Floats, last: Floats, sizes: Sequence[float], stature_m: float
) -> NDArray[np.bool_]:
    """Return which points (..., 3) are in a capsule of two radii and a depth over the width."""
    thick, thin, flat = sizes
    along = last - first
    share = np.clip((point - first) @ along / (along @ along), 0.0, 1.0)
    off = point - first - share[..., None] * along
    off[..., 2] /= flat
    radius = thick + share * (thin - thick) + HULL_THICKER
    return np.linalg.norm(off, axis=-1) < stature_m * radius
