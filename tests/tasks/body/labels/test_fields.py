import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tasks.body.anatomy.nearest_bones import is_limb, label_points
from tasks.body.anatomy.proportions import HUMERAL_HEAD, body_size, complete_joints
from tasks.body.labels.fields import carry_back, make_fields, nearest_bones
from tasks.body.labels.final import label_carried, make_body_fields
from tasks.body.labels.regions import clean_labels
from tasks.geometry.voxel_lines import lines_of_index

BONES, MOST = 4, 3
VOXEL = 0.02
ORIGIN_M = np.array([-1.0, 0.01, -0.3])


@pytest.fixture
def rng():
    return np.random.default_rng(71)


def still(bones=BONES):
    return np.tile(np.eye(3), (bones, 1, 1)), np.zeros((bones, 3))


def block(low, high):
    axes = [np.arange(a, b) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3).astype(np.int32)


def naive_distance(cell, own, other):
    """Return 127ths of the most that a cell is away from a bone's voxels, negative inside."""
    inside = (own == cell).all(axis=1).any()
    away = np.linalg.norm((other if inside else own) - cell, axis=1).min()
    share = min((away - 0.5) / MOST, 1.0)
    return round(127 * (-share if inside else share))


def naive_nearest(index, first, bone, turn, shift):
    """Look every voxel up in every bone; then fill lines between equal ends in cubes of 8."""
    around = block(first.min(axis=0) - 1, first.max(axis=0) + 2)
    sides = []
    for b in range(BONES):
        own = {tuple(voxel) for voxel in first[bone == b].tolist()}
        sides.append((first[bone == b], [v for v in around.tolist() if tuple(v) not in own]))
    found = []
    for voxel in index:
        best, nearest = 127, -1
        for b, (own, other) in enumerate(sides):
            cell = np.floor(turn[b] @ voxel + shift[b] + 0.5)
            away = naive_distance(cell, own, np.array(other)) if len(own) else 127
            if away < best:
                best, nearest = away, b
        found.append(nearest)
    line = (index - index.min(axis=0)) // [1, 1, 8]
    begin = 0
    for n in range(1, len(index) + 1):
        goes_on = n < len(index) and (line[n] == line[n - 1]).all()
        if not (goes_on and index[n, 2] == index[n - 1, 2] + 1):
            if found[begin] == found[n - 1]:
                found[begin:n] = [found[begin]] * (n - begin)
            begin = n
    return found


@pytest.mark.parametrize("density", [0.5, 1.0], ids=["noise", "block"])
def test_nearest_bones_agree_with_looking_every_voxel_up(rng, density):
    first = block((40, 2, 100), (46, 9, 111))
    bone = np.digitize(first[:, 2] + rng.integers(0, 2, len(first)), [103, 107]) - 1
    bone[first[:, 0] == 45] = 3
    bone = bone.astype(np.int64)  # -1 to 1 and 3: bone 2 has no voxels
    fields = make_fields(first, bone, BONES, MOST)
    turn = Rotation.from_rotvec(rng.normal(size=(BONES, 3)) * 0.3).as_matrix()
    shift = np.array([43, 5, 105]) - turn @ [43, 5, 105] + rng.normal(size=(BONES, 3))
    index = block((37, 0, 94), (49, 9, 115))
    index = index[rng.random(len(index)) < density]
    found = nearest_bones(lines_of_index(index), fields, turn, shift)
    assert found.tolist() == naive_nearest(index, first, bone, turn, shift)
    assert set(found.tolist()) == {-1, 0, 1, 3}


def test_a_body_at_rest_has_the_bones_that_it_began_with():
    index = block((3, 4, 5), (9, 15, 27))
    bone = np.digitize(index[:, 2], [12, 19])
    found = nearest_bones(lines_of_index(index), make_fields(index, bone, BONES, MOST), *still())
    np.testing.assert_array_equal(found, bone)


