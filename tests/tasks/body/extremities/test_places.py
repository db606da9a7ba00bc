from dataclasses import replace

import numpy as np
import pytest

from tasks.body.anatomy.skin import SkinModel, SurfaceFrame
from tasks.body.extremities.candidates import Candidates, CandidateSettings
from tasks.body.extremities.faces import _above_necks, follow_face, initial_places
from tasks.body.extremities.feet import FootSettings
from tasks.body.extremities.moves import Motion
from tasks.body.extremities.places import _hand_costs, find_extremities, hand_ends
from tasks.body.extremities.settings import ExtremitySettings
from tests.figures.skin_figures import CLOTH, GOLD, JOINTS, SKIN, STATURE_M, STRETCHED, dancer

RATE_HZ = 30.0
too_slow_interpreted = pytest.mark.compiled
EMPTY = SurfaceFrame(np.empty((0, 3)), np.empty((0, 3), np.uint8), np.empty(0, np.uint8))


@pytest.fixture
def rng():
    return np.random.default_rng(31)


def swing(frames, *, held=4):
    """Return (time, 2, 3) hands that swing from the sides to the front, one above the other,
    cross there, and come back: the right one passes 14 cm above the left."""
    x = np.concatenate([np.zeros(held), np.linspace(0, 2 * np.pi, frames - held)])
    far = 0.5 + 0.5 * np.cos(x)
    right = np.stack([0.12 - 0.865 * far, 1.32 - 0.1 * (1 - far), 0.34 * (1 - far)], axis=1)
    left = np.stack([-0.12 + 0.865 * far, 1.32 - 0.24 * (1 - far), 0.34 * (1 - far)], axis=1)
    return np.stack([right, left], axis=1)


def film(hands, rng, **dressed):
    return [dancer(h, rng, **dressed) for h in hands]


def off(found, hands):
    """Return (time, 2) how far the hands found are from where they are."""
    return np.linalg.norm(found.position[:, 1:] - hands, axis=2)


@too_slow_interpreted
@pytest.mark.parametrize("sash", [None, GOLD], ids=["plain", "gold sash"])
def test_hands_that_cross_keep_their_sides(rng, sash):
    hands = swing(44)
    found = find_extremities(film(hands, rng, sash=sash), RATE_HZ, STATURE_M, JOINTS)
    assert (hands[:, 0, 0] > hands[:, 1, 0] + 0.1).any()
    assert (off(found, hands) < 0.05).all()
    assert found.weight[:, 1:].min() > 0.5
    face = found.position[:, 0] - [0.0, 1.49, 0.07]
    assert (np.linalg.norm(face, axis=1) < 0.06).all()
    assert (found.facing[:, 2] > 0.9).all()
    assert abs(found.facing[:, 0]).max() < 0.2
    spots = np.concatenate([each.face for each in found.candidates])
    bare = np.concatenate([each.face_bare for each in found.candidates])
    away = np.linalg.norm(spots - [0.0, 1.49, 0.07], axis=1)
    assert (bare[away < 0.06] < 0.3).all()
    assert (bare[away > 0.4] > 0.5).all()
    assert (away > 0.4).any()


@too_slow_interpreted
def test_a_turned_performer_is_followed_alike(rng):
    """Turned about the vertical, moved and made smaller: all places follow."""
    hands = swing(30)
    frames = film(hands, rng)
    turn = np.array([[0.28, 0.0, 0.96], [0.0, 1.0, 0.0], [-0.96, 0.0, 0.28]])

    def moved(place):
        return 0.8 * place @ turn.T + [3.0, 0.0, -2.0]

    again = find_extremities(
        [SurfaceFrame(moved(f.center), f.color, f.camera) for f in frames],
        RATE_HZ,
        0.8 * STATURE_M,
        {name: moved(place) for name, place in JOINTS.items()},
    )
    assert (off(again, moved(hands)) < 0.04).all()
    ahead = np.array([0.0, 0.0, 1.0]) @ turn.T
    assert (again.facing @ ahead > 0.9).all()


@too_slow_interpreted
def test_a_hidden_hand_is_unseen_and_found_again(rng):
    hands = swing(40)
    frames = film(hands, rng)
    hidden = np.zeros(40, bool)
    hidden[25:33] = True
    for t in np.flatnonzero(hidden):
        frames[t] = dancer(hands[t], rng, shown=(True, False))
    found = find_extremities(frames, RATE_HZ, STATURE_M, JOINTS)
    error = off(found, hands)
    assert (error[:, 0] < 0.05).all()
    assert (error[~hidden, 1] < 0.05).all()
    unsure = np.isnan(found.position[hidden, 2, 0]) | (found.weight[hidden, 2] < 0.8)
    assert unsure.mean() > 0.7


