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
_LEG_OF_STATURE = 0.5
"""A leg from hip to ankle over the stature [share]. Drillis and Contini (1966) give 0.491."""
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
    `UNITS` which brings the body nearest to `stature_m` (by default 1.65 m), in log ratio.

    Parameters
    ----------
    raw : (time, marker, 3) float64
        In the file's unit.
    """
    if scale is not None:
        return scale, [f"One unit is {scale:g} m, as given."], []
    few = raw[:: max(1, len(raw) // _FRAMES_LOOKED_AT)]
    sizes = {unit_m: _measure_body(place_joints(few * unit_m, choice)) for unit_m, _ in UNITS}
    wanted = stature_m or TYPICAL_STATURE_M
    fits = {unit_m: abs(math.log(size / wanted)) for unit_m, size in sizes.items() if size > 0}
    nearest = min(fits, key=lambda unit_m: fits[unit_m], default=None)
    unit_m = motion.unit_m or nearest
    if unit_m is None:
        fault = "it does not say its unit, and no leg shows the size of the body"
        return math.nan, [], [f"{fault}: give the metres in one unit with --scale"]
    size = _measure_body(place_joints(few * unit_m, choice))
    name = dict(UNITS).get(nearest or 0.0, "")
    if not math.isnan(size) and not LEAST_STATURE_M <= size <= GREATEST_STATURE_M:
        other = f"; in {name} it would be {sizes[nearest]:.3g} m" if nearest else ""
        other = "" if nearest == unit_m else other
        return (
            unit_m,
            [],
            [
                f"with {unit_m:.4g} m in one unit the body is {size:.3g} m tall, where "
                f"{LEAST_STATURE_M} to {GREATEST_STATURE_M} m is human{other}: give the metres "
                "in one unit with --scale"
            ],
        )
    if motion.unit_m is not None:
        return unit_m, [], []
    note = f"The unit was taken to be {name} ({unit_m:.4g} m): so the body is {size:.2f} m tall."
    return unit_m, [note], []


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
    position: Positions, motion: MotionFile, *, up: str | None = None
) -> tuple[str, list[str]]:
    """Return the axis that points up, and notes: given, stated, or along which the body stands.

    A BVH file's Y is a custom rather than a statement: there a body that clearly stands along
    another axis, in the median over the take, is believed.

    Parameters
    ----------
    position : (time, 21, 3) float64
        The joints, in the file's axes.
    """
    if up is not None:
        return up, [f"{up.upper()} points up, as given."]
    body = _stand_along(position)
    if body is None:
        if motion.up is not None:
            return motion.up, []
        return "y", ["Y was taken to point up: no head and no feet show it."]
    axis = int(np.argmax(np.abs(body)))
    inferred = ("-" if body[axis] < 0 else "") + "xyz"[axis]
    others = np.delete(np.abs(body), axis).max()
    clear = abs(body[axis]) > 2 * others
    if motion.up is None:
        doubt = "" if clear else ", though not by much: --up overrules it"
        return inferred, [
            f"{inferred.upper()} was taken to point up: the body stands along it{doubt}."
        ]
    if inferred == motion.up or not clear:
        return motion.up, []
    if motion.source == "bvh":  # that Y is up is only a custom there
        return inferred, [
            f"{inferred.upper()} was taken to point up, not Y as is usual: the body stands "
            "along it; --up overrules it."
        ]
    return motion.up, [
        f"{motion.up.upper()} points up as the file says, but the body stands along "
        f"{inferred.upper()}: --up overrules it."
    ]


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
