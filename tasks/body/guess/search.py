"""Guess the joints of a take in which nobody stretches the arms.

A body of usual proportions is fitted to some frames, each by itself. Facing is told by the
likelihood of the voxels and by the color of the face, hands by the colors that the faces have. From
the frame that all of this fits best the body is followed through the frames around it, and so are
the bodies that the voxels of a few frames make. Each of these errs in its own way: the joints that
are given back are where most of them say. Where the frames that were fitted by themselves differ
from that, the guess is unsure.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.body.anatomy.bones import BONE_NUMBER, Floats
from tasks.body.blobs.fitting import Fit
from tasks.body.guess.single_frames import Shown, fit_both_ways, forward
from tasks.body.guess.skin import learn_skin, reach_lumps, skin_lumps, vote_face
from tasks.body.guess.tracks import follow_measured_body, follow_usual_body
from tasks.body.guess.usual_body import UsualBody, make_usual_body
from tasks.engine.progress import within
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

HANDS_WORTH = 0.3
"""What two hands on skin are worth [mean logarithm of the voxels' likelihoods]. Chosen by eye on
the shared captures; not measured."""

BACKWARD_COST = 0.5
"""What a foot costs that points backwards [mean logarithm of the voxels' likelihoods]. Chosen by
eye on the shared captures; not measured."""

TURNED_FOOT = 0.3
"""Cosine of the angle between a foot and the front of the hips below which it points backwards. 73
degrees; chosen by eye on the shared captures, not measured."""

HEIGHT_SHARES = (0.05, 99.98)
"""The lowest and the highest voxel of a performer [percentiles of the voxels' heights]."""

TALL = 90.0
"""Which of the heights of frames is the stature [percentile]."""

CLOSE_FITTING = 3.15
"""Likelihood of the voxels from which clothes fit closely [mean logarithm]. It was 3.2 to 3.8 in
captures with close-fitting clothes, 1.9 to 3.1 with a kimono."""

CROUCHING = 1.05
"""How much more the stature is than the height of a dancing performer [factor]. In twenty captures
the median is 1.05, with 0.99 to 1.17. Where clothes are loose, a body of the height fits better:
they are counted as the body's."""

MOST_FOLLOWED = 100
"""Through how many frames bodies are followed at most. With 100 it takes as long as to look at the
frames."""

MEASURED = 3
"""In how many frames the body is measured besides. Chosen, not measured: more take longer."""

NEARLY = 1.25
"""How much farther from where most bodies go the body of a better frame may go [factor]. Chosen by
eye on the shared captures; not measured."""

DISTANCE_COST = 10.0
"""What it costs a frame to differ from what was followed [1/m, mean over the joints]. A decimeter
counts as much as the best frame is better than a bad one; chosen by eye on the shared captures, not
measured."""

SKULL_RADIUS = 0.09
"""How far from its line a voxel is the head's [statures]. A head's breadth and half, for the line
may be off; chosen by eye on the shared captures, not measured."""

TOP_WITHIN = 0.06
"""How far above and below the top of the usual head the top is looked for [statures]. Chosen by eye
on the shared captures; not measured."""

UPRIGHT = 0.7
"""Cosine of the angle of the head's line to the vertical from which a head is upright. 45 degrees;
chosen by eye on the shared captures, not measured."""

CAP = 0.03
"""How far below its top the voxels are whose middle is the top of a head [statures]. Chosen by eye
on the shared captures; not measured."""

HAND_AROUND = 0.06
"""How far from wrist and finger tip a voxel is a hand's, not the head's [statures]. Half a hand's
length; chosen by eye on the shared captures, not measured."""

HIGHEST = 99.0
"""Which of the heights of the head's voxels is its top [percentile]. The rest may be stray."""

SURE = 0.9
"""Confidence of a guess that all frames agree on [share]. With `UNSURE` it is 0.6 at a distance of
0.05 statures: of twelve captures, five of six that lost limbs were farther apart, none of six that
lost hardly any."""

UNSURE = 6.0
"""How much the confidence falls with the distance of the frames [1/stature]. See `SURE`."""

MOST_CONFIDENCE = 0.8
"""Confidence of a guess at most: proportions are not those of the performer."""


@dataclass(frozen=True, eq=False)
class Guess:
    """The joints of a body in a frame, guessed from several."""

    frame: int
    joints: dict[str, Floats]
    """(3,) by name, m, in that frame."""
    looked_at: tuple[int, ...]
    """The frames that the body was fitted to."""
    margin: float
    """How much likelier the voxels are, and the more a face, than with the body facing the other
    way [mean logarithm of the likelihoods]: the median of the frames."""
    apart_m: float
    """How far joints of frames that were fitted by themselves are from where they were followed to,
    m: the median of the frames."""
    confidence: float
    """0 to 1."""


@dataclass(frozen=True, eq=False)
class _Look:
    """A frame with the fit that faces the likelier way."""

    frame: int
    fit: Fit
    margin: float
    value: float = 0.0


def guess_body(
    shown: Shown, rate_hz: float, frames: Sequence[int], stature_m: float | None
) -> Guess:
    """Return the joints of a body in the frame of some that it fits best.

    Parameters
    ----------
    shown
        The take.
    rate_hz
        Frames a second.
    frames
        Those that may be looked at: each shows one whole person.
    stature_m
        The performer's height where it is known.
    """
    chosen = [frames[n] for n in np.unique(np.linspace(0, len(frames) - 1, LOOKED_AT).astype(int))]
    height_m = stature_m or _measure_height(shown, frames)
    body = make_usual_body(height_m)
    with within(0.0, 0.5):
        looks = side_by_side(lambda frame: _look(shown, frame, body), chosen)
    looks.sort(key=lambda look: -look.margin)
    skin = learn_skin(shown, body, [(look.frame, look.fit) for look in looks[:SUREST]])
    with within(0.5, 0.6):
        looks = side_by_side(lambda look: _with_hands(shown, look, body, skin), looks)
    looks.sort(key=lambda look: -look.value)
    if stature_m is None and np.median([look.fit.likelihood for look in looks]) > CLOSE_FITTING:
        body = make_usual_body(CROUCHING * height_m)
    body = body.with_head(_top_of_head(shown, body, looks[: len(looks) // 2 + 1]))
    first = max(0, min(looks[0].frame - MOST_FOLLOWED // 2, len(shown.hulls) - MOST_FOLLOWED))
    part = shown.part(first, min(len(shown.hulls), first + MOST_FOLLOWED))
    near = [replace(look, frame=look.frame - first) for look in looks]
    near = [look for look in near if 0 <= look.frame < len(part.hulls)]
    with within(0.6, 1.0):
        frame, joints, position = _follow(part, rate_hz, near, body, stature_m)
    apart_m = float(np.median(_distances(near, body, position)))
    confidence = min(MOST_CONFIDENCE, max(0.0, SURE - UNSURE * apart_m / body.stature_m))
    return Guess(
        first + frame,
        joints,
        tuple(sorted(chosen)),
        float(np.median([look.margin for look in looks])),
        apart_m,
        confidence,
    )


def _measure_height(shown: Shown, frames: Sequence[int]) -> float:
    """Return the height of nearly the tallest hull, m."""
    some = frames[:: max(1, len(frames) // (2 * LOOKED_AT))]
    heights = [np.ptp(np.percentile(shown.points(n)[:, 1], HEIGHT_SHARES)) for n in some]
    return float(np.percentile(heights, TALL))


def _look(shown: Shown, frame: int, body: UsualBody) -> _Look:
    """Return a frame with the fit that faces the likelier way."""
    ways = fit_both_ways(shown, frame, body)
    value = [way.likelihood + FACE_WORTH * vote_face(shown, frame, body, way.pose) for way in ways]
    order = np.argsort(value)[::-1]
    margin = value[order[0]] - value[order[1]] if len(ways) > 1 else 0.0
    return _Look(frame, ways[order[0]], float(margin))


def _with_hands(shown: Shown, look: _Look, body: UsualBody, skin: NDArray[np.float64]) -> _Look:
    """Return a look with its hands on skin, and what it is worth."""
    lumps = skin_lumps(shown, look.frame, body, look.fit.pose, skin)
    fit, hands = reach_lumps(shown, look.frame, body, look.fit, lumps)
    joints, front = body.place(fit.pose), forward(fit.pose)
    feet = [joints[side + "Foot"] - joints[side + "Heel"] for side in "RL"]
    backward = sum(float(f @ front) < TURNED_FOOT * float(np.linalg.norm(f)) for f in feet)
    value = fit.likelihood + min(look.margin, SURE_FACING)
    value += HANDS_WORTH * (hands == 2) - BACKWARD_COST * backward
    return replace(look, fit=fit, value=value)


def _top_of_head(shown: Shown, body: UsualBody, looks: Sequence[_Look]) -> Floats:
    """Return (3,) where the top of the head is, in the pose that the body stands in, m."""
    head, neck, stature = body.joints["Head"], body.joints["Neck"], body.stature_m
    found = []
    for look in looks:
        pose = look.fit.pose
        at = body.place(pose)["Neck"]
        point = (shown.points(look.frame) - at) @ pose.rotation[BONE_NUMBER["Head"]] + neck
        own = np.hypot(*(point - head)[:, [0, 2]].T) < SKULL_RADIUS * stature
        own &= abs(point[:, 1] - head[1]) < TOP_WITHIN * stature
        if own.sum() > 0:
            top = float(np.percentile(point[own, 1], HIGHEST))
            cap = own & (point[:, 1] > top - TOP_WITHIN / 2 * stature)
            middle = point[cap].mean(axis=0)
            found.append([middle[0], top + shown.grid.voxel_m / 2, middle[2]])
    return np.median(found, axis=0) if found else head


def _follow(
    part: Shown,
    rate_hz: float,
    looks: Sequence[_Look],
    body: UsualBody,
    stature_m: float | None,
) -> tuple[int, dict[str, Floats], Floats]:
    """Return a frame, joints there whose body goes where most do, and (time, 21, 3) where that is.

    The bodies that are followed first tell where the joints of the bodies are that come after.
    """
    with within(0.0, 0.3):
        usual = follow_usual_body(part, rate_hz, looks[0].frame, looks[0].fit.pose, body)
    away = _distances(looks, body, usual)
    value = np.array([look.value for look in looks]) - DISTANCE_COST * away
    best = [looks[n].frame for n in np.argsort(-value, kind="stable")[:MEASURED]]

    joints = [dict(zip(JOINTS, usual[frame], strict=True)) for frame in best]
    joints = [_with_head(part, *each, body.stature_m) for each in zip(best, joints, strict=True)]
    for share in (0.3, 0.65):
        with within(share, share + 0.35):
            tracks = side_by_side(
                lambda n, joints=joints: follow_measured_body(
                    part, rate_hz, best[n], joints[n], stature_m
                ),
                range(len(best)),
            )
        position = np.median([usual, *(track.position for track in tracks)], axis=0)
        off = [np.linalg.norm(track.position - position, axis=2).mean() for track in tracks]
        chosen = int(np.argmax(off <= NEARLY * np.min(off)))  # the first was best by itself
        result = best[chosen], joints[chosen], position
        joints = [
            _with_head(part, track.frame, track.moved_to(position), body.stature_m)
            for track in tracks
        ]
    return result


def _with_head(
    part: Shown, frame: int, joints: dict[str, Floats], stature_m: float
) -> dict[str, Floats]:
    """Return joints with the top of an upright head in the middle of the hull's top there.

    A body without a face tells badly how its head is tilted.
    """
    neck, head, point = joints["Neck"], joints["Head"], part.points(frame)
    line = (head - neck) / np.linalg.norm(head - neck)
    along = (point - neck) @ line
    away = np.linalg.norm(point - neck - along[:, None] * line, axis=1)
    own = (away < SKULL_RADIUS * stature_m) & (along > np.linalg.norm(head - neck) / 2)
    for hand in (joints[side + name] for side in "RL" for name in ("Wrist", "Fin")):
        own &= np.linalg.norm(point - hand, axis=1) > HAND_AROUND * stature_m
    if line[1] < UPRIGHT or not own.any():
        return joints
    top = float(np.percentile(point[own, 1], HIGHEST))
    middle = point[own & (point[:, 1] > top - CAP * stature_m)].mean(axis=0)
    placed = np.array([middle[0], top + part.grid.voxel_m / 2, middle[2]])
    if np.linalg.norm(placed - head) > SKULL_RADIUS * stature_m:
        return joints
    return {**joints, "Head": placed}


def _distances(looks: Sequence[_Look], body: UsualBody, position: Floats) -> Floats:
    """Return (look,) how far joints are from where they are in other poses, m, their mean."""
    own = np.array([list(body.place(look.fit.pose).values()) for look in looks])
    other = position[[look.frame for look in looks]]
    return np.linalg.norm(own - other, axis=2).mean(axis=1)
