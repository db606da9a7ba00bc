"""Pictures show what is there: sides, places, missing joints; and files are whole."""

import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.pictures.pictures import write_png
from storage.schema import JOINTS
from tasks.rendering.drawing.canvas import BLUE, ORANGE, PAPER
from tasks.rendering.figures import (
    FigureSettings,
    draw_overlay,
    draw_stick_figures,
)
from tasks.studio.dancing.choreography import lonely, okuri48, radio_arms
from tasks.studio.performances import TK, YS, generate_performance


@pytest.fixture(scope="module")
def performance():
    return generate_performance([radio_arms()], TK, rate_hz=30.0)


def near(image, color, within=12):
    return (np.abs(image.astype(int) - color).max(axis=2) <= within).sum()


def pixels(image, color, within=12):
    return np.argwhere(np.abs(image.astype(int) - color).max(axis=2) <= within)


def inked(image):
    """Saturated pixels: limbs, heads and trunks, but neither paper, floor nor text."""
    return np.ptp(image.astype(int), axis=2) > 60


def turned_and_moved(position, heading, place):
    c, s = np.cos(heading), np.sin(heading)
    return position @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) + place


def test_a_row_has_the_width_asked_for_and_every_figure_in_its_place(performance):
    image = draw_stick_figures(performance.position, [9, 60, 100], title="Radio")
    assert image.dtype == np.uint8
    assert image.shape[1:] == (1200, 3)
    columns = inked(image).any(axis=0)
    for middle in (20 + 1160 * (n + 0.5) / 3 for n in range(3)):
        assert columns[round(middle) - 60 : round(middle) + 60].any()
    assert not inked(image)[:, [0, -1]].any()
    assert not inked(image)[[0, -1]].any()


def test_the_right_side_is_the_viewers_left_and_darker(performance):
    image = draw_stick_figures(
        performance.position, [9], settings=FigureSettings(width=400, aside=0.0)
    )
    dark = pixels(image, tuple(round(0.72 * c) for c in BLUE))
    light = pixels(
        image, tuple(round(0.72 * c + 0.28 * p) for c, p in zip(BLUE, PAPER, strict=True))
    )
    assert min(len(dark), len(light)) > 100
    assert dark[:, 1].mean() < 195.0 < 205.0 < light[:, 1].mean()


def test_feet_are_below_heads(performance):
    image = draw_stick_figures(performance.position, [9], settings=FigureSettings(width=300))
    head = pixels(image, BLUE)
    assert head[:, 0].min() == np.argwhere(inked(image))[:, 0].min()


def test_the_place_on_the_stage_and_the_first_heading_change_nothing(performance):
    frames = [9, 70]
    here = draw_stick_figures(performance.position, frames)
    elsewhere = turned_and_moved(performance.position, 2.1, [3.0, 0.0, -7.0])
    there = draw_stick_figures(elsewhere, frames)
    assert (np.abs(here.astype(int) - there).max(axis=2) > 8).mean() < 1e-4


def test_lines_to_a_missing_joint_are_left_out(performance):
    whole = performance.position[[9]]
    less = whole.copy()
    less[0, [JOINTS.index(name) for name in ("RElbow", "LKnee", "Waist", "Head")]] = np.nan
    counts = [inked(draw_stick_figures(p, [0])).sum() for p in (whole, less, less * np.nan)]
    assert counts[0] > 1.2 * counts[1] > 100.0
    assert counts[2] == 0


def test_figures_of_other_size_are_drawn_to_one_scale():
    small, tall = (generate_performance([okuri48()], p, rate_hz=30.0).position for p in (TK, YS))
    both = np.concatenate([small[:1], tall[:1]])
    image = inked(draw_stick_figures(both, [0, 1]))
    heights = [np.ptp(np.argwhere(half)[:, 0]) for half in np.split(image, 2, axis=1)]
    assert heights[1] / heights[0] == pytest.approx(1.80 / 1.55, abs=0.03)


