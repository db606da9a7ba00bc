"""Tell which way a performer with stretched arms faces. Points are metres with y up."""

import numpy as np
from numpy.typing import NDArray

from tasks.body.initial.arms import Arms, Points
from tasks.body.initial.trunk import Trunk


def vote_facing(
    point: Points,
    arms: Arms,
    trunk: Trunk,
    feet: list[Points],
    surface: Points | None,
    color: NDArray[np.uint8] | None,
) -> tuple[float, list[str]]:
    """Return how surely the performer faces `arms.front` (-1 to 1) and what said so.

    Four witnesses: feet are longer before the ankle than behind it, knees bend forward, a face
    has the color of the hands and hair has not, and heads are held before the neck.

    Parameters
    ----------
    point : (voxel, 3) float64
    arms, trunk
        As measured, facing either way.
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
        sole = foot[foot[:, 1] < low + 0.018 * stature]
        instep = foot[foot[:, 1] > low + 0.033 * stature]
        if len(sole) > 5 and len(instep) > 5:
            steps.append((sole.mean(axis=0) - instep.mean(axis=0)) @ arms.front)
    if steps:
        votes.append((float(np.sum(steps)) / (0.03 * stature), 1.0, "the feet"))
    level = point[:, 1].min() + 0.27 * stature
    knees = point[abs(point[:, 1] - level) < 0.04 * stature]
    if len(knees) > 5 and feet:
        ends = (np.mean([foot.mean(axis=0) for foot in feet], axis=0) + trunk.hips) / 2.0
        bend = float((knees.mean(axis=0) - ends) @ arms.front)
        votes.append((bend / (0.05 * stature), 1.0, "the bend of the knees"))
    if surface is not None and color is not None:
        vote = _vote_of_face(surface, color.astype(np.float64), arms, trunk)
        if vote is not None:
            votes.append((vote, 2.0, "the color of the face"))
    about = point - trunk.head
    skull = (abs(about @ arms.left) < 0.09 * stature) & (abs(about @ arms.front) < 0.12 * stature)
    skull &= point[:, 1] > trunk.head[1] - 0.09 * stature
    base = abs(point[:, 1] - trunk.neck[1] - 0.025 * stature) < 0.012 * stature
    base &= abs(about @ arms.left) < 0.06 * stature
    base &= abs(about @ arms.front) < 0.12 * stature
    if skull.any() and base.any():
        lean = (point[skull].mean(axis=0) - point[base].mean(axis=0)) @ arms.front
        votes.append((lean / (0.015 * stature), 0.5, "the carriage of the head"))
    total = sum(weight for _, weight, _ in votes)
    if not total:
        return 0.0, []
    vote = sum(weight * float(np.clip(v, -1, 1)) for v, weight, _ in votes) / total
    return vote, [name for v, _, name in votes if v * vote > 0]


def _vote_of_face(surface: Points, color: Points, arms: Arms, trunk: Trunk) -> float | None:
    """Return in which direction the head has the color of the hands, in head radii."""
    half = arms.half_span_m
    hand = [color[np.linalg.norm(surface - tip, axis=1) < 0.10 * half] for tip in arms.tip]
    skin = np.concatenate(hand)
    height = (surface[:, 1] - trunk.neck[1]) / (trunk.head[1] - trunk.neck[1])
    head = (height > 0.38) & (height < 0.85)
    head &= np.linalg.norm((surface - trunk.head) * [1, 0, 1], axis=1) < 0.16 * half
    if head.sum() < 20:
        return None
    total = color[head].sum(axis=1)
    if len(skin) < 10:  # hands hidden: hair is mostly darker than a face
        alike = 1.0 / (1.0 + np.exp(-(total - (total.min() + total.max()) / 2) / 30.0))
    else:
        target = np.median(skin, axis=0)
        # chroma alone would let dark hair pass for skin: brightness counts, less than chroma
        unlike = np.linalg.norm(
            color[head] / (total[:, None] + 40) - target / (target.sum() + 40), axis=1
        ) + 0.5 * abs(np.log((total + 40) / (target.sum() + 40)))
        alike = np.exp(-((unlike / 0.25) ** 2))
    share = alike.mean()
    if not 0.08 < share < 0.92:
        return None
    ahead = (surface[head] - surface[head].mean(axis=0)) @ arms.front
    return float((alike @ ahead / alike.sum() - (1 - alike) @ ahead / (1 - alike).sum()) / 0.03)
