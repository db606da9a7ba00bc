"""A fitted figure that stands still, for what asks how doubtful it is."""

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.body.anatomy.bones import BONES, rest_pose
from tasks.body.blobs.fitting import Fit
from tasks.body.blobs.model import middles
from tasks.body.blobs.samples import draw_samples
from tasks.body.extremities.candidates import Candidates
from tasks.body.poses.joint import Account, FittedPoses
from tasks.body.poses.limbs import LIMBS
from tasks.body.poses.passes import Fitting
from tasks.body.poses.settings import JointMethodSettings
from tasks.geometry.voxels import encode_runs, take_frame
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

FRAMES = 9


@pytest.fixture(scope="module")
def right():
    """A figure that stands still, with a pose that fits, and hands where skin is."""
    joints, occupied, _ = figure_of_tubes(0.0)
    runs = encode_runs(occupied[None])
    model = model_of((joints, occupied, figure_of_tubes(0.0)[2]), runs)
    pose = rest_pose(model.origin)
    fit = Fit(pose, 1.0, np.ones(len(BONES)))
    samples = draw_samples([take_frame(runs, 0)] * FRAMES, None, 2000)
    looks = np.ones((1, len(BONES) + 1), np.float32)
    take = Fitting(GRID, 30.0, model, JointMethodSettings(), None, None, None, samples, looks)
    fits = (fit,) * FRAMES
    account = Account(take, (fits, fits), fits, np.full((FRAMES, 2), -1.0))
    position = np.stack([[joints[name] for name in JOINTS]] * FRAMES)
    still = np.zeros((FRAMES, 11))
    fitted = FittedPoses(
        position, position[0], np.tile(np.eye(3), (FRAMES, 11, 1, 1)), position[:, :11],
        still + 1.0, still[:, 0] > 0, still[:, :2] > 0, (pose,) * FRAMES, model, account,
    )  # fmt: skip
    hands = middles(model, pose)[[LIMBS[0].end, LIMBS[1].end]]
    seen = Candidates(
        hands,
        np.ones(2),
        np.ones(2, bool),
        np.empty((0, 3)),
        np.empty(0),
        np.empty((0, 3)),
        np.empty(0),
        np.empty(0),
    )
    return fitted, [seen] * FRAMES
