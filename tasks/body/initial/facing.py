"""Tell which way a performer with stretched arms faces. Points are metres with y up."""

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.proportions import Points
from tasks.body.initial.arms import Arms
from tasks.body.initial.trunk import Trunk

SOLE_BELOW = 0.018
"""Height of a foot's sole [statures]. Chosen by eye on the shared captures; not measured."""

INSTEP_ABOVE = 0.033
"""Where a foot's instep begins, above the floor [statures]. Chosen by eye on the shared captures;
not measured."""

LONGER_BEFORE = 0.03
"""How far both soles together are before their insteps when the vote is full [statures]. Chosen by
eye on the shared captures; not measured."""

KNEE_LEVEL = 0.27
"""Height of the knees above the floor [statures]. `SHANK_SHARE` and `ANKLE_HEIGHT` are 0.282; knees
that bend are lower."""

KNEE_SLAB = 0.04
"""How far above and below that height voxels are the knees' [statures]. Chosen by eye on the shared
captures; not measured."""

BENT = 0.05
"""How far knees are before the middle of feet and hips when the vote is full [statures]. Chosen by
eye on the shared captures; not measured."""

SKULL_ASIDE = 0.09
"""How far beside the middle of the head a voxel of it is at most [statures]. Chosen by eye on the
shared captures; not measured."""

SKULL_AHEAD = 0.12
"""How far before or behind the middle of the head a voxel of head or neck is at most [statures].
Chosen by eye on the shared captures; not measured."""

SKULL_TALL = 0.09
"""How far below the top of the head its upper part reaches [statures]. Chosen by eye on the shared
captures; not measured."""

NAPE_ABOVE = 0.025
"""Height above the base of the neck at which the neck is looked at [statures]. Chosen by eye on the
shared captures; not measured."""

NAPE_SLAB = 0.012
"""How far above and below that height voxels are the neck's [statures]. Chosen by eye on the shared
captures; not measured."""

NAPE_ASIDE = 0.06
"""How far beside the middle of the head a voxel of the neck is at most [statures]. Chosen by eye on
the shared captures; not measured."""

LEAN = 0.015
"""How far the head is before the neck when the vote is full [statures]. Chosen by eye on the shared
captures; not measured."""

FEET_WEIGHT = 1.0
"""Weight of the feet's vote, against the others'. Chosen by eye on the shared captures; not
measured."""

KNEES_WEIGHT = 1.0
"""Weight of the knees' vote, against the others'. Chosen by eye on the shared captures; not
measured."""

FACE_WEIGHT = 2.0
"""Weight of the face's vote, against the others'. A face tells most surely, where it shows; not
measured."""

HEAD_WEIGHT = 0.5
"""Weight of the vote of the head's carriage, against the others'. Heads are held in many ways; not
measured."""

HAND_WITHIN = 0.10
"""How far from a finger tip a voxel of the hand is at most [half spans]. Chosen by eye on the
shared captures; not measured."""

FACE_HEIGHTS = (0.38, 0.85)
"""Between which heights a face is [shares of the height from neck to top of the head]. Chosen by
eye on the shared captures; not measured."""

FACE_AROUND = 0.16
"""How far from the head's vertical a voxel of it is at most [half spans]. Chosen by eye on the
shared captures; not measured."""

DARKER = 30.0
"""How much darker than the middle hair must be to be surely no face [levels of the sum of red,
green and blue]. Chosen by eye on the shared captures; not measured."""

LEVELS_ADDED = 40
"""What is added to the sum of red, green and blue before it divides [levels]. Dark colors have no
exact chroma; chosen by eye on the shared captures, not measured."""

LIGHT_SHARE = 0.5
"""How much a difference of the logarithm of brightness counts against one of chroma. Chroma alone
would let dark hair pass for skin; not measured."""

UNLIKE = 0.25
"""Difference of two colors at which they are hardly alike, chroma and brightness together. Chosen
by eye on the shared captures; not measured."""

FACE_SHARES = (0.08, 0.92)
"""Between which shares of the head the face's color must be to tell anything. Chosen by eye on the
shared captures; not measured."""

FACE_BEFORE_M = 0.03
"""How far the face's color is before the rest of the head when the vote is full. Chosen by eye on
the shared captures; not measured."""


