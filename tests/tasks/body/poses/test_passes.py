"""A trunk that did not turn with the performer is turned as hands and feet say."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES, place_bones, rest_pose, turn
from tasks.body.blobs.samples import draw_samples
from tasks.body.poses import passes
from tasks.body.poses.passes import Fitting, follow
from tasks.body.poses.settings import JointMethodSettings
from tasks.geometry.voxels import encode_runs, take_frame
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

FRAMES = 3
ENDS = ("Head", "RFin", "LFin", "RFoot", "LFoot")
pytestmark = pytest.mark.compiled


@pytest.fixture(scope="module")
def standing():
    """A take of a figure that stands still, with forearms bent up; toes point ahead."""
    figure = figure_of_tubes(0.9)
    runs = encode_runs(np.stack([figure[1]] * FRAMES))
    model = model_of(figure, runs)
    cues = np.tile([figure[0][name] for name in ENDS], (FRAMES, 1, 1))
    samples = draw_samples([take_frame(runs, t) for t in range(FRAMES)], None, 2000)
    looks = np.ones((1, len(BONES) + 1), np.float32)
    return Fitting(GRID, 30.0, model, JointMethodSettings(), cues, None, cues[0], samples, looks)


def hip_across(take, pose):
    """Return by how much the left hip is to the left of the right one, m."""
    joints = place_bones(pose, take.model.origin)
    return (joints[BONES.index("LUpperLeg")] - joints[BONES.index("RUpperLeg")])[0]


@pytest.mark.parametrize("yaw", [np.pi, 2.8, -2.8])
def test_a_trunk_that_faces_away_from_hands_and_feet_is_turned(standing, yaw, monkeypatch):
    rest = rest_pose(standing.model.origin)
    wrong = turn(rest, yaw, rest.root)
    found = [fit.pose for fit in follow(standing, range(FRAMES), wrong)]
    assert all(hip_across(standing, pose) > 0.15 for pose in found)
    monkeypatch.setattr(passes, "_CROSSED", 4.0)  # more than any angle
    assert hip_across(standing, follow(standing, range(FRAMES), wrong)[-1].pose) < 0.1


def test_arms_that_are_crossed_by_themselves_turn_no_trunk(standing):
    rest = rest_pose(standing.model.origin)
    cues = standing.cues.copy()
    cues[:, [1, 2]] = cues[:, [2, 1]]  # hands taken for each other, feet as they are
    crossed = replace(standing, cues=cues)
    assert hip_across(standing, follow(crossed, range(FRAMES), rest)[-1].pose) > 0.15