def test_a_match_that_is_the_query_moved_turned_and_scaled_covers_it(performance):
    query = performance.position[10:80]
    copy = 1.2 * turned_and_moved(query, -1.0, [1.0, 0.0, 2.0])
    same = draw_overlay(query, query, instants=4)
    moved = draw_overlay(query, copy, instants=4)
    figures = np.s_[50:-60]
    assert (np.abs(same.astype(int) - moved).max(axis=2)[figures] > 24).mean() < 2e-3
    assert near(moved[figures], ORANGE) > 2.0 * near(moved[figures], BLUE)


def test_a_match_that_differs_shows_both_colors(performance):
    other = generate_performance([lonely()], YS, rate_hz=30.0).position
    image = draw_overlay(performance.position[10:80], other[10:90], title="Not alike")
    assert near(image[60:-60], BLUE) > 500
    assert near(image[60:-60], ORANGE) > 500


def test_the_warping_path_says_which_frames_stand_together(performance):
    query, match = performance.position[20:60], performance.position[20:80]
    pairs = [(n, n + n // 3) for n in range(40)]
    sizes = {"query_stature_m": 1.5, "match_stature_m": 1.5, "instants": 3}
    warped = draw_overlay(query, match, pairs=pairs, **sizes)
    straight = draw_overlay(query[[0, 20, 39]], match[[0, 26, 52]], **sizes)
    np.testing.assert_array_equal(warped[:-60], straight[:-60])
    assert (draw_overlay(query, match, **sizes) != straight).any()
    labeled = draw_overlay(query, match, pairs=pairs, starts=(400, 7000), **sizes)
    np.testing.assert_array_equal(labeled[:-60], warped[:-60])
    assert (labeled[-60:] != warped[-60:]).any()


def test_limbs_that_were_not_searched_with_are_faint(performance):
    clip = performance.position[20:60]
    whole = draw_overlay(clip, clip, instants=1)[50:-60]
    feet = draw_overlay(clip, clip, instants=1, joints=("RHeel", "RFoot", "LHeel", "LFoot"))
    assert near(feet[50:-60], ORANGE) < 0.05 * near(whole, ORANGE)
    rows = np.argwhere(inked(feet[50:-60]) & (np.ptp(feet[50:-60].astype(int), axis=2) > 90))
    assert rows[:, 0].min() > 0.7 * len(whole)


def test_what_cannot_be_drawn_is_refused(performance):
    position = performance.position
    with pytest.raises(ValueError, match=r"frames \[3, 999\] cannot all be drawn; give at least"):
        draw_stick_figures(position, [3, 999])
    with pytest.raises(ValueError, match="give at least one, each within 0-"):
        draw_stick_figures(position, [])
    with pytest.raises(ValueError, match=r"shape \(5, 20, 3\) cannot be drawn"):
        draw_stick_figures(position[:5, :20], [0])
    with pytest.raises(ValueError, match="width is 0, it must be a whole number 1 or more"):
        FigureSettings(width=0)
    with pytest.raises(ValueError, match="0 instants cannot be drawn; ask for at least one"):
        draw_overlay(position, position, instants=0)


def test_a_written_picture_is_the_picture(tmp_path):
    image = np.random.default_rng(7).integers(0, 256, (5, 8, 3), dtype=np.uint8)
    path = tmp_path / "one.png"
    write_png(path, image)
    write_png(path, image)
    np.testing.assert_array_equal(cv2.imread(str(path))[..., ::-1], image)
    assert [p.name for p in tmp_path.iterdir()] == ["one.png"]


def test_a_picture_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    image = np.zeros((5, 8, 3), np.uint8)
    with pytest.raises(
        InputError, match=r"cannot be written \(No such file or directory\); choose"
    ):
        write_png(tmp_path / "nowhere" / "one.png", image)
    (tmp_path / "taken.png").mkdir()
    with pytest.raises(InputError, match="choose a folder that exists"):
        write_png(tmp_path / "taken.png", image)
    with pytest.raises(InputError, match=r"does not end in \.png"):
        write_png(tmp_path / "one.jpg", image)
    with pytest.raises(ValueError, match=r"float64 array of shape \(5, 8\) is no picture"):
        write_png(tmp_path / "one.png", np.zeros((5, 8)))
    assert [p.name for p in tmp_path.iterdir()] == ["taken.png"]
