"""Find face and hands in every frame of a take by one best path (digitization paper, 3.4.1).

The paper follows, from frame to frame, the skin-colored region nearest to the last one; a hand lost
once is lost for good. Here the whole take decides. Of all candidates of all frames the likeliest
path of both hands at once is taken (Viterbi 1967), so that hands that cross or clap keep their
sides. A hand may be unseen; then the path remembers where it was, and how long it may have been on
its way. A place's weight is how much the other paths, weighed with their likelihoods, agree with
the best one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.proportions import FACE_AHEAD, FACE_BELOW_TOP
from tasks.body.anatomy.skin import (
    SkinModel,
    SkinSettings,
    SurfaceFrame,
    check_joints,
    find_hands,
    learn_skin,
)
from tasks.body.extremities.candidates import (
    Candidates,
    CandidateSettings,
    find_candidates,
    measure_references,
)
from tasks.body.extremities.feet import FootSettings, choose_feet, find_feet_of, learn_feet
from tasks.body.extremities.paths import FARTHEST_ASIDE, PACE_HZ, Motion, best_paths
from tasks.engine.settings import NotNegative, Positive, check_ranges
from tasks.engine.threads import side_by_side

Floats = NDArray[np.float64]

BESIDE = 2.0
"""How far from a face another place is looked at that may be the face instead [distances of the
first face from its end]. Chosen by eye on the shared captures; not measured."""

LEAST_FACE = 0.5
"""Skin that such a place must have [as of the face]. Chosen by eye on the shared captures; not
measured."""

NEAR_AS_HAND = 0.6
"""How much nearer an end a hand is than a face [logarithm of the ratio]. It is half as far from its
finger tips as a face from the top of the head."""

SURELY_AWAY = 2.0
"""How far from the face a lump surely is not the face itself [`at_face_within`]. Chosen by eye on
the shared captures; not measured."""

FACE_SPEED = 0.6
"""Typical speed of a face [statures a second]. Less than of a hand; chosen by eye on the shared
captures, not measured."""

FACE_FASTEST = 4.0
"""The most a face moves [statures a second]. Less than a hand; chosen by eye on the shared
captures, not measured."""


@dataclass(frozen=True)
class ExtremitySettings:
    """Everything that changes where hands, face and feet are found; lengths in statures.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    skin: SkinSettings = field(default_factory=SkinSettings)
    """How the color of skin is learned."""
    candidates: CandidateSettings = field(default_factory=CandidateSettings)
    """Where hands and face could be."""
    feet: FootSettings = field(default_factory=FootSettings)
    """How feet are found."""
    hand_motion: Motion = field(default_factory=Motion)
    """How hands move."""
    face_motion: Motion = field(
        default_factory=lambda: Motion(speed=FACE_SPEED, fastest=FACE_FASTEST)
    )
    """How faces move. More slowly than hands; chosen by eye on the shared captures, not
    measured."""

    learn_s: NotNegative = 0.1
    """How near the initial frame the frames are from which skin is learned. The arms are still held
    there."""

    unseen: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which a hand or the face is not seen [nats]. Chosen by eye on
    the shared captures; not measured."""

    no_skin: NotNegative = 3.0
    """Cost of a frame (at 30 Hz) in which a hand is where no skin is, if hands differ from clothes
    [nats]. Chosen by eye on the shared captures; not measured."""

    some_skin: Positive = 0.25
    """Skin of a place from which `no_skin` costs nothing [as of the initial hand]. The rest may
    hide in a sleeve."""

    little_skin: NotNegative = 0.7
    """Cost, on top, of a hand of which nothing is seen [nats]. Half a hand costs half of it; chosen
    by eye on the shared captures, not measured."""

    no_end: NotNegative = 0.3
    """Cost of a frame (at 30 Hz) in which a hand is not an end of the surface [nats]. It grows as
    skin says less; chosen by eye on the shared captures, not measured."""

    usual_end: Positive = 0.22
    """How much the distance of a face from the top of the head may change [logarithm of the ratio
    to the first]. A neck is farther from it."""

    like_hand: NotNegative = 1.0
    """Cost of a frame (at 30 Hz) in which a face is as near an end of the surface as a hand is
    [nats]. With less than 1 a hand raised before the forehead was taken for the face in one of 26
    rendered captures, with 2 a face for a hand in another; in between nothing changed."""

    together: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which both hands are one lump [nats]. As of one unseen, for one
    lump is no evidence of two hands. From there on more changes nothing."""

    at_face: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which a hand is where the face or the throat is [nats]. They
    are skin without it; chosen by eye on the shared captures, not measured."""

    at_face_within: Positive = 0.06
    """How near the face a lump may well be the face itself [statures]. Half a head's depth; at
    twice that it surely is not."""

    at_neck_within: Positive = 0.037
    """How near the line from the middle of the head down to the base of the neck a lump may well be
    the neck's skin [statures]. Half a neck's depth; at twice that it surely is not. Of a rendered
    child the nape was taken for a hand for 40 frames; of 4000 hands of rendered captures that were
    right 1 in 160 came within 6 hundredths."""

    side: NotNegative = 0.07
    """Cost of a frame (at 30 Hz) in which a hand is as far on the other side as hands typically are
    on their own [nats]. Taken alone, it would be 2: but what a frame says of sides, the next
    repeats. With 0.2 arms that were crossed for two seconds were exchanged; of 45 rendered captures
    0.07 exchanged the hands of none where 0.2 did not."""

    typical_side: Positive = 0.13
    """How far to its side a hand typically is [statures]. Of twelve generated takes, the median."""

    plain_front: Positive = 0.015
    """How far skin lies before the middle of a head that surely faces there [statures]. Half as
    much is believed half; chosen by eye on the shared captures, not measured."""

    reach_slack: Positive = 0.06
    """How much farther from the neck than the outstretched hand was a hand may be before it costs
    [statures]. Shoulders rise, and the neck is known from the face only."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class Extremities:
    """Where face and hands are."""

    position: Floats
    """(time, 3, 3) metres, of face, right and left hand; NaN where unseen. A hand's place is the
    middle of what is seen of it, a face's the middle of its skin, before the head's."""

    facing: Floats
    """(time, 3) where the head faces, horizontally; NaN where the face is unseen. The vector is
    from 0 to 1 long, the longer the surer."""

    weight: Floats
    """(time, 3) from 0 to 1: how likely the place is right; 0 where unseen."""

    foot: Floats
    """(time, 2, 3) metres, the middle of what is seen of the right and the left foot."""

    foot_weight: Floats
    """(time, 2) from 0 to 1, as `weight`."""

    candidates: tuple[Candidates, ...]
    """The places of each frame that were chosen from."""

    hand_ends: tuple[Floats, ...]
    """(place, 3) a frame: metres, the candidates that are ends or look like a hand."""

    hand_cost: tuple[Floats, ...]
    """(candidate,) a frame: nats that each place costs a hand by itself; smaller is likelier."""

    model: SkinModel
    """What color skin has in this take."""


