"""The body of blobs: what a foot is made of, and how far it bends."""

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES, rest_pose, rotation_of
from tasks.body.anatomy.nearest_bones import bones_of_voxels
from tasks.body.blobs import least_squares
from tasks.body.blobs.model import make_model
from tasks.geometry.voxels import encode_runs, voxel_centers, voxel_index
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

FOOT, FORWARD = BONES.index("LFoot"), np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def figure():
    return figure_of_tubes(0.0)


@pytest.fixture(scope="module")
def points(figure):
    return voxel_centers(GRID, voxel_index(encode_runs(figure[1][None]), 0))


def test_the_hem_of_a_skirt_is_no_part_of_the_foot(figure, points):
    joints, _, label = figure
    bone = bones_of_voxels(points, label, joints, FORWARD)
    around = np.random.default_rng(0).uniform(-0.02, 0.02, (60, 3))
    hem = joints["LAnkle"] + (0.12, 0.06, 0.0) + around  # beside the leg, and above the sole
    both = np.concatenate([points, hem]), np.concatenate([bone, np.full(len(hem), FOOT)])
    bare, clad = make_model(points, bone, joints, FORWARD), make_model(*both, joints, FORWARD)
    own, dressed = (model.blobs.offset[model.blobs.bone == FOOT] for model in (bare, clad))
    assert np.ptp(own[:, 2]) > 0.05  # blobs of heel and toes tell where it points
    np.testing.assert_allclose(dressed, own, atol=1e-9)


@pytest.mark.parametrize(
    ("up_degrees", "allowed"), [(50.0, False), (25.0, True), (0.0, True), (-60.0, True)]
)
def test_toes_bend_up_only_so_far(figure, up_degrees, allowed):
    model = model_of(figure, encode_runs(figure[1][None]))
    rotation = rest_pose(model.origin).rotation
    rotation[FOOT] = rotation_of(np.array([-np.radians(up_degrees), 0.0, 0.0]))
    system = np.zeros((least_squares.UNKNOWNS, least_squares.UNKNOWNS + 1))
    least_squares.add_priors(
        rotation, rotation, np.zeros((len(BONES), 2)), model.limits, system[:, :-1], system[:, -1]
    )
    assert system.any() != allowed
