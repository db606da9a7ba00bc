"""Put a limb where its end was seen, and choose between two fits of a take limb by limb.

A fit only moves to better poses nearby. So an arm that vanished in the trunk and comes out
elsewhere stays lost, and an elbow on the wrong side of the line from shoulder to hand stays there.
Therefore a limb with little support is tried where its end was seen, with its middle joint at
several places on the circle about that line. The caller keeps the pose that explains the frame
best.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, Floats, Pose, place_bones, rotation_of

_LEAST_FOLD = 1.05
"""How near the end of a limb comes to its beginning at least [differences of its bones' lengths].
Nearer, its middle joint has no place. The 5 % were chosen by eye; not measured."""

_MOST_STRETCH = 0.99
"""How far the end of a limb goes from its beginning at most [sums of its bones' lengths]. Farther,
its middle joint has no place. The 1 % was chosen by eye; not measured."""

_NO_SIDE_M = 1e-6
"""A middle joint nearer to the line of its limb shows no side. It is far less than a voxel."""

_ALONG_DEPTH = 0.9
"""Cosine above which a direction goes along z too nearly to be crossed with it [cosine]. Any number
between 0.58 and 1 leaves an axis that can be crossed."""

_NOT_ZERO = 1e-9
"""What divides at least, where a divisor may be 0 [number]."""


@dataclass(frozen=True)
class Limb:
    """An arm or a leg: a chain of three bones."""

    upper: int
    lower: int
    end: int

    @property
    def bones(self) -> list[int]:
        """The bones, from the trunk outwards."""
        return [self.upper, self.lower, self.end]


LIMBS = tuple(
    Limb(*(BONES.index(side + part) for part in parts))
    for parts in (("UpperArm", "ForeArm", "Hand"), ("UpperLeg", "LowerLeg", "Foot"))
    for side in "RL"
)
"""Right arm, left arm, right leg, left leg."""


def reach_for(
    pose: Pose, origin: Floats, limb: Limb, offset: Floats, place: Floats, swivels: int
) -> list[Pose]:
    """Return poses in which a limb ends at a place, each with its middle joint at another place.

    Parameters
    ----------
    pose
        All other bones stay as they are here.
    origin : (bone, 3) float64
        Proximal joints of the initial pose, m.
    offset : (3,) float64
        The point of the limb's last bone that shall come to the place, m from the bone's joint.
    place : (3,) float64
        The place, m. A limb that is too short points to it.
    swivels
        How many places of the middle joint are tried.
    """
    joints = place_bones(pose, origin)
    start = joints[limb.upper]
    upper = float(np.linalg.norm(origin[limb.lower] - origin[limb.upper]))
    lower = float(np.linalg.norm(origin[limb.end] + offset - origin[limb.lower]))
    line = place - start
    shortest, longest = abs(upper - lower) * _LEAST_FOLD, (upper + lower) * _MOST_STRETCH
    length = float(np.clip(np.linalg.norm(line), shortest, longest))
    along = line / max(float(np.linalg.norm(line)), _NOT_ZERO)
    end = start + length * along
    share = (upper**2 - lower**2 + length**2) / (2 * length)
    radius = np.sqrt(max(upper**2 - share**2, 0.0))
    side = joints[limb.lower] - start
    side = side - (side @ along) * along
    if np.linalg.norm(side) < _NO_SIDE_M:
        side = _across(along)
    side /= np.linalg.norm(side)
    found = []
    for swivel in range(swivels):
        around = rotation_of(along * (2 * np.pi * swivel / swivels)) @ side
        middle = start + share * along + radius * around
        rotation = pose.rotation.copy()
        _point(rotation, limb.upper, origin[limb.lower] - origin[limb.upper], middle - start)
        _point(rotation, limb.lower, origin[limb.end] + offset - origin[limb.lower], end - middle)
        rotation[limb.end] = rotation[limb.lower]
        found.append(Pose(pose.root, rotation))
    return found


def choose_fits(
    costs: Floats, places: Sequence[Floats] | Floats, scale_m: float
) -> NDArray[np.int64]:
    """Return (time,) the fit to take in each frame, at the least cost over all frames (Viterbi).

    Parameters
    ----------
    costs : (fit, time) float64
        What it costs to take a fit in a frame.
    places : (fit, time, point, 3) float64
        Where each fit has the points, m. To change the fit costs as much as the points move more
        than they do within a fit, in the mean.
    scale_m
        How far points move at the cost of 1.
    """
    at = np.asarray(places)
    fits, frames = costs.shape
    total = costs[:, 0].copy()
    back = np.zeros((frames, fits), np.int64)
    for t in range(1, frames):
        step = np.linalg.norm(at[None, :, t] - at[:, None, t - 1], axis=-1).mean(-1)
        own = np.diagonal(step)
        change = np.maximum(step - own.min(), 0.0) / scale_m
        np.fill_diagonal(change, np.minimum(np.diagonal(change), 1.0))
        ways = total[:, None] + change
        back[t] = ways.argmin(0)
        total = ways.min(0) + costs[:, t]
    chosen = np.empty(frames, np.int64)
    chosen[-1] = total.argmin()
    for t in range(frames - 1, 0, -1):
        chosen[t - 1] = back[t, chosen[t]]
    return chosen


def _point(rotation: Floats, bone: int, rest: Floats, direction: Floats) -> None:
    """Turn a bone by the smallest angle that makes `rest` point in a direction."""
    now = rotation[bone] @ rest
    now, goal = (
        now / np.linalg.norm(now),
        direction / max(float(np.linalg.norm(direction)), _NOT_ZERO),
    )
    axis = np.cross(now, goal)
    sine, cosine = float(np.linalg.norm(axis)), float(now @ goal)
    if sine < _NOT_ZERO:
        axis = _across(now)
        if cosine > 0:
            return
    angle = np.arctan2(sine, cosine)
    rotation[bone] = rotation_of(axis / np.linalg.norm(axis) * angle) @ rotation[bone]


def _across(direction: Floats) -> Floats:
    """Return (3,) a vector at right angles to a direction."""
    other = (0.0, 0.0, 1.0) if abs(direction[2]) < _ALONG_DEPTH else (1.0, 0.0, 0.0)
    return np.cross(direction, other)