def find_extremities(
    frames: Sequence[SurfaceFrame],
    rate_hz: float,
    stature_m: float,
    joints: Mapping[str, NDArray[np.float64]],
    *,
    initial_frame: int = 0,
    settings: ExtremitySettings | None = None,
) -> Extremities:
    """Return where face, hands and feet are in every frame of a take.

    Parameters
    ----------
    frames
        The take's colored surfaces; each is asked for twice at most, so they may be made when
        they are asked for. Frames may be empty.
    rate_hz
        Frames a second.
    stature_m
        The performer's height.
    joints : mapping of (3,) float64
        The initial model: metres, by the names of the archive; `skin.SKIN_JOINTS` are used.
    initial_frame
        The frame that the initial model is of; the hands' sides are decided there.
    settings
        How skin is learned, and paths are weighed.

    Raises
    ------
    ValueError
        If there is no frame, a joint is missing, the initial frame is not in the take, or rate
        or stature are not positive.
    """
    settings = settings or ExtremitySettings()
    check_joints(joints, stature_m)
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise ValueError(f"rate_hz {rate_hz} must be positive; give frames a second")
    if not 0 <= initial_frame < len(frames):
        raise ValueError(
            f"initial_frame {initial_frame} is not one of the take's {len(frames)} frames; give "
            "the frame that the initial model is of"
        )
    near = int(settings.learn_s * rate_hz)
    shown = [
        frames[t]
        for t in range(max(initial_frame - near, 0), min(initial_frame + near + 1, len(frames)))
    ]
    model = learn_skin(shown, joints, stature_m, settings.skin)
    start = initial_places(joints, stature_m)
    references = measure_references(
        shown, model, start[1:], start[0], stature_m, settings.candidates
    )

    feet = learn_feet(shown, joints, stature_m, settings.feet)

    def find(t: int) -> tuple[Candidates, tuple[Floats, Floats]]:
        frame, none = frames[t], (np.empty((0, 3)), np.empty(0))
        stood = find_feet_of(frame, feet, stature_m, settings.feet) if feet else none
        found = find_candidates(frame, model, references, stature_m, settings.candidates)
        return found, stood

    both = side_by_side(find, range(len(frames)))
    chosen = choose_extremities(
        tuple(found for found, _ in both),
        model,
        rate_hz,
        stature_m,
        joints,
        initial_frame=initial_frame,
        settings=settings,
    )
    if feet is None:
        return chosen
    foot, foot_weight = choose_feet(
        [stood for _, stood in both], feet, chosen.position[:, 0], chosen.facing, rate_hz,
        stature_m, initial_frame, settings.feet,
    )  # fmt: skip
    return replace(chosen, foot=foot, foot_weight=foot_weight)


