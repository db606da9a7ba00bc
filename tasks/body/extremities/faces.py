"""The face's path through a take, and where it looks: the first of what `places` finds."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.proportions import FACE_AHEAD, FACE_BELOW_TOP
from tasks.body.anatomy.skin import SkinModel, find_hands
from tasks.body.extremities.candidates import Candidates
from tasks.body.extremities.paths import PACE_HZ, best_paths
from tasks.body.extremities.settings import ExtremitySettings

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


def follow_face(
    candidates: Sequence[Candidates],
    model: SkinModel,
    rate_hz: float,
    stature_m: float,
    start: Floats,
    *,
    initial_frame: int,
    settings: ExtremitySettings,
) -> tuple[Floats, Floats, Floats]:
    """Return where the face is in each frame, where it looks, and how sure that is.

    Parameters
    ----------
    candidates
        A frame each.
    model
        What color skin has, and how well it tells.
    rate_hz
        Frames a second.
    stature_m
        The performer's height.
    start
        (3,) where the face is in the initial frame, statures.
    initial_frame, settings
        As of `places.find_extremities`.

    Returns
    -------
    face : (time, 3) float64
        Metres; NaN where it is not seen.
    facing : (time, 3) float64
        Where the head faces, horizontally; the longer the vector the surer.
    weight : (time, 1) float64
        How much the other paths agree, 0 to 1.
    """
    pace = PACE_HZ / rate_hz
    spot = [c.face / stature_m for c in candidates]
    usual = _usual_end(candidates[initial_frame], start * stature_m)
    price = [_face_cost(c, usual, model, settings) * pace for c in candidates]
    face, weight, _ = best_paths(
        (spot, [np.empty((0, 3))] * len(spot)),
        (price, [np.empty(0)] * len(spot)),
        (start, np.full(3, np.nan)),
        initial_frame,
        1.0 / rate_hz,
        settings.face_motion,
        (settings.unseen * pace, 0.0),
    )
    at = _above_necks(candidates, face[:, 0] * stature_m, initial_frame, stature_m, settings)
    return at, _facing(candidates, at, settings), weight[:, :1]


def initial_places(joints: Mapping[str, NDArray[np.float64]], stature_m: float) -> Floats:
    """Return (3, 3) where face, right and left hand are in the initial model, in metres."""
    neck, head = np.asarray(joints["Neck"]), np.asarray(joints["Head"])
    front = np.cross(np.subtract(joints["LShoulder"], joints["RShoulder"]), head - neck)
    front = front / max(float(np.linalg.norm(front)), 1e-9)
    face = FACE_BELOW_TOP * neck + (1.0 - FACE_BELOW_TOP) * head + FACE_AHEAD * stature_m * front
    return np.stack([face, *((a + b) / 2.0 for a, b in find_hands(joints, stature_m))])


def lacking_skin(skin: Floats, settings: ExtremitySettings) -> Floats:
    """Return (candidate,) what each place costs for showing less skin than in the initial model."""
    none = 1.0 - np.clip(skin / settings.some_skin, 0.0, 1.0)
    return settings.no_skin * none + settings.little_skin * (1.0 - np.clip(skin, 0.0, 1.0))


def _face_cost(
    candidates: Candidates, usual: float, model: SkinModel, settings: ExtremitySettings
) -> Floats:
    """Return (face candidate,) what each place costs the face."""
    nearer = np.log(max(usual, 1e-9)) - np.log(np.maximum(candidates.face_end, 1e-9))
    like_hand = (nearer - settings.usual_end) / (NEAR_AS_HAND - settings.usual_end)
    lacking = lacking_skin(candidates.face_skin, settings)
    like_hand = settings.like_hand * np.clip(like_hand, 0.0, 1.0)
    bare = settings.no_hair * candidates.face_bare
    return model.face_separability * (lacking + like_hand + bare)


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
