"""Hair around a face, and none around a hand."""

import numpy as np
import pytest

from storage.schema import NO_CAMERA
from tasks.body.anatomy.colors import color_cells
from tasks.body.anatomy.skin import SurfaceFrame
from tasks.body.extremities.hair import _sum_around, hair_around, learn_hair

BALL_M = 0.16
SKIN, HAIR, CLOTH = (222, 176, 142), (32, 26, 28), (112, 40, 128)
FACE = np.array([0.0, 1.48, 0.08])
HAND = np.array([0.0, 1.3, 0.4])


@pytest.fixture
def rng():
    return np.random.default_rng(8)


def dancer(rng, *, head=HAIR):
    """A face before a ball of hair, a hand before it in a sleeve, and a gown."""
    parts = [
        (FACE, 0.05, 300, SKIN), (np.add(FACE, (0.0, 0.06, -0.06)), 0.08, 500, head),
        (HAND, 0.05, 300, SKIN), (HAND - [0.0, 0.1, 0.1], 0.1, 400, CLOTH),
        (np.array([0.0, 0.8, 0.0]), 0.4, 2000, CLOTH),
    ]  # fmt: skip
    center, color = [], []
    for middle, radius, count, shade in parts:
        way = rng.normal(size=(count, 3))
        center.append(middle + radius * way / np.linalg.norm(way, axis=1)[:, None])
        color.append(np.clip(np.array(shade) + rng.normal(0, 3, (count, 3)), 0, 255))
    color = np.concatenate(color).astype(np.uint8)
    return SurfaceFrame(np.concatenate(center), color, np.zeros(len(color), np.uint8))


def is_skin(frame):
    return frame.color[:, 0] > 180


def test_hair_is_around_the_face_and_not_around_a_hand(rng):
    first = dancer(rng)
    hair = learn_hair([(first, is_skin(first))], FACE, BALL_M)
    assert hair is not None
    assert hair.known > 0.9
    around = hair_around(dancer(rng), np.stack([FACE, HAND]), hair, BALL_M)
    assert around[0] == pytest.approx(1.0, abs=0.15)
    assert around[1] < 0.02


def test_a_hood_of_the_gown_tells_nothing(rng):
    first = dancer(rng, head=CLOTH)
    hair = learn_hair([(first, is_skin(first))], FACE, BALL_M)
    assert hair is None or hair.known < 0.2


def test_where_only_skin_is_seen_there_is_no_hair(rng):
    first = dancer(rng)
    assert learn_hair([(first, np.ones(len(first.center), bool))], FACE, BALL_M) is None
    empty = SurfaceFrame(np.empty((0, 3)), np.empty((0, 3), np.uint8), np.empty(0, np.uint8))
    assert learn_hair([(empty, np.zeros(0, bool))], FACE, BALL_M) is None
    hair = learn_hair([(first, is_skin(first))], FACE, BALL_M)
    assert hair is not None
    np.testing.assert_array_equal(hair_around(empty, FACE[None], hair, BALL_M), [0.0])


def test_what_is_worn_below_the_face_is_no_hair(rng):
    """A collar reaches into the ball around the face."""
    first = dancer(rng)
    collar = FACE + rng.uniform(-0.05, 0.05, (200, 3)) - [0.0, 0.08, 0.03]
    gold = np.tile(np.array((196, 158, 44), np.uint8), (200, 1))
    frame = SurfaceFrame(
        np.concatenate([first.center, collar]), np.concatenate([first.color, gold]),
        np.zeros(len(first.center) + 200, np.uint8),
    )  # fmt: skip
    below = frame.center[:, 1] < FACE[1]
    own = below & (np.linalg.norm(frame.center - FACE, axis=1) < BALL_M)
    hair = learn_hair([(frame, is_skin(frame) & (frame.color[:, 2] > 100))], FACE, BALL_M)
    assert hair is not None
    gilded = SurfaceFrame(frame.center[own], frame.color[own], frame.camera[own])
    only = gilded.color[:, 0] > 180
    assert hair.ratio[color_cells(gilded.color[only & (gilded.color[:, 2] < 100)])].max() == 0.0


def test_sums_are_those_of_all_voxels_in_a_ball_that_have_a_color(rng):
    first = dancer(rng)
    hair = learn_hair([(first, is_skin(first))], FACE, BALL_M)
    assert hair is not None
    camera = np.where(rng.random(len(first.center)) < 0.3, NO_CAMERA, 1).astype(np.uint8)
    frame = SurfaceFrame(first.center, first.color, camera)
    place = FACE + rng.normal(0, 0.1, (5, 3))
    ratio = hair.ratio[color_cells(frame.color)]
    near = np.linalg.norm(frame.center[None] - place[:, None], axis=2) < BALL_M
    wanted = (near * (ratio * (camera != NO_CAMERA))).sum(axis=1)
    np.testing.assert_allclose(_sum_around(frame, place, hair.ratio, BALL_M), wanted)