def vote_facing(
    point: Points,
    arms: Arms,
    trunk: Trunk,
    feet: list[Points],
    surface: Points | None,
    color: NDArray[np.uint8] | None,
) -> tuple[float, list[str]]:
    """Return how surely the performer faces `arms.front` (-1 to 1) and what said so.

    Four cues: feet are longer before the ankle than behind it, knees bend forward, a face
    has the color of the hands and hair has not, and heads are held before the neck.

    Parameters
    ----------
    point : (voxel, 3) float64
    arms, trunk
        As they were measured; the performer may face either way.
    feet : list of (voxel, 3) float64
        The voxels of each foot.
    surface, color : (surface voxel, 3)
        Centers in metres and RGB, or None.
    """
    stature = trunk.stature_m
    votes: list[tuple[float, float, str]] = []
    steps = []
    for foot in feet:
        low = foot[:, 1].min()
        sole = foot[foot[:, 1] < low + SOLE_BELOW * stature]
        instep = foot[foot[:, 1] > low + INSTEP_ABOVE * stature]
        if len(sole) > 5 and len(instep) > 5:
            steps.append((sole.mean(axis=0) - instep.mean(axis=0)) @ arms.front)
    if steps:
        votes.append((float(np.sum(steps)) / (LONGER_BEFORE * stature), FEET_WEIGHT, "the feet"))
    level = point[:, 1].min() + KNEE_LEVEL * stature
    knees = point[abs(point[:, 1] - level) < KNEE_SLAB * stature]
    if len(knees) > 5 and feet:
        ends = (np.mean([foot.mean(axis=0) for foot in feet], axis=0) + trunk.hips) / 2.0
        bend = float((knees.mean(axis=0) - ends) @ arms.front)
        votes.append((bend / (BENT * stature), KNEES_WEIGHT, "the bend of the knees"))
    if surface is not None and color is not None:
        vote = _vote_of_face(surface, color.astype(np.float64), arms, trunk)
        if vote is not None:
            votes.append((vote, FACE_WEIGHT, "the color of the face"))
    about = point - trunk.head
    near = abs(about @ arms.front) < SKULL_AHEAD * stature
    skull = near & (abs(about @ arms.left) < SKULL_ASIDE * stature)
    skull &= point[:, 1] > trunk.head[1] - SKULL_TALL * stature
    base = abs(point[:, 1] - trunk.neck[1] - NAPE_ABOVE * stature) < NAPE_SLAB * stature
    base &= near & (abs(about @ arms.left) < NAPE_ASIDE * stature)
    if skull.any() and base.any():
        lean = (point[skull].mean(axis=0) - point[base].mean(axis=0)) @ arms.front
        votes.append((lean / (LEAN * stature), HEAD_WEIGHT, "the carriage of the head"))
    total = sum(weight for _, weight, _ in votes)
    if not total:
        return 0.0, []
    vote = sum(weight * float(np.clip(v, -1, 1)) for v, weight, _ in votes) / total
    return vote, [name for v, _, name in votes if v * vote > 0]


def _vote_of_face(surface: Points, color: Points, arms: Arms, trunk: Trunk) -> float | None:
    """Return how far forward the head has the color of the hands, 1 for a full vote; or None."""
    half = arms.half_span_m
    hand = [color[np.linalg.norm(surface - tip, axis=1) < HAND_WITHIN * half] for tip in arms.tip]
    skin = np.concatenate(hand)
    height = (surface[:, 1] - trunk.neck[1]) / (trunk.head[1] - trunk.neck[1])
    head = (height > FACE_HEIGHTS[0]) & (height < FACE_HEIGHTS[1])
    head &= np.linalg.norm((surface - trunk.head) * [1, 0, 1], axis=1) < FACE_AROUND * half
    if head.sum() < 20:
        return None
    total = color[head].sum(axis=1)
    if len(skin) < 10:  # hands hidden: hair is mostly darker than a face
        alike = 1.0 / (1.0 + np.exp(-(total - (total.min() + total.max()) / 2) / DARKER))
    else:
        target = np.median(skin, axis=0)
        light, usual = total + LEVELS_ADDED, target.sum() + LEVELS_ADDED
        unlike = np.linalg.norm(color[head] / light[:, None] - target / usual, axis=1)
        unlike += LIGHT_SHARE * abs(np.log(light / usual))
        alike = np.exp(-((unlike / UNLIKE) ** 2))
    share = alike.mean()
    if not FACE_SHARES[0] < share < FACE_SHARES[1]:
        return None
    ahead = (surface[head] - surface[head].mean(axis=0)) @ arms.front
    return float(
        (alike @ ahead / alike.sum() - (1 - alike) @ ahead / (1 - alike).sum()) / FACE_BEFORE_M
    )
