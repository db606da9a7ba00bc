"""Label voxels by the bone they are nearest to, bones having the thickness of a body.

Thicknesses are shares of the body's size, from the girths of adults over their statures
(compare the radii in Drillis and Contini 1966). Neighbors on the trunk are parted by planes
where anatomy parts them: thickness says nothing there. Points are metres with y up.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONE_NUMBER, Floats
from tasks.body.anatomy.proportions import Points, body_size, unit

BONES = (
    (1, "Neck", "Head", 0.060, 0.055),
    (2, "Waist", "Neck", 0.085, 0.060),
    (3, "Hips", "Waist", 0.078, 0.085),
    *((4 + 2 * k, f"{s}Shoulder", f"{s}Elbow", 0.024, 0.046) for k, s in enumerate("RL")),
    *((5 + 2 * k, f"{s}Elbow", f"{s}Fin", 0.046, 0.046) for k, s in enumerate("RL")),
    *((8 + 2 * k, f"{s}Hip", f"{s}Knee", 0.076, 0.032) for k, s in enumerate("RL")),
    *((9 + 2 * k, f"{s}Knee", f"{s}Ankle", 0.032, 0.040) for k, s in enumerate("RL")),
    *((9 + 2 * k, f"{s}Heel", f"{s}Foot", 0.022, 0.018) for k, s in enumerate("RL")),
)
"""Label, first and last joint, and the bone's radius at both, in statures."""
NEEDED = (
    *("Head", "Neck"),
    *(side + name for side in "RL" for name in ("Shoulder", "Elbow", "Fin", "Hip", "Knee", "Foot")),
)
"""The joints without which voxels cannot be labelled; the others are put in by proportion."""
CLOTH_HANGS = 0.5
"""Distance straight below an arm counts this much: sleeves hang from it."""
GROIN_RISE = 0.9
"""How far the border of waist and leg rises, to the outside, as tangent: along the groin."""
FLATNESS = 0.70
"""Depth of a trunk over its width."""
RIBS_BELOW_TOP = 0.336
"""From the top of the head to the border of body and waist, in statures: where the ribs end, midway
between xiphion and omphalion (means of women and men, De Leva 1996). Told from the hips, which are
at 0.51 in that table, the border would be off by a third of what a body's legs are longer."""
NECK_REACH, SHOULDER_REACH = 0.12, 0.10
"""How far from its joint the plane that parts the head, an arm, holds: half the breadth of the
shoulders, the length from the shoulder to the armpit and some cloth; statures."""
HUMERAL_HEAD = 0.014
"""Radius of the head of the upper arm's bone, 23 mm (Boileau and Walch 1997); statures."""
CLOTH = 0.015
"""How much thicker a limb is than its bone's radius at most, before it is cloth, statures."""


def label_points(
    point: Points, joints: Mapping[str, Points], *, whole_arms: bool = False
) -> NDArray[np.uint8]:
    """Return the label 1 to 11 (voxel,) of points (voxel, 3), given complete joints.

    With `whole_arms` an arm has the head of its bone; without, it is cut through the shoulder's
    joint, about which it turns.
    """
    size = body_size(joints)
    places = {**joints, "Hips": (joints["RHip"] + joints["LHip"]) / 2.0}
    across = unit(joints["LShoulder"] - joints["RShoulder"])
    least = np.full(len(point), np.inf)
    label = np.zeros(len(point), np.uint8)
    for number, first, last, thick, thin in BONES:
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
    limb = np.asarray(label) < BONES[3][0]
    for number, first, last, thick, thin in BONES[3:]:
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

    The neck is cut across. An arm that hangs is cut upright; one that is stretched from the inner
    end of the shoulder, above, to the armpit, which is farther out.

    sizes : the body's, and how far the arms' planes are inward of their joints, m
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

    One halves the bend of the spine where the ribs end; one through each hip rises outwards.
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
    """Return (voxel,) the bone of each labeled voxel, -1 for unlabeled: hands and feet apart.

    `ends` are the joints by name; a hand begins at the wrist, a foot before or below the ankle.
    """
    bone = labels.astype(np.int64) - 1
    stature = ends["Head"][1] - min(ends["RFoot"][1], ends["LFoot"][1])
    for side in "RL":
        arm = ends[side + "Fin"] - ends[side + "Elbow"]
        beyond = (points - ends[side + "Wrist"]) @ arm > 0
        bone[(bone == BONE_NUMBER[side + "ForeArm"]) & beyond] = BONE_NUMBER[side + "Hand"]
        below = points - ends[side + "Ankle"]
        low = below[:, 1] < 0.03 * stature
        foot = (below[:, 1] < 0) | (low & (below @ forward > 0.03 * stature))
        bone[(bone == BONE_NUMBER[side + "LowerLeg"]) & foot] = BONE_NUMBER[side + "Foot"]
    return bone
