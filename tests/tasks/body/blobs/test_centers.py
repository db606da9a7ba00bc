"""Joints that are found from how bones move, beside what is known and what is differentiated."""

import numpy as np
import pytest

from tasks.body.anatomy import bones as articulated
from tasks.body.anatomy.bones import BONES, PARENT, Pose
from tasks.body.blobs import least_squares
from tasks.body.blobs.centers import CenterSettings, Evidence, move_centers

HELD = [BONES.index(bone) for bone in ("Body", "Head", "RUpperLeg", "LUpperLeg", "RFoot", "LFoot")]
LEFT = np.array([1.0, 0.0, 0.0])
SETTINGS = CenterSettings()


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def body(rng):
    """Origin of every bone, and six blobs a bone: bone, and place in the initial pose."""
    origin = rng.normal(size=(len(BONES), 3)) * 0.4
    origin[BONES.index("Head")] = origin[BONES.index("Body")]
    bone = np.repeat(np.arange(len(BONES)), 6)
    return origin, bone, origin[bone] + rng.normal(size=(len(bone), 3)) * 0.15


def a_pose(rng, spread):
    rotation = np.stack([articulated.rotation_of(rng.normal(size=3) * spread) for _ in BONES])
    return Pose(rng.normal(size=3), rotation)


def place(pose, origin, bone, rest):
    joints = articulated.place_bones(pose, origin)
    return joints, articulated.carry(pose, joints, bone, rest - origin[bone])


def evidence(pose, origin, bone, rest, seen):
    joints, mean = place(pose, origin, bone, rest)
    information = np.tile(np.eye(3) * 20.0, (len(bone), 1, 1))
    return Evidence(bone, mean, information, seen - mean, joints, pose.rotation)


def test_joints_return_to_where_bones_turn(rng, body):
    true, bone, rest = body
    moved = rng.normal(size=true.shape) * 0.02
    moved[HELD] = 0.0
    mirror = [BONES.index("L" + name[1:]) if name[0] == "R" else k for k, name in enumerate(BONES)]
    for k, twin in enumerate(mirror):  # as uneven as the two sides of a body are: not at all
        if twin != k:
            moved[twin] = moved[k] * (-1, 1, 1)
        elif BONES[k][0] not in "RL":
            moved[k, 0] = 0.0
    wrong = true + moved
    poses = [a_pose(rng, 0.6) for _ in range(25)]
    frames = [evidence(p, wrong, bone, rest, place(p, true, bone, rest)[1]) for p in poses]
    found = move_centers(frames, LEFT, 1.6, np.full(len(BONES), 0.02), SETTINGS)
    left_over = np.linalg.norm(wrong + found - true, axis=1)
    assert np.linalg.norm(moved, axis=1).max() > 0.02
    assert left_over.max() < 0.25 * np.linalg.norm(moved, axis=1).max()
    assert (found[HELD] == 0).all()


@pytest.mark.parametrize("held", ["Head", "RUpperLeg", "LUpperLeg", "RFoot", "LFoot"])
def test_neck_hips_and_ankles_stay_where_bones_turn_about_another_place(held, rng, body):
    true, bone, rest = body
    wrong = true.copy()
    wrong[BONES.index(held)] += (0.0, 0.0, 0.04)
    poses = [a_pose(rng, 0.6) for _ in range(25)]
    frames = [evidence(p, wrong, bone, rest, place(p, true, bone, rest)[1]) for p in poses]
    found = move_centers(frames, LEFT, 1.6, np.full(len(BONES), 0.02), SETTINGS)
    assert (found[HELD] == 0).all()
    assert found.any()


def test_joints_that_never_bend_stay(rng, body):
    origin, bone, rest = body
    still = Pose(np.zeros(3), np.tile(np.eye(3), (len(BONES), 1, 1)))
    seen = place(still, origin, bone, rest)[1] + rng.normal(size=rest.shape) * 0.01
    frames = [evidence(still, origin, bone, rest, seen)] * 10
    found = move_centers(frames, LEFT, 1.6, np.full(len(BONES), 0.02), SETTINGS)
    assert np.abs(found).max() < 1e-9


def test_one_side_speaks_for_the_other(rng, body):
    true, bone, rest = body
    k, twin = BONES.index("RForeArm"), BONES.index("LForeArm")
    wrong = true.copy()
    wrong[k] += (0.02, 0.01, 0.0)
    poses = []
    for _ in range(20):
        rotation = np.tile(np.eye(3), (len(BONES), 1, 1))
        turn = articulated.rotation_of(rng.normal(size=3))
        for j in (k, BONES.index("RHand")):
            rotation[j] = turn
        poses.append(Pose(np.zeros(3), rotation))
    frames = [evidence(p, wrong, bone, rest, place(p, true, bone, rest)[1]) for p in poses]
    found = move_centers(frames, LEFT, 1.6, np.full(len(BONES), 0.02), SETTINGS)
    assert np.linalg.norm(found[k] - (true - wrong)[k]) < 0.008
    np.testing.assert_allclose(found[twin], found[k] * (-1, 1, 1), atol=0.006)


def test_slopes_are_what_differences_give(rng, body):
    from tasks.body.blobs.centers import _center_slope, _pose_slope

    origin, bone, rest = body
    pose = a_pose(rng, 0.8)
    frame = evidence(pose, origin, bone, rest, rest)
    centers, poses = _center_slope(frame), _pose_slope(frame)
    step = 1e-6
    for j in (2, 3, 4, 11):
        for axis in range(3):
            other = origin.copy()
            other[j, axis] += step
            mean = place(pose, other, bone, rest)[1]
            np.testing.assert_allclose(
                centers[:, :, 3 * j + axis], (mean - frame.mean) / step, atol=1e-5
            )
            twist = np.zeros(least_squares.UNKNOWNS)
            twist[3 + 3 * j + axis] = step
            turned = np.empty_like(pose.rotation)
            least_squares.move(twist, pose.rotation, turned)
            mean = place(Pose(pose.root, turned), origin, bone, rest)[1]
            np.testing.assert_allclose(
                poses[:, :, 3 + 3 * j + axis], (mean - frame.mean) / step, atol=1e-5
            )
    for held in HELD:
        assert not centers[:, :, 3 * held : 3 * held + 3].any()
    assert PARENT[4] == 3


def test_distances_that_are_usual_are_positive():
    with pytest.raises(ValueError, match=r"uneven is 0\.0, it must be a number larger than 0"):
        CenterSettings(uneven=0.0)