def hand_ends(candidates: Sequence[Candidates], settings: ExtremitySettings) -> list[Floats]:
    """Return the candidates (place, 3), m, of each frame that are ends or look like a hand."""
    return [c.hand[c.hand_end | (c.hand_skin >= settings.some_skin)] for c in candidates]


def choose_extremities(
    candidates: Sequence[Candidates],
    model: SkinModel,
    rate_hz: float,
    stature_m: float,
    joints: Mapping[str, NDArray[np.float64]],
    *,
    initial_frame: int,
    settings: ExtremitySettings,
) -> Extremities:
    """Return which candidates of all frames are face and hands; the feet are left unseen.

    Parameters
    ----------
    candidates
        A frame each.
    model
        What color skin has, and how well it tells.
    rate_hz, stature_m, joints, initial_frame, settings
        As of `find_extremities`.
    """
    start = initial_places(joints, stature_m) / stature_m
    pace = PACE_HZ / rate_hz
    spot = [c.face / stature_m for c in candidates]
    usual = _usual_end(candidates[initial_frame], start[0] * stature_m)
    price = [_face_cost(c, usual, model, settings) * pace for c in candidates]
    face, face_weight, _ = best_paths(
        (spot, [np.empty((0, 3))] * len(spot)),
        (price, [np.empty(0)] * len(spot)),
        (start[0], np.full(3, np.nan)),
        initial_frame,
        1.0 / rate_hz,
        settings.face_motion,
        (settings.unseen * pace, 0.0),
    )
    at = _above_necks(candidates, face[:, 0] * stature_m, initial_frame, stature_m, settings)
    face[:, 0] = at / stature_m
    facing = _facing(candidates, at, settings)
    spot = [c.hand / stature_m for c in candidates]
    hand_cost = _hand_costs(
        candidates, spot, (face[:, 0], facing), start, joints, stature_m, model, settings
    )
    sided = _side_costs(spot, face[:, 0], facing, settings)
    hands, hand_weight, _ = best_paths(
        (spot, spot),
        (
            [(cost + aside) * pace for cost, aside in zip(hand_cost, sided, strict=True)],
            [(cost - aside) * pace for cost, aside in zip(hand_cost, sided, strict=True)],
        ),
        (start[1], start[2]),
        initial_frame,
        1.0 / rate_hz,
        settings.hand_motion,
        (settings.unseen * pace, settings.unseen * pace),
        together=settings.together * pace,
    )
    known = np.array([model.face_separability, model.hand_separability, model.hand_separability])
    return Extremities(
        np.concatenate([face[:, :1], hands], axis=1) * stature_m,
        facing,
        np.concatenate([face_weight[:, :1], hand_weight], axis=1) * known,
        np.full((len(spot), 2, 3), np.nan),
        np.zeros((len(spot), 2)),
        tuple(candidates),
        tuple(hand_ends(candidates, settings)),
        tuple(hand_cost),
        model,
    )


