import numpy as np
import pytest

from tasks.body.labels import provisional
from tasks.geometry.voxel_lines import lines_of_index
from tests.twins.voxels import face_neighbors

SETTINGS = provisional.ProvisionalSettings()


@pytest.fixture
def rng():
    return np.random.default_rng(47)


def block(*sides):
    return (
        np.stack(np.meshgrid(*map(range, sides), indexing="ij"), -1).reshape(-1, 3).astype(np.int32)
    )


def naive_previous(index, previous_index, previous_label):
    label = []
    for voxel in index.tolist():
        distance = [sum((a - b) ** 2 for a, b in zip(voxel, other, strict=True))
                    for other in previous_index.tolist()]  # fmt: skip
        label.append(previous_label[distance.index(min(distance))])
    return label


def test_labels_are_those_of_the_nearest_voxel_before(rng):
    now, before = (np.argwhere(rng.random((6, 8, 11)) < share) for share in (0.5, 0.05))
    now = np.concatenate([now, [[9, 3, 2]]])
    label = rng.integers(1, 12, len(before)).astype(np.uint8)
    found = provisional.label_from_previous(lines_of_index(now), lines_of_index(before), label)
    assert found.tolist() == naive_previous(now, before, label)
    assert len(set(found.tolist())) > 5


def test_a_voxel_far_from_all_of_before_still_takes_the_nearest():
    before = block(4, 5, 3)
    label = np.where(before[:, 0] < 2, 3, 8).astype(np.uint8)
    now = lines_of_index(np.array([[-30, 1, 1], [2, 2, 1], [40, 2, 2]]))
    found = provisional.label_from_previous(now, lines_of_index(before), label)
    assert found.tolist() == [3, 8, 8]


def test_voxels_far_from_all_of_before_take_the_first_of_the_nearest(rng):
    before, some = (  # lines of several voxels
        np.argwhere(np.repeat(rng.random(shape) < 0.05, 5, axis=2))
        for shape in ((19, 23, 6), (3, 22, 5))
    )
    label = rng.integers(1, 12, len(before)).astype(np.uint8)
    shifts = [[-15, -30, 12], [2, 1, 47], [11, 0, -43], [31, 9, -20]]
    now = np.concatenate([np.add(some, shift) for shift in shifts])
    found = provisional.label_from_previous(lines_of_index(now), lines_of_index(before), label)
    assert found.tolist() == naive_previous(now, before, label)
    assert len(set(found.tolist())) > 5


@pytest.mark.parametrize("up", [1, -1])
def test_far_voxels_of_a_line_may_be_nearest_to_different_ones(up):
    """The line's own length does not put off what is 30 beyond its one end: 28 beyond the other."""
    now = np.array([[0, 0, z] for z in range(5)])
    near, far = (-28, 34) if up == 1 else (32, -30)
    aside = [[-12, 0, near], *([-12, y, near] for y in range(100, 115))]  # lines that are together
    before = np.array([*aside, [12, 0, far]])
    label = np.array([*[1] * len(aside), 2], np.uint8)
    found = provisional.label_from_previous(lines_of_index(now), lines_of_index(before), label)
    assert found.tolist() == naive_previous(now, before, label)
    assert set(found.tolist()) == {1, 2}


@pytest.mark.parametrize("scale", [1, 3], ids=["near", "beyond the columns in order"])
def test_a_nearer_voxel_in_a_farther_row_is_taken(scale):
    before = lines_of_index(scale * np.array([[8, 8, 0], [11, 0, 0]]))  # 11.3 and 11 away
    now = lines_of_index(np.array([[0, 0, 0]]))
    assert provisional.label_from_previous(now, before, np.array([3, 8])).tolist() == [8]


