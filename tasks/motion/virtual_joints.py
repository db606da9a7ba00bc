"""Joints that no marker sits on, from the markers around them.

Everything here is a formula over `(time, space)` arrays in metres. No formula knows which
way is up in the room, so turning the markers turns the joints with them. `NaN` in, `NaN`
out. Names are those of `tasks.motion.marker_sets`: the 21 joints and the landmarks of the body.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

MARKER_RADIUS_M = 0.007
"""Half of the 14 mm marker that most laboratories use."""
KNEE_BREADTH = 0.22
"""Breadth of the knee in lengths of the thigh: about 9.5 cm at 1.70 m."""
ANKLE_BREADTH = 0.17
"""Breadth of the ankle in lengths of the shank: about 7 cm at 1.70 m."""
SHOULDER_DROP = 0.17
"""Shoulder joint below the acromion, in distances of the acromia (Rab et al. 2002)."""
HAND_LENGTH = 2.18
"""Wrist to finger tip over wrist to knuckle: 188 to 86 mm, 170 to 78 mm (de Leva 1996)."""
FOOT_LENGTH = 1.35
"""Heel to toe tip over heel to second toe's base: the ball lies at about 0.74 of a foot."""
BAND_TO_CROWN_M = 0.085
"""The crown above a band of four markers around forehead and back of the head."""
EYES_TO_CROWN = 1.67
"""Skull's base to crown over skull's base to eyes: 19 cm to 11.4 cm in the DAZ body."""
SKULL_OF_LEG = 0.235
"""Skull's base to crown in lengths of the leg: 0.115 to 0.49 of the body's height."""


class Rule(NamedTuple):
    """One way to place a point that the file does not have."""

    point: str
    needs: tuple[str, ...]
    place: Callable[..., Points]
    how: str


def plan_points(given: Iterable[str]) -> list[Rule]:
    """Return the rules to follow, in order, when the points named in `given` are there.

    A point that is given is never replaced; of several rules for a point the first whose
    needs are met is taken. Which rules apply depends on names only, so it cannot change
    from frame to frame.
    """
    have = set(given)
    plan = []
    for rule in _RULES:
        if rule.point not in have and have.issuperset(rule.needs):
            have.add(rule.point)
            plan.append(rule)
    return plan


def place_points(given: Mapping[str, Points]) -> dict[str, Points]:
    """Return the points of `given`, (time, 3) metres each, and all that follow from them."""
    points = dict(given)
    for rule in plan_points(given):
        points[rule.point] = rule.place(*(points[name] for name in rule.needs))
    return points


def find_hip_center(
    right_asis: Points, left_asis: Points, right_psis: Points, left_psis: Points, *, right: bool
) -> Points:
    """Return a hip joint centre by the regression of Harrington et al. 2007.

    In millimetres from the middle of the ASIS: -0.24 PD - 9.9 forward, -0.30 PW - 10.9 up,
    0.33 PW + 7.3 to the side, with PW the distance of the ASIS and PD that of the middles of
    ASIS and PSIS, each its median over the take (J. Biomech. 40:595-602, the equations
    without leg length).

    Parameters
    ----------
    right_asis, left_asis, right_psis, left_psis : (time, 3) float64
        Anterior and posterior superior iliac spines, metres.
    right : bool
        The right hip, or the left.

    Returns
    -------
    (time, 3) float64
        Metres.
    """
    middle = (right_asis + left_asis) / 2
    back = (right_psis + left_psis) / 2
    width = _median_distance(right_asis, left_asis)
    depth = _median_distance(middle, back)
    forward, up, side = _pelvis_axes(right_asis, left_asis, back)
    sideways = 0.33 * width + 0.0073
    return (
        middle
        + (-0.24 * depth - 0.0099) * forward
        + (-0.30 * width - 0.0109) * up
        + (sideways if right else -sideways) * side
    )


