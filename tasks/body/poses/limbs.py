"""Find a limb again that a fit has lost, and choose between two fits of a take limb by limb.

A soft assignment only climbs: an arm that vanished in the trunk and comes out elsewhere, or an
elbow that took the wrong side of the line from shoulder to hand, stays wrong. So a limb with
little support is put, as a hypothesis, where its end was seen, with its middle joint at several
places on the circle about that line; whichever explains the frame best stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, Floats, Pose, place_bones, rotation_of


@dataclass(frozen=True)
class Limb:
    """A chain of three bones: upper, lower, end."""

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
    """Return poses whose limb ends at a place, its middle joint all around.

    Parameters
    ----------
    pose
        Everything else stays as it is here.
    origin : (bone, 3) float64
        Proximal joints of the initial pose, m.
    offset : (3,) float64
        The point of the limb's end bone that shall come to the place, m from its joint.
    place : (3,) float64
        Where, m; a limb too short points there.
    swivels
        How many places of the middle joint are tried.
    """
    joints = place_bones(pose, origin)
    start = joints[limb.upper]
    upper = float(np.linalg.norm(origin[limb.lower] - origin[limb.upper]))
    lower = float(np.linalg.norm(origin[limb.end] + offset - origin[limb.lower]))
    line = place - start
    length = float(np.clip(np.linalg.norm(line), abs(upper - lower) * 1.05, (upper + lower) * 0.99))
    along = line / max(float(np.linalg.norm(line)), 1e-9)
    end = start + length * along
    share = (upper**2 - lower**2 + length**2) / (2 * length)
    radius = np.sqrt(max(upper**2 - share**2, 0.0))
    side = joints[limb.lower] - start
    side = side - (side @ along) * along
    if np.linalg.norm(side) < 1e-6:
        side = np.cross(along, (0.0, 0.0, 1.0) if abs(along[2]) < 0.9 else (1.0, 0.0, 0.0))
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
    """Return (time,) which fit to take in each frame, changing where fits agree (Viterbi).

    Parameters
    ----------
    costs : (fit, time) float64
        What it costs to take a fit in a frame.
    places : (fit, time, point, 3) float64
        Where each fit has the points, m; a change costs their mean step beyond the usual.
    scale_m
        A step that costs 1.
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
    """Turn a bone, by as little as can be, until `rest` points in a direction."""
    now = rotation[bone] @ rest
    now, goal = now / np.linalg.norm(now), direction / max(float(np.linalg.norm(direction)), 1e-9)
    axis = np.cross(now, goal)
    sine, cosine = float(np.linalg.norm(axis)), float(now @ goal)
    if sine < 1e-9:
        axis = np.cross(now, (0.0, 0.0, 1.0) if abs(now[2]) < 0.9 else (1.0, 0.0, 0.0))
        if cosine > 0:
            return
    angle = np.arctan2(sine, cosine)
    rotation[bone] = rotation_of(axis / np.linalg.norm(axis) * angle) @ rotation[bone]
