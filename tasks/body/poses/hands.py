"""Find hands at ends of the hull that no limb was fitted to.

What was seen as a hand may be something else of its color, or the other hand. An arm that was
fitted there shares the voxels of the other arm, and its own voxels stick out unexplained. So arms
are tried at ends of the hull that no blob is near to. Where this makes the voxels of some frames on
end much likelier, the hand is there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tasks.body.anatomy.bones import Floats, place_bones
from tasks.body.blobs.fitting import Fit
from tasks.body.blobs.model import place_model
from tasks.body.poses.limbs import LIMBS
from tasks.body.poses.passes import Fitting, reach_best
from tasks.engine.threads import side_by_side
from tasks.geometry.runs import runs

_HANDS = (1, 2)
"""The cues of the right and of the left hand [cue]. Cues are face, hands, feet, right before
left."""

_REACH = 1.1
"""How far from its shoulder the end of an arm is looked for [lengths of the arm]. The shoulder of a
fit may be some centimeters off; the 10 % were chosen by eye on the shared captures, not
measured."""


def look_for_hands(take: Fitting, fits: Sequence[Fit], ends: Sequence[Floats]) -> Fitting:
    """Return the take with hands seen at free ends where these explain its frames better.

    Parameters
    ----------
    take
        The take with the hands as they were seen.
    fits
        The fits of its frames that were made with these hands.
    ends
        (place, 3) where a hand could be in each frame, m.
    """
    if take.cues is None or take.placed is None:
        return take
    step = max(1, round(take.settings.hand_missing_s * take.rate_hz))
    frames = range(take.frames)

    def look(t: int) -> tuple[Floats | None, Floats | None]:
        return _elsewhere(take, fits[t], t, ends[t])

    found = dict(zip(frames[::step], side_by_side(look, frames[::step]), strict=True))
    begun = [t for t, hands in found.items() if any(hand is not None for hand in hands)]
    near = {n for t in begun for n in range(t - step, t + step + 1)} & set(frames)
    rest = sorted(near - set(found))
    found |= dict(zip(rest, side_by_side(look, rest), strict=True))
    cues = take.cues.copy()
    weights = np.ones(cues.shape[:2]) if take.cue_weights is None else take.cue_weights.copy()
    for hand, cue in enumerate(_HANDS):
        places = {t: hands[hand] for t, hands in found.items() if hands[hand] is not None}
        for first, end in runs(np.isin(frames, list(places))):
            for t in range(first, end) if end - first >= step else ():
                cues[t, cue], weights[t, cue] = places[t], 1.0
    return replace(take, cues=cues, cue_weights=weights)


def _elsewhere(
    take: Fitting, fit: Fit, frame: int, ends: Floats
) -> tuple[Floats | None, Floats | None]:
    """Return the free ends that right and left hand are at; None for a hand that stays."""
    assert take.placed is not None
    model, settings = take.model, take.settings
    best: list[tuple[float, Floats | None]] = [(settings.hand_missing, None)] * 2
    free = _free_ends(take, fit, ends)
    if not len(free):
        return None, None
    sample, joints = take.sample(frame), place_bones(fit.pose, model.origin)
    for hand, limb in enumerate(LIMBS[:2]):
        offset = take.placed[_HANDS[hand]] - model.origin[limb.end]
        if not np.isfinite(offset).all():
            continue
        upper = np.linalg.norm(model.origin[limb.lower] - model.origin[limb.upper])
        lower = np.linalg.norm(model.origin[limb.end] + offset - model.origin[limb.lower])
        away = np.linalg.norm(free - joints[limb.upper], axis=1)
        for place in free[away < _REACH * (upper + lower)]:
            other = reach_best(take, sample, fit.pose, limb, offset, place)
            gain = other.likelihood - fit.likelihood
            if gain > best[hand][0]:
                best[hand] = (gain, place)
    (right_gain, right), (left_gain, left) = best
    if right is not None and left is not None and (right == left).all():
        return (right, None) if right_gain >= left_gain else (None, left)
    return right, left


def _free_ends(take: Fitting, fit: Fit, ends: Floats) -> Floats:
    """Return (place, 3) the ends of a frame's hull that no blob is near to, m."""
    mean, _ = place_model(take.model, fit.pose)
    away = np.linalg.norm(ends[:, None] - mean, axis=2)
    return ends[away.min(axis=1, initial=np.inf) > take.settings.free_end * take.model.stature]