def find_hip_center_from_sacrum(
    right_asis: Points, left_asis: Points, sacrum: Points, *, right: bool
) -> Points:
    """Return a hip joint centre by Bell et al. 1990, for a pelvis without PSIS markers.

    From the middle of the ASIS, in distances of the ASIS: 0.19 back, 0.30 down and 0.36 to
    the side (J. Biomech. 23:617-621). The sacrum marker only sets the plane of the pelvis,
    so it does not matter how high on the sacrum it sits. Arrays are (time, 3), metres.
    """
    width = _median_distance(right_asis, left_asis)
    forward, up, side = _pelvis_axes(right_asis, left_asis, sacrum)
    shift = -0.19 * forward - 0.30 * up + (0.36 if right else -0.36) * side
    return (right_asis + left_asis) / 2 + width * shift


def find_chord_center(above: Points, lateral: Points, outside: Points) -> Points:
    """Return the knee's centre by the chord function of the Plug-in Gait model.

    It lies in the plane of the hip, the lateral knee marker and the thigh marker, on the far
    side from the thigh marker, half a knee and a marker's radius from the knee marker, where
    the angle between hip and knee marker is a right one. The breadth of the knee is taken as
    `KNEE_BREADTH` of the thigh, which Plug-in Gait would have measured.

    Parameters
    ----------
    above, lateral, outside : (time, 3) float64
        Hip centre, knee marker, thigh marker; metres.
    """
    thigh = above - lateral
    length = np.linalg.norm(thigh, axis=-1, keepdims=True)
    along = _unit_or_nan(thigh)
    inward = -_unit_or_nan(_reject(outside - lateral, along))
    offset = _half_breadth(KNEE_BREADTH, above, lateral)
    cosine = np.minimum(_divide(offset, length), 1.0)
    return lateral + offset * (cosine * along + np.sqrt(1 - cosine**2) * inward)


def shift_ankle(knee_marker: Points, knee: Points, ankle_marker: Points) -> Points:
    """Return the ankle's centre: its lateral marker moved inward as the knee's was.

    The way is that from the knee's marker to its centre, made square to the shank; the
    distance half an ankle (`ANKLE_BREADTH` of the shank) and a marker's radius. Arrays are
    (time, 3), metres.
    """
    inward = _unit_or_nan(_reject(knee - knee_marker, _unit_or_nan(ankle_marker - knee)))
    return ankle_marker + _half_breadth(ANKLE_BREADTH, knee, ankle_marker) * inward


def drop_shoulder(
    near: Points, far: Points, *, upper: tuple[Points, Points], lower: tuple[Points, Points]
) -> Points:
    """Return the shoulder joint below the acromion marker `near` (Rab et al. 2002).

    It lies `SHOULDER_DROP` of the distance of both acromia (median over the take) down the
    trunk, whose axis runs from the middle of `upper` to the middle of `lower`; all (time, 3).
    """
    down = _unit_or_nan(_mean(*lower) - _mean(*upper))
    return near + SHOULDER_DROP * _median_distance(near, far) * down


def lift_band(
    right_front: Points, left_front: Points, right_back: Points, left_back: Points
) -> Points:
    """Return the crown: the middle of a head band, lifted square to it by `BAND_TO_CROWN_M`."""
    sideways = right_front + right_back - left_front - left_back
    forward = right_front + left_front - right_back - left_back
    middle = _mean(right_front, left_front, right_back, left_back)
    return middle + BAND_TO_CROWN_M * _unit_or_nan(np.cross(sideways, forward))


def lift_skull(skull: Points, right_eye: Points, left_eye: Points) -> Points:
    """Return the crown above the skull's base, from where the eyes are.

    The eyes are taken to lie as far ahead of the skull's base as above it, so the head's own
    up is half a right angle from the line to their middle; (time, 3) each.
    """
    sideways = _unit_or_nan(right_eye - left_eye)
    eyes = _reject(_mean(right_eye, left_eye) - skull, sideways)
    up = (eyes + np.cross(sideways, eyes)) * math.sqrt(0.5)
    return skull + EYES_TO_CROWN * up


def lift_neck(skull: Points, neck: Points, hip: Points, knee: Points, ankle: Points) -> Points:
    """Return the crown: `SKULL_OF_LEG` of the leg beyond the skull's base, as the neck points."""
    leg = _median_distance(hip, knee) + _median_distance(knee, ankle)
    return skull + SKULL_OF_LEG * leg * _unit_or_nan(skull - neck)


