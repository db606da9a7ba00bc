import numpy as np
import pytest

from tasks.body.anatomy.skin import (
    SkinSettings,
    SurfaceFrame,
    find_skin_parts,
    learn_skin,
)
from tests.figures.skin_figures import (
    CLOTH,
    GLOVE,
    GOLD,
    HAIR,
    JOINTS,
    SKIN,
    STATURE_M,
    STRETCHED,
    dancer,
    is_skin,
    skin_ratio,
)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def learn(rng, **dressed):
    frames = [dancer(STRETCHED, rng, **dressed) for _ in range(3)]
    return learn_skin(frames, JOINTS, STATURE_M, SkinSettings())


def shades(rng, color, count=400):
    """Return a color as it is filmed: more or less lit, with noise."""
    lit = np.asarray(color) * rng.uniform(0.8, 1.0, (count, 1)) + rng.normal(0, 3, (count, 3))
    return np.clip(lit, 0, 255).astype(np.uint8)


def test_skin_is_told_from_cloth_hair_and_a_gold_sash(rng):
    model = learn(rng, sash=GOLD)
    known = {c: is_skin(model, shades(rng, c)).mean() for c in (SKIN, CLOTH, HAIR, GOLD)}
    assert known[SKIN] > 0.95
    assert max(known[CLOTH], known[GOLD]) < 0.02
    assert known[HAIR] < 0.06  # nearly black, whose chroma is noise
    assert model.hand_separability > 0.9
    assert model.face_separability > 0.9


def test_gloves_are_known_by_their_own_color(rng):
    model = learn(rng, hand=GLOVE)
    hand, face = skin_ratio(model, shades(rng, GLOVE))
    assert np.mean(hand > 1.0) > 0.95
    assert np.mean(face > 1.0) < 0.02
    hand, face = skin_ratio(model, shades(rng, SKIN))
    assert np.mean(face > 1.0) > 0.95
    assert np.mean(hand > 1.0) < 0.02


@pytest.mark.compiled
def test_a_costume_of_the_color_of_skin_makes_a_model_that_knows_nothing(rng):
    model = learn(rng, cloth=SKIN)
    assert model.hand_separability < 0.05
    assert model.face_separability < 0.05


@pytest.mark.compiled
def test_gloves_of_the_costumes_color_leave_a_guess_by_the_face(rng):
    model = learn(rng, hand=CLOTH)
    assert model.hand_separability == pytest.approx(0.4 * model.face_separability)
    assert np.mean(skin_ratio(model, shades(rng, SKIN))[0] > 1.0) > 0.95


def test_hands_that_the_hull_has_lost_are_not_learned_from_specks(rng):
    frame = dancer(STRETCHED, rng, hand=GLOVE)
    lost = find_skin_parts(frame.center, JOINTS, STATURE_M, SkinSettings()) == 1
    lost[np.flatnonzero(lost)[:2]] = False
    left = SurfaceFrame(frame.center[~lost], frame.color[~lost], frame.camera[~lost])
    model = learn_skin([left], JOINTS, STATURE_M, SkinSettings())
    assert model.hand_separability == pytest.approx(0.4 * model.face_separability)
    assert np.mean(skin_ratio(model, shades(rng, SKIN))[0] > 1.0) > 0.95


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_the_ratio_is_that_of_the_shares_of_a_color(rng, share):
    """Without shades: hands are of one color only, and a share of all else is too."""
    center = dancer(STRETCHED, rng).center
    kind = find_skin_parts(center, JOINTS, STATURE_M, SkinSettings())
    assert {0, 1, 2, 3} == set(kind.tolist())
    red, blue = np.array(GLOVE, np.uint8), np.array(CLOTH, np.uint8)
    also = (kind == 0) & (rng.random(len(center)) < share)
    color = np.where(((kind == 1) | also)[:, None], red, blue)
    camera = np.zeros(len(center), np.uint8)
    model = learn_skin([SurfaceFrame(center, color, camera)], JOINTS, STATURE_M, SkinSettings())
    hand, _ = skin_ratio(model, red[None])
    assert hand[0] == pytest.approx(-np.log(also.sum() / (kind == 0).sum()), abs=0.05)
    assert model.hand_separability == pytest.approx(1 - share if share < 0.3 else 0, abs=0.05)


def test_hands_and_face_are_where_the_joints_say():
    place = np.array(
        [
            *([-0.80, 1.33, 0.0], [0.72, 1.30, 0.03], [0.66, 1.32, 0.0]),
            *([0.0, 1.50, 0.09], [0.0, 1.50, -0.09], [0.0, 1.0, 0.1], [0.0, 1.5, 0.0]),
        ]
    )
    kind = find_skin_parts(place, JOINTS, STATURE_M, SkinSettings())
    np.testing.assert_array_equal(kind, [1, 1, 3, 2, 0, 0, 3])


@pytest.mark.compiled
def test_colors_that_are_not_a_voxels_own_teach_nothing(rng):
    frames = [dancer(STRETCHED, rng)]
    odd = SurfaceFrame(frames[0].center, frames[0].color.copy(), frames[0].camera)
    odd.color[odd.camera == 255] = SKIN
    models = [learn_skin([f], JOINTS, STATURE_M, SkinSettings()) for f in (frames[0], odd)]
    np.testing.assert_array_equal(models[0].hand, models[1].hand)
    own = SurfaceFrame(odd.center, odd.color, np.zeros_like(odd.camera))
    assert (learn_skin([own], JOINTS, STATURE_M, SkinSettings()).hand != models[0].hand).any()


def test_what_is_missing_is_said(rng):
    frames = [dancer(STRETCHED, rng)]
    with pytest.raises(ValueError, match="no frame; give one"):
        learn_skin([], JOINTS, STATURE_M, SkinSettings())
    with pytest.raises(ValueError, match="has no RFin; give all of Head, Neck"):
        learn_skin(frames, JOINTS | {"RFin": np.full(3, np.nan)}, STATURE_M, SkinSettings())
    with pytest.raises(ValueError, match="has no Neck"):
        learn_skin(
            frames, {k: v for k, v in JOINTS.items() if k != "Neck"}, STATURE_M, SkinSettings()
        )
    with pytest.raises(ValueError, match=r"stature_m 0\.0 must be positive"):
        learn_skin(frames, JOINTS, 0.0, SkinSettings())


def test_settings_that_tell_no_skin_are_refused():
    with pytest.raises(ValueError, match=r"hand_begins is 1\.5, it must be .*; most is 0, it must"):
        SkinSettings(hand_begins=1.5, most=0)
