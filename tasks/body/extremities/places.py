"""Find face and hands in every frame of a take by one best path (digitization paper, 3.4.1).

The paper follows, from frame to frame, the skin-colored region nearest to the last one; a hand lost
once is lost for good. Here the whole take decides. Of all candidates of all frames the likeliest
path of both hands at once is taken (Viterbi 1967), so that hands that cross or clap keep their
sides. A hand may be unseen; then the path remembers where it was, and how long it may have been on
its way. A place's weight is how much the other paths, weighed with their likelihoods, agree with
the best one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.proportions import FACE_AHEAD
from tasks.body.anatomy.skin import (
    SkinModel,
    SurfaceFrame,
    check_joints,
    learn_skin,
)
from tasks.body.extremities.candidates import (
    Candidates,
    find_candidates,
    is_skin,
    measure_references,
)
from tasks.body.extremities.faces import follow_face, initial_places, lacking_skin
from tasks.body.extremities.feet import choose_feet, find_feet_of, learn_feet
from tasks.body.extremities.hair import hair_around, learn_hair
from tasks.body.extremities.paths import FARTHEST_ASIDE, PACE_HZ, best_paths
from tasks.body.extremities.settings import ExtremitySettings
from tasks.engine.threads import side_by_side

Floats = NDArray[np.float64]

SURELY_AWAY = 2.0
"""How far from the face a lump surely is not the face itself [`at_face_within`]. Chosen by eye on
the shared captures; not measured."""


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

    feet_exchanged: bool = False
    """Whether the initial model has the feet for each other, by what they do in the whole take."""


def find_extremities(
    frames: Sequence[SurfaceFrame],
    rate_hz: float,
    stature_m: float,
    joints: Mapping[str, NDArray[np.float64]],
    *,
    initial_frame: int = 0,
    exchange_cost: Callable[[], float] | None = None,
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
    exchange_cost
        Tells what it costs that the feet have each other's sides there, as for `choose_feet`.
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
    ball_m = settings.candidates.head_ball * stature_m
    hair = learn_hair([(frame, is_skin(frame, model)) for frame in shown], start[0], ball_m)

    def find(t: int) -> tuple[Candidates, tuple[Floats, Floats]]:
        frame, none = frames[t], (np.empty((0, 3)), np.empty(0))
        stood = find_feet_of(frame, feet, stature_m, settings.feet) if feet else none
        found = find_candidates(frame, model, references, stature_m, settings.candidates)
        if hair:
            there = settings.enough_hair * hair_around(frame, found.face, hair, ball_m)
            found = replace(found, face_bare=hair.known * (1.0 - np.minimum(there, 1.0)))
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
    foot, foot_weight, exchanged = choose_feet(
        [stood for _, stood in both], feet, chosen.position[:, 0], chosen.facing, rate_hz,
        stature_m, initial_frame, settings.feet, exchange_cost,
    )  # fmt: skip
    return replace(chosen, foot=foot, foot_weight=foot_weight, feet_exchanged=exchanged)


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
    at, facing, face_weight = follow_face(
        candidates, model, rate_hz, stature_m, start[0],
        initial_frame=initial_frame, settings=settings,
    )  # fmt: skip
    face = at / stature_m
    spot = [c.hand / stature_m for c in candidates]
    hand_cost = _hand_costs(
        candidates, spot, (face, facing), start, joints, stature_m, model, settings
    )
    sided = _side_costs(spot, face, facing, settings)
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
        np.concatenate([face[:, None], hands], axis=1) * stature_m,
        facing,
        np.concatenate([face_weight, hand_weight], axis=1) * known,
        np.full((len(spot), 2, 3), np.nan),
        np.zeros((len(spot), 2)),
        tuple(candidates),
        tuple(hand_ends(candidates, settings)),
        tuple(hand_cost),
        model,
    )


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
            known * lacking_skin(frame.hand_skin, settings)
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
