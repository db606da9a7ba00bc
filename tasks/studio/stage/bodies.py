"""The surface of a clothed performer, posed by the joints.

Every bone carries a tube of rings; a kimono adds a skirt around both legs and sleeves that hang
from the forearms, a furisode sleeves of the robe's own color that hang from the wrists.
Thicknesses are those of an adult of 1.70 m, scaled by the performer's bones. Tubes overlap where
they meet, so the surface has no holes; what lies inside is never seen.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tasks.studio.dancing.limbs import unit
from tasks.studio.stage.robes import hang_skirt, hang_sleeve
from tasks.studio.stage.tubes import Color, Track, Tube, join_tubes, shape_stations, tube_along

Clothes = Literal["fitting", "kimono", "furisode"]
"""What a performer wears."""

SEGMENTS = (
    *("Head", "Body", "Waist", "RUpperArm", "RForeArm", "LUpperArm", "LForeArm"),
    *("RUpperLeg", "RLowerLeg", "LUpperLeg", "LLowerLeg"),
)
"""Names of the labels 1 to 11 of a segment."""

SKIN: Color = (222, 176, 142)  # of face and hands, RGB. By eye.
HAIR: Color = (32, 26, 28)  # of the head, RGB. By eye.
CHECKS = {
    "Body": ((176, 38, 48), (226, 98, 92)),
    "Waist": ((36, 58, 150), (92, 122, 206)),
    "RUpperArm": ((214, 120, 28), (246, 184, 92)),
    "RForeArm": ((120, 44, 132), (178, 108, 190)),
    "LUpperArm": ((236, 202, 60), (190, 148, 22)),
    "LForeArm": ((52, 142, 190), (132, 204, 236)),
    "RUpperLeg": ((74, 62, 128), (120, 108, 180)),
    "RLowerLeg": ((142, 84, 56), (190, 134, 104)),
    "LUpperLeg": ((58, 60, 72), (116, 116, 130)),
    "LLowerLeg": ((190, 70, 120), (230, 132, 170)),
}
"""The two colors of each segment's close-fitting clothes, RGB before light falls on them."""

ROBE = ((112, 40, 128), (158, 72, 166))  # two colors of a kimono, RGB. By eye.
# Two colors of each sleeve of a kimono, RGB. By eye.
SLEEVES = {"R": ((132, 36, 96), (184, 82, 142)), "L": ((84, 52, 150), (130, 98, 196))}
SASH = ((196, 158, 44), (232, 204, 104))  # two colors of the sash of a kimono, RGB. By eye.
SHOES = ((40, 36, 40), (70, 64, 70))  # two colors of shoes, RGB. By eye.
SOCKS = ((236, 232, 228), (214, 208, 206))  # two colors of socks, RGB. By eye.

_ADULT_M = 0.961 * 1.70  # ankle to top of the head along the bones of an adult of 1.70 m
# Rings, as of `_HEAD`. An adult\'s, by eye.
_ARM = ((0.0, 0.052, 0.052), (0.45, 0.047, 0.047), (1.0, 0.039, 0.039))
# Rings, as of `_HEAD`. An adult\'s, by eye.
_FOREARM = ((0.0, 0.040, 0.040), (0.25, 0.043, 0.041), (1.0, 0.028, 0.024))
# Rings, as of `_HEAD`. An adult\'s, by eye.
_HAND = ((0.0, 0.026, 0.022), (0.35, 0.041, 0.018), (0.8, 0.034, 0.013), (1.0, 0.014, 0.009))
# Rings, as of `_HEAD`. An adult\'s, by eye.
_THIGH = ((0.0, 0.088, 0.090), (0.4, 0.077, 0.079), (1.0, 0.053, 0.055))
# Rings, as of `_HEAD`. An adult\'s, by eye.
_SHANK = ((0.0, 0.053, 0.055), (0.3, 0.057, 0.058), (0.8, 0.038, 0.040), (1.0, 0.037, 0.041))
# Rings, as of `_HEAD`. An adult's, by eye.
_FOOT = (
    *((0.0, 0.018, 0.022), (0.05, 0.031, 0.035), (0.3, 0.036, 0.045)),
    *((0.7, 0.046, 0.030), (0.9, 0.040, 0.019), (1.0, 0.016, 0.010)),
)
# Rings, as of `_HEAD`. An adult's, by eye.
_WAIST = ((0.0, 0.163, 0.112), (0.5, 0.155, 0.110), (1.0, 0.134, 0.096))
# Rings, as of `_HEAD`. An adult's, by eye.
_CHEST = (
    *((0.0, 0.134, 0.096), (0.4, 0.150, 0.106), (0.7, 0.166, 0.112), (0.88, 0.170, 0.090)),
    *((0.96, 0.110, 0.074), (1.0, 0.070, 0.062)),
)
_HEAD = (
    *((0.0, 0.058, 0.058), (0.30, 0.052, 0.054), (0.38, 0.048, 0.072), (0.50, 0.066, 0.090)),
    *((0.70, 0.078, 0.100), (0.84, 0.073, 0.092), (0.94, 0.050, 0.064), (1.0, 0.016, 0.020)),
)
"""Rings: share of the bone's length, half width and half depth in metres."""


