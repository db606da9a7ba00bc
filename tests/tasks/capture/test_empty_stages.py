"""What a camera sees where nobody dances is found in films and before screens, or is refused."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from storage.errors import InputError
from tasks.capture.empty_stages import check_telling, read_backgrounds, unsure_notes
from tasks.capture.estimating import estimate_background, fill, find_groups
from tasks.capture.screens import NoScreenError, estimate_screen, key_fault
from tests.figures.films import write_film

ROWS, COLUMNS, FRAMES = 60, 84, 24
RED, SKIN = (170.0, 40.0, 50.0), (205.0, 160.0, 130.0)


def wall(color=(120.0, 110.0, 90.0)):
    """A wall (row, column, 3) of one hue that is brighter in the middle, with slanting folds."""
    row, column = np.mgrid[:ROWS, :COLUMNS]
    light = 1.1 - 0.004 * np.hypot(row - 25, column - 40) + 0.08 * np.sin((row + 2 * column) / 9)
    return light[..., None] * np.array(color)


def danced(stage, middles, rng, *, radius=9.0, color=RED):
    """Frames (time, row, column, 3) of a round body whose middle is at these columns."""
    row, column = np.mgrid[:ROWS, :COLUMNS]
    frames = np.empty((len(middles), ROWS, COLUMNS, 3), np.uint8)
    for n, (frame, middle) in enumerate(zip(frames, middles, strict=True)):
        away = np.hypot(column - middle, (row - 30) * 0.6) - radius
        inside = np.clip(0.5 - away, 0.0, 1.0)[..., None]
        body = np.array(color) * (1.0 + 0.1 * np.sin(row / 4 + n))[..., None]
        gain = 1.0 + 0.02 * np.sin(n)
        noisy = gain * (stage * (1 - inside) + body * inside) + rng.normal(0, 2, (ROWS, COLUMNS, 3))
        frame[:] = noisy.clip(0, 255).round()
    return frames


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def off(background, stage, where=np.s_[:]):
    """How far a background is from a stage at worst, of the brightness of both."""
    found = background.color * (stage[where].mean() / background.color[where].mean())
    return np.abs(found - stage)[where].max()


def test_the_stage_is_found_though_the_performer_stays_at_a_place_for_most_of_the_film(rng):
    stage = wall()
    still, walk = np.full(18, 40.0), np.linspace(40, 110, 6)
    frames = danced(stage, [*still, *walk], rng)
    median = np.median(frames, axis=0)
    assert np.abs(median - stage).max() > 60
    found = estimate_background(frames.copy())
    assert off(found, stage) < 15
    assert found.sure > 0.99


def test_a_chair_among_the_performers_ways_stays_on_the_stage(rng):
    stage = wall()
    stage[26:34, 36:46] = (30.0, 60.0, 150.0)
    frames = danced(stage, 41 + 38 * np.sin(np.arange(FRAMES) / 2.0), rng)
    found = estimate_background(frames)
    assert off(found, stage, np.s_[28:32, 38:44]) < 12
    assert found.sure > 0.99


def test_where_the_performer_never_leaves_the_stage_around_is_a_guess(rng):
    stage = wall()
    frames = danced(stage, 40 + 4 * np.sin(np.arange(FRAMES)), rng)
    found = estimate_background(frames)
    assert off(found, stage) < 25
    assert 0.90 < found.sure < 0.99


def test_groups_are_the_most_frequent_colors(rng):
    images = np.empty((20, 5, 7, 3), np.uint8)
    images[:] = rng.integers(98, 103, images.shape)
    images[:6] = rng.integers(10, 15, images[:6].shape)
    color, noise, seen = find_groups(images, np.ones(images.shape[:3], bool), 2)
    np.testing.assert_allclose(color[0], images[6:].mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(color[1], images[:6].mean(axis=0), atol=1e-3)
    spread = np.sqrt(images[6:].astype(float).var(axis=0).mean(axis=-1))
    np.testing.assert_allclose(noise[0], spread, rtol=1e-3)
    np.testing.assert_allclose(seen, np.broadcast_to([[[0.7]], [[0.3]]], seen.shape))


def test_what_is_not_known_takes_the_color_around():
    color = np.full((9, 12, 3), 50.0, np.float32)
    known = np.ones((9, 12), bool)
    known[2:7, 3:10] = False
    color[~known] = 200.0
    assert (np.abs(fill(color, known) - 50.0) < 1e-3).all()


GREEN = (45.0, 150.0, 70.0)


@pytest.mark.parametrize("key", ["auto", "#00b140"])
@pytest.mark.parametrize("screen", [GREEN, (50.0, 80.0, 170.0)], ids=["green", "blue"])
def test_before_a_screen_the_performer_need_not_leave(rng, key, screen):
    if key != "auto" and screen != GREEN:
        key = "#1040c0"
    stage = wall(screen)
    frames = danced(stage, 40 + 4 * np.sin(np.arange(FRAMES)), rng, color=SKIN)
    found = estimate_screen(frames, key)
    assert off(found, stage) < 25
    if key != "auto":
        assert found.key == key
        return
    color = [int(found.key[n : n + 2], 16) for n in (1, 3, 5)]
    assert np.abs(np.array(color) - stage.mean(axis=(0, 1))).max() < 15


def test_what_is_beside_the_screen_and_does_not_move_is_the_stage(rng):
    stage = wall(GREEN)
    stage[:, 66:] = wall()[:, 66:]
    frames = danced(stage, 30 + 5 * np.sin(np.arange(FRAMES)), rng, color=SKIN)
    found = estimate_screen(frames, "auto")
    assert off(found, stage, np.s_[:, 69:]) < 12
    assert found.sure > 0.9


def test_a_film_without_such_a_screen_is_refused_with_what_it_has(rng):
    frames = danced(wall((150.0, 60.0, 60.0)), np.full(6, 30.0), rng, color=SKIN)
    with pytest.raises(NoScreenError, match="no blue or green screen covers more than 0%"):
        estimate_screen(frames.copy(), "auto")
    with pytest.raises(NoScreenError, match=r"hue of the key color #00b140; the most .* is #9"):
        estimate_screen(frames.copy(), "#00b140")


@pytest.mark.parametrize(
    ("key", "said"),
    [("green", 'must be "auto" or a color'), ("#12", "such as"), ("#808080", "without a hue")],
)
def test_a_nonsense_key_is_refused(key, said):
    assert said in (key_fault(key) or "")
    assert key_fault("auto") is key_fault("") is key_fault("#0047bb") is None


def capture_of(path, *, masks=(), backgrounds=()):
    camera = SimpleNamespace(name="cam1", width=COLUMNS, height=ROWS)
    return SimpleNamespace(
        folder="dance", cameras=(camera,), videos=(path,), masks=masks, backgrounds=backgrounds
    )


def test_a_film_is_read_once_for_a_background_until_it_changes(tmp_path, rng):
    path = tmp_path / "cam1.mp4"
    write_film(path, danced(wall(), np.linspace(-20, 100, 30), rng), options={"crf": "12"})
    [first] = read_backgrounds(capture_of(path), "film")
    [again] = read_backgrounds(capture_of(path), "film")
    assert again is first
    assert off(first, wall()) < 25
    with pytest.raises(InputError, match="camera 'cam1': no blue or green screen"):
        read_backgrounds(capture_of(path), "given", "auto")
    write_film(path, danced(wall(GREEN), np.linspace(-20, 100, 30), rng))
    assert read_backgrounds(capture_of(path), "film")[0] is not first


def test_a_background_is_kept_until_its_picture_changes(tmp_path):
    picture = tmp_path / "cam1.png"
    read = []
    for level in (70, 70, 90):
        if level == 90 or not read:
            cv2.imwrite(str(picture), np.full((6, 8, 3), level, np.uint8))
        read += read_backgrounds(capture_of(None, backgrounds=(picture,)))
    assert read[0] is read[1]
    assert (read[0].color == 70).all()
    assert (read[2].color == 90).all()


@pytest.mark.parametrize(
    ("masks", "backgrounds", "background", "key", "said"),
    [
        ((), (), "given", "", "nothing tells the performer from the stage"),
        ((1,), (), "given", "auto", 'masks in `silhouettes`, and key = "auto" stands under'),
        ((1,), (), "film", "", 'and background = "film" stands under'),
    ],
)
def test_nothing_or_two_things_that_tell_are_refused(masks, backgrounds, background, key, said):
    with pytest.raises(InputError, match=said):
        check_telling(capture_of(None, masks=masks, backgrounds=backgrounds), background, key)


@pytest.mark.parametrize(
    ("masks", "backgrounds", "background", "key"),
    [
        ((1,), (), "given", ""),
        ((), (1,), "given", ""),
        ((), (), "film", ""),
        ((), (1,), "", "auto"),
    ],
)
def test_one_thing_that_tells_is_enough(masks, backgrounds, background, key):
    check_telling(capture_of(None, masks=masks, backgrounds=backgrounds), background, key)


def test_how_sure_backgrounds_are_is_said():
    cameras = [SimpleNamespace(name="cam1"), SimpleNamespace(name="cam2")]
    [note] = unsure_notes(cameras, [1.0, 0.93], before_screen=False)
    assert note.endswith("this much of a picture: cam2 7.0%, where the performer never leaves.")
    [note] = unsure_notes(cameras, [1.0, 0.997], before_screen=True)
    assert note.endswith("are sure in 99.7% of a picture at least.")
