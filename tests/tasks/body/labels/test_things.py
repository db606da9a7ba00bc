"""What belongs to no segment: an arm of boxes with a rod, a cloth, or a piece apart."""

import numpy as np
import pytest

from storage.schema import JOINTS, SEGMENTS
from tasks.body.anatomy.bones import BONES
from tasks.body.labels.fields import carry_back, make_fields
from tasks.body.labels.final import label_carried
from tasks.body.labels.things import find_staying
from tasks.geometry.voxel_lines import lines_of_index
from tasks.geometry.voxels import VoxelGrid, encode_runs, voxel_centers

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


def test_what_stays_off_the_body_all_through_a_take_is_found():
    """A seated body, a rod behind it that a silhouette has lost once, and a cloth that moves."""
    grid = VoxelGrid((-0.5, 0.0, -0.5), 0.05, (20, 33, 21))
    joints = np.full((10, len(JOINTS), 3), np.nan)
    for name, at in {
        "Head": (0, 1.3, 0), "Neck": (0, 1.0, 0), "Waist": (0, 0.7, 0), "RHip": (0, 0.5, 0),
        "LHip": (0, 0.5, 0), "RKnee": (0, 0.5, 0.4), "RAnkle": (0, 0.1, 0.4),
    }.items():  # fmt: skip
        joints[:, JOINTS.index(name)] = at
    center = np.stack(np.meshgrid(*[np.arange(n) for n in grid.shape], indexing="ij"), axis=-1)
    point = voxel_centers(grid, center)
    body = (
        (abs(point[..., 0]) < 0.1) & (abs(point[..., 2]) < 0.1) & (abs(point[..., 1] - 0.9) < 0.5)
    )
    body |= (
        (abs(point[..., 0]) < 0.1)
        & (abs(point[..., 1] - 0.5) < 0.1)
        & (abs(point[..., 2] - 0.22) < 0.22)
    )
    rod, cloth = np.s_[4:6, 0:8, 3:5], np.s_[15:17, 0:8, 3:5]
    occupied = np.broadcast_to(body, (10, *grid.shape)).copy()
    occupied[:, *rod] = True
    occupied[9, *rod] = False
    occupied[::2, *cloth] = True
    hulls = [encode_runs(each[None]) for each in occupied]
    wanted = np.zeros(grid.shape, bool)
    wanted[rod] = True
    found = find_staying(hulls, joints, grid, 1.7)
    np.testing.assert_array_equal(found, np.flatnonzero(wanted))
    assert not len(find_staying(hulls[:5], joints[:5], grid, 1.7))


def test_what_stays_is_no_segments(fields):
    stays = np.zeros(SHAPE, bool)
    stays[CLOTH] = True
    found = label(frame(CLOTH), fields, stays)
    assert (found[stays] == 0).all()
    own = found.copy()
    own[CLOTH] = -1
    assert not (own == 0).any()
