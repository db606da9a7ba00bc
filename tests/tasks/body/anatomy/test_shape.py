import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from storage.schema import JOINTS
from tasks.body.anatomy import segments as tree
from tasks.body.anatomy import shape as body_model
from tests.conftest import swaying_body
from tests.twins.segments import pose_in_world

VOXELS = 300


@pytest.fixture
def rng():
    return np.random.default_rng(31)


@pytest.fixture
def joint():
    return swaying_body(5, 1)[0]


@pytest.fixture
def labeled(rng, joint):
    """Return voxels around the joint of each segment, stretched differently along x, y, z."""
    origin = np.stack([joint[JOINTS.index(name)] for name in tree.ORIGINS])
    count = VOXELS + 10 * np.arange(11)
    label = np.repeat(np.arange(1, 12), count)
    center = origin[label - 1] + rng.normal(size=(len(label), 3)) * [0.02, 0.09, 0.05]
    order = rng.permutation(len(label))
    return center[order], label[order]


def test_equation_2_in_homogeneous_matrices(labeled, joint):
    center, label = labeled
    model = body_model.measure_body(center, label, joint)
    for k in range(11):
        voxels = center[label == k + 1]
        world = np.eye(4)
        mean, _, axes = body_model.principal_axes(voxels)
        world[:3, :3], world[:3, 3] = axes, mean
        own = np.eye(4)
        own[:3, :3], own[:3, 3] = model.rotation[k], model.position[k]
        wanted = np.linalg.inv(own) @ world
        np.testing.assert_allclose(model.shape.axes[k], wanted[:3, :3], atol=1e-12)
        np.testing.assert_allclose(model.shape.centroid[k], wanted[:3, 3], atol=1e-12)


def test_the_ellipsoids_at_the_first_frame_are_those_of_the_voxels(labeled, joint):
    center, label = labeled
    model = body_model.measure_body(center, label, joint)
    mean, inverse = tree.place_ellipsoids(model.shape, model.position, model.rotation)
    for k in range(11):
        voxels = center[label == k + 1]
        away = voxels - voxels.sum(axis=0) / len(voxels)
        spread = sum(np.outer(a, a) for a in away) / len(voxels)
        np.testing.assert_allclose(mean[k], voxels.sum(axis=0) / len(voxels))
        np.testing.assert_allclose(np.linalg.inv(inverse[k]), spread, atol=1e-12)
    assert model.shape.volume_share[4] == np.mean(label == 5)
    assert model.shape.volume_share.sum() == pytest.approx(1)


def test_all_joints_are_rebuilt_from_the_local_parameters(labeled, joint):
    joint[JOINTS.index("LHeel")] = np.nan
    model = body_model.measure_body(labeled[0], labeled[1], joint)
    _, turn = tree.pose_in_parents(model.position, model.rotation)
    local = model.shape.offset.copy()
    local[0] = model.position[0]
    position, rotation = pose_in_world(local, turn)
    np.testing.assert_allclose(position, model.position, atol=1e-12)
    again = tree.carry_joints(model.shape.joint, position, rotation)
    np.testing.assert_allclose(again, joint, atol=1e-12, equal_nan=True)


def test_moving_and_turning_a_performer_changes_no_shape(labeled, joint):
    center, label = labeled
    turn = Rotation.from_rotvec([0.3, 1.1, -0.4]).as_matrix()
    before = body_model.measure_body(center, label, joint).shape
    after = body_model.measure_body(
        center @ turn.T + [1, 2, 3], label, joint @ turn.T + [1, 2, 3]
    ).shape
    np.testing.assert_allclose(after.centroid, before.centroid, atol=1e-9)
    np.testing.assert_allclose(after.variance, before.variance, atol=1e-9)
    np.testing.assert_allclose(after.joint, before.joint, atol=1e-9)
    np.testing.assert_allclose(np.abs(after.axes), np.abs(before.axes), atol=1e-6)


def test_principal_axes_of_a_box_are_its_edges():
    index = np.stack(np.meshgrid(range(9), range(3), range(5), indexing="ij"), -1).reshape(-1, 3)
    mean, variance, axes = body_model.principal_axes(index.astype(float))
    np.testing.assert_allclose(mean, [4, 1, 2])
    np.testing.assert_allclose(variance, [(n * n - 1) / 12 for n in (3, 5, 9)])
    np.testing.assert_allclose(axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)


def test_labels_that_measure_nothing_are_refused(labeled, joint):
    center, label = labeled
    with pytest.raises(ValueError, match="do not fit; pass a label"):
        body_model.measure_body(center[1:], label, joint)
    with pytest.raises(ValueError, match=r"labels 4 \(0\), 9 \(0\) cannot be measured"):
        body_model.measure_body(center, np.where(np.isin(label, [4, 9]), 0, label), joint)
    with pytest.raises(ValueError, match=r"labels 12 \(3\) cannot be measured"):
        body_model.measure_body(center, np.where(np.arange(len(label)) < 3, 12, label), joint)
    flat = np.where((label == 6)[:, None], center * [1, 0, 1], center)
    with pytest.raises(ValueError, match="voxels of label 6 lie in a plane"):
        body_model.measure_body(flat, label, joint)


def test_a_segments_motion_has_the_velocities_of_its_law(rng):
    time_s = np.arange(40) / 30.0 + 5.0
    position, rotation = rng.normal(size=(40, 11, 3)), np.tile(np.eye(3), (40, 11, 1, 1))
    axis = np.array([0.6, 0.0, -0.8])
    rotation[:, 8] = Rotation.from_rotvec(7.0 * time_s[:, None] * axis).as_matrix()
    position[:, 8] = np.outer(time_s, [0.1, -0.4, 0.2]) + 3
    motion = body_model.segment_motion(time_s, position, rotation, 8)
    np.testing.assert_allclose(motion.velocity, np.tile([0.1, -0.4, 0.2], (40, 1)), atol=1e-9)
    np.testing.assert_allclose(motion.angular_velocity, np.tile(7.0 * axis, (40, 1)), atol=1e-9)
    np.testing.assert_array_equal(motion.position, position[:, 8])
    assert ((motion.quaternion[1:] * motion.quaternion[:-1]).sum(axis=1) > 0).all()
    assert Rotation.from_quat(motion.quaternion).as_matrix() == pytest.approx(rotation[:, 8])


def test_times_that_do_not_rise_are_no_motion():
    position, rotation = np.zeros((3, 11, 3)), np.tile(np.eye(3), (3, 11, 1, 1))
    for time_s in ([0.0], [0.0, 1.0, 1.0]):
        with pytest.raises(ValueError, match="do not make a motion"):
            body_model.segment_motion(np.array(time_s), position, rotation, 0)


def test_there_is_no_twelfth_segment(rng):
    with pytest.raises(ValueError, match="no segment 11; the eleven"):
        body_model.segment_motion(np.arange(2.0), rng.normal(size=(2, 11, 3)), np.eye(3), 11)
