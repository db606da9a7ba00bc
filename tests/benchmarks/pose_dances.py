"""The dances of the captures that poses are measured on: shared motion and the studio's own."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.motion.importing import ImportSettings, read_joint_track
from tasks.studio.dancing.choreography import LOW, lonely, mirrored, okuri48, walk
from tasks.studio.dancing.limbs import unit
from tasks.studio.filming import stretch_arms_first
from tasks.studio.performances import SH, Performer, generate_performance

Track = NDArray[np.float64]

STILL_S, BLEND_S = 0.5, 0.7
ANKLE_HEIGHT, HEEL_BEHIND = 0.039, 0.03
"""Of the stature: ankle above the sole, heel behind the ankle (Winter, as in the studio)."""

CHILD = Performer("child", 1.15, legs=0.9, arms=0.92, shoulders=0.95)


def read_dance(path: Path, first: int, every: int, frames: int) -> Track:
    """Return (time, 21, 3) joints of a motion file from a frame on, m, with heels added."""
    track = read_joint_track(path, ImportSettings())[0]
    position = track.position[first::every][:frames].astype(np.float64)
    if len(position) < frames:
        raise ValueError(f"{path.name} has {len(position)} such frames from {first}, not {frames}")
    return add_heels(position, track.stature_m or 1.6)


def add_heels(position: Track, stature_m: float) -> Track:
    """Return joints with heels: on the sole, which passes through the toe and below the ankle.

    The sole is the line in the plane of shank and foot whose distance from the ankle is that of
    a foot; where shank and foot are nearly one line the plane is that of the frames around.
    """
    position = position.copy()
    height = ANKLE_HEIGHT * stature_m
    for side in "RL":
        knee, ankle, toe = (
            position[:, JOINTS.index(side + name)] for name in ("Knee", "Ankle", "Foot")
        )
        ahead, length = unit(toe - ankle), np.linalg.norm(toe - ankle, axis=1)
        across = np.cross(unit(ankle - knee), ahead)
        clear = np.linalg.norm(across, axis=1) > 0.2
        time = np.arange(len(position))
        across = np.stack([np.interp(time, time[clear], axis[clear]) for axis in across.T], axis=1)
        across = unit(across - (across * ahead).sum(axis=1, keepdims=True) * ahead)
        angle = np.arcsin(np.minimum(height / length, 0.9))[:, None]
        below = np.cross(ahead, across)  # at right angles to the foot, towards the sole
        sole = np.cos(angle) * ahead - np.sin(angle) * below
        along = np.cos(angle[:, 0]) * length + HEEL_BEHIND * stature_m
        position[:, JOINTS.index(side + "Heel")] = toe - along[:, None] * sole
    return position


def on_floor(position: Track) -> Track:
    """Return joints raised or lowered as a whole until the lowest toe or heel is at 0."""
    soles = [JOINTS.index(side + name) for side in "RL" for name in ("Heel", "Foot")]
    return position - [0.0, position[:, soles, 1].min(), 0.0]


def reshape(
    position: Track, *, legs: float = 1.0, trunk: float = 1.0, arms: float = 1.0, head: float = 1.0
) -> Track:
    """Return joints of a body whose parts have other lengths; feet keep to the floor."""
    found = position * legs
    hips = position[:, [JOINTS.index("RHip"), JOINTS.index("LHip")]].mean(axis=1)
    for name in ("Waist", "Neck", "RShoulder", "LShoulder"):
        own = JOINTS.index(name)
        found[:, own] = legs * hips + trunk * (position[:, own] - hips)
    chains = [("Neck", ("Head",), head)]
    chains += [(side + "Shoulder", (side + "Elbow", side + "Wrist", side + "Fin"), arms)
               for side in "RL"]  # fmt: skip
    for root, names, ratio in chains:
        base = JOINTS.index(root)
        for own in map(JOINTS.index, names):
            found[:, own] = found[:, base] + ratio * (position[:, own] - position[:, base])
    return found


def spin(position: Track, most_degrees: float) -> Track:
    """Return joints turned about the vertical through the hips, slow, fast and slow again.

    The added turn of a frame rises to `most_degrees` in the middle of the track.
    """
    turn = most_degrees * np.sin(np.linspace(0.0, np.pi, len(position))) ** 2
    angle = np.radians(np.cumsum(turn))
    cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    rows = [[cosine, zero, sine], [zero, zero + 1.0, zero], [-sine, zero, cosine]]
    rotation = np.moveaxis(np.array(rows), 2, 0)
    hips = position[:, [JOINTS.index("RHip"), JOINTS.index("LHip")]].mean(axis=1, keepdims=True)
    pivot = hips * [1.0, 0.0, 1.0]
    return (position - pivot) @ rotation.transpose(0, 2, 1) + pivot


def studio_dance(performer: Performer, rate_hz: float, frames: int) -> Track:
    """Return joints of a studio's performer: okuri for the tall, lonely for a child."""
    danced = [lonely(), walk(4, hands=LOW)] if performer.height_m < 1.3 else [
        okuri48(), mirrored(okuri48()), walk(4, hands=LOW)
    ]  # fmt: skip
    return generate_performance(danced, performer, rate_hz=rate_hz).position[:frames]


def with_opening(position: Track, rate_hz: float, frames: int) -> Track:
    """Return a track of so many frames that begins with arms stretched."""
    return stretch_arms_first(position, rate_hz, still_s=STILL_S, blend_s=BLEND_S)[:frames]


STUDIO = {"okuri": SH, "child": CHILD}
"""Performers of the studio's own dances, by the name of the dance in a capture's plan."""
