"""Feet found by their colors, below what hides the legs."""

import numpy as np
import pytest

from storage.schema import NO_CAMERA
from tasks.body.anatomy.skin import SurfaceFrame
from tasks.body.extremities.feet import (
    FootSettings,
    _find_low,
    _still_around,
    choose_feet,
    find_feet_of,
    learn_feet,
)

STATURE, RATE_HZ = 1.6, 30.0
SETTINGS = FootSettings()
SKIRT, WHITE = (80, 20, 90), (225, 225, 220)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def ball(rng, middle, radii, count):
    way = rng.normal(size=(count, 3))
    return np.array(middle) + way / np.linalg.norm(way, axis=1)[:, None] * radii


def dancer(rng, right, left, *, feet=WHITE, hidden=()):
    """A cone of cloth over two feet, whose middles are given."""
    height = rng.uniform(0.12, 1.4, 2500)
    angle = rng.uniform(0, 2 * np.pi, 2500)
    middle = (np.array(right) + left) / 2
    radius = 0.3 - 0.15 * height
    skirt = np.stack(
        [middle[0] + radius * np.cos(angle), height, middle[2] + radius * np.sin(angle)], 1
    )
    points, colors = [skirt], [np.tile(SKIRT, (2500, 1))]
    for side, place in (("R", right), ("L", left)):
        if side not in hidden:
            points.append(ball(rng, place, (0.04, 0.03, 0.1), 220))
            colors.append(np.tile(feet, (220, 1)))
    color = np.concatenate(colors) + rng.normal(0, 4, (sum(map(len, points)), 3))
    color = np.clip(color, 0, 255).astype(np.uint8)
    return SurfaceFrame(np.concatenate(points), color, np.zeros(len(color), np.uint8))


def joints_at(right, left):
    joints = {}
    for side, place in (("R", right), ("L", left)):
        joints[side + "Heel"] = np.subtract(place, (0, 0, 0.08))
        joints[side + "Foot"] = np.add(place, (0, 0, 0.1))
    return joints


def walk(frames):
    """Feet that pass each other, and cross: the right one steps far to the left."""
    t = np.linspace(0, 1, frames)[:, None]
    right = np.array([-0.12, 0.04, 0.0]) + t * (0.36, 0, 0.5)
    left = np.array([0.12, 0.04, 0.05]) + t * (0.0, 0.0, -0.3)
    return right, left


def test_feet_that_cross_keep_their_sides(rng):
    right, left = walk(30)
    frames = [
        dancer(rng, r, o, hidden=("R",) if 18 <= t < 22 else ())
        for t, (r, o) in enumerate(zip(right, left, strict=True))
    ]
    feet = learn_feet(frames[:3], joints_at(right[0], left[0]), STATURE, SETTINGS)
    assert feet is not None
    assert feet.known > 0.8
    found = [find_feet_of(frame, feet, STATURE, SETTINGS) for frame in frames]
    face = np.tile((0.0, 1.5, 0.1), (30, 1))
    facing = np.tile((0.0, 0.0, 1.0), (30, 1))
    place, weight, _ = choose_feet(found, feet, face, facing, RATE_HZ, STATURE, 0, SETTINGS)
    seen = np.isfinite(place[:, 0, 0])
    assert not seen[18:22].any()
    assert seen.sum() == 26
    assert np.linalg.norm(place[seen, 0] - right[seen], axis=1).max() < 0.05
    assert np.linalg.norm(place[:, 1] - left, axis=1).max() < 0.05
    assert weight[seen, 0].min() > 0.5


@pytest.mark.parametrize("taken", [False, True])
def test_feet_that_were_taken_for_each_other_are_told_by_the_take(rng, taken):
    """They stand one before the other at first, and on their sides later."""
    t = np.clip(np.linspace(-1.0, 1.0, 90), 0.0, 1.0)[:, None]
    right = np.array([0.01, 0.04, 0.2]) - t * (0.16, 0.0, 0.1)
    left = np.array([-0.01, 0.04, -0.1]) + t * (0.16, 0.0, 0.1)
    frames = [dancer(rng, r, o) for r, o in zip(right, left, strict=True)]
    first = (left[0], right[0]) if taken else (right[0], left[0])
    feet = learn_feet(frames[:3], joints_at(*first), STATURE, SETTINGS)
    assert feet is not None
    found = [find_feet_of(frame, feet, STATURE, SETTINGS) for frame in frames]
    face, facing = np.tile((0.0, 1.5, 0.1), (90, 1)), np.tile((0.0, 0.0, 1.0), (90, 1))
    place, _, told = choose_feet(
        found, feet, face, facing, RATE_HZ, STATURE, 0, SETTINGS, lambda: 0.0
    )
    assert told == taken
    assert np.linalg.norm(place[:, 0] - right, axis=1).max() < 0.05
    for cost in (None, lambda: 100.0):
        *_, told = choose_feet(found, feet, face, facing, RATE_HZ, STATURE, 0, SETTINGS, cost)
        assert not told


