"""The dances of the captures that poses are measured on: shared motion and the studio's own."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.motion.importing import ImportSettings, read_joint_track
from tasks.studio.dancing.choreography import (
    LOW,
    Movement,
    Step,
    lonely,
    mirrored,
    okuri48,
    pose,
    turning,
    walk,
)
from tasks.studio.dancing.limbs import unit
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.performances import SH, TK, YS, Performer, generate_performance

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


def studio_dance(name: str, rate_hz: float, frames: int) -> Track:
    """Return joints of a dance of the studio's own, by the name that a plan gives it."""
    performer, danced = STUDIO[name]
    return generate_performance(danced, performer, rate_hz=rate_hz).position[:frames]


def folding() -> Movement:
    """Hands cross before the body, the arms fold, hands meet and part, low and high."""
    crossed = pose(right=(-0.5, -0.4, 0.5), left=(-0.5, -0.3, 0.6))
    other = pose(right=(-0.45, -0.1, 0.62), left=(-0.45, -0.25, 0.5))
    folded = pose(right=(-0.42, -0.3, 0.3), left=(-0.42, -0.36, 0.36))
    wide = pose((0.5, -0.2, 0.5))
    beats = (
        *((0.0, pose(LOW)), (0.6, crossed), (1.0, wide), (1.5, other | {"twist": 0.3})),
        *((2.0, folded | {"bow": 0.2}), (2.6, pose((-0.2, 0.3, 0.6), crouch=0.1))),
        *((3.1, crossed | {"twist": -0.3}), (3.8, wide)),
    )
    return Movement("folding", 3.8, beats)


def lunging() -> Movement:
    """A deep step forward, one hand ahead and one behind; back, and to the side."""
    beats = (
        *((0.0, pose(LOW)), (0.9, pose(right=(-0.2, 0.1, 0.85), left=(0.4, -0.5, -0.4)))),
        *((1.5, {"crouch": 0.22, "bow": 0.3}), (2.2, pose((-0.3, -0.5, 0.5), crouch=0.08))),
        *((3.0, pose(right=(0.6, 0.5, 0.2), left=(-0.3, -0.5, 0.4), crouch=0.25, side=0.2)),),
        (3.8, pose(LOW, crouch=0.05, bow=0.0, side=0.0)),
    )
    steps = (
        *(Step("R", 0.3, 1.0, forward=0.4, lift=0.04), Step("R", 1.7, 2.3, forward=0.0)),
        *(Step("L", 2.4, 3.0, left=0.3), Step("L", 3.3, 3.8)),
    )
    return Movement("lunging", 3.8, beats, steps)


def sinking() -> Movement:
    """Deep in the knees and bowed, hands before the shins and at the sash, a quarter turn."""
    beats = (
        *((0.0, pose(LOW)), (0.8, pose((0.05, -0.8, 0.35), crouch=0.4, bow=0.7))),
        *((1.6, pose((-0.3, -0.55, 0.3), crouch=0.35, bow=0.3, twist=0.4)),),
        *((2.6, pose((0.3, 0.5, 0.4), crouch=0.45, bow=0.1, twist=-0.3)),),
        (3.8, pose(LOW, crouch=0.1, bow=0.1, twist=0.0)),
    )
    steps = (Step("R", 1.6, 2.2, turn=-0.8), Step("L", 2.2, 2.8, turn=-0.8))
    return Movement("sinking", 3.8, beats, steps)


