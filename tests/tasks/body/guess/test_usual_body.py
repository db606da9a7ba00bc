import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.body.anatomy.bones import BONES, rest_pose, turn
from tasks.body.anatomy.proportions import body_size
from tasks.body.guess.usual_body import make_usual_body, usual_joints


def test_usual_joints_are_those_of_a_body_of_that_height_with_a_usual_span():
    joints = usual_joints(1.6)
    assert list(joints) == list(JOINTS)
    assert joints["Head"][1] == pytest.approx(1.6)
    assert body_size(joints) == pytest.approx(1.6, rel=0.03)
    span = joints["LFin"][0] - joints["RFin"][0]
    assert span == pytest.approx(1.6, rel=0.05)  # Vitruvius
    for name in (n[1:] for n in JOINTS if n[0] == "R"):
        np.testing.assert_allclose(joints["L" + name], joints["R" + name] * [-1.0, 1.0, 1.0])
    assert joints["LFoot"][2] > joints["LAnkle"][2] > joints["LHeel"][2]


def test_a_usual_body_has_blobs_on_every_bone_and_is_placed_by_its_pose():
    body = make_usual_body(1.6)
    assert set(body.blobs.blobs.bone) == set(range(len(BONES)))
    assert body.blobs.cloth.share.sum() < 0.02
    rest = rest_pose(body.blobs.origin)
    for name, place in body.place(rest).items():
        np.testing.assert_allclose(place, body.joints[name], atol=1e-12)
    turned = body.place(turn(rest, np.pi / 2.0, np.zeros(3)))  # about the vertical through 0
    x, y, z = body.joints["LFin"]
    np.testing.assert_allclose(turned["LFin"], [z, y, -x], atol=1e-12)


def test_the_top_of_the_head_can_be_moved_alone():
    body = make_usual_body(1.6)
    other = body.with_head(np.array([0.0, 1.7, 0.0]))
    assert other.joints["Head"][1] == 1.7
    assert all(np.array_equal(other.joints[n], body.joints[n]) for n in JOINTS if n != "Head")
