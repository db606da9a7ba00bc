"""A performer's body: proportions, and joints from what the performer wills.

The feet are given, the hips are carried over them as high as both legs reach, the spine and
the hands follow their controls; legs and arms are two-bone limbs. Proportions are shares of
body height after Drillis and Contini (1966), as printed in Winter, *Biomechanics and Motor
Control of Human Movement*, 4.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.studio.dancing.limbs import bend_limb, facing, turned, unit

Track = NDArray[np.float64]

SIDES = {"R": -1.0, "L": 1.0}
"""Sides by the first letter of their joints' names; the sign is that of the body's left."""

HANDS = tuple(f"{side}_{axis}" for side in SIDES for axis in ("out", "up", "forward"))
CONTROLS = (
    *("bow", "side", "twist", "nod", "tilt", "look"),
    *("crouch", "tiptoe", "sway_left", "sway_forward"),
    *HANDS,
)
"""What a performer wills, each a number a frame.

bow forward, side (lean to the left), twist (left), and for the head nod, tilt, look: radians
on top of what carries it. crouch, sway: shares of the leg's length. tiptoe: heels up, radians.
Hands: the wrist seen from the shoulder, in lengths of the arm: out from the body, up, forward.
"""


@dataclass(frozen=True)
class Bones:
    """Lengths of a body, in metres."""

    head: float
    trunk: float
    """Waist to base of the neck."""
    waist: float
    """Middle of the hips to waist."""
    shoulder: float
    """Half the distance between the shoulders."""
    upper_arm: float
    forearm: float
    hand: float
    hip: float
    """Half the distance between the hip joints."""
    thigh: float
    shank: float
    ankle: float
    """Height of the ankle above the sole."""
    heel: float
    """Heel behind the ankle."""
    foot: float
    """Toe tip ahead of the ankle."""

    @property
    def arm(self) -> float:
        """Shoulder to wrist."""
        return self.upper_arm + self.forearm

    @property
    def leg(self) -> float:
        """Hip to ankle."""
        return self.thigh + self.shank


def measure_bones(
    height_m: float, *, legs: float = 1.0, arms: float = 1.0, shoulders: float = 1.0
) -> Bones:
    """Return the bones of a body of this height.

    Parameters
    ----------
    height_m : float
        Floor to top of the head, standing.
    legs, arms, shoulders : float
        Length relative to the average for this height; the trunk makes up for longer legs.
    """
    thigh, shank, ankle = 0.245 * legs, 0.246 * legs, 0.039
    above = (1.0 - thigh - shank - ankle) / (1.0 - 0.530)
    return Bones(
        **{
            name: share * height_m
            for name, share in {
                "head": 0.17 * above,
                "trunk": 0.195 * above,
                "waist": 0.105 * above,
                "shoulder": 0.108 * shoulders,
                "upper_arm": 0.176 * arms,
                "forearm": 0.146 * arms,
                "hand": 0.09 * arms,
                "hip": 0.05,
                "thigh": thigh,
                "shank": shank,
                "ankle": ankle,
                "heel": 0.03,
                "foot": 0.118,
            }.items()
        }
    )


@dataclass(frozen=True)
class FootTrack:
    """Where one foot is: it turns about the tip of its toes."""

    toe: Track
    """(time, 3), metres; y is the height above the floor."""
    yaw: Track
    """(time,), radians."""
    pitch: Track
    """(time,), radians, heel up."""

    def point(self, back_m: float, up_m: float = 0.0) -> Track:
        """Return the point (time, 3) of the foot so far behind the toes and above the sole."""
        frame = turned(self.yaw, self.pitch, np.zeros_like(self.yaw))
        return self.toe + up_m * frame[..., 1] - back_m * frame[..., 2]


def pose_figure(
    bones: Bones,
    controls: Mapping[str, Track],
    feet: Mapping[str, FootTrack],
    ground: Track,
    yaw: Track,
) -> dict[str, Track]:
    """Return the joints of a performer, by the names of the archive.

    Parameters
    ----------
    bones : Bones
        The performer's lengths; all are kept exactly but hip middle to neck, which bends.
    controls : mapping of (time,) float64
        One track for each name of `CONTROLS`.
    feet : mapping of FootTrack
        By "R" and "L".
    ground : (time, 3) float64
        The point of the floor over which the hips are carried.
    yaw : (time,) float64
        Heading of the pelvis, radians.

    Returns
    -------
    dict of (time, 3) float64
        Metres: 21 joints.
    """
    joints: dict[str, Track] = {}
    for side, foot in feet.items():
        joints[f"{side}Ankle"] = foot.point(bones.foot, bones.ankle)
        joints[f"{side}Heel"] = foot.point(bones.foot + bones.heel)
        joints[f"{side}Foot"] = foot.toe
    center = _carry_hips(bones, controls, joints, ground, yaw)
    _stack_spine(bones, controls, joints, center, yaw)
    for side in SIDES:
        _stand_on_leg(bones, joints, side, feet[side].yaw, yaw)
        _reach_with_arm(bones, controls, joints, side, yaw)
    return joints


def _carry_hips(bones, controls, joints, ground, yaw) -> Track:
    """Return the middle of the hips, as high as both legs reach, less the crouch."""
    flat = turned(yaw, np.zeros_like(yaw), np.zeros_like(yaw))
    back = 0.22 * np.sin(controls["bow"]) * bones.trunk  # else a bow would fall over
    center = ground + (
        (bones.leg * controls["sway_left"])[:, None] * flat[..., 0]
        + (bones.leg * controls["sway_forward"] - back)[:, None] * flat[..., 2]
    )
    soft, lowest = 0.006 * bones.leg, np.zeros(len(yaw))
    for side, sign in SIDES.items():
        joints[f"{side}Hip"] = center + sign * bones.hip * flat[..., 0]
        ankle = joints[f"{side}Ankle"]
        aside = np.linalg.norm((joints[f"{side}Hip"] - ankle)[:, [0, 2]], axis=-1)
        height = ankle[:, 1] + np.sqrt(
            np.maximum((0.994 * bones.leg) ** 2 - aside**2, (0.5 * bones.leg) ** 2)
        )
        lowest = lowest + np.exp(-(height - bones.leg) / soft)
    raised = bones.leg - soft * np.log(lowest) - bones.leg * controls["crouch"]
    center[:, 1] = raised
    for side in SIDES:
        joints[f"{side}Hip"][:, 1] = raised
    return center


def _stack_spine(bones, controls, joints, center, yaw) -> None:
    """Put waist, neck, head and shoulders over the middle of the hips."""
    bow, side, twist = controls["bow"], controls["side"], controls["twist"]
    loins = turned(yaw + 0.3 * twist, 0.4 * bow, 0.4 * side)
    chest = turned(yaw + twist, bow, side)
    joints["Waist"] = center + bones.waist * loins[..., 1]
    joints["Neck"] = joints["Waist"] + bones.trunk * chest[..., 1]
    head = turned(
        yaw + twist + controls["look"],
        0.7 * bow + controls["nod"] + 0.08,
        0.7 * side + controls["tilt"],
    )
    joints["Head"] = joints["Neck"] + bones.head * head[..., 1]
    drop = 0.12 * bones.trunk
    for letter, sign in SIDES.items():
        joints[f"{letter}Shoulder"] = (
            joints["Neck"] + sign * bones.shoulder * chest[..., 0] - drop * chest[..., 1]
        )


def _stand_on_leg(bones, joints, side, foot_yaw, yaw) -> None:
    """Bend the knee forward, between the way of the foot and that of the pelvis."""
    pole = unit(facing(foot_yaw) + facing(yaw))
    joints[f"{side}Knee"], _ = bend_limb(
        joints[f"{side}Hip"],
        joints[f"{side}Ankle"],
        pole,
        upper_m=bones.thigh,
        lower_m=bones.shank,
        reach=1.05,  # the hips already stay within reach of both ankles
    )


def _reach_with_arm(bones, controls, joints, side, yaw) -> None:
    """Bring the hand where it is willed, the elbow out and down, of a low hand also back."""
    sign = SIDES[side]
    frame = turned(yaw + controls["twist"], 0.5 * controls["bow"], 0.8 * controls["side"])
    left, up, forward = frame[..., 0], frame[..., 1], frame[..., 2]
    out, above, ahead = (controls[f"{side}_{axis}"][:, None] for axis in ("out", "up", "forward"))
    shoulder = joints[f"{side}Shoulder"]
    target = shoulder + bones.arm * (sign * out * left + above * up + ahead * forward)
    pole = (0.5 + 0.25 * above) * sign * left - 0.5 * up + 0.35 * (above - 1.0) * forward
    elbow, wrist = bend_limb(
        shoulder, target, pole, upper_m=bones.upper_arm, lower_m=bones.forearm, reach=0.988
    )
    hand = unit(wrist - elbow) + 0.25 * forward - 0.2 * sign * left
    joints[f"{side}Elbow"], joints[f"{side}Wrist"] = elbow, wrist
    joints[f"{side}Fin"] = wrist + bones.hand * unit(hand)
