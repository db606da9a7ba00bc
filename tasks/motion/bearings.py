"""Units, the axis that points up, and the floor, from the body where the file is silent."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from storage.formats.motion.motion_file import MotionFile
from storage.schema import JOINTS
from tasks.motion.marker_choice import Choice, place_joints
from tasks.motion.stature import measure_stature

Positions = NDArray[np.float64]

UNITS = (
    (1.0, "meters"),
    (0.01, "centimeters"),
    (0.001, "millimeters"),
    (0.0254, "inches"),
    (0.0254 / 0.45, "CMU units of 1/0.45 inch"),
)
"""Metres in one unit, and its name, for files that do not say theirs."""

TYPICAL_STATURE_M = 1.65
"""The stature that units are told by where no other is given. Between usual women and men."""
LEAST_STATURE_M = 0.5
"""The least stature that is human. A newborn child is as long; no dancer is smaller."""
GREATEST_STATURE_M = 2.6
"""The greatest stature that is human. Chosen well above any performer; not measured."""
LIKELY_STATURE_M = (0.8, 2.1)
"""The statures that are likely where the unit is inferred: from a child that begins to walk to a
very tall man. A unit outside is taken only where none is inside."""
SMALLEST_GIVEN_M, LARGEST_GIVEN_M = 0.1, 10.0
"""The statures that a given scale may make. Dolls and giants may be meant; what is beyond is a
slip."""
_LEG_OF_STATURE = 0.5
"""A leg from hip to ankle over the stature [share]. Drillis and Contini (1966) give 0.491."""
_NEAR_FLOOR_M = 0.25
"""How far the lowest point of a body may be from the floor's zero. Chosen: a marker is a few
centimetres above it, and what rolls on the floor of a generated dance goes below it."""
_LYING_M = 0.9
"""Lower than this the highest point of a lying body is, in the median. Chosen: a child of 0.9 m
stands as high, a grown body that lies or crouches stays lower."""
_FRAMES_LOOKED_AT = 400  # enough for a median of the body's size, and quick

AXES: dict[str, Positions] = {
    "y": np.eye(3),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "-z": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]]),
    "-x": np.array([[0, 1.0, 0], [-1, 0, 0], [0, 0, 1]]),
}
"""The rotation that brings each axis up to +Y; never a mirror."""


def find_unit(
    raw: Positions,
    choice: Choice,
    motion: MotionFile,
    *,
    scale: float | None = None,
    stature_m: float | None = None,
) -> tuple[float, list[str], list[str]]:
    """Return the metres in one unit, notes, and faults (a clause each).

    The unit is the one given (`scale`), else the one that the file states, else that of
    `UNITS` which brings the body nearest to `stature_m`, in log ratio. Where no stature is given,
    the units that make a body of a likely stature go before the others, the nearest to 1.65 m is
    taken, and what the body would be in the others of them is said.

    Parameters
    ----------
    raw : (time, marker, 3) float64
        In the file's unit.
    """
    few = raw[:: max(1, len(raw) // _FRAMES_LOOKED_AT)]
    if scale is not None:
        size = _measure_body(place_joints(few * scale, choice))
        return _given_scale(scale, size)
    sizes = {unit_m: _measure_body(place_joints(few * unit_m, choice)) for unit_m, _ in UNITS}
    low, high = LIKELY_STATURE_M
    seen = [unit_m for unit_m, size in sizes.items() if size > 0]
    likely = [unit_m for unit_m in seen if low <= sizes[unit_m] <= high]
    wanted = stature_m or TYPICAL_STATURE_M
    fits = {unit_m: abs(math.log(sizes[unit_m] / wanted)) for unit_m in seen}
    candidates = seen if stature_m else likely or seen
    nearest = min(candidates, key=lambda unit_m: fits[unit_m], default=None)
    unit_m = motion.unit_m or nearest
    if unit_m is None:
        fault = "it does not say its unit, and no leg shows the size of the body"
        return math.nan, [], [f"{fault}: give the metres in one unit with --scale"]
    size = _measure_body(place_joints(few * unit_m, choice))
    names = dict(UNITS)
    if not math.isnan(size) and not LEAST_STATURE_M <= size <= GREATEST_STATURE_M:
        other = f"; in {names[nearest]} it would be {sizes[nearest]:.3g} m" if nearest else ""
        fault = (
            f"with {unit_m:.4g} m in one unit the body is {size:.3g} m tall, where "
            f"{LEAST_STATURE_M} to {GREATEST_STATURE_M} m is human"
            f"{'' if nearest == unit_m else other}: give the metres in one unit with --scale"
        )
        return unit_m, [], [fault]
    if motion.unit_m is not None:
        return unit_m, [], []
    others = [
        f"in {names[other]} it would be {sizes[other]:.2f} m, which --scale {other:.4g} says"
        for other in likely
        if other != unit_m and stature_m is None
    ]
    said = f"The unit was taken to be {names[unit_m]} ({unit_m:.4g} m): so the body is {size:.2f} m"
    return unit_m, [f"{'; '.join([f'{said} tall', *others])}."], []


def _given_scale(scale: float, size: float) -> tuple[float, list[str], list[str]]:
    """Return a given unit, a note, and a fault where the body cannot be meant."""
    if math.isnan(size) or LEAST_STATURE_M <= size <= GREATEST_STATURE_M:
        return scale, [f"One unit is {scale:g} m, as given."], []
    if SMALLEST_GIVEN_M <= size <= LARGEST_GIVEN_M:
        return scale, [f"One unit is {scale:g} m, as given. So the body is {size:.3g} m tall."], []
    fault = (
        f"with the given {scale:g} m in one unit the body is {size:.3g} m tall: give another "
        "--scale, or none"
    )
    return scale, [], [fault]


def _measure_body(position: Positions) -> float:
    """Return the body's stature, or twice its leg where head or neck are missing; else NaN."""
    stature = measure_stature(position, JOINTS)
    if not math.isnan(stature):
        return stature
    legs = [
        np.linalg.norm(position[:, a] - position[:, b], axis=1)
        + np.linalg.norm(position[:, b] - position[:, c], axis=1)
        for a, b, c in (
            [JOINTS.index(side + name) for name in ("Hip", "Knee", "Ankle")] for side in "RL"
        )
    ]
    leg = np.concatenate(legs)
    leg = leg[np.isfinite(leg)]
    return float(np.median(leg)) / _LEG_OF_STATURE if leg.size else math.nan