@dataclass(frozen=True)
class BodySurface:
    """A performer's surface, frame by frame."""

    vertex: NDArray[np.float32]
    """(time, vertex, 3), metres."""
    triangle: NDArray[np.int32]
    """(triangle, 3) vertices, counter-clockwise seen from outside."""
    color: NDArray[np.uint8]
    """(triangle, 3) RGB before light falls on it."""
    segment: NDArray[np.uint8]
    """(vertex,) label 1 to 11 of the segment that carries the vertex."""
    is_cloth: NDArray[np.bool_]
    """(vertex,) True for skirt and sleeves, which hang off the body."""


def pose_surface(joints: Mapping[str, Track], *, clothes: Clothes = "fitting") -> BodySurface:
    """Return the surface of a clothed performer.

    Parameters
    ----------
    joints : mapping of (time, 3) float64
        Metres; the 21 joints by the names of the archive, none missing.
    clothes : str
        "fitting": close to the body, each segment checked in two colors of its own; "kimono":
        with a skirt, a sash, and sleeves that hang from the forearms; "furisode": both sleeves
        have the robe's color, cuffs that of the sash, and hang from the wrists.

    Raises
    ------
    ValueError
        If a joint is missing or not finite in some frame, or the clothes are unknown.
    """
    if clothes not in get_args(Clothes):
        raise ValueError(
            f"there are no clothes {clothes!r}; choose 'fitting', 'kimono' or 'furisode'"
        )
    missing = [name for name in _needed() if not np.isfinite(joints.get(name, np.nan)).all()]
    if missing:
        raise ValueError(
            f"a body cannot be posed without {', '.join(missing)}; give a track whose 21 joints "
            "are finite in every frame"
        )
    joints = {name: np.asarray(joints[name], np.float64) for name in _needed()}
    axes, scale = _trunk_axes(joints), _measure(joints)
    robed, long = clothes != "fitting", clothes == "furisode"
    tubes = [*_trunk(joints, axes, scale, robed=robed), _head(joints, axes, scale)]
    for side, outward in (("R", -1.0), ("L", 1.0)):
        tubes += _arm(joints, axes, scale, side, outward, clothes)
        tubes += _leg(joints, axes, scale, side, robed=robed)
    body = join_tubes(tubes)
    cloth = []
    if robed:
        cloth.append(hang_skirt(joints, axes.hip_left, scale, ROBE))
        for side in "RL":
            colors = ROBE if long else SLEEVES[side]
            cloth.append(hang_sleeve(joints, axes.front, scale, side, colors, from_wrist=long))
    whole = join_tubes([*tubes, *cloth])
    vertices = whole.vertex.shape[1]
    return BodySurface(
        whole.vertex.astype(np.float32),
        whole.triangle,
        whole.color,
        whole.segment,
        np.arange(vertices) >= body.vertex.shape[1],
    )


