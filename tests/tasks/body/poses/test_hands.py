"""Hands that were seen at a wrong place are found where an arm sticks out unexplained."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES, rest_pose
from tasks.body.blobs.fitting import fit_frame
from tasks.body.blobs.samples import draw_samples
from tasks.body.poses.hands import look_for_hands
from tasks.body.poses.limbs import LIMBS, reach_for
from tasks.body.poses.passes import Fitting
from tasks.body.poses.settings import JointMethodSettings
from tasks.geometry.voxels import encode_runs, take_frame
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

RATE, FRAMES = 20.0, 8  # 0.1 s are two frames
OFF = np.array([-0.1, 0.0, 0.0])  # the middle of the right hand from its wrist
pytestmark = pytest.mark.compiled  # some hundred fits


@pytest.fixture(scope="module")
def strayed():
    """A take that stands still, and fits whose right arm is with the left one."""
    figure = figure_of_tubes(0.0)
    runs = encode_runs(np.stack([figure[1]] * FRAMES))
    model = model_of(figure, runs)
    right, left = (
        model.origin[BONES.index(f"{s}Hand")] + k * OFF for s, k in (("R", 1), ("L", -1))
    )
    cues = np.full((FRAMES, 5, 3), np.nan)
    cues[:, 1], cues[:, 2] = right, left
    samples = draw_samples([take_frame(runs, t) for t in range(FRAMES)], None, 2000)
    looks = np.ones((1, len(BONES) + 1), np.float32)
    weights = np.full((FRAMES, 5), 0.5)
    take = Fitting(GRID, RATE, model, JointMethodSettings(), cues, weights, cues[0], samples, looks)
    rest = rest_pose(model.origin)
    astray = reach_for(rest, model.origin, LIMBS[0], OFF, left - [0.3, 0.0, 0.0], 1)[0]
    fits = [
        fit_frame(model, take.sample(t), pose, pose, settings=take.settings.fit, steps=0)
        for t, pose in enumerate([rest] + [astray] * 6 + [rest])
    ]
    return take, fits, right, left


def seen_astray(take, left, frames):
    cues = take.cues.copy()
    cues[list(frames), 1] = left - [0.3, 0.0, 0.0]
    return replace(take, cues=cues)


def test_a_hand_is_where_its_arm_sticks_out(strayed):
    take, fits, right, left = strayed
    wrong = seen_astray(take, left, range(1, 7))
    ends = [np.stack([right, left, right + np.array([0.0, 0.6, 0.3])])] * FRAMES
    found = look_for_hands(wrong, fits, ends)
    np.testing.assert_array_equal(found.cues[:, :3], take.cues[:, :3])
    assert found.cue_weights[:, 1].tolist() == [0.5, *[1.0] * 6, 0.5]
    assert (found.cue_weights[:, 2] == 0.5).all()
    assert (wrong.cues[1:7, 1] != right).any()  # what was given stays


def test_a_single_frame_says_nothing(strayed):
    take, fits, right, left = strayed
    alone = [fits[0], fits[0], fits[2], *[fits[0]] * 5]
    wrong = seen_astray(take, left, [2])
    found = look_for_hands(wrong, alone, [right[None]] * FRAMES)
    np.testing.assert_array_equal(found.cues, wrong.cues)


def test_what_explains_no_more_is_no_hand(strayed):
    take, fits, right, _ = strayed
    beside = right + np.array([0.3, 0.25, 0.25])
    for ends in (beside[None], np.empty((0, 3))):
        found = look_for_hands(take, [fits[0]] * FRAMES, [ends] * FRAMES)
        np.testing.assert_array_equal(found.cues, take.cues)
    assert look_for_hands(replace(take, cues=None), fits, [right[None]] * FRAMES).cues is None
