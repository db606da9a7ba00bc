"""Silhouettes agree with slow twins, find planted figures, and leave shadows and flicker out."""

from typing import Any

import cv2
import numpy as np
import pytest

from storage.formats.pictures.video import open_video, read_frames
from tasks.capture import backgrounds
from tasks.capture.backgrounds import Background, make_background, measure_gain, smooth
from tasks.reconstruction import silhouettes as stage
from tasks.reconstruction.regions.components import clean_region
from tasks.reconstruction.regions.differences import differ_in_chroma, differ_in_color
from tasks.reconstruction.regions.outlines import draw_outline
from tasks.reconstruction.silhouettes import SilhouetteSettings, extract_silhouettes
from tests.twins import silhouettes as naive

ROWS, COLUMNS = 48, 64
CRCB = SilhouetteSettings(rule="crcb")
BOTH = pytest.mark.parametrize("rule", ["chroma", "crcb"])


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def plate(rng, rows=ROWS, columns=COLUMNS, noise=2.0):
    """A green wall, brighter to the right and on top."""
    shade = np.linspace(0.8, 1.1, columns)[:, None] * np.linspace(1.1, 0.8, rows)[:, None, None]
    return noisy(np.array([60.0, 140.0, 70.0]) * shade, rng, noise)


def noisy(image, rng, noise=2.0):
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def figure(rows=ROWS, columns=COLUMNS):
    """Where a standing figure is: a disc on a column, with an arm."""
    there = np.zeros((rows, columns), np.uint8)
    cv2.circle(there, (30, 12), 6, 1, -1)
    cv2.rectangle(there, (24, 17), (36, 42), 1, -1)
    cv2.rectangle(there, (36, 20), (52, 26), 1, -1)
    return there.astype(bool)


def dressed(image, there, color=(150, 40, 60)):
    return np.where(there[..., None], np.array(color, np.uint8), image)


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def one(frame, background, settings=stage.DEFAULT):
    return extract_silhouettes(frame[None], background, settings)[0]


def planes(image):
    """A plane a channel."""
    return np.ascontiguousarray(image.transpose(2, 0, 1))


def random_scene(rng, rows=14, columns=19):
    """A background and a frame that has every kind of pixel, many near the limits."""
    color = rng.uniform(5, 220, (rows, columns, 3)).astype(np.float32)
    noise = rng.uniform(0, 6, (rows, columns)).astype(np.float32)
    shares = rng.uniform(0.2, 1.7, (rows, columns, 1))
    image = color * shares + rng.normal(0, 12, color.shape)
    return Background(color, noise), np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("size", [(7, 9), (1, 5), (6, 1), (2, 2)])
def test_smoothing_agrees_with_its_naive_twin(rng, size):
    image = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
    np.testing.assert_array_equal(smooth(image), naive.smooth(image))


@pytest.mark.parametrize("count", [1, 2, 31, 300])
@pytest.mark.parametrize("largest", [0.01, 1.1, 12.5], ids=["a bucket", "usual", "beyond buckets"])
def test_the_median_of_what_can_be_told_is_exact(rng, largest, count):
    values = rng.uniform(0.9 * largest, largest, count).astype(np.float32)
    among_others = rng.permutation(np.append(values, np.full(7, np.inf, np.float32)))
    assert backgrounds._median(among_others, count) == np.median(values)


@pytest.mark.parametrize("kind", ["any", "dark", "clipped", "somebody", "far brighter"])
def test_the_gain_agrees_with_its_naive_twin(rng, kind):
    background, image = random_scene(rng)
    image = np.clip(background.color * 1.17 + rng.normal(0, 9, image.shape), 0, 255)
    if kind == "dark":
        background = Background(background.color * 0 + 3, background.noise)
    elif kind == "clipped":
        image[:, ::2] = 255
    elif kind == "somebody":
        image[:, :7] = 200
    elif kind == "far brighter":
        background = Background(background.color / 9 + 10, background.noise)
    image = image.astype(np.uint8)
    slow = naive.gain(image, background.color)
    assert measure_gain(image, background) == pytest.approx(slow, rel=1e-5)
    assert {"any": 1.1 < slow < 1.25, "dark": slow == 1, "far brighter": slow == 2}.get(kind, True)


