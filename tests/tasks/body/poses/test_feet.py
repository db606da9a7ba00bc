"""Feet that were fitted backwards are turned round, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES, Pose, rest_pose, rotation_of
from tasks.body.blobs.fitting import FitSettings, fit_frame
from tasks.body.blobs.samples import draw_samples
from tasks.body.poses.feet import turn_feet
from tasks.body.poses.passes import Fitting
from tasks.body.poses.settings import JointMethodSettings
from tasks.geometry.voxels import encode_runs, take_frame
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

FRAMES = 4
FOOT, SHIN = BONES.index("LFoot"), BONES.index("LLowerLeg")
pytestmark = pytest.mark.compiled


@pytest.fixture(scope="module")
def standing():
    """A take of somebody who stands still, at 20 frames a second."""
    figure = figure_of_tubes(0.0)
    runs = encode_runs(np.stack([figure[1]] * FRAMES))
    model = model_of(figure, runs)
    samples = draw_samples([take_frame(runs, t) for t in range(FRAMES)], None, 2000)
    looks = np.ones((1, len(BONES) + 1), np.float32)
    return Fitting(GRID, 20.0, model, JointMethodSettings(), None, None, None, samples, looks)


def fits_of(take, turns):
    """Return the fits of a take with some bones turned by rotation vectors."""
    pose = rest_pose(take.model.origin)
    rotation = pose.rotation.copy()
    for bone, turn in turns.items():
        rotation[bone] = rotation_of(np.array(turn)) @ rotation[bone]
    turned = Pose(pose.root, rotation)
    return [
        fit_frame(take.model, take.sample(t), turned, turned, settings=FitSettings(), steps=0)
        for t in range(FRAMES)
    ]


def test_a_foot_that_points_backwards_is_turned_round(standing):
    found = turn_feet(standing, fits_of(standing, {FOOT: (0.0, 2.9, 0.0)}))
    toes = np.stack([fit.pose.rotation[FOOT] @ (0.0, 0.0, 1.0) for fit in found])
    assert (toes[:, 2] > 0.9).all()


@pytest.mark.parametrize(
    "turns",
    [
        {},
        {FOOT: (0.0, 0.8, 0.0)},  # turned out
        {SHIN: (1.6, 0.0, 0.0), FOOT: (1.6, 0.0, 0.0)},  # kicked back, along the leg
        {FOOT: (1.85, 0.0, 0.0)},  # on tiptoe it points nowhere
    ],
)
def test_other_feet_stay(standing, turns):
    fits = fits_of(standing, turns)
    assert all(new is old for new, old in zip(turn_feet(standing, fits), fits, strict=True))


def test_a_foot_stays_where_voxels_say_so(standing):
    fits = fits_of(standing, {FOOT: (0.0, 2.9, 0.0)})
    sure = [replace(fit, likelihood=fit.likelihood + 1.0) for fit in fits]
    assert all(new is old for new, old in zip(turn_feet(standing, sure), sure, strict=True))