def wrapping() -> Movement:
    """One arm over the other before the breast, then the other one over it, while turning."""
    over = pose(right=(-0.5, -0.15, 0.4), left=(-0.4, -0.3, 0.3))
    under = pose(right=(-0.4, -0.4, 0.32), left=(-0.5, -0.2, 0.44))
    beats = (
        *(
            (0.0, pose(LOW)),
            (0.5, over),
            (1.1, under | {"twist": 0.3}),
            (1.6, pose((0.4, 0.2, 0.5))),
        ),
        *((2.1, under | {"twist": -0.2, "bow": 0.15}), (2.7, over), (3.2, under)),
        (3.8, pose((0.1, -0.4, 0.5), twist=0.0, bow=0.0)),
    )
    steps = tuple(
        Step("LR"[n % 2], 0.4 + 0.55 * n, 0.85 + 0.55 * n, turn=0.45 * (n + 1)) for n in range(6)
    )
    return Movement("wrapping", 3.8, beats, steps)


def raising() -> Movement:
    """A foot lifted and put across the other one, then the other; hands at the hips and up."""
    beats = (
        *((0.0, pose(LOW)), (0.6, pose((0.3, -0.6, 0.1))), (1.3, pose(right=(-0.3, 0.6, 0.4)))),
        *((1.9, pose((-0.35, -0.2, 0.5), crouch=0.1)), (2.6, pose(left=(-0.3, 0.6, 0.4)))),
        *((3.2, pose((-0.3, -0.45, 0.35), crouch=0.15)), (3.8, pose((0.4, -0.3, 0.4), crouch=0.0))),
    )
    steps = (
        *(Step("R", 0.4, 1.2, left=0.2, forward=0.12, lift=0.2), Step("L", 1.4, 2.2, lift=0.25)),
        *(Step("L", 2.4, 3.0, left=-0.1, forward=0.1, lift=0.2), Step("R", 3.1, 3.7, lift=0.12)),
    )
    return Movement("raising", 3.8, beats, steps)


def sweeping() -> Movement:
    """One sleeve swept across the other arm and back, low over the knees, hands behind the back."""
    behind = pose((0.12, -0.75, -0.45))
    beats = (
        *((0.0, pose(LOW)), (0.5, pose(right=(-0.6, 0.05, 0.55), left=(0.3, -0.3, 0.6)))),
        *(
            (1.0, pose(right=(0.7, 0.1, 0.3), twist=-0.4)),
            (1.5, pose(left=(-0.6, 0.0, 0.5), twist=0.3)),
        ),
        *(
            (2.1, behind | {"twist": 0.0, "bow": 0.25}),
            (2.7, pose((-0.45, -0.6, 0.4), crouch=0.25)),
        ),
        *((3.2, pose((-0.25, 0.75, 0.3), crouch=0.05, bow=0.0)), (3.8, pose(LOW))),
    )
    steps = (Step("L", 0.5, 1.1, forward=0.2), Step("R", 1.5, 2.1, forward=0.2, turn=0.6),
             Step("L", 2.6, 3.2, forward=0.05, turn=1.0))  # fmt: skip
    return Movement("sweeping", 3.8, beats, steps)


def with_opening(position: Track, rate_hz: float, frames: int) -> Track:
    """Return a track of so many frames that begins with arms stretched."""
    return stretch_arms_first(position, rate_hz, still_s=STILL_S, blend_s=BLEND_S)[:frames]


STUDIO = {
    "okuri": (SH, (okuri48(), mirrored(okuri48()), walk(4, hands=LOW))),
    "child": (CHILD, (lonely(), walk(4, hands=LOW))),
    "folding": (SH, (folding(), mirrored(folding()))),
    "folding-mirrored": (TK, (mirrored(folding()), folding())),
    "lunging": (YS, (lunging(), folding())),
    "lunging-mirrored": (SH, (mirrored(lunging()), folding())),
    "low": (TK, (sinking(), folding())),
    "wrapping": (SH, (wrapping(), raising())),
    "raising-mirrored": (SH, (mirrored(raising()), sweeping())),
    "low-mirrored": (SH, (mirrored(sinking()), sweeping())),
    "turn-left": (SH, (turning("left"), folding())),
    "turn-right": (TK, (turning("right"), folding())),
}
"""Performers and what they dance, by the name of the dance in a capture's plan."""