@pytest.mark.parametrize("levels", [0.0, 5.0])
def test_color_distance_agrees_with_its_naive_twin(rng, levels):
    background, image = random_scene(rng)
    gain, darkest, brightest, threshold = 1.1, 0.6, 1.2, 14.0
    seed = np.empty(image.shape[:2], np.uint8)
    limits = np.array([gain, threshold, levels, darkest, brightest], np.float32)
    differ_in_color(planes(image), planes(background.color), background.noise, limits, seed)
    checked = 0
    for i, j in np.ndindex(seed.shape):
        behind = 1.1 * background.color[i, j].astype(float)
        far = naive.distortion(image[i, j].astype(float), behind, darkest, brightest)
        limit = max(threshold, levels * background.noise[i, j])
        if abs(far - limit) > 0.05:
            assert seed[i, j] == (far > limit)
            checked += 1
    assert checked > 0.97 * seed.size
    assert 0.1 < seed.mean() < 0.9


def test_chroma_distance_agrees_with_its_naive_twin(rng):
    background, image = random_scene(rng)
    seed = np.empty(image.shape[:2], np.uint8)
    differ_in_chroma(image, background.color, np.float32(9.0), seed)
    for i, j in np.ndindex(seed.shape):
        seen, behind = naive.chroma(image[i, j]), naive.chroma(background.color[i, j])
        far = max(abs(a - b) for a, b in zip(seen, behind, strict=True))
        assert seed[i, j] == (far > 9.0) or abs(far - 9.0) < 1e-3
    assert 0.1 < seed.mean() < 0.9


@pytest.mark.parametrize(
    ("cut", "passes", "noise", "other"),
    [
        (0.3, 1, 9.0, np.inf),
        (0.5, 1, 9.0, np.inf),
        (0.5, 2, 9.0, 30.0),
        (0.5, 2, 90.0, 60.0),
        (0.5, 2, 90.0, np.inf),
    ],
)
def test_the_outline_agrees_with_its_naive_twin(rng, cut, passes, noise, other):
    there = figure()
    there[:5, :9] = there[-4:, -9:] = True  # at the border of the picture
    there[-4:, np.arange(COLUMNS) % 12 < 5] = True
    color = plate(rng).astype(np.float32)
    image = smooth(noisy(dressed(color * 0.8, there, (150, 40, 60)), rng, noise))
    image[0, 6:8] = color[0, 6:8] * 0.8  # inside the region, but it looks like the background
    rough = cv2.dilate(there.astype(np.uint8), np.ones((2, 2), np.uint8)).astype(bool)
    behind = np.concatenate([planes(color), color.sum(axis=2, dtype=np.float32)[None]])
    fast, slow = rough.astype(np.uint8), rough
    for _ in range(passes):
        fast = draw_outline(fast, planes(image), behind, (0, 0), (3, cut, other))
        slow = naive.outline(image, color, slow, 3, cut, other)
    np.testing.assert_array_equal(fast.astype(bool), slow)
    assert (slow != rough).sum() > 20


def test_a_thin_hand_of_another_color_beside_the_trunk_is_kept(rng):
    trunk, hand = figure(), np.zeros((ROWS, COLUMNS), bool)
    hand[33:36, 37:40] = True
    image = cv2.blur(dressed(dressed(plate(rng), trunk), hand, (80, 150, 150)), (3, 3))
    background = make_background(np.stack([plate(rng) for _ in range(20)]))
    assert one(image, background)[hand].mean() > 0.7
    assert one(image, background, SilhouetteSettings(other_color=400.0))[hand].mean() < 0.4


def test_the_outline_in_a_box_is_that_in_the_picture(rng):
    there: Any = cv2.dilate(figure().astype(np.uint8), np.ones((2, 2), np.uint8))
    box = (slice(1, 48), slice(18, 60))
    color = plate(rng).astype(np.float32)
    image = planes(noisy(dressed(color * 0.8, figure()), rng, 30.0))
    behind = np.concatenate([planes(color), color.sum(axis=2, dtype=np.float32)[None]])
    whole = draw_outline(there, image, behind, (0, 0), (3, 0.5, 27.0))
    part = draw_outline(there[box].copy(), image, behind, (1, 18), (3, 0.5, 27.0))
    np.testing.assert_array_equal(part, whole[box])
    assert (whole != there).sum() > 20


