"""Limbs of different colors are told apart, and light from one side is no color."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES, Pose, place_bones, rest_pose, rotation_of
from tasks.body.anatomy.colors import color_cells
from tasks.body.blobs.fitting import Fit
from tasks.body.poses import worn
from tasks.body.poses.limbs import LIMBS
from tasks.body.poses.passes import Fitting
from tasks.body.poses.settings import JointMethodSettings
from tasks.geometry.voxels import encode_runs, voxel_centers, voxel_index
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

FRAMES, WRONG = 140, slice(60, 75)
RED, BLUE, DARK_RED = (200, 60, 50), (50, 60, 200), (110, 33, 28)
TURNED = rotation_of(np.array([0.0, np.pi, 0.0]))


@pytest.fixture(scope="module")
def figure():
    """The model of a figure of tubes, its voxels, and which forearm each is near, 0 for none."""
    made = figure_of_tubes(0.0)
    runs = encode_runs(made[1][None])
    model, index = model_of(made, runs), voxel_index(runs, 0).astype(np.int16)
    joints = place_bones(rest_pose(model.origin), model.origin)
    x = voxel_centers(GRID, index)[:, 0]
    side = np.where(x < joints[LIMBS[0].lower, 0], 1, np.where(x > joints[LIMBS[1].lower, 0], 2, 0))
    return model, index, side


def take_of(figure, right, left):
    """Return a still figure whose sleeves have colors, a (time,) of them each."""
    model, index, side = figure
    looks = np.ones((1, len(BONES) + 1), np.float32)
    samples = []
    for colors in zip(right, left, strict=True):
        color = np.array([(90, 90, 90), *colors], np.uint8)[side]
        samples.append((index, color_cells(color).astype(np.int32)))
    return Fitting(GRID, 20.0, model, JointMethodSettings(), None, None, None, samples, looks)


def fits_of(figure, turned=()):
    """Return fits of the still figure; in some frames it faces the other way."""
    model, _, _ = figure
    rest = rest_pose(model.origin)
    around = Pose(rest.root * (-1.0, 1.0, -1.0), TURNED @ rest.rotation)
    poses = [around if t in turned else rest for t in range(FRAMES)]
    return [Fit(pose, 1.0, np.ones(len(BONES))) for pose in poses]


def test_colors_on_the_wrong_sides_are_marked(figure):
    take = take_of(figure, [RED] * FRAMES, [BLUE] * FRAMES)
    mark = worn.mark_sides(take, fits_of(figure, range(FRAMES)[WRONG]), 0)
    is_wrong = np.zeros(FRAMES, bool)
    is_wrong[WRONG] = True
    assert mark[is_wrong][2:-2].max() < -0.5
    assert mark[~is_wrong][:50].min() > 0.5
    assert not worn.mark_sides(take, fits_of(figure), 1).any()  # both legs are gray


@pytest.mark.parametrize("left", [RED, DARK_RED], ids=["alike", "in the shade"])
def test_sides_that_wear_the_same_are_not_asked(figure, left):
    take = take_of(figure, [RED] * FRAMES, [left] * FRAMES)
    assert not worn.mark_sides(take, fits_of(figure, range(FRAMES)[WRONG]), 0).any()


def exchange(monkeypatch, figure, take, likelihood, turned=range(FRAMES)[WRONG]):
    """Return what is exchanged, and which stretches were tried."""
    tried = []

    def fit(take, _fits, pair, stretch):
        tried.append((pair, stretch))
        found = fits_of(figure)[slice(*stretch)]
        return take, [replace(each, likelihood=likelihood) for each in found]

    monkeypatch.setattr(worn, "fit_exchanged", fit)
    fits, gains = fits_of(figure, turned), np.full((FRAMES, 2), -0.1)
    return fits, worn.exchange_by_colors(take, fits, gains, 0), tried


def test_a_stretch_is_exchanged_where_that_is_about_as_likely(monkeypatch, figure):
    take = take_of(figure, [RED] * FRAMES, [BLUE] * FRAMES)
    _, (_, found, gains), tried = exchange(monkeypatch, figure, take, 0.98)
    assert len(tried) == 1
    assert tried[0][0] == 0
    first, last = tried[0][1]
    assert abs(first - WRONG.start) <= 2
    assert abs(last - WRONG.stop) <= 2
    assert (gains[:, 0] == -1.0).all()  # none could be exchanged now
    assert (gains[:, 1] == -0.1).all()  # of the legs colors say nothing
    assert worn.mark_sides(take, found, 0).min() > 0.9


def test_a_stretch_stays_that_is_much_less_likely_exchanged(monkeypatch, figure):
    take = take_of(figure, [RED] * FRAMES, [BLUE] * FRAMES)
    fits, (_, found, gains), tried = exchange(monkeypatch, figure, take, 0.8)
    assert tried
    assert (gains[WRONG, 0] == 0.0)[3:-3].all()  # it could well be exchanged
    assert all(a is b for a, b in zip(fits, found, strict=True))


def test_the_initial_frame_is_right_whatever_most_frames_are(monkeypatch, figure):
    take = take_of(figure, [RED] * FRAMES, [BLUE] * FRAMES)
    _, _, tried = exchange(monkeypatch, figure, take, 1.0, turned=range(20, FRAMES))
    [(pair, (first, last))] = tried
    assert pair == 0
    assert abs(first - 20) <= 2
    assert last == FRAMES


def test_one_initial_frame_does_not_exchange_all_others(monkeypatch, figure):
    take = take_of(figure, [RED] * FRAMES, [BLUE] * FRAMES)
    fits, (_, found, gains), tried = exchange(monkeypatch, figure, take, 1.0, turned=range(4))
    assert worn.mark_sides(take, fits, 0)[0] < -0.3
    assert not tried
    assert all(a is b for a, b in zip(fits, found, strict=True))
    assert (gains == -0.1).all()