def _needed() -> list[str]:
    """Return the names of the 21 joints."""
    limbs = ("Shoulder", "Elbow", "Wrist", "Fin", "Hip", "Knee", "Ankle", "Heel", "Foot")
    return ["Head", "Neck", "Waist", *(side + limb for side in "RL" for limb in limbs)]


def _measure(joints: Mapping[str, Track]) -> float:
    """Return the performer's size relative to an adult of 1.70 m."""

    def length(a: Track, b: Track) -> float:
        return float(np.median(np.linalg.norm(a - b, axis=-1)))

    hips = (joints["RHip"] + joints["LHip"]) / 2.0
    legs = [
        length(joints[f"{side}{a}"], joints[f"{side}{b}"])
        for side in "RL"
        for a, b in (("Hip", "Knee"), ("Knee", "Ankle"))
    ]
    spine = length(joints["Head"], joints["Neck"]) + length(joints["Neck"], hips)
    return (spine + sum(legs) / 2.0) / _ADULT_M


@dataclass(frozen=True)
class _Axes:
    """Unit vectors (time, 3) of pelvis and chest."""

    hips: Track
    hip_left: Track
    hip_front: Track
    left: Track
    front: Track
    up: Track


def _trunk_axes(joints: Mapping[str, Track]) -> _Axes:
    """Return the frames of pelvis and chest."""
    hips = (joints["RHip"] + joints["LHip"]) / 2.0
    loins, up = unit(joints["Waist"] - hips), unit(joints["Neck"] - joints["Waist"])
    hip_left = _across(joints["LHip"] - joints["RHip"], loins)
    left = _across(joints["LShoulder"] - joints["RShoulder"], up)
    return _Axes(hips, hip_left, np.cross(hip_left, loins), left, np.cross(left, up), up)


def _across(vector: Track, axis: Track) -> Track:
    """Return the direction of a vector at right angles to an axis."""
    return unit(vector - (vector * axis).sum(axis=-1, keepdims=True) * axis)


def _carry(front: Track, before: Track, after: Track) -> Track:
    """Turn a direction at right angles to one bone by the shortest way to the next bone."""
    along = (front * after).sum(axis=-1, keepdims=True)
    bend = 1.0 + (before * after).sum(axis=-1, keepdims=True)
    return _across(front - along / np.maximum(bend, 1e-3) * (before + after), after)


def _trunk(joints: Mapping[str, Track], axes: _Axes, scale: float, *, robed: bool) -> list[Tube]:
    """Return waist and chest."""
    middle = joints["Waist"]
    waist = tube_along(
        axes.hips,
        middle,
        axes.hip_front,
        shape_stations(_WAIST, 8, scale, round_start=True),
        SEGMENTS.index("Waist") + 1,
        ROBE if robed else CHECKS["Waist"],
        around=28,
    )
    stations = shape_stations(_CHEST, 13, scale, round_end=True)
    label, around = SEGMENTS.index("Body") + 1, 28
    chest = tube_along(
        middle,
        joints["Neck"],
        axes.front,
        stations,
        label,
        ROBE if robed else CHECKS["Body"],
        around=around,
    )
    if robed:
        sash = 5 * 2 * around
        in_sash_colors = tube_along(
            middle, joints["Neck"], axes.front, stations, label, SASH, around=around
        )
        chest.color[:sash] = in_sash_colors.color[:sash]
    return [waist, chest]


def _head(joints: Mapping[str, Track], axes: _Axes, scale: float) -> Tube:
    """Return neck and head: skin in front, hair behind, dark eyes."""
    along = unit(joints["Head"] - joints["Neck"])
    front = _carry(axes.front, axes.up, along)
    stations = shape_stations(_HEAD, 16, scale)
    head = tube_along(joints["Neck"], joints["Head"], front, stations, 1, (SKIN, SKIN), around=24)
    head = replace(head, vertex=head.vertex + _nose(head, front, scale))
    center = head.vertex[0, head.triangle].mean(axis=1) - joints["Neck"][0]
    height = center @ along[0] / np.linalg.norm(joints["Head"][0] - joints["Neck"][0])
    ahead, aside = center @ front[0] / scale, center @ np.cross(along, front)[0] / scale
    face = (ahead > 0.025) & (height < 0.8)
    head.color[(height > 0.36) & ~face] = HAIR
    eyes = (abs(height - 0.65) < 0.03) & (ahead > 0.05) & (abs(abs(aside) - 0.032) < 0.014)
    head.color[eyes] = HAIR
    return head