def test_feet_that_stay_crossed_for_long_at_first_are_right(rng):
    """The initial model has heard what their sides tell as long as they stay."""
    t = np.clip(np.linspace(-3.0, 1.0, 90), 0.0, 1.0)[:, None]
    right = np.array([0.05, 0.04, 0.2]) - t * (0.12, 0.0, 0.0)
    left = np.array([-0.05, 0.04, -0.1]) + t * (0.12, 0.0, 0.0)
    frames = [dancer(rng, r, o) for r, o in zip(right, left, strict=True)]
    feet = learn_feet(frames[:3], joints_at(right[0], left[0]), STATURE, SETTINGS)
    assert feet is not None
    found = [find_feet_of(frame, feet, STATURE, SETTINGS) for frame in frames]
    face, facing = np.tile((0.0, 1.5, 0.1), (90, 1)), np.tile((0.0, 0.0, 1.0), (90, 1))
    place, _, told = choose_feet(
        found, feet, face, facing, RATE_HZ, STATURE, 0, SETTINGS, lambda: 0.0
    )
    assert not told
    assert np.linalg.norm(place[:, 0] - right, axis=1).max() < 0.05


def test_what_feet_that_stand_as_at_first_tell_is_not_heard_again():
    position = np.zeros((9, 2, 3))
    position[:2, 0], position[6:, 1], position[4] = 0.2, 0.1, np.nan
    assert _still_around(position, 3) == (2, 6)
    assert _still_around(position[2:6], 1) == (0, 4)
    assert _still_around(np.full((4, 2, 3), np.nan), 1) == (0, 4)


def test_feet_like_the_cloth_say_that_they_say_nothing(rng):
    right, left = walk(3)
    frames = [dancer(rng, r, o, feet=SKIRT) for r, o in zip(right, left, strict=True)]
    feet = learn_feet(frames, joints_at(right[0], left[0]), STATURE, SETTINGS)
    assert feet is not None
    assert feet.known < 0.2


def test_without_toes_or_voxels_there_are_no_feet(rng):
    right, left = walk(1)
    frame = dancer(rng, right[0], left[0])
    lame = joints_at(right[0], left[0])
    lame["RFoot"] = np.full(3, np.nan)
    assert learn_feet([frame], lame, STATURE, SETTINGS) is None
    empty = SurfaceFrame(np.empty((0, 3)), np.empty((0, 3), np.uint8), np.empty(0, np.uint8))
    joints = joints_at(right[0], left[0])
    assert learn_feet([empty], joints, STATURE, SETTINGS) is None
    feet = learn_feet([frame], joints, STATURE, SETTINGS)
    assert feet is not None
    place, mass = find_feet_of(empty, feet, STATURE, SETTINGS)
    assert place.shape == (0, 3)
    assert mass.shape == (0,)


def test_hands_above_are_no_feet(rng):
    right, left = walk(1)
    frame = dancer(rng, right[0], left[0])
    hand = ball(rng, (0.4, 1.1, 0.0), 0.06, 200)
    center = np.concatenate([frame.center, hand])
    color = np.concatenate([frame.color, np.tile(WHITE, (200, 1)).astype(np.uint8)])
    both = SurfaceFrame(center, color, np.zeros(len(color), np.uint8))
    feet = learn_feet([frame], joints_at(right[0], left[0]), STATURE, SETTINGS)
    assert feet is not None
    place, _ = find_feet_of(both, feet, STATURE, SETTINGS)
    assert len(place) >= 2
    assert place[:, 1].max() < 0.4 * STATURE


@pytest.mark.parametrize("seen", [0.0, 0.5, 1.0])
def test_low_voxels_are_those_seen_that_are_near_the_lowest_of_them(rng, seen):
    center = rng.uniform(0.0, 1.0, (60, 3))
    camera = np.where(rng.random(60) < seen, 3, NO_CAMERA).astype(np.uint8)
    own = camera != NO_CAMERA
    lowest = center[own, 1].min(initial=np.inf)
    wanted = np.flatnonzero(own & (center[:, 1] < lowest + 0.4))
    np.testing.assert_array_equal(_find_low(center, camera, 0.4), wanted)
    assert 5 < len(wanted) < 30 or not seen
