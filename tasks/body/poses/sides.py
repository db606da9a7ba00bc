"""Tell right limbs from left ones where hands or feet met and parted, or were exchanged at first.

After two hands met, their colors do not tell which is which, but the arms do. So in each stretch of
frames in which the two are apart, the limbs are tried the other way round in some frames. If this
explains the voxels about as well, the whole stretch is fitted that way round. Of legs the fit that
explains it better stays. Of arms all stretches are decided together, for crossed arms explain
voxels little better than others: what counts, too, is whether hands that met went on as they moved.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, Floats, Pose, place_bones, rest_pose
from tasks.body.anatomy.identity import Stretch, choose_states, tell_turns
from tasks.body.blobs.fitting import Fit
from tasks.body.blobs.model import middles
from tasks.body.poses.limbs import LIMBS, Limb
from tasks.body.poses.passes import Fitting, follow, merge, reach_best, settle
from tasks.engine.threads import side_by_side
from tasks.geometry.runs import runs

_PAIRS = ((LIMBS[:2], (1, 2)), (LIMBS[2:], (3, 4)))
"""The arms and the legs, each with the two cues of their ends."""

_LEAST_STRETCH = 2
"""A stretch of fewer frames is left out, whatever the rate [frames]. A stretch is followed from
frame to frame."""

_ARMS = 0
"""Which of the pairs is the arms."""

_CROSSED_LESS = 0.035
"""How much less likely crossed arms make voxels where they are as likely as arms that are not [mean
logarithm of their likelihoods]. Sleeves hide where forearms cross: of arms that were not crossed
the other way round was 0.03 to 0.4 less likely, of arms that were 0.05 less to 0.03 likelier, in
rendered captures."""

_TELLS = 0.01
"""By what that tells 1 nat more [mean logarithm]. A third of it; chosen, not measured."""

_ASIDE, _MOST_ASIDE = 30.0, 4.0
"""What a second costs in which the right hand is to the left of the left one [nats a stature], and
what a stretch costs for it at most [nats]. As where hands are looked for; who crosses the arms may
keep them crossed."""

Limbs = tuple[Limb, ...]


def tell_sides(
    take: Fitting, fits: Sequence[Fit]
) -> tuple[Fitting, list[Fit], NDArray[np.bool_], Floats]:
    """Return the fits with right and left limbs exchanged where this explains the voxels better.

    Parameters
    ----------
    take
        The take that was fitted.
    fits
        The fits of its frames.

    Returns
    -------
    take
        As given, with the cues of hands and feet exchanged where the limbs were.
    fits : list of Fit
    unsure : (time, 2) bool
        True where right and left hand, or right and left foot, could be exchanged.
    gains : (time, 2) float64
        How much likelier the frame's stretch would be the other way round than it is [mean
        logarithm of the likelihoods of voxels]; NaN where the pair is together.
    """
    kept = list(fits)
    unsure = np.zeros((len(kept), len(_PAIRS)), bool)
    gains = np.full(unsure.shape, np.nan)
    for pair, (limbs, cues) in enumerate(_PAIRS):
        at = np.stack([middles(take.model, fit.pose) for fit in kept])
        ends = at[:, [limb.end for limb in limbs]]
        stretches = _stretches(take, ends)
        wholes = _widen(ends, stretches)
        others = [
            _try(take, kept, pair, ends, both) for both in zip(stretches, wholes, strict=True)
        ]
        gain = [-np.inf if other is None else gain for gain, other in others]
        is_arms = pair == _ARMS
        chosen = _choose(take, kept, ends, stretches, gain) if is_arms else np.array(gain) > 0.0
        found = zip(stretches, wholes, others, chosen, strict=True)
        for (first, last), whole, (gain, other), exchanged in found:
            gains[first:last, pair] = -gain if exchanged else gain
            if other is not None:
                unsure[first:last, pair] = gain < take.settings.side_margin
            if other is not None and exchanged:
                kept[slice(*whole)] = other
                take = _with_cues_exchanged(take, cues, whole)
    return take, kept, unsure, gains


def _try(
    take: Fitting, fits: Sequence[Fit], pair: int, ends: Floats, both: tuple[Stretch, Stretch]
) -> tuple[float, list[Fit] | None]:
    """Return how much likelier a stretch is the other way round, and, if that is near, the fits.

    These are of the second of both stretches, which holds the first.
    """
    (limbs, cues), ((first, last), whole) = _PAIRS[pair], both
    count = max(take.settings.side_frames, round((last - first) / take.rate_hz))
    looked = np.unique(np.linspace(first, last - 1, count).astype(int))
    tried = _exchange(take, fits, limbs, ends, looked)
    gain = _gain(fits, tried)
    crossed = _crossed(take, fits[first:last], ends[first:last])
    less = _CROSSED_LESS if pair == _ARMS and crossed < 0.0 else 0.0
    if gain < -take.settings.side_margin - less:
        return gain, None
    other = _fit_between(take, tried, (first, last), cues)
    swapped = _with_cues_exchanged(take, cues, whole)
    before = follow(swapped, range(first - 1, whole[0] - 1, -1), other[0].pose)[::-1]
    after = follow(swapped, range(last, whole[1]), other[-1].pose)
    return _gain(fits[first:last], dict(enumerate(other))), [*before, *other, *after]


def _widen(ends: Floats, stretches: Sequence[Stretch]) -> list[Stretch]:
    """Return stretches that begin and end where a pair (time, 2, 3) is nearest between them."""
    apart = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    cuts = [
        end + int(np.argmin(apart[end:first]))
        for (_, end), (first, _) in itertools.pairwise(stretches)
    ]
    first, last = [s[0] for s in stretches[:1]], [s[1] for s in stretches[-1:]]
    return list(zip([*first, *cuts], [*cuts, *last], strict=True))


def _choose(
    take: Fitting, fits: Sequence[Fit], ends: Floats, stretches: Sequence[Stretch],
    gains: Sequence[float],
) -> NDArray[np.bool_]:  # fmt: skip
    """Return in which stretches arms are exchanged, from how much likelier that makes them."""
    if not stretches:
        return np.zeros(0, np.bool_)
    cost = np.zeros((len(stretches), 2))
    for n, ((first, last), gain) in enumerate(zip(stretches, gains, strict=True)):
        crossed = _crossed(take, fits[first:last], ends[first:last])
        told = (gain - np.sign(crossed) * _CROSSED_LESS) / _TELLS
        aside = _ASIDE * crossed * (last - first) / take.rate_hz
        cost[n, 1] = -told - np.clip(aside, -_MOST_ASIDE, _MOST_ASIDE)
    turn = tell_turns(ends / take.model.stature, stretches, take.rate_hz)
    return choose_states(cost, turn)


def _crossed(take: Fitting, fits: Sequence[Fit], ends: Floats) -> float:
    """Return how far the right end is left of the left one, in the mean [statures]."""
    hips = [BONES.index(side + "UpperLeg") for side in "RL"]
    found = []
    for fit, (right, left) in zip(fits, ends, strict=True):
        joints = place_bones(fit.pose, take.model.origin)[hips]
        across = joints[1] - joints[0]
        found.append((right - left) @ across / np.linalg.norm(across))
    return float(np.mean(found)) / take.model.stature


def fit_exchanged(
    take: Fitting, fits: Sequence[Fit], pair: int, stretch: Stretch
) -> tuple[Fitting, list[Fit]] | None:
    """Return the fits of a stretch with the limbs of a pair exchanged; None if nobody is there.

    With them comes the take, the cues of the pair exchanged in the stretch as well.

    Parameters
    ----------
    take, fits
        The take that was fitted, and the fits of its frames.
    pair
        0 for the arms, 1 for the legs.
    stretch
        The first frame, and the frame after the last one.
    """
    limbs, cues = _PAIRS[pair]
    first, last = stretch
    at = [middles(take.model, fit.pose) for fit in fits[first:last]]
    ends = np.zeros((len(fits), len(limbs), 3))
    ends[first:last] = np.stack(at)[:, [limb.end for limb in limbs]]
    tried = _exchange(take, fits, limbs, ends, np.array([first, last - 1]))
    if not tried:
        return None
    found = _fit_between(take, tried, stretch, cues)
    crossed = _with_cues_exchanged(take, cues, stretch)
    for _ in range(take.settings.settle_rounds - 1):
        found = settle(crossed.part(*stretch), [fit.pose for fit in found])
    return crossed, found


def _fit_between(
    take: Fitting, tried: dict[int, Fit], stretch: Stretch, cues: tuple[int, int]
) -> list[Fit]:
    """Return the fits of a stretch from fits of its frames in which a pair is exchanged."""
    crossed = _with_cues_exchanged(take, cues, stretch).part(*stretch)
    frames = range(crossed.frames)
    there = follow(crossed, frames, tried[min(tried)].pose)
    back = follow(crossed, frames[::-1], tried[max(tried)].pose)[::-1]
    return settle(crossed, merge(crossed, there, back))


def _stretches(take: Fitting, ends: Floats) -> list[Stretch]:
    """Return the stretches in which a pair of ends (time, 2, 3) is apart.

    A stretch is its first frame and the frame after its last one. Short stretches are left out, for
    an exchange that is over soon is none.
    """
    apart = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    is_apart = apart > take.settings.side_apart * take.model.stature
    least = max(_LEAST_STRETCH, round(take.settings.side_least_s * take.rate_hz))
    return [(first, end) for first, end in runs(is_apart) if end - first >= least]


def _exchange(
    take: Fitting, fits: Sequence[Fit], limbs: Limbs, ends: Floats, frames: NDArray[np.integer]
) -> dict[int, Fit]:
    """Return fits of frames in which each limb of a pair ends where the other one did."""
    model = take.model
    rest = middles(model, rest_pose(model.origin))

    def reach(pose: Pose, t: int) -> Fit:
        sample, found = take.sample(t), fits[t]
        for limb, place in zip(limbs, ends[t, ::-1], strict=True):
            offset = rest[limb.end] - model.origin[limb.end]
            found = reach_best(take, sample, pose, limb, offset, place)
            pose = found.pose
        return found

    shown = [t for t in frames.tolist() if take.sample(t).count]
    return dict(zip(shown, side_by_side(lambda t: reach(fits[t].pose, t), shown), strict=True))


def _gain(fits: Sequence[Fit], others: dict[int, Fit]) -> float:
    """Return how much likelier other fits make the voxels of their frames, in the mean."""
    gains = [other.likelihood - fits[t].likelihood for t, other in others.items()]
    return float(np.mean(gains)) if gains else -np.inf


def _with_cues_exchanged(take: Fitting, pair: tuple[int, int], stretch: Stretch) -> Fitting:
    """Return the take with the cues of a pair exchanged in a stretch."""
    changed, own = {}, slice(*stretch)
    for name in ("cues", "cue_weights"):
        table = getattr(take, name)
        if table is not None:
            changed[name] = table.copy()
            changed[name][own, pair] = table[own, pair[::-1]]
    return replace(take, **changed)
