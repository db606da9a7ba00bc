"""Label voxels by the bone they are nearest to, bones having the thickness of a body.

A bone's thickness is a share of the body's size (`THICK_BONES`). Planes part neighbors on the trunk
where anatomy parts them: thickness says nothing there. Points are metres with y up.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONE_NUMBER, Floats
from tasks.body.anatomy.proportions import (
    FLATNESS,
    GROIN_RISE,
    HUMERAL_HEAD,
    RIBS_BELOW_TOP,
    THICK_BONES,
    Points,
    body_size,
    unit,
)

PLACED_JOINTS = (
    *("Head", "Neck"),
    *(side + name for side in "RL" for name in ("Shoulder", "Elbow", "Fin", "Hip", "Knee", "Foot")),
)
"""The joints without which voxels cannot be labelled. The others are put in by proportion."""

LIMB_BONES = THICK_BONES[3:]
"""The bones of arms and legs."""

CLOTH_HANGS = 0.5
"""How much distance straight below an arm counts [share of other distance]. Sleeves hang from an
arm; chosen by eye on the shared captures, not measured."""

NECK_REACH = 0.12
"""How far from the neck the plane holds that parts the head from the body [statures]. Half the
breadth of the shoulders, and some cloth."""

SHOULDER_REACH = 0.10
"""How far from a shoulder the plane holds that parts an arm from the body [statures]. From the
shoulder to the armpit, and some cloth."""

CLOTH = 0.015
"""How much farther from its bone than the radius a limb's voxel is at most [statures]. What is
farther is cloth; chosen by eye on the shared captures, not measured."""

FOOT_BEGINS = 0.03
"""How far before the ankle a foot begins, and how far above the ankle it reaches there
[statures]. Chosen by eye on the shared captures; not measured."""


def label_points(
    point: Points, joints: Mapping[str, Points], *, whole_arms: bool = False
) -> NDArray[np.uint8]:
    """Return the label 1 to 11 (voxel,) of points (voxel, 3) in a body with complete joints.

    With `whole_arms` an arm keeps the head of its bone. Without, a plane through the shoulder's
    joint, about which the arm turns, cuts it off.
    """
    size = body_size(joints)
    places = {**joints, "Hips": (joints["RHip"] + joints["LHip"]) / 2.0}
    across = unit(joints["LShoulder"] - joints["RShoulder"])
    least = np.full(len(point), np.inf)
    label = np.zeros(len(point), np.uint8)
    for number, first, last, thick, thin in THICK_BONES:
        start, bone = places[first], places[last] - places[first]
        share = np.clip((point - start) @ bone / max(float(bone @ bone), 1e-12), 0.0, 1.0)
        off = point - start - share[:, None] * bone
        if number in (2, 3):
            off = off - (1.0 - FLATNESS) * (off @ across)[:, None] * across
        if number in (4, 5, 6, 7):
            off[:, 1] *= np.where(off[:, 1] < 0, CLOTH_HANGS, 1.0)
        distance = np.linalg.norm(off, axis=1) - size * (thick + share * (thin - thick))
        closer = distance < least
        least[closer], label[closer] = distance[closer], number
    inward = HUMERAL_HEAD * size if whole_arms else 0.0
    _cut_off_head_and_arms(point, places, label, (size, inward))
    _cut_trunk(point, places, label)
    return label


def is_limb(
    point: Points, joints: Mapping[str, Points], label: NDArray[np.integer]
) -> NDArray[np.bool_]:
    """Return (voxel,) False where a point labeled an arm or a leg is cloth around it.

    Parameters
    ----------
    point : (voxel, 3) float64
        Metres.
    joints
        Complete joints.
    label : (voxel,) int
        1 to 11; 0 is none.
    """
    size = body_size(joints)
    limb = np.asarray(label) < LIMB_BONES[0][0]
    for number, first, last, thick, thin in LIMB_BONES:
        own = np.flatnonzero(label == number)
        start, bone = joints[first], joints[last] - joints[first]
        share = np.clip((point[own] - start) @ bone / max(float(bone @ bone), 1e-12), 0.0, 1.0)
        away = np.linalg.norm(point[own] - start - share[:, None] * bone, axis=1)
        limb[own] |= away <= size * (thick + share * (thin - thick) + CLOTH)
    return limb


def _cut_off_head_and_arms(
    point: Points, places: Mapping[str, Points], label: NDArray[np.uint8],
    sizes: tuple[float, float],
) -> None:  # fmt: skip
    """Part the body from head and upper arms, in place, by planes near the joints.

    One plane cuts the neck across. A hanging arm is cut upright. A stretched arm is cut from the
    inner end of the shoulder, above, to the armpit, which is farther out.

    `sizes` are the body's, and how far the arms' planes are inward of their joints, m.
    """
    size, inward = sizes
    up = unit(places["Neck"] - places["Hips"])
    across = unit(places["LShoulder"] - places["RShoulder"])
    cuts = [(1, places["Neck"], places["Head"] - places["Neck"], NECK_REACH)]
    for number, side, outward in ((4, "R", -across), (6, "L", across)):
        arm = unit(places[f"{side}Elbow"] - places[f"{side}Shoulder"])
        inner = places[f"{side}Shoulder"] - inward * outward
        cuts.append((number, inner, outward + arm + up, SHOULDER_REACH))
    for number, place, normal, reach in cuts:
        away = point - place
        here = (label == 2) | (label == number)
        here &= np.linalg.norm(away, axis=1) < reach * size
        label[here] = np.where(away[here] @ normal >= 0, number, 2)


def _cut_trunk(point: Points, places: Mapping[str, Points], label: NDArray[np.uint8]) -> None:
    """Part body, waist and upper legs, in place, by planes.

    One plane halves the bend of the spine where the ribs end. A plane through each hip rises
    outwards.
    """
    up = unit(places["Waist"] - places["Hips"])
    across = unit(places["LHip"] - places["RHip"])
    ribs = places["Hips"] + ((places["Head"] - places["Hips"]) @ up) * up
    ribs -= RIBS_BELOW_TOP * body_size(places) * up
    above = (point - ribs) @ (up + unit(places["Neck"] - places["Waist"])) >= 0
    label[(label == 3) & above] = 2
    label[(label == 2) & ~above] = 3
    left = (point - places["Hips"]) @ across > 0
    loins = (label == 3) | (label == 8) | (label == 10)
    for number, side, outward, is_side in ((8, "R", -across, ~left), (10, "L", across, left)):
        hip = places[f"{side}Hip"]
        normal = unit(up - unit(places[f"{side}Knee"] - hip)) - GROIN_RISE * outward
        here = loins & is_side
        is_leg = here & ((point - hip) @ normal < 0)
        label[here & ~is_leg] = 3
        label[is_leg & (label == 3)] = number


def bones_of_voxels(
    points: Floats, labels: NDArray[np.integer], ends: dict[str, Floats], forward: Floats
) -> NDArray[np.int64]:
    """Return (voxel,) the bone of each labeled voxel, hands and feet apart; -1 without a label.

    `ends` are the joints by name. A hand begins at the wrist, a foot before or below the ankle.
    """
    bone = labels.astype(np.int64) - 1
    stature = ends["Head"][1] - min(ends["RFoot"][1], ends["LFoot"][1])
    for side in "RL":
        arm = ends[side + "Fin"] - ends[side + "Elbow"]
        beyond = (points - ends[side + "Wrist"]) @ arm > 0
        bone[(bone == BONE_NUMBER[side + "ForeArm"]) & beyond] = BONE_NUMBER[side + "Hand"]
        below = points - ends[side + "Ankle"]
        low = below[:, 1] < FOOT_BEGINS * stature
        foot = (below[:, 1] < 0) | (low & (below @ forward > FOOT_BEGINS * stature))
        bone[(bone == BONE_NUMBER[side + "LowerLeg"]) & foot] = BONE_NUMBER[side + "Foot"]
    return bone