def initial_places(joints: Mapping[str, NDArray[np.float64]], stature_m: float) -> Floats:
    """Return (3, 3) where face, right and left hand are in the initial model, in metres."""
    neck, head = np.asarray(joints["Neck"]), np.asarray(joints["Head"])
    front = np.cross(np.subtract(joints["LShoulder"], joints["RShoulder"]), head - neck)
    front = front / max(float(np.linalg.norm(front)), 1e-9)
    face = FACE_BELOW_TOP * neck + (1.0 - FACE_BELOW_TOP) * head + FACE_AHEAD * stature_m * front
    return np.stack([face, *((a + b) / 2.0 for a, b in find_hands(joints, stature_m))])


def _face_cost(
    candidates: Candidates, usual: float, model: SkinModel, settings: ExtremitySettings
) -> Floats:
    """Return (face candidate,) what each place costs the face."""
    nearer = np.log(max(usual, 1e-9)) - np.log(np.maximum(candidates.face_end, 1e-9))
    like_hand = (nearer - settings.usual_end) / (NEAR_AS_HAND - settings.usual_end)
    lacking = _lacking(candidates.face_skin, settings)
    return model.face_separability * (lacking + settings.like_hand * np.clip(like_hand, 0.0, 1.0))


def _usual_end(candidates: Candidates, face: Floats) -> float:
    """Return how far the face of the initial frame is from an end of the surface, statures.

    0 where there is none, so that nothing is nearer.
    """
    if not len(candidates.face):
        return 0.0
    usual = candidates.face_end[_nearest_to(candidates.face, face)]
    return float(usual) if np.isfinite(usual) else 0.0


def _above_necks(
    candidates: Sequence[Candidates],
    face: Floats,
    initial_frame: int,
    stature_m: float,
    settings: ExtremitySettings,
) -> Floats:
    """Return (time, 3) the faces, with necks replaced by the faces above them.

    A neck shows skin, also from behind. It is farther from an end of the surface, the top of the
    head, than the face was in the initial frame. It is replaced by the most skin-colored place
    beside it that is as far from the end as the face was.
    """
    first, seen = candidates[initial_frame], np.isfinite(face[:, 0])
    if not seen[initial_frame]:
        return face
    usual = first.face_end[_nearest_to(first.face, face[initial_frame])]
    if not np.isfinite(usual):
        return face
    moved = face.copy()
    for t in np.flatnonzero(seen).tolist():
        frame = candidates[t]
        own, share = _nearest_to(frame.face, face[t]), frame.face_end / usual
        beside = np.linalg.norm(frame.face - face[t], axis=1) < BESIDE * usual * stature_m
        fits = beside & (np.abs(np.log(share)) < settings.usual_end)
        fits &= frame.face_skin > LEAST_FACE * frame.face_skin[own]
        if share[own] > 1.0 and fits.any() and not fits[own]:
            moved[t] = frame.face[np.argmax(np.where(fits, frame.face_skin, -1.0))]
    return moved


