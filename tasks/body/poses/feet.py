"""Turn feet round that point backwards.

A foot is as long before as behind its middle, and its blobs fit either way round. Once it points
backwards, it stays so, for the fit moves to better poses nearby only. So where a foot points to the
back of the pelvis for some frames, and is turned in its ankle as well, it is laid the other way
round, with its middle where it was. It stays there if it then points forwards and the voxels are
about as likely.
"""

from collections.abc import Sequence

import numpy as np

from tasks.body.anatomy.bones import BONES, PARENT, Floats, Pose, place_bones, rotation_of
from tasks.body.blobs.fitting import Fit
from tasks.body.blobs.model import middles
from tasks.body.poses.limbs import LIMBS, Limb, reach_for
from tasks.body.poses.passes import Fitting, settle
from tasks.geometry.runs import runs

_BACK = -0.2
"""Cosine of the angle between a foot and where the pelvis points, seen from above, below which the
foot points backwards [cosine]. It is 102 degrees: a hip and a knee turn a foot by 90."""

_FRONT = 0.1
"""As `_BACK`, above which it points forwards. Of 40 feet of rendered captures that were turned, 21
came beyond it, of which 2 were worse there."""

_IN_ANKLE = 0.5
"""Least angle by which a foot is turned from its lower leg, since the initial pose, to be wrong
[rad]. Who kneels or kicks points a foot backwards, too, but along the leg."""

_LEVEL = 0.35
"""Least share of a foot's length that is seen from above where its direction is asked [share]. On
tiptoe it has none."""

_LEAST_S = 0.1
"""How long it must be so at least [s]. A fit that errs for less is led back by its neighbors."""

_WORSE = 0.008
"""By how much voxels may become less likely [mean logarithm of their likelihoods]. Of 20 feet of
rendered captures that were turned, those beyond it were not better for it."""


def turn_feet(take: Fitting, fits: Sequence[Fit]) -> list[Fit]:
    """Return the fits, with feet that point backwards turned round where that is as likely.

    Parameters
    ----------
    take
        The take that was fitted.
    fits
        The fits of its frames.
    """
    kept = list(fits)
    least = max(2, round(_LEAST_S * take.rate_hz))
    for limb in LIMBS[2:]:
        toes = _toes(take, kept, limb)
        ahead, level = _ahead(take, kept, toes)
        for first, last in runs(ahead < 0.0):
            own = slice(first, last)
            if last - first < least or ahead[own].mean() > _BACK or level[own].mean() < _LEVEL:
                continue
            if np.mean([_turn_in_ankle(fit.pose, limb) for fit in kept[own]]) < _IN_ANKLE:
                continue
            turned = _settle_turned(take.part(first, last), kept[own], limb, toes[own])
            gain = np.mean([fit.likelihood for fit in turned])
            gain -= np.mean([fit.likelihood for fit in kept[own]])
            after, _ = _ahead(take, turned, _toes(take, turned, limb))
            if gain > -_WORSE and after.mean() > _FRONT:
                kept[own] = turned
    return kept


def _toes(take: Fitting, fits: Sequence[Fit], limb: Limb) -> Floats:
    """Return (time, 3) along a foot towards the toes, in the initial pose level, m."""
    along = take.model.middle[limb.end] * (1.0, 0.0, 1.0)
    return np.stack([fit.pose.rotation[limb.end] @ along for fit in fits])


def _ahead(take: Fitting, fits: Sequence[Fit], toes: Floats) -> tuple[Floats, Floats]:
    """Return the cosine between feet and the pelvis, and the share of feet seen from above."""
    hips = [BONES.index(side + "UpperLeg") for side in "RL"]
    right, left = np.stack([place_bones(fit.pose, take.model.origin)[hips] for fit in fits], axis=1)
    forward = np.cross(left - right, (0.0, 1.0, 0.0))
    flat = toes * (1.0, 0.0, 1.0)
    lengths = [np.maximum(np.linalg.norm(each, axis=1), 1e-9) for each in (forward, flat, toes)]
    cosine = (forward * flat).sum(axis=1) / (lengths[0] * lengths[1])
    return cosine, lengths[1] / lengths[2]


def _turn_in_ankle(pose: Pose, limb: Limb) -> float:
    """Return by which angle a foot is turned from its lower leg since the initial pose, rad."""
    local = pose.rotation[PARENT[limb.end]].T @ pose.rotation[limb.end]
    return float(np.arccos(np.clip((np.trace(local) - 1.0) / 2.0, -1.0, 1.0)))


def _settle_turned(take: Fitting, fits: Sequence[Fit], limb: Limb, toes: Floats) -> list[Fit]:
    """Return the fits of a stretch with a foot the other way round."""
    poses = [_turned(take, fit.pose, limb, -toe) for fit, toe in zip(fits, toes, strict=True)]
    found: list[Fit] = []
    for _ in range(take.settings.settle_rounds):
        found = settle(take, [fit.pose for fit in found] if found else poses)
    return found


def _turned(take: Fitting, pose: Pose, limb: Limb, toe: Floats) -> Pose:
    """Return a pose whose foot points to where `toe` does and has its middle where it was."""
    model = take.model
    rest = model.middle[limb.end]
    turn = np.arctan2(toe[0], toe[2]) - np.arctan2(rest[0], rest[2])
    rotation = rotation_of(np.array([0.0, turn, 0.0]))
    ankle = middles(model, pose)[limb.end] - rotation @ rest
    [found] = reach_for(pose, model.origin, limb, np.zeros(3), ankle, 1)
    found.rotation[limb.end] = rotation
    return found