def carry_on(start: Points, through: Points, share: float) -> Points:
    """Return the point `share` times as far from `start` as `through` is, on their line."""
    return start + share * (through - start)


def complete_corner(beside: Points, behind: Points, across: Points) -> Points:
    """Return the fourth corner of a parallelogram, `across` being the opposite one."""
    return beside + behind - across


def _pelvis_axes(
    right_asis: Points, left_asis: Points, back: Points
) -> tuple[Points, Points, Points]:
    """Forward, up and right, each a unit vector (Wu et al. 2002)."""
    side = _unit_or_nan(right_asis - left_asis)
    forward = _unit_or_nan(_reject((right_asis + left_asis) / 2 - back, side))
    return forward, np.cross(side, forward), side


def _half_breadth(breadth: float, upper: Points, lower: Points) -> float:
    return breadth * _median_distance(upper, lower) / 2 + MARKER_RADIUS_M


def _median_distance(a: Points, b: Points) -> float:
    distance = np.linalg.norm(a - b, axis=-1)
    distance = distance[np.isfinite(distance)]
    return float(np.median(distance)) if distance.size else math.nan


def _mean(*points: Points) -> Points:
    return sum(points[1:], points[0]) / len(points)


def _reject(vector: Points, axis: Points) -> Points:
    """Return what of `vector` is square to the unit vector `axis`."""
    return vector - np.sum(vector * axis, axis=-1, keepdims=True) * axis


def _unit_or_nan(vector: Points) -> Points:
    """Return vectors of length 1, with NaN where there is no direction."""
    return _divide(vector, np.linalg.norm(vector, axis=-1, keepdims=True))


def _divide(number: Points | float, by: Points) -> Points:
    """Divide, with NaN where there is nothing to divide by."""
    return number / np.where(by > 0, by, np.nan)


def _drop_by_spine(
    near: Points, far: Points, c7: Points, clavicle: Points, t10: Points, sternum: Points
) -> Points:
    return drop_shoulder(near, far, upper=(c7, clavicle), lower=(t10, sternum))


def _drop_by_hips(near: Points, far: Points, neck: Points, hip: Points, other: Points) -> Points:
    return drop_shoulder(near, far, upper=(neck, neck), lower=(hip, other))


def _shift_ankle(knee_marker: Points, knee: Points, ankle_marker: Points, _: Points) -> Points:
    """Shift the ankle; the last marker is what tells that the knee is not its own marker."""
    return shift_ankle(knee_marker, knee, ankle_marker)


def _hip_rules(side: str) -> list[Rule]:
    asis, right = ("RAsis", "LAsis"), side == "R"
    return [
        Rule(
            f"{side}Hip",
            (*asis, "RPsis", "LPsis"),
            partial(find_hip_center, right=right),
            "from the ASIS and PSIS markers by the regression of Harrington et al. 2007",
        ),
        Rule(
            f"{side}Hip",
            (*asis, "Sacrum"),
            partial(find_hip_center_from_sacrum, right=right),
            "from the ASIS and sacrum markers by the regression of Bell et al. 1990",
        ),
    ]


def _arm_rules(side: str, other: str) -> list[Rule]:
    acromia = (f"{side}Acromion", f"{other}Acromion")
    drop = f"below the acromion marker by {SHOULDER_DROP} of the acromia's distance"
    shoulder, elbow, fin = f"{side}Shoulder", f"{side}Elbow", f"{side}Fin"
    lateral, knuckle = f"{side}ElbowLateral", f"{side}Knuckle"
    spine = ("C7", "Clavicle", "T10", "Sternum")
    hips = ("Neck", "RHip", "LHip")
    return [
        Rule(shoulder, (*acromia, *spine), _drop_by_spine, f"{drop} (Rab et al. 2002)"),
        Rule(shoulder, (*acromia, *hips), _drop_by_hips, f"{drop} (Rab et al. 2002)"),
        Rule(shoulder, acromia[:1], _mean, "the acromion marker itself"),
        Rule(elbow, (lateral, f"{side}ElbowMedial"), _mean, "the middle of both epicondyles"),
        Rule(elbow, (lateral,), _mean, "the lateral elbow marker itself"),
        Rule(
            fin,
            (f"{side}Wrist", knuckle),
            partial(carry_on, share=HAND_LENGTH),
            f"the hand carried on to {HAND_LENGTH} times wrist to knuckle (de Leva 1996)",
        ),
        Rule(fin, (knuckle,), _mean, "the knuckle itself"),
    ]