def _nearest_to(places: Floats, place: Floats) -> int:
    """Return which of some places (place, 3) is the nearest to one."""
    return int(np.argmin(np.linalg.norm(places - place, axis=1)))


def _lacking(skin: Floats, settings: ExtremitySettings) -> Floats:
    """Return (candidate,) what each place costs for showing less skin than in the initial model."""
    none = 1.0 - np.clip(skin / settings.some_skin, 0.0, 1.0)
    return settings.no_skin * none + settings.little_skin * (1.0 - np.clip(skin, 0.0, 1.0))


def _facing(candidates: Sequence[Candidates], face: Floats, settings: ExtremitySettings) -> Floats:
    """Return (time, 3) where the head faces, horizontally; the longer the vector the surer."""
    facing = np.full(face.shape, np.nan)
    for t, (frame, place) in enumerate(zip(candidates, face, strict=True)):
        if np.isnan(place[0]):
            continue
        front = frame.face_front[_nearest_to(frame.face, place)] * [1.0, 0.0, 1.0]
        length = float(np.linalg.norm(front))
        facing[t] = front / max(length, settings.plain_front)
    return facing


def _hand_costs(
    candidates: Sequence[Candidates],
    place: Sequence[Floats],
    head: tuple[Floats, Floats],
    start: Floats,
    joints: Mapping[str, NDArray[np.float64]],
    stature_m: float,
    model: SkinModel,
    settings: ExtremitySettings,
) -> list[Floats]:
    """Return for each frame (candidate,) what each place costs either hand.

    `head` are where the face is, statures, and where it looks.
    """
    face, facing = head
    below = np.asarray(joints["Neck"]) / stature_m - start[0]
    arm = float(np.linalg.norm(start[1:] - start[0] - below, axis=1).mean())
    known = model.hand_separability
    no_end = settings.no_end + (1.0 - known) * settings.no_skin
    costs = []
    inside = np.nan_to_num(-FACE_AHEAD * facing)
    for frame, spot, seen, back in zip(
        candidates, place, _carry_on(face, start[0]), inside, strict=True
    ):
        along = np.clip((spot - seen)[:, 1:2], below[1], 0.0) * (0.0, 1.0, 0.0)
        at_face = SURELY_AWAY - np.minimum(
            np.linalg.norm(spot - seen, axis=1) / settings.at_face_within,
            np.linalg.norm(spot - seen - back - along, axis=1) / settings.at_neck_within,
        )
        reach = np.linalg.norm(spot - seen - below, axis=1)
        beyond = np.maximum(reach - arm - settings.reach_slack, 0.0) / settings.reach_slack
        costs.append(
            known * _lacking(frame.hand_skin, settings)
            + no_end * ~frame.hand_end
            + settings.at_face * np.clip(at_face, 0.0, 1.0)
            + beyond**2
        )
    return costs


def _side_costs(
    place: Sequence[Floats], face: Floats, facing: Floats, settings: ExtremitySettings
) -> list[Floats]:
    """Return for each frame (candidate,) what a side costs the right hand and gains the left."""
    costs = []
    for spot, seen, front in zip(place, face, facing, strict=True):
        left = np.array([front[2], 0.0, -front[0]])  # of who looks there, y up
        aside = (spot - seen) @ left / settings.typical_side
        costs.append(settings.side * np.clip(np.nan_to_num(aside), -FARTHEST_ASIDE, FARTHEST_ASIDE))
    return costs


def _carry_on(position: Floats, start: Floats) -> Floats:
    """Return (time, 3) the positions, with the last one seen where there is none."""
    carried, last = position.copy(), start
    for t in range(len(carried)):
        last = carried[t] = last if np.isnan(carried[t, 0]) else carried[t]
    return carried