def find_up(
    position: Positions,
    motion: MotionFile,
    *,
    up: str | None = None,
    rest: Positions | None = None,
) -> tuple[str, list[str]]:
    """Return the axis that points up, and notes: given, stated, or along which the body stands.

    What a C3D file says of its screen is believed. A BVH file's Y is a custom rather than a
    statement: a body that clearly stands along another axis, in the median over the take, is
    believed, if its skeleton stands along that axis too, or its feet are at the zero of that axis,
    or it does not lie on the floor of Y. So a body that lies is not stood up. Where a file says
    nothing, the body stands, unless its feet are not at zero then and it lies on the floor along
    Y or Z. Both readings are said.

    Parameters
    ----------
    position : (time, 21, 3) float64
        The joints, in metres, in the file's axes.
    rest : (1, 21, 3) float64, optional
        The joints of a BVH file while nothing is turned.
    """
    if up is not None:
        return up, [f"{up.upper()} points up, as given."]
    body = _stand_along(position)
    if body is None:
        if motion.up is not None:
            return motion.up, []
        return "y", ["Y was taken to point up: no head and no feet show it."]
    inferred, clear = _axis_along(body)
    if motion.up is None:
        return _infer_up(position, inferred, clear=clear, c3d=motion.source == "c3d")
    if inferred == motion.up or not clear:
        return motion.up, []
    if motion.source == "bvh":  # that Y is up is only a custom there
        return _doubt_custom(position, inferred, rest)
    return motion.up, [
        f"{motion.up.upper()} points up as the file says, but the body stands along "
        f"{inferred.upper()}: --up overrules it."
    ]


def _axis_along(body: Positions) -> tuple[str, bool]:
    """Return the axis nearest to a direction, and whether it is much nearer than the others."""
    axis = int(np.argmax(np.abs(body)))
    others = np.delete(np.abs(body), axis).max()
    return ("-" if body[axis] < 0 else "") + "xyz"[axis], bool(abs(body[axis]) > 2 * others)


def _infer_up(
    position: Positions, inferred: str, *, clear: bool, c3d: bool
) -> tuple[str, list[str]]:
    """Return the axis that points up in a file that says nothing, and a note."""
    floors = [axis for axis in ("zy" if c3d else "yz") if _lies_on_floor(position, axis)]
    if clear and floors and inferred not in floors and not _stands_on_floor(position, inferred):
        return floors[0], [
            f"{floors[0].upper()} was taken to point up: so the body lies on the floor. If it "
            f"stands, {inferred.upper()} points up, which --up {inferred} says."
        ]
    doubt = "" if clear else ", though not by much: --up overrules it"
    return inferred, [f"{inferred.upper()} was taken to point up: the body stands along it{doubt}."]


def _doubt_custom(
    position: Positions, inferred: str, rest: Positions | None
) -> tuple[str, list[str]]:
    """Return the axis that points up in a BVH file whose body stands along another than Y."""
    skeleton = None if rest is None else _stand_along(rest)
    standing, clear = (None, False) if skeleton is None else _axis_along(skeleton)
    agrees = clear and standing == inferred
    usual = _lies_on_floor(position, "y") or (clear and standing == "y")
    if agrees or not usual or _stands_on_floor(position, inferred):
        return inferred, [
            f"{inferred.upper()} was taken to point up, not Y as is usual: the body stands "
            "along it; --up overrules it. If the body lies, Y points up, which --up y says."
        ]
    return "y", [
        f"Y was taken to point up, as is usual: so the body lies along {inferred.upper()}. If it "
        f"stands, {inferred.upper()} points up, which --up {inferred} says."
    ]