def test_small_components_and_holes_agree_with_their_naive_twin(rng):
    for density in (0.3, 0.5, 0.65):
        region = rng.random((22, 31)) < density
        fast = np.zeros(region.shape, np.bool_)
        clean_region(region.astype(np.uint8), (6.0, 4.0), fast)
        slow = naive.without_small_components_and_holes(region, 6.0, 4.0)
        np.testing.assert_array_equal(fast, slow)
        assert (slow != region).sum() > 0


@BOTH
def test_a_frame_of_the_background_is_empty(rng, rule):
    settings = SilhouetteSettings(rule=rule)
    image = plate(rng)
    background = make_background(image[None])
    assert not one(image, background, settings).any()
    assert not extract_silhouettes(np.stack([plate(rng)] * 3), background, settings).any()


@BOTH
def test_a_planted_figure_is_found_to_the_pixel(rng, rule):
    background = make_background(plate(rng)[None])
    found = one(dressed(plate(rng), figure()), background, SilhouetteSettings(rule=rule))
    assert overlap(found, figure()) > {"chroma": 0.97, "crcb": 0.8}[rule]


def test_the_crcb_rule_swells_the_outline_where_chroma_does_not(rng):
    background = make_background(plate(rng)[None])
    frame = smooth(smooth(dressed(plate(rng), figure(), (210, 40, 160))))
    assert one(frame, background, CRCB).sum() > 1.1 * figure().sum()
    assert overlap(one(frame, background), figure()) > 0.94
    once = SilhouetteSettings(passes=1)
    assert overlap(one(frame, background, once), figure()) < 0.9


@pytest.mark.parametrize("color", [(8, 8, 8), (250, 250, 250), (210, 160, 130), (20, 30, 120)],
                         ids=["black", "white", "skin", "navy"])  # fmt: skip
def test_black_white_and_skin_are_the_performer(rng, color):
    background = make_background(plate(rng)[None])
    assert overlap(one(dressed(plate(rng), figure(), color), background), figure()) > 0.96


@pytest.mark.parametrize("dark", [0.9, 0.75, 0.6])
def test_a_shadow_is_background_and_costs_the_figure_no_outline(rng, dark):
    background = make_background(plate(rng)[None])
    image = plate(rng).astype(float)
    image[34:, 8:60] *= dark
    found = one(dressed(noisy(image, rng, 1.0), figure()), background)
    assert overlap(found, figure()) > 0.96


def test_a_deep_shadow_is_the_performer_to_the_crcb_rule(rng):
    background = make_background(plate(rng)[None])
    image = plate(rng).astype(float)
    image[40:, 8:60] *= 0.2
    assert one(image.astype(np.uint8), background, CRCB).sum() > 250


@pytest.mark.parametrize("gain", [0.75, 1.2])
def test_another_exposure_changes_little(rng, gain):
    background = make_background(plate(rng)[None])
    frame = dressed(plate(rng), figure())
    brighter = np.clip(np.rint(frame * gain), 0, 255).astype(np.uint8)
    assert overlap(one(brighter, background), one(frame, background)) > 0.97


@pytest.mark.compiled
@BOTH
def test_cutting_a_take_into_blocks_changes_nothing(rng, rule):
    settings = SilhouetteSettings(rule=rule)
    background = make_background(plate(rng)[None])
    frames = np.stack([dressed(plate(rng), np.roll(figure(), n, 1)) for n in range(7)])
    frames[3] = (frames[3] * 0.9).astype(np.uint8)
    before = frames.copy()
    whole = extract_silhouettes(frames, background, settings)
    for cut in (1, 4):
        parts = [extract_silhouettes(part, background, settings) for part in
                 (frames[:cut], frames[cut:])]  # fmt: skip
        np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(frames, before)
    assert whole.any(axis=(1, 2)).all()
    assert whole.dtype == np.bool_
    assert extract_silhouettes(frames[:0], background, settings).shape == (0, ROWS, COLUMNS)