@too_slow_interpreted
def test_hands_hidden_for_long_come_back_on_their_own_sides(rng):
    """They vanish crossed, so that each comes back nearer to where the other vanished."""
    hands = np.concatenate(
        [swing(44)[:24], np.tile([[-0.5, 1.1, 0.2], [0.5, 1.1, 0.2]], (24, 1, 1))]
    )
    assert hands[23, 0, 0] > hands[23, 1, 0]
    frames = film(hands, rng)
    for t in range(24, 36):
        frames[t] = dancer(hands[t], rng, shown=(False, False))
    found = find_extremities(frames, RATE_HZ, STATURE_M, JOINTS)
    assert (off(found, hands)[36:] < 0.05).all()


@too_slow_interpreted
@pytest.mark.parametrize("wrists", [("RWrist",), ("RWrist", "LWrist")], ids=["one", "both"])
def test_unknown_wrists_are_a_hand_before_the_fingertips(rng, wrists):
    hands = swing(20)
    joints = JOINTS | {name: np.full(3, np.nan) for name in wrists}
    joints.pop(wrists[-1])
    found = find_extremities(film(hands, rng), RATE_HZ, STATURE_M, joints)
    assert (off(found, hands) < 0.05).all()
    np.testing.assert_allclose(initial_places(joints, STATURE_M)[1:], STRETCHED, atol=0.01)


@too_slow_interpreted
def test_empty_frames_are_unseen_and_cost_nothing_else(rng):
    hands = swing(36)
    frames = film(hands, rng)
    frames[4:8] = [EMPTY] * 4
    found = find_extremities(frames, RATE_HZ, STATURE_M, JOINTS)
    assert np.isnan(found.position[4:8]).all()
    assert (found.weight[4:8] == 0).all()
    assert np.isnan(found.facing[4:8]).all()
    there = np.r_[:4, 8:36]
    assert (off(found, hands)[there] < 0.05).all()
    assert len(found.candidates[5].hand) == len(found.hand_cost[5]) == 0


@too_slow_interpreted
def test_the_initial_frame_may_be_any(rng):
    hands = swing(33)
    frames = film(hands, rng)[::-1]
    found = find_extremities(frames, RATE_HZ, STATURE_M, JOINTS, initial_frame=31)
    assert (off(found, hands[::-1]) < 0.05).all()


@too_slow_interpreted
def test_where_skin_says_nothing_weights_are_low(rng):
    hands = swing(30)
    sure = find_extremities(film(hands, rng), RATE_HZ, STATURE_M, JOINTS)
    gloved = find_extremities(film(hands, rng, hand=CLOTH), RATE_HZ, STATURE_M, JOINTS)
    nude = find_extremities(film(hands, rng, cloth=SKIN), RATE_HZ, STATURE_M, JOINTS)
    assert np.median(sure.weight[:, 1:]) > 0.85
    assert gloved.weight[:, 1:].max() < 0.42
    assert nude.weight.max() < 0.1


@pytest.mark.compiled
def test_each_hand_is_among_the_cheapest_candidates(rng):
    hands = swing(12)
    found = find_extremities(film(hands, rng), RATE_HZ, STATURE_M, JOINTS)
    for t, (frame, cost) in enumerate(zip(found.candidates, found.hand_cost, strict=True)):
        first = frame.hand[np.argsort(cost)[:3]]
        apart = np.linalg.norm(first[:, None] - hands[t][None], axis=2).min(axis=0)
        assert (apart < 0.05).all()


def test_a_neck_is_not_the_face_beside_it():
    """The neck shows more skin, and is farther from the top of the head than the face was."""

    def seen(face_end, skin):
        none = np.empty((0, 3))
        face = np.array([[0.0, 1.55, 0.05], [0.0, 1.45, 0.0], [0.3, 1.2, 0.0]])
        return Candidates(
            none, none[:, 0], np.empty(0, bool), face, skin, 0 * face, face_end, 0 * skin
        )

    usual = seen(np.array([0.08, 0.14, 0.05]), np.array([1.0, 0.8, 0.9]))
    turned = seen(np.array([0.09, 0.15, 0.08]), np.array([0.7, 1.0, 0.9]))
    hidden = seen(np.array([0.15, 0.16, 0.08]), np.array([0.7, 1.0, 0.9]))
    covered = seen(np.array([0.09, 0.15, 0.08]), np.array([0.3, 1.0, 0.9]))
    face, neck = usual.face[:2]
    places = np.stack([face, neck, neck, neck, face, np.full(3, np.nan)])
    frames = [usual, turned, hidden, covered, turned, turned]
    found = _above_necks(frames, places, 0, STATURE_M, ExtremitySettings())
    np.testing.assert_array_equal(found, [face, face, neck, neck, face, [np.nan] * 3])
    lost = _above_necks(frames, places, 5, STATURE_M, ExtremitySettings())
    np.testing.assert_array_equal(lost, places)