def _leg_rules(side: str) -> list[Rule]:
    hip, knee, ankle, foot = (f"{side}{name}" for name in ("Hip", "Knee", "Ankle", "Foot"))
    knee_out, knee_in, thigh = f"{knee}Lateral", f"{knee}Medial", f"{side}ThighSide"
    ankle_out, toe = f"{ankle}Lateral", f"{side}ToeBase"
    chord = f"inward of the knee marker by half a knee, {KNEE_BREADTH} of the thigh"
    shift = f"inward of the ankle marker by half an ankle, {ANKLE_BREADTH} of the shank"
    return [
        Rule(knee, (knee_out, knee_in), _mean, "the middle of both epicondyles"),
        Rule(knee, (hip, knee_out, thigh), find_chord_center, f"{chord} (chord function)"),
        Rule(knee, (knee_out,), _mean, "the lateral knee marker itself"),
        Rule(ankle, (ankle_out, f"{ankle}Medial"), _mean, "the middle of both malleoli"),
        Rule(ankle, (knee_out, knee, ankle_out, f"{knee}Medial"), _shift_ankle, shift),
        Rule(ankle, (knee_out, knee, ankle_out, thigh), _shift_ankle, shift),
        Rule(ankle, (ankle_out,), _mean, "the lateral ankle marker itself"),
        Rule(
            foot,
            (f"{side}Heel", toe),
            partial(carry_on, share=FOOT_LENGTH),
            f"the foot carried on to {FOOT_LENGTH} times heel to toe base",
        ),
        Rule(foot, (toe,), _mean, "the toe base itself"),
    ]


def _head_rules() -> list[Rule]:
    band = ("RFrontHead", "LFrontHead", "RBackHead", "LBackHead")
    fourth = "the fourth corner of the head band's other three"
    eyes = f"above the skull's base by {EYES_TO_CROWN} times its distance from the eyes"
    neck = f"above the skull's base by {SKULL_OF_LEG} of the leg, as the neck points"
    return [
        *(
            Rule(point, (beside, behind, across), complete_corner, fourth)
            for point, beside, behind, across in (
                ("RFrontHead", "LFrontHead", "RBackHead", "LBackHead"),
                ("LFrontHead", "RFrontHead", "LBackHead", "RBackHead"),
                ("RBackHead", "LBackHead", "RFrontHead", "LFrontHead"),
                ("LBackHead", "RBackHead", "LFrontHead", "RFrontHead"),
            )
        ),
        Rule(
            "Head",
            band,
            lift_band,
            f"the head band's middle lifted {BAND_TO_CROWN_M * 100:.1f} cm to the crown",
        ),
        Rule("Head", ("Skull", "REye", "LEye"), lift_skull, eyes),
        Rule("Head", ("Skull", "Neck", "RHip", "RKnee", "RAnkle"), lift_neck, neck),
        Rule("Head", ("Skull", "Neck", "LHip", "LKnee", "LAnkle"), lift_neck, neck),
    ]


_NECK_AND_WAIST = [
    Rule("Neck", ("C7", "Clavicle"), _mean, "the middle of C7 and the collar bones' notch"),
    Rule("Neck", ("C7",), _mean, "the C7 marker itself"),
    Rule(
        "Waist",
        ("RAsis", "LAsis", "RPsis", "LPsis"),
        _mean,
        "the middle of the four pelvis markers",
    ),
    Rule(
        "Waist",
        ("RAsis", "LAsis", "Sacrum", "Sacrum"),
        _mean,
        "the middle of the sacrum marker and the middle of the ASIS",
    ),
]
_RULES = (
    *_hip_rules("R"),
    *_hip_rules("L"),
    *_NECK_AND_WAIST,
    *_arm_rules("R", "L"),
    *_arm_rules("L", "R"),
    Rule("Neck", ("RShoulder", "LShoulder"), _mean, "the middle of the shoulders"),
    *_leg_rules("R"),
    *_leg_rules("L"),
    *_head_rules(),
)