def naive_volumes(label, neighbors, share, tolerance, rings):
    label = label.tolist()
    labeled = sum(value > 0 for value in label)
    member = {k: [n for n, value in enumerate(label) if value == k] for k in range(1, 12)}
    for _ in range(rings):
        ratio = {k: label.count(k) / (share[k - 1] * labeled) for k in range(1, 12) if share[k - 1]}
        worst = min(ratio, key=lambda k: (ratio[k], k))
        if ratio[worst] >= 1 - tolerance:
            break
        member[worst] = [n for n in member[worst] if label[n] == worst]
        around = [k for n in member[worst] for k in neighbors[n] if k >= 0]
        ring = list(dict.fromkeys(k for k in around if label[k] not in (0, worst)))
        wanted = int(np.ceil(share[worst - 1] * labeled)) - len(member[worst])
        taken = [ring[n * len(ring) // min(len(ring), wanted)]
                 for n in range(min(len(ring), wanted))]  # fmt: skip
        for voxel in taken:
            label[voxel] = worst
        member[worst] += taken
        if not ring:
            break
    return label


@pytest.mark.parametrize("seed", range(4))
def test_volumes_are_restored_as_by_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    index = np.argwhere(rng.random((9, 7, 8)) < 0.8).astype(np.int32)
    label = (1 + index[:, 0] // 3 + 3 * (index[:, 1] > 5)).astype(np.uint8)
    label[rng.random(len(label)) < 0.05] = 0
    share = np.zeros(11)
    share[np.unique(label[label > 0]) - 1] = rng.dirichlet(np.full(len(np.unique(label)) - 1, 2.0))
    settings = provisional.ProvisionalSettings(most_rings=60)
    grown = provisional.restore_volumes(label, lines_of_index(index), share, settings)
    assert grown.tolist() == naive_volumes(label, face_neighbors(index), share, 0.03, 60)
    assert (grown != label).sum() > 20
    assert (grown[label == 0] == 0).all()


def test_a_frame_before_without_voxels_is_refused():
    some, none = lines_of_index(block(1, 2, 3)), lines_of_index(np.zeros((0, 3), np.int32))
    with pytest.raises(ValueError, match="0 voxels with 0 labels say nothing"):
        provisional.label_from_previous(some, none, np.zeros(0, int))
    with pytest.raises(ValueError, match="6 voxels with 5 labels say nothing"):
        provisional.label_from_previous(some, some, np.ones(5, int))
    empty = provisional.label_from_previous(none, some, np.ones(6, int))
    assert empty.shape == (0,)


def shares(label):
    return np.bincount(label, minlength=12)[1:] / np.count_nonzero(label)


def test_a_shrunken_segment_grows_to_its_share_at_its_border_only():
    index = block(30, 5, 4)
    label = np.where(index[:, 0] < 24, 4, 5).astype(np.uint8)
    share = shares(np.where(index[:, 0] < 15, 4, 5))
    grown = provisional.restore_volumes(label, lines_of_index(index), share, SETTINGS)
    assert shares(grown)[4] >= 0.97 * share[4]
    assert shares(grown)[4] <= share[4] + 1 / len(index)
    assert (grown[index[:, 0] >= 24] == 5).all()
    assert (grown[index[:, 0] < 13] == 4).all()


def test_each_ring_goes_to_the_segment_that_shrank_most():
    index = block(40, 3, 2)
    truth = np.digitize(index[:, 0], [10, 30]) + 1
    label = (np.digitize(index[:, 0], [4, 36]) + 1).astype(np.uint8)
    share = shares(truth)
    grown = label
    for rings in range(1, 13):
        settings = provisional.ProvisionalSettings(most_rings=rings)
        grown = provisional.restore_volumes(label, lines_of_index(index), share, settings)
        low = shares(grown)[[0, 2]] / share[[0, 2]]
        assert abs(low[0] - low[1]) <= 0.1 + 1e-9  # a ring of one tenth, in turn
    np.testing.assert_array_equal(grown, truth)


def test_nothing_grows_where_all_segments_have_their_share():
    index = block(6, 5, 4)
    label = (index[:, 1] + 1).astype(np.uint8)
    grown = provisional.restore_volumes(label, lines_of_index(index), shares(label), SETTINGS)
    np.testing.assert_array_equal(grown, label)


def test_a_share_that_cannot_be_reached_ends():
    index = block(6, 5, 4)
    label = np.ones(len(index), np.uint8)
    share = np.array([0.5, 0.5, *[0] * 9])
    grown = provisional.restore_volumes(label, lines_of_index(index), share, SETTINGS)
    np.testing.assert_array_equal(grown, label)


def test_a_frame_goes_through_all_four_steps():
    before = block(30, 5, 4)
    label = np.where(before[:, 0] < 15, 4, 5).astype(np.uint8)
    index = np.add(before, [2, 0, 0])
    skin = np.where(index[:, 0] > 29, 5, 0)
    lines, previous = lines_of_index(index), lines_of_index(before)
    found = provisional.label_provisionally(
        lines, previous, label, shares(label), SETTINGS, skin_label=skin
    )
    nearest = provisional.label_from_previous(lines, previous, label)
    assert (nearest == 4).sum() == 13 * 20
    assert (found[skin > 0] == 5).all()
    assert shares(found)[3] >= 0.97 * shares(label)[3]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"volume_tolerance": 1.0},
            "volume_tolerance is 1.0, it must be a number 0 or more and below 1",
        ),
        ({"most_rings": -1}, "most_rings is -1, it must be a whole number 0 or more"),
        ({"skin_speed": 0.0}, "skin_speed is 0.0, it must be a number larger"),
        ({"least_skin_m2": -0.1}, "least_skin_m2 is -0.1, it must be a number 0"),
    ],
)
def test_settings_that_label_nothing_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        provisional.ProvisionalSettings(**settings)