def test_a_figure_at_the_border_and_a_picture_full_of_it(rng):
    background = make_background(plate(rng)[None])
    there = np.zeros((ROWS, COLUMNS), bool)
    there[20:, :15] = True
    assert overlap(one(dressed(plate(rng), there), background), there) > 0.97
    there[:] = True
    assert one(dressed(plate(rng), there), background).all()


def test_one_picture_has_its_noise_measured(rng):
    flat = np.full((90, 120, 3), 120.0)
    background = make_background(noisy(flat, rng, 6.0)[None])
    assert np.ptp(background.noise) == 0.0
    assert background.noise[0, 0] == pytest.approx(0.375 * 6.0, rel=0.1)


def test_several_pictures_leave_out_who_walks_through_and_follow_exposure(rng):
    clean = plate(rng, noise=0.0)
    images = []
    for n in range(11):
        seen = dressed(clean, np.roll(figure(), 20 * n, 1)) if n % 3 == 1 else clean
        images.append(noisy(seen * (1.0 + 0.04 * np.sin(n)), rng, 4.0))
    background = make_background(np.stack(images))
    assert np.abs(background.color - smooth(clean)).mean() < 1.0
    assert np.median(background.noise) == pytest.approx(0.375 * 4.0, rel=0.25)


def test_where_the_background_flickers_the_threshold_is_higher(rng):
    images = np.stack([plate(rng).astype(float) for _ in range(9)])
    images[:, :, 40:] += rng.normal(0, 60, (9, ROWS, 24, 3))
    background = make_background(np.clip(images, 0, 255).astype(np.uint8))
    assert background.noise[:, 44:].mean() > 5 * background.noise[:, :36].mean()
    frame = plate(rng).astype(float)
    frame[:, 40:] += rng.normal(0, 60, (ROWS, 24, 3))
    frame = np.clip(frame, 0, 255).astype(np.uint8)
    strict = SilhouetteSettings(noise_levels=0.0, component_share=0.0)
    tolerant = SilhouetteSettings(noise_levels=5.0, component_share=0.0)
    assert one(frame, background, tolerant).sum() < 0.1 * one(frame, background, strict).sum()


def test_what_is_no_film_or_no_background_is_refused(rng):
    background = make_background(plate(rng)[None])
    frames = plate(rng)[None]
    for wrong in (frames[0], frames.astype(float), frames[..., :2]):
        with pytest.raises(ValueError, match=r"is no film; \(time, row, column, 3\) uint8"):
            extract_silhouettes(wrong, background)
        with pytest.raises(ValueError, match="is no background"):
            make_background(wrong)
    with pytest.raises(ValueError, match="is no background"):
        make_background(frames[:0])
    with pytest.raises(ValueError, match="frames are 63 x 48 and the background is 64 x 48"):
        extract_silhouettes(frames[:, :, 1:], background)


def test_all_wrong_settings_are_said_at_once():
    with pytest.raises(ValueError, match="rule is 'hsv'") as raised:
        SilhouetteSettings(rule="hsv", threshold=-1.0, darkest=1.2, cut=1.0, reach_px=0, passes=99)
    for said in (
        "threshold is -1.0",
        "darkest is 1.2",
        "cut is 1.0",
        "reach_px is 0",
        "passes is 99",
    ):
        assert said in str(raised.value)


@pytest.mark.data
@pytest.mark.compiled
@pytest.mark.parametrize("name", ["plain", "kimono", "spin", "martial"])
def test_rendered_dancers_are_cut_out(shared_data, name):
    truth = np.load(shared_data / "captures" / f"{name}_truth.npz")
    camera = {"plain": 3, "kimono": 7, "spin": 7, "martial": 3}[name]  # the hardest of each
    masks = np.unpackbits(truth["masks"][::30, camera - 1], axis=-1)[..., :320].astype(bool)
    folder = shared_data / "captures" / name
    video = open_video(folder / "videos" / f"cam{camera}.mp4")
    plates = cv2.imread(str(folder / "background" / f"cam{camera}.png"), cv2.IMREAD_COLOR_RGB)
    assert plates is not None
    background = make_background(plates[None])
    found = extract_silhouettes(read_frames(video, 0, 121)[::30], background)
    union, both = (found | masks[:5]).sum((1, 2)), (found & masks[:5]).sum((1, 2))
    assert (both / union).mean() > 0.95