def test_what_is_far_from_all_bones_is_none_s_and_nothing_has_no_bones():
    index = block((0, 0, 0), (4, 5, 6))
    fields = make_fields(index, np.zeros(len(index), int), BONES, MOST)
    beside = np.array([[6, 2, 3], [7, 2, 3], [90, 2, 3]])
    assert nearest_bones(lines_of_index(beside), fields, *still()).tolist() == [0, -1, -1]
    assert nearest_bones(lines_of_index(beside[:0]), fields, *still()).shape == (0,)


def test_a_bent_joint_is_parted_half_way():
    first = block((0, 0, 0), (7, 7, 40))
    bone = (first[:, 2] >= 20).astype(np.int64)
    fields = make_fields(first, bone, 2, 9)
    joint = np.array([[3.0, 3.0, 19.5]] * 2)
    bend = Rotation.from_rotvec([[0, 0, 0], [0, np.pi / 2, 0]]).as_matrix()  # on along x
    turn, shift = carry_back(joint, bend, joint, np.zeros(3), 1.0)
    beyond = block((9, 0, 17), (20, 7, 23))
    assert (nearest_bones(lines_of_index(beyond), fields, turn, shift) == 1).all()
    elbow = block((0, 3, 16), (7, 4, 23))
    found = nearest_bones(lines_of_index(elbow), fields, turn, shift)
    away = (elbow[:, 0] - 3.0) + (elbow[:, 2] - 19.5)  # the plane that halves the bend
    clear = np.abs(away) > 1.5
    np.testing.assert_array_equal(found[clear], away[clear] > 0)
    assert clear.sum() == 25


def test_carrying_back_undoes_a_pose(rng):
    origin, joint = rng.normal(size=(2, BONES, 3))
    rotation = Rotation.random(BONES, rng=71).as_matrix()
    turn, shift = carry_back(joint, rotation, origin, ORIGIN_M, VOXEL)
    begun = rng.integers(0, 50, (BONES, 3))
    world = joint + np.einsum("bij,bj->bi", rotation, ORIGIN_M + VOXEL * begun - origin)
    now = (world - ORIGIN_M) / VOXEL
    back = np.einsum("bij,bj->bi", turn, now) + shift
    np.testing.assert_allclose(back, begun, atol=1e-9)


def standing():
    """Return the joints of a body with its arms stretched, and its voxels with some cloth."""
    joints = {"Head": (0, 1.7, 0), "Neck": (0, 1.44, 0)}
    for side, sign in (("R", -1), ("L", 1)):
        arm = {"Shoulder": (0.16, 1.36), "Elbow": (0.42, 1.36), "Fin": (0.86, 1.36)}
        leg = {"Hip": (0.1, 0.87), "Knee": (0.1, 0.47)}
        for name, (x, y) in (arm | leg).items():
            joints[side + name] = (sign * x, y, 0)
        joints[side + "Foot"] = (sign * 0.1, 0.02, 0.16)
    joints = {name: np.array(place, float) for name, place in joints.items()}
    index = block((3, 0, 5), (98, 86, 26))
    center = ORIGIN_M + VOXEL * index
    x, y, z = np.abs(center[:, 0]), center[:, 1], center[:, 2]
    trunk = (x < 0.17) & (np.abs(z) < 0.1) & (y > 0.86) & (y < 1.44)
    head = (np.hypot(x, z) < 0.09) & (y >= 1.44)
    arm = (np.hypot(y - 1.36, z) < 0.05) & (x < 0.86)
    sleeve = (x > 0.5) & (x < 0.7) & (np.abs(z) < 0.03) & (y > 1.0) & (y < 1.36)
    leg = (np.hypot(x - 0.1, z) < 0.08) & (y <= 0.86)
    occupied = trunk | head | arm | sleeve | leg
    return joints, index[occupied], center[occupied], sleeve[occupied] & ~arm[occupied]


