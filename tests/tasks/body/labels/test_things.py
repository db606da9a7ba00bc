"""What belongs to no segment: an arm of boxes with a rod, a cloth, or a piece apart."""

import numpy as np
import pytest

from storage.schema import SEGMENTS
from tasks.body.anatomy.bones import BONES
from tasks.body.labels.fields import carry_back, make_fields
from tasks.body.labels.final import label_carried
from tasks.body.labels.things import find_staying
from tasks.geometry.voxel_lines import lines_of_index
from tasks.geometry.voxels import encode_runs

SHAPE = (70, 40, 40)
ARM, HAND, TRUNK = np.s_[20:36, 18:22, 18:22], np.s_[36:42, 18:22, 18:22], np.s_[8:20, 8:32, 14:26]
MOST = 8
FORE_ARM = SEGMENTS.index("RForeArm") + 1


def frame(*boxes):
    """Return the voxels of a body with some boxes more, in order."""
    occupied = np.zeros(SHAPE, bool)
    for box in (TRUNK, ARM, HAND, *boxes):
        occupied[box] = True
    return np.argwhere(occupied).astype(np.int32)


@pytest.fixture
def fields():
    bone = np.full(SHAPE, -1)
    for name, box in (("Body", TRUNK), ("RForeArm", ARM), ("RHand", HAND)):
        bone[box] = BONES.index(name)
    index = frame()
    return make_fields(index, bone[tuple(index.T)], len(BONES), MOST)


def label(index, fields, stays=None):
    """Return the labels as a volume, -1 where nothing is."""
    origin, turn = np.zeros((len(BONES), 3)), np.broadcast_to(np.eye(3), (len(BONES), 3, 3))
    back = carry_back(origin, turn, origin, np.zeros(3), 1.0)
    found = np.full(SHAPE, -1)
    found[tuple(index.T)] = label_carried(
        lines_of_index(index), fields, *back, None if stays is None else stays[tuple(index.T)]
    )
    return found


ROD = np.s_[37:41, 22:40, 18:22]
CLOTH = np.s_[24:34, 19:21, 2:18]
APART = np.s_[56:66, 4:14, 4:14]


def test_what_a_hand_holds_belongs_to_no_segment_beyond_the_hand(fields):
    found = label(frame(ROD), fields)
    assert (found[37:41, 26:40, 18:22] == 0).all()
    assert (found[HAND] == FORE_ARM).all()
    assert (found[ARM] == FORE_ARM).all()
    assert (found[TRUNK] == SEGMENTS.index("Body") + 1).all()


def test_cloth_that_hangs_from_an_arm_is_of_the_arm(fields):
    found = label(frame(CLOTH), fields)
    assert (found[CLOTH] == FORE_ARM).all()
    assert not (found == 0).any()


def test_a_piece_apart_and_far_belongs_to_no_segment_and_one_near_does(fields):
    near = np.s_[44:48, 18:22, 18:22]
    found = label(frame(APART, near), fields)
    assert (found[APART] == 0).all()
    assert (found[near] == FORE_ARM).all()
    assert (found == 0).sum() == 1000


def test_a_body_alone_and_one_who_is_nowhere_near_are_as_before(fields):
    assert not (label(frame(), fields) == 0).any()
    far = np.argwhere(np.ones((3, 4, 5), bool)).astype(np.int32)
    assert (label(far, fields)[tuple(far.T)] == 0).all()


def test_what_stays_far_from_the_body_all_through_a_take_is_found():
    rng = np.random.default_rng(6)
    occupied, far = rng.random((2, 10, 5, 4, 6)) < 0.5
    occupied[:, 2, 1, 3:5] = far[:, 2, 1, 3:5] = True
    far[0, 2, 1, 4] = False  # once a leg was near
    occupied[:, 0, 0, 0], far[:, 0, 0, 0] = True, False  # a body that keeps in place
    hulls = [encode_runs(each[None]) for each in occupied]
    marks = [own[each] for own, each in zip(far, occupied, strict=True)]
    staying = find_staying(hulls, marks, (5, 4, 6))
    np.testing.assert_array_equal(staying, (occupied & far).sum(axis=0) >= 8)
    assert staying[2, 1, 3:5].all()
    assert not staying[0, 0, 0]


def test_cloth_that_stays_in_its_place_is_no_segments(fields):
    stays = np.zeros(SHAPE, bool)
    stays[CLOTH] = stays[ARM] = True
    found = label(frame(CLOTH), fields, stays)
    assert (found[24:34, 19:21, 2:8] == 0).all()
    assert (found[ARM] == FORE_ARM).all()