def _stands_on_floor(position: Positions, axis: str) -> bool:
    """Tell whether the lowest point of a body that stands along an axis is at its zero."""
    low, _ = _heights(position, axis)
    return abs(low) <= _NEAR_FLOOR_M


def _lies_on_floor(position: Positions, axis: str) -> bool:
    """Tell whether a body is low, near the zero of an axis, and hardly ever stands along it."""
    low, high = _heights(position, axis)
    return abs(low) <= _NEAR_FLOOR_M and high <= _LYING_M


def _heights(position: Positions, axis: str) -> tuple[float, float]:
    """Return the lowest point of a take along an axis, and the median of its highest ones."""
    heights = position[..., "xyz".index(axis[-1])] * (-1.0 if axis.startswith("-") else 1.0)
    there = ~np.isnan(heights)
    seen = there.any(axis=1)
    low = np.where(there, heights, np.inf).min(axis=1)[seen]
    high = np.where(there, heights, -np.inf).max(axis=1)[seen]
    return float(np.percentile(low, 1)), float(np.median(high))


def _stand_along(position: Positions) -> Positions | None:
    """Return the median way from the feet to the head, or the nearest joints to them."""
    high = _first_there(position, (("Head",), ("Neck",), ("RShoulder", "LShoulder"), ("Waist",)))
    low = _first_there(position, (("RAnkle", "LAnkle"), ("RFoot", "LFoot"), ("RKnee", "LKnee")))
    if high is None:
        high = _first_there(position, (("RHip", "LHip"),))
    if high is None or low is None:
        return None
    way = high - low
    way = way[np.isfinite(way).all(axis=1)]
    return np.median(way, axis=0) if len(way) else None


def _first_there(position: Positions, groups: tuple[tuple[str, ...], ...]) -> Positions | None:
    for group in groups:
        middle = position[:, [JOINTS.index(joint) for joint in group]].mean(axis=1)
        if np.isfinite(middle).any():
            return middle
    return None


def find_floor(position: Positions, motion: MotionFile, choice: Choice) -> tuple[float, list[str]]:
    """Return by how many metres to lift the track onto the floor at y = 0, and notes.

    The feet's lowest point is the 1st percentile over time of the lowest joint of the feet,
    of the ankles where heels and toes are missing. Bones end at the sole, a marker's center is
    some 4 cm above it, an ankle 8 cm; what is within about 5 cm of that stays where it is.

    Parameters
    ----------
    position : (time, 21, 3) float64
        The joints, in metres, Y up.
    """
    bones = motion.source == "bvh"
    expected, least, most = (0.0, -0.05, 0.05) if bones else (0.04, -0.05, 0.09)
    if choice.marker_set == "shosa":
        expected = 0.0
    lowest = _lowest(position, ("RHeel", "RFoot", "LHeel", "LFoot"))
    if lowest is None:
        lowest = _lowest(position, ("RAnkle", "LAnkle"))
        expected, least, most = 0.08, 0.0, 0.13
    if lowest is None:
        return 0.0, ["The floor is where the file has its zero: the feet are missing."]
    if least <= lowest <= most:
        return 0.0, []
    shift = expected - lowest
    way = "lifted" if shift > 0 else "lowered"
    return shift, [
        f"The track was {way} by {abs(shift) * 100:.1f} cm: the feet's lowest point was at "
        f"{lowest * 100:.1f} cm and is taken to be {expected * 100:.0f} cm above the floor."
    ]


def _lowest(position: Positions, joints: tuple[str, ...]) -> float | None:
    heights = position[:, [JOINTS.index(joint) for joint in joints], 1]
    lowest = np.where(np.isnan(heights), np.inf, heights).min(axis=1)
    lowest = lowest[np.isfinite(lowest)]
    return float(np.percentile(lowest, 1)) if len(lowest) else None


def side_notes(position: Positions) -> Iterator[str]:
    """Warn where the toes point behind the body, as exchanged or mirrored sides make them."""
    joint = {name: position[:, i] for i, name in enumerate(JOINTS)}
    forward = np.cross([0.0, 1.0, 0.0], joint["RHip"] - joint["LHip"])
    toes = [
        joint[f"{side}Foot"] - joint[f"{side}{back}"] for side in "RL" for back in ("Heel", "Ankle")
    ]
    ahead = np.concatenate([np.sum(forward * toe, axis=1) for toe in toes])
    ahead = ahead[np.isfinite(ahead)]
    if len(ahead) and np.mean(ahead < 0) > 0.75:
        yield (
            "Left and right look exchanged: the toes point behind the body, as in a file with "
            "swapped names or mirrored axes."
        )