def test_at_rest_the_labels_are_the_initial_ones_and_a_sleeve_is_its_arm_s():
    joints, index, center, is_sleeve = standing()
    label = label_points(center, complete_joints(joints))
    fields = make_body_fields(index, center, label, joints, VOXEL)
    found = label_carried(lines_of_index(index), fields, *still(15))
    assert set(found.tolist()) == set(range(1, 12))
    is_body = is_limb(center, complete_joints(joints), label)
    same = found[is_body] == clean_labels(label, lines_of_index(index))[is_body]
    assert same.mean() > 0.999  # but on a line or two between equal ends
    low = is_sleeve & (center[:, 1] < 1.2)
    right = center[low, 0] < 0
    np.testing.assert_array_equal(found[low], np.where(right, 5, 7))
    hangs = fields.begin[[4, 6], 1] * VOXEL
    assert (hangs > 1.1).all()  # the sleeves, down to 1.0, are not carried along


def test_far_from_the_body_there_are_no_labels():
    joints, index, center, _ = standing()
    label = label_points(center, complete_joints(joints))
    fields = make_body_fields(index, center, label, joints, VOXEL)
    turn, shift = still(15)
    assert not label_carried(lines_of_index(index[:9]), fields, turn, shift + 500).any()


def test_the_trunk_is_parted_where_anatomy_parts_it():
    joints, _, center, _ = standing()
    whole = complete_joints(joints)
    label = label_points(center, whole)
    middle = np.hypot(center[:, 0], center[:, 2]) < 0.05
    top = center[:, 1]
    ribs = 1.7 - 0.336 * body_size(whole)
    np.testing.assert_array_equal(
        label[middle & (top > 1.0)] == 3, top[middle & (top > 1.0)] < ribs
    )
    np.testing.assert_array_equal(label[middle] == 1, top[middle] >= 1.44)
    shoulder = (np.abs(center[:, 0] - 0.16) < 0.05) & (np.abs(top - 1.36) < 0.05)
    beyond = 2 * (center[:, 0] - 0.16) + (top - 1.36) >= 0
    np.testing.assert_array_equal(label[shoulder] == 6, beyond[shoulder])
    assert 50 < shoulder.sum() < len(center) / 10


def test_a_whole_arm_has_the_head_of_its_bone():
    joints, _, center, _ = standing()
    whole = complete_joints(joints)
    label = label_points(center, whole)
    longer = label_points(center, whole, whole_arms=True)
    inner = 0.16 - HUMERAL_HEAD * body_size(whole)
    shoulder = (np.abs(center[:, 0] - 0.15) < 0.05) & (np.abs(center[:, 1] - 1.36) < 0.05)
    beyond = 2 * (center[:, 0] - inner) + (center[:, 1] - 1.36) >= 0
    np.testing.assert_array_equal(longer[shoulder] == 6, beyond[shoulder])
    changed = label != longer
    assert set(label[changed].tolist()) == {2}
    assert set(longer[changed].tolist()) == {4, 6}


def test_an_arm_that_hangs_is_cut_upright():
    joints, *_ = standing()
    hanging = joints | {
        "LElbow": np.array([0.16, 1.1, 0.0]), "LFin": np.array([0.16, 0.66, 0.0]),
    }  # fmt: skip
    point = np.array([[x, 1.36 + y, 0.0] for x in (0.13, 0.19) for y in (-0.08, 0.0, 0.05)])
    label = label_points(point, complete_joints(hanging))
    assert label.tolist() == [2, 2, 2, 6, 6, 6]


def test_where_cubes_begin_changes_next_to_nothing(rng):
    first = block((0, 0, 0), (9, 7, 30))
    bone = np.digitize(first[:, 2], [8, 17, 23])
    fields = make_fields(first, bone, BONES, MOST)
    shift = np.cumsum(rng.normal(size=(BONES, 3)), axis=0)
    here = nearest_bones(lines_of_index(first), fields, still()[0], shift)
    moved = nearest_bones(
        lines_of_index(np.add(first, [0, 0, 5])), fields, still()[0], shift - [0, 0, 5]
    )
    assert (here == moved).mean() > 0.99
    assert set(here.tolist()) >= {0, 1, 2}