def _nose(head: Tube, front: Track, scale: float) -> Track:
    """Return how far each vertex of a head is drawn out to make the nose."""
    drawn = np.zeros(head.vertex.shape[1])
    ring = drawn[: 16 * 24].reshape(16, 24)
    ring[8, 6], ring[9, 6] = 0.028 * scale, 0.014 * scale
    return drawn[:, None] * front[:, None]


def _arm(
    joints: Mapping[str, Track],
    axes: _Axes,
    scale: float,
    side: str,
    outward: float,
    clothes: Clothes,
) -> list[Tube]:
    """Return upper arm, forearm and hand; the outer third of a furisode's forearm is the cuff."""
    shoulder, elbow, wrist, tip = (
        joints[side + name] for name in ("Shoulder", "Elbow", "Wrist", "Fin")
    )
    upper, lower, hand = unit(elbow - shoulder), unit(wrist - elbow), unit(tip - wrist)
    front = _carry(axes.front, outward * axes.left, upper)
    front_lower = _carry(front, upper, lower)
    palm = -np.cross(_carry(front_lower, lower, hand), hand)
    label = SEGMENTS.index(f"{side}UpperArm") + 1
    colors, sleeve = {
        "fitting": (CHECKS[f"{side}UpperArm"], CHECKS[f"{side}ForeArm"]),
        "kimono": (SLEEVES[side], SLEEVES[side]),
        "furisode": (ROBE, ROBE),
    }[clothes]
    rounded = {"round_start": True, "round_end": True}
    arm, forearm = (shape_stations(keys, 8, scale, **rounded) for keys in (_ARM, _FOREARM))
    around = 16
    covered = tube_along(elbow, wrist, front_lower, forearm, label + 1, sleeve, around=around)
    if clothes == "furisode":
        faces = 2 * around * (len(forearm) - 1)
        covered.color[2 * faces // 3 : faces] = np.array(SASH[0])
    return [
        tube_along(shoulder, elbow, front, arm, label, colors, around=around),
        covered,
        tube_along(wrist, tip, palm, shape_stations(_HAND, 7, scale), label + 1, (SKIN, SKIN)),
    ]


def _leg(
    joints: Mapping[str, Track], axes: _Axes, scale: float, side: str, *, robed: bool
) -> list[Tube]:
    """Return upper leg, lower leg and foot; the sole goes through heel and toe."""
    hip, knee, ankle, heel, toe = (
        joints[side + name] for name in ("Hip", "Knee", "Ankle", "Heel", "Foot")
    )
    upper, lower = unit(knee - hip), unit(ankle - knee)
    down = np.cross(axes.hip_left, axes.hip_front)
    front = _carry(axes.hip_front, down, upper)
    label = SEGMENTS.index(f"{side}UpperLeg") + 1
    above = ROBE if robed else CHECKS[f"{side}UpperLeg"]
    below = ROBE if robed else CHECKS[f"{side}LowerLeg"]
    thigh, shank = (
        shape_stations(keys, 11, scale, round_start=True, round_end=True)
        for keys in (_THIGH, _SHANK)
    )
    return [
        tube_along(hip, knee, front, thigh, label, above, around=18),
        tube_along(knee, ankle, _carry(front, upper, lower), shank, label + 1, below, around=16),
        tube_along(
            heel,
            toe,
            _across(ankle - heel, unit(toe - heel)),
            shape_stations(_FOOT, 10, scale),
            label + 1,
            SOCKS if robed else SHOES,
            on_front=True,
        ),
    ]
