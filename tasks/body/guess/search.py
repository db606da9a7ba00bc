"""Guess the joints of a take in which nobody stretches the arms.

A body of usual proportions is fitted to frames from the whole take, each by itself. Facing is told
by the likelihood of the voxels and by the color of the face, hands by the colors that the faces
have. The frame that all of this fits best is the one that the take begins with.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import Floats
from tasks.body.blobs.fitting import Fit
from tasks.body.guess.single_frames import Shown, fit_both_ways, forward
from tasks.body.guess.skin import learn_skin, reach_lumps, skin_lumps, vote_face
from tasks.body.guess.usual_body import UsualBody, make_usual_body
from tasks.engine.threads import side_by_side

LOOKED_AT = 16
"""How many frames the body is fitted to. Chosen by eye on the shared captures; not measured."""

FACE_WORTH = 0.2
"""What a full vote of the face is worth [mean logarithm of the voxels' likelihoods]. Facing was
right in 40 frames of 40 that it was chosen on, and in 63 of 64 others."""

SUREST = 6
"""From how many of the frames whose facing is surest the color of skin is learned."""

SURE_FACING = 0.3
"""Margin of the facing from which a larger one is worth no more [mean logarithm of the voxels'
likelihoods]."""

HANDS_WORTH, BACKWARD_COST = 0.3, 0.5
"""What two hands on skin are worth, and what a foot costs that points backwards [mean logarithm of
the voxels' likelihoods]."""

TURNED_FOOT = 0.3
"""Cosine of the angle between a foot and the front of the hips below which it points backwards. 73
degrees; chosen by eye on the shared captures, not measured."""

HEIGHT_SHARES = (0.05, 99.98)
"""The lowest and the highest voxel of a performer [percentiles of the voxels' heights]."""

TALL = 90.0
"""Which of the heights of frames is the stature [percentile]."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A body of usual proportions in the frame that it fits best."""

    frame: int
    joints: dict[str, Floats]
    """(3,) by name, m."""
    stature_m: float
    """Of the body."""
    margin: float
    """How much likelier the voxels are, and the more a face, than with the body facing the other
    way [mean logarithm of the likelihoods]."""
    looked_at: tuple[int, ...]
    """The frames that the body was fitted to."""


@dataclass(frozen=True, eq=False)
class _Look:
    """A frame with the fit that faces the likelier way."""

    frame: int
    fit: Fit
    margin: float
    value: float = 0.0


def guess_body(shown: Shown, frames: Sequence[int], stature_m: float | None) -> Guess:
    """Return the body in the frame of some that it fits best.

    Parameters
    ----------
    shown
        The take.
    frames
        Those that may be looked at: each shows one whole person.
    stature_m
        The performer's height where it is known.
    """
    step = max(1, len(frames) // LOOKED_AT)
    chosen = [frames[n] for n in np.unique(np.linspace(0, len(frames) - 1, LOOKED_AT).astype(int))]
    stature_m = stature_m or _measure_stature(shown, frames[:: max(1, step // 2)])
    body = make_usual_body(stature_m)
    looks = side_by_side(lambda frame: _look(shown, frame, body), chosen)
    looks.sort(key=lambda look: -look.margin)
    skin = learn_skin(shown, body, [(look.frame, look.fit) for look in looks[:SUREST]])
    looks = side_by_side(lambda look: _with_hands(shown, look, body, skin), looks)
    best = max(looks, key=lambda look: look.value)
    return Guess(
        best.frame, body.place(best.fit.pose), stature_m, best.margin, tuple(chosen)
    )


def _measure_stature(shown: Shown, frames: Sequence[int]) -> float:
    """Return the height of nearly the tallest hull, m."""
    heights = [np.ptp(np.percentile(shown.points(n)[:, 1], HEIGHT_SHARES)) for n in frames]
    return float(np.percentile(heights, TALL))


def _look(shown: Shown, frame: int, body: UsualBody) -> _Look:
    """Return a frame with the fit that faces the likelier way."""
    ways = fit_both_ways(shown, frame, body)
    value = [
        way.likelihood + FACE_WORTH * vote_face(shown, frame, body, way.pose) for way in ways
    ]
    order = np.argsort(value)[::-1]
    margin = value[order[0]] - value[order[1]] if len(ways) > 1 else 0.0
    return _Look(frame, ways[order[0]], float(margin))


def _with_hands(
    shown: Shown, look: _Look, body: UsualBody, skin: NDArray[np.float64]
) -> _Look:
    """Return a look with its hands on skin, and what it is worth."""
    lumps = skin_lumps(shown, look.frame, body, look.fit.pose, skin)
    fit, hands = reach_lumps(shown, look.frame, body, look.fit, lumps)
    joints, front = body.place(fit.pose), forward(fit.pose)
    feet = [joints[side + "Foot"] - joints[side + "Heel"] for side in "RL"]
    backward = sum(float(f @ front) < TURNED_FOOT * float(np.linalg.norm(f)) for f in feet)
    value = fit.likelihood + min(look.margin, SURE_FACING)
    value += HANDS_WORTH * (hands == 2) - BACKWARD_COST * backward
    return replace(look, fit=fit, value=value)
