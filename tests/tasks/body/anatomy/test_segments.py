import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from storage.schema import JOINTS, SEGMENTS
from tasks.body.anatomy import segments as tree
from tests.conftest import swaying_body
from tests.twins.segments import pose_in_world


@pytest.fixture
def rng():
    return np.random.default_rng(23)


@pytest.fixture
def joint():
    return swaying_body(3, 1)[0]


def random_pose(rng, frames):
    rotation = Rotation.from_rotvec(rng.normal(size=(frames * 11, 3))).as_matrix()
    return rng.normal(size=(frames, 11, 3)), rotation.reshape(frames, 11, 3, 3)


def homogeneous(rotation, position):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def test_words_are_those_of_the_archive():
    assert len(tree.PARENTS) == len(tree.ORIGINS) == len(tree.ENDS) == len(SEGMENTS)
    assert len(tree.CARRIERS) == len(JOINTS)
    parents = {SEGMENTS[k]: SEGMENTS[p] for k, p in enumerate(tree.PARENTS) if p >= 0}
    arms = {f"{s}ForeArm": f"{s}UpperArm" for s in "RL"} | {f"{s}UpperArm": "Body" for s in "RL"}
    legs = {f"{s}LowerLeg": f"{s}UpperLeg" for s in "RL"} | {f"{s}UpperLeg": "Waist" for s in "RL"}
    assert parents == {"Body": "Head", "Waist": "Body"} | arms | legs
    for k, name in enumerate(JOINTS):
        carrier = SEGMENTS[tree.CARRIERS[k]]
        if name in tree.ORIGINS:
            assert tree.ORIGINS[tree.CARRIERS[k]] == name
        else:
            assert carrier[0] == name[0]
            assert carrier[1:] == ("ForeArm" if name[1:] in ("Wrist", "Fin") else "LowerLeg")


def test_children_are_on_the_negative_x_axis_as_the_paper_prints_it(joint):
    position, rotation = tree.local_systems(joint)
    np.testing.assert_allclose(np.linalg.det(rotation), 1)
    for k in range(11):
        end = np.mean([joint[JOINTS.index(name)] for name in tree.ENDS[k]], axis=0)
        local = rotation[k].T @ (end - position[k])
        np.testing.assert_allclose(local[1:], 0, atol=1e-12)
        assert local[0] < 0


def test_z_is_the_way_the_performer_faces_where_a_segment_is_upright():
    joint = swaying_body(0, 1)[0]
    joint[:, 0] = np.where(np.array([name[0] for name in JOINTS]) == "L", 0.2, -0.2)
    joint[:3, 0] = 0.0
    joint[:, 2] = 0.0  # left is +x, up is +y: the face looks to +z
    _, rotation = tree.local_systems(joint)
    np.testing.assert_allclose(rotation[[1, 7, 9], :, 2], [[0, 0, 1]] * 3, atol=1e-9)


def test_an_axis_along_the_way_faced_takes_its_z_from_the_way_up():
    joint = swaying_body(0, 1)[0]
    elbow, wrist = JOINTS.index("RElbow"), JOINTS.index("RWrist")
    _, rotation = tree.local_systems(joint)
    joint[wrist] = joint[elbow] + 0.25 * rotation[1, :, 2]
    _, rotation = tree.local_systems(joint)
    assert np.isfinite(rotation).all()
    assert rotation[4, :, 2] @ [0, 1, 0] > 0.9


def test_equation_1_in_homogeneous_matrices(rng):
    position, rotation = random_pose(rng, 1)
    local, turn = tree.pose_in_parents(position, rotation)
    for k, parent in enumerate(tree.PARENTS):
        above = np.eye(4) if parent < 0 else homogeneous(rotation[0, parent], position[0, parent])
        wanted = np.linalg.inv(above) @ homogeneous(rotation[0, k], position[0, k])
        np.testing.assert_allclose(homogeneous(turn[0, k], local[0, k]), wanted, atol=1e-12)


def test_the_world_is_rebuilt_from_local_parameters(rng):
    position, rotation = random_pose(rng, 5)
    again = pose_in_world(*tree.pose_in_parents(position, rotation))
    np.testing.assert_allclose(again[0], position, atol=1e-12)
    np.testing.assert_allclose(again[1], rotation, atol=1e-12)


def test_turning_a_parent_carries_what_hangs_on_it_and_nothing_else(joint):
    local, turn = tree.pose_in_parents(*tree.local_systems(joint))
    before = pose_in_world(local, turn)
    turn[3] = turn[3] @ Rotation.from_rotvec([0, 0.4, 0.3]).as_matrix()
    after = pose_in_world(local, turn)
    moved = np.linalg.norm(after[0] - before[0], axis=1) > 1e-9
    assert list(np.flatnonzero(moved)) == [4]
    span = [np.linalg.norm(p[0][4] - p[0][3]) for p in (before, after)]
    assert span[0] == pytest.approx(span[1])


def test_ellipsoids_are_equation_4_inverted(rng):
    position, rotation = random_pose(rng, 3)
    axes = Rotation.from_rotvec(rng.normal(size=(11, 3))).as_matrix()
    centroid, variance = rng.normal(size=(11, 3)), rng.uniform(0.001, 0.02, (11, 3))
    shape = tree.BodyShape(
        centroid, axes, variance, np.zeros((11, 3)), np.zeros((21, 3)), np.full(11, 1 / 11)
    )
    mean, inverse = tree.place_ellipsoids(shape, position, rotation)
    for t in range(3):
        for k in range(11):
            world = rotation[t, k] @ axes[k]
            spread = world @ np.diag(variance[k]) @ world.T
            np.testing.assert_allclose(inverse[t, k] @ spread, np.eye(3), atol=1e-9)
            np.testing.assert_allclose(mean[t, k], position[t, k] + rotation[t, k] @ centroid[k])


def test_a_wrist_or_ankle_that_is_missing_is_stood_in_for(joint):
    joint[[JOINTS.index("RWrist"), JOINTS.index("LAnkle")]] = np.nan
    _, rotation = tree.local_systems(joint)
    way = joint[JOINTS.index("RElbow")] - joint[JOINTS.index("RFin")]
    np.testing.assert_allclose(rotation[4, :, 0], way / np.linalg.norm(way))


def test_a_body_that_is_none_is_refused(joint):
    with pytest.raises(ValueError, match=r"shape \(19, 3\) are no body"):
        tree.local_systems(joint[:19])
    with pytest.raises(ValueError, match="segments that begin at RShoulder, RElbow have no"):
        tree.local_systems(np.where(np.arange(21)[:, None] == 4, np.nan, joint))
    joint[JOINTS.index("LKnee")] = joint[JOINTS.index("LHip")]
    with pytest.raises(ValueError, match="segment at LHip has no length"):
        tree.local_systems(joint)
