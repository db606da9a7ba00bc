"""Hands that were taken for each other are told apart by the arms they are at."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES, rest_pose
from tasks.body.blobs.fitting import FitSettings, fit_frame
from tasks.body.blobs.model import middles
from tasks.body.blobs.samples import draw_samples
from tasks.body.poses.limbs import LIMBS, reach_for
from tasks.body.poses.passes import Fitting
from tasks.body.poses.settings import JointMethodSettings
from tasks.body.poses.sides import tell_sides
from tasks.geometry.voxels import encode_runs, take_frame
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

BENDS = (0.0, 0.9, 1.8, 2.5, 2.5, 2.5, 2.5, 2.5)  # forearms come in over the shoulders
HANDS = [LIMBS[0].end, LIMBS[1].end]
pytestmark = pytest.mark.compiled  # some hundred fits


@pytest.fixture(scope="module")
def crossed():
    """A take, its fits, and others that have the hands meet in frame 2 and exchanged after it."""
    figures = [figure_of_tubes(bend) for bend in BENDS]
    runs = encode_runs(np.stack([figure[1] for figure in figures]))
    model = model_of(figures[0], runs)
    ends = [(f[0][f"{side}Wrist"], f[0][f"{side}Fin"]) for f in figures for side in "RL"]
    hands = np.mean(ends, axis=1).reshape(len(BENDS), 2, 3)
    cues, weights = np.full((len(BENDS), 5, 3), np.nan), np.full((len(BENDS), 5), 0.5)
    cues[:, 1:3] = hands
    samples = draw_samples([take_frame(runs, t) for t in range(len(BENDS))], None, 2000)
    looks = np.ones((1, len(BONES) + 1), np.float32)
    take = Fitting(GRID, 20.0, model, JointMethodSettings(), cues, weights, cues[0], samples, looks)
    rest = rest_pose(model.origin)
    offsets = [middles(model, rest)[limb.end] - model.origin[limb.end] for limb in LIMBS[:2]]

    def fit(t, places, steps=6):
        best, pose = None, rest
        for limb, offset, place in zip(LIMBS[:2], offsets, places, strict=True):
            ways = reach_for(pose, model.origin, limb, offset, place, 4)
            fits = [
                fit_frame(model, take.sample(t), w, w, settings=FitSettings(), steps=steps)
                for w in ways
            ]
            best = max(fits, key=lambda fit: fit.likelihood)
            pose = best.pose
        return best

    right = [fit(t, hands[t]) for t in range(len(BENDS))]
    met = np.add(hands[2].mean(axis=0), [[0.02, 0.0, 0.0], [-0.02, 0.0, 0.0]])
    wrong = [*right[:2], fit(2, met, 0), *(fit(t, hands[t, ::-1]) for t in range(3, len(BENDS)))]
    return take, right, wrong, hands


def away(take, fits, hands):
    """Return (time, 2) how far hands are from where they are, m."""
    at = np.stack([middles(take.model, fit.pose)[HANDS] for fit in fits])
    return np.linalg.norm(at - hands, axis=2)


def exchanged(take):
    """Return the take in which the hands were taken for each other from frame 3 on."""
    cues = take.cues.copy()
    cues[3:, 1:3] = take.cues[3:, 2:0:-1]
    return replace(take, cues=cues)


def test_exchanged_hands_are_told_by_their_arms(crossed):
    take, _, wrong, hands = crossed
    _, found, unsure, gains = tell_sides(exchanged(take), wrong)
    assert away(take, wrong, hands)[3:].min() > 0.1
    assert away(take, found, hands)[3:].max() < 0.06
    assert not unsure.any()
    assert np.nanmax(gains[:, 0]) < -take.settings.side_margin


def test_hands_that_are_right_stay(crossed):
    take, right, _, _ = crossed
    _, found, unsure, _gains = tell_sides(take, right)
    assert all(a is b for a, b in zip(found, right, strict=True))
    assert not unsure.any()


def test_what_could_be_either_is_unsure_and_stays(crossed):
    """With a margin that nothing exceeds, the exchange is tried in earnest and rejected."""
    take, right, _, hands = crossed
    wide = replace(take, settings=replace(take.settings, side_margin=9.0))
    _, found, unsure, _gains = tell_sides(wide, right)
    assert away(take, found, hands).max() < 0.06
    assert unsure.all()


def test_a_long_stretch_is_looked_at_in_a_frame_a_second(crossed, monkeypatch):
    """In a frame a second at least is looked whether the pair is exchanged."""
    take, right, _, _ = crossed
    slow = replace(take, rate_hz=1.0, settings=replace(take.settings, side_frames=2))
    looked = []

    def note(*arguments):
        looked.append(arguments[-1].tolist())
        return {}

    monkeypatch.setattr("tasks.body.poses.sides._exchange", note)
    tell_sides(slow, right)
    tell_sides(replace(slow, rate_hz=20.0), right)
    long, short = looked[0], looked[-1]
    assert len(long) > 4
    assert len(short) == 2


def test_a_moment_apart_is_no_exchange(crossed):
    take, _, wrong, _ = crossed
    short = replace(take, settings=replace(take.settings, side_least_s=1.0))
    _, found, unsure, _gains = tell_sides(short, wrong)
    assert all(a is b for a, b in zip(found, wrong, strict=True))
    assert not unsure.any()