def test_a_hand_that_passes_is_not_the_face(rng):
    """It shows more skin than the face, which is half hidden meanwhile, but no hair is around."""
    way = np.linspace(-0.5, 0.5, 41)[:, None] * (0.0, 1.2, 0.0) + (0.06, 1.5, 0.12)
    none = np.empty((0, 3))
    frames = []
    for hand, far in zip(way, np.abs(np.linspace(-1.0, 1.0, 41)), strict=True):
        face = np.array([rng.normal((0.0, 1.5, 0.07), 0.02), hand])
        skin, end = np.array([0.3 + 0.7 * far, 1.0]), np.full(2, 0.09)
        frames.append(
            Candidates(none, none[:, 0], np.empty(0, bool), face, skin, 0 * face, end, 0 * end)
        )
    table = np.zeros((64, 64, 64), np.float32)
    model, start = SkinModel(table, table, 1.0, 1.0), frames[0].face[0] / STATURE_M

    def follow(bare):
        seen = [replace(frame, face_bare=np.array([0.0, bare])) for frame in frames]
        place, *_ = follow_face(
            seen, model, RATE_HZ, STATURE_M, start,
            initial_frame=0, settings=ExtremitySettings(),
        )  # fmt: skip
        return np.linalg.norm(place - [frame.face[0] for frame in frames], axis=1)

    assert follow(0.0)[-1] > 0.3
    assert np.nanmax(follow(1.0)) < 1e-6


def test_the_nape_is_no_hand():
    """A kimono shows the nape: skin behind the neck, which no hand needs to explain."""
    start = initial_places(JOINTS, STATURE_M) / STATURE_M
    face, neck = start[0] * STATURE_M, np.asarray(JOINTS["Neck"])
    nape, chest, belly = (0.0, 0.02, -0.05), (0.0, -0.05, 0.25), (0.1, -0.4, 0.15)
    hand, none = neck + np.array([nape, chest, belly]), np.zeros((1, 3))
    frame = Candidates(
        hand, np.ones(3), np.ones(3, bool), face[None], np.ones(1), none, np.ones(1), np.zeros(1)
    )  # fmt: skip
    table = np.zeros((64, 64, 64), np.float32)
    [cost] = _hand_costs(
        [frame], [hand / STATURE_M], (start[:1], np.array([[0.0, 0.0, 1.0]])), start, JOINTS,
        STATURE_M, SkinModel(table, table, 1.0, 1.0), ExtremitySettings(),
    )  # fmt: skip
    assert cost[0] > 1.5
    np.testing.assert_allclose(cost[1:], 0.0, atol=1e-9)


def test_what_cannot_be_followed_is_said(rng):
    frames = film(swing(6), rng)
    with pytest.raises(ValueError, match=r"rate_hz 0\.0 must be positive; give frames a second"):
        find_extremities(frames, 0.0, STATURE_M, JOINTS)
    with pytest.raises(ValueError, match="initial_frame 6 is not one of the take's 6 frames"):
        find_extremities(frames, RATE_HZ, STATURE_M, JOINTS, initial_frame=6)
    with pytest.raises(ValueError, match="has no Head; give all of"):
        find_extremities(frames, RATE_HZ, STATURE_M, replace_joint("Head"))


def replace_joint(name):
    return JOINTS | {name: np.full(3, np.nan)}


def test_what_shows_enough_skin_may_be_a_hand_though_it_is_no_end():
    place = np.arange(9.0).reshape(3, 3)
    frame = Candidates(
        place, np.array([0.1, 0.3, 0.5]), np.array([True, False, False]), place, place[0], place,
        place[0], place[0],
    )  # fmt: skip
    [usual] = hand_ends([frame], ExtremitySettings())
    np.testing.assert_array_equal(usual, place)
    [strict] = hand_ends([frame], ExtremitySettings(some_skin=0.4))
    np.testing.assert_array_equal(strict, place[[0, 2]])


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (CandidateSettings, {"cell": 0.0}, r"cell is 0\.0, it must be a number larger than 0"),
        (FootSettings, {"most": 0}, "most is 0, it must be a whole number 1 or more"),
        (Motion, {"lasting": 1.5}, r"lasting is 1\.5, it must be a number 0 or more and at most 1"),
        (
            ExtremitySettings,
            {"some_skin": -1},
            "some_skin is -1, it must be a number larger than 0",
        ),
    ],
)
def test_settings_that_find_nothing_are_refused(kind, settings, message):
    with pytest.raises(ValueError, match=message):
        kind(**settings)
