import numpy as np
import pytest

from tasks.body.labels import final as final_labeling
from tasks.body.labels import nearest as nearest_voxels
from tasks.body.labels import regions
from tasks.geometry.voxel_lines import VoxelLines, lines_of_index
from tests.twins.voxels import face_neighbors


@pytest.fixture
def rng():
    return np.random.default_rng(43)


def noise(rng, labels, *, shape=(7, 9, 6), density=0.6):
    """Return voxels of noise in order, and labels in patches with some undecided."""
    index = np.argwhere(rng.random(shape) < density).astype(np.int32)
    label = (index[:, 0] // 3 + index[:, 1] // 4 + rng.integers(0, 2, len(index))) % labels
    return np.add(index, [40, 2, 700]), label.astype(np.uint8)


def naive_regions(label, neighbors):
    """Merge voxel by voxel until nothing changes; return a set of sets."""
    name = list(range(len(label)))
    changed = True
    while changed:
        changed = False
        for n, around in enumerate(neighbors):
            for other in around:
                if other >= 0 and label[n] and label[n] == label[other] and name[other] < name[n]:
                    name[n] = name[other]
                    changed = True
    return {frozenset(n for n in range(len(label)) if name[n] == k) for k in set(name) if label[k]}


def naive_clean(label, neighbors):
    regions = naive_regions(label, neighbors)
    clean = [0] * len(label)
    for value in set(label.tolist()) - {0}:
        own = [r for r in regions if label[min(r)] == value]
        for n in min(own, key=lambda r: (-len(r), min(r))):
            clean[n] = value
    while True:
        ring = {}
        for n, around in enumerate(neighbors):
            found = [clean[k] for k in around if k >= 0 and clean[k]]
            if not clean[n] and found:
                ring[n] = found[0]
        if not ring:
            return clean
        for n, value in ring.items():
            clean[n] = value


def label_regions(label, lines):
    """Return the region of each voxel, -1 without label, and the regions' sizes."""
    stretch = regions._find_stretches(label, lines.table)
    region, size = regions._find_regions(stretch, *regions._find_columns(stretch))
    return np.repeat(region, stretch[:, regions._END] - stretch[:, regions._Z]), size


def test_regions_are_those_of_a_plain_merging(rng):
    index, label = noise(rng, 3)
    region, size = label_regions(label, lines_of_index(index))
    found = {frozenset(np.flatnonzero(region == k).tolist()) for k in range(len(size))}
    assert found == naive_regions(label, face_neighbors(index))
    np.testing.assert_array_equal(size, np.bincount(region[region >= 0]))
    assert len(found) > 10


def test_regions_are_those_of_connected_components_3d(rng):
    cc3d = pytest.importorskip("cc3d")
    index, label = noise(rng, 4, shape=(23, 31, 17))
    box = np.zeros(index.max(axis=0) + 1, np.uint8)
    box[tuple(index.T)] = label
    wanted = cc3d.connected_components(box, connectivity=6)[tuple(index.T)]
    region, _ = label_regions(label, lines_of_index(index))
    pairs = set(zip(region.tolist(), wanted.tolist(), strict=True))
    assert len(pairs) == len(set(region.tolist())) == len(set(wanted.tolist()))


@pytest.mark.parametrize("seed", range(4))
def test_cleaning_agrees_with_its_naive_twin_and_leaves_one_region_a_label(seed):
    index, label = noise(np.random.default_rng(seed), 4)
    lines = lines_of_index(index)
    clean = final_labeling.clean_labels(label, lines)
    wanted = np.array(naive_clean(label, face_neighbors(index)))
    connected = wanted > 0
    np.testing.assert_array_equal(clean[connected], wanted[connected])
    assert (clean > 0).all()
    _, size = label_regions(np.where(connected, clean, 0), lines)
    assert len(size) == 3
    assert (label != clean).any()


def test_of_equally_large_regions_the_first_stays():
    line = lines_of_index(np.array([[0, 0, n] for n in range(9)]))
    label = np.array([4, 4, 6, 6, 6, 4, 4, 6, 6])
    assert final_labeling.clean_labels(label, line).tolist() == [
        4,
        4,
        6,
        6,
        6,
        6,
        6,
        6,
        6,
    ]


def test_a_piece_apart_takes_the_nearest_label():
    body = np.stack(np.meshgrid(range(8), range(5), range(3), indexing="ij"), -1).reshape(-1, 3)
    apart = np.array([[11, 2, 1], [11, 2, 2]])
    label = np.concatenate([np.where(body[:, 0] < 4, 2, 9), [2, 2]])
    clean = final_labeling.clean_labels(label, lines_of_index(np.concatenate([body, apart])))
    assert clean[-2:].tolist() == [9, 9]
    np.testing.assert_array_equal(clean[:-2], label[:-2])


@pytest.mark.parametrize("density", [0.01, 0.3, 0.9])
@pytest.mark.parametrize("far", [0, 40], ids=["among them", "beyond the columns in order"])
def test_what_is_lost_takes_the_label_of_the_first_of_the_nearest_voxels(rng, density, far):
    index, _ = noise(rng, 3, shape=(13, 11, 17), density=density)
    index[index[:, 0] > 46, 0] += far
    lines = lines_of_index(index)
    lost = np.repeat(rng.random(len(lines.table)) < 0.5, lines.table[:, 3])
    lost[0], lost[-1] = index[0, 0] == index[-1, 0], index[0, 0] != index[-1, 0]
    lost = np.repeat(lost[lines.table[:, 4]], lines.table[:, 3])
    label = np.where(lost, 0, rng.integers(1, 12, len(index))).astype(np.uint8)
    wanted = label.copy()
    for n in np.flatnonzero(lost):
        away = ((index[n] - index[~lost]) ** 2).sum(axis=1)
        wanted[n] = label[~lost][away.argmin()]
    nearest_voxels.fill_from_nearest(label, lines)
    np.testing.assert_array_equal(label, wanted)
    assert len(set(wanted[lost].tolist())) > 1


def test_cleaning_changes_nothing_that_is_clean_and_not_its_argument(rng):
    index, label = noise(rng, 4)
    kept = label.copy()
    lines = lines_of_index(index)
    once = final_labeling.clean_labels(label, lines)
    np.testing.assert_array_equal(label, kept)
    main, size = label_regions(np.ones(len(index), np.uint8), lines)
    whole = main == size.argmax()
    again = final_labeling.clean_labels(once[whole], lines_of_index(index[whole]))
    np.testing.assert_array_equal(again, once[whole])


def test_an_empty_frame_has_no_labels():
    nothing = VoxelLines(np.zeros((0, 5), np.int32))
    assert final_labeling.clean_labels(np.zeros(0, np.uint8), nothing).shape == (0,)
    assert lines_of_index(np.zeros((0, 3), int)).voxels == 0


def spread_of(rng, count):
    root = rng.normal(size=(count, 3, 3))
    return rng.normal(size=(count, 3)), np.linalg.inv(root @ root.swapaxes(1, 2) + np.eye(3))


def test_equation_5_worked_by_hand():
    mean = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    inverse = np.array([np.diag([1 / 0.09, 100, 100]), np.diag([1 / 0.01, 100, 100])])
    center = np.array([[0.7, 0, 0], [0.8, 0, 0]])  # D: 5.44 and 9; 7.11 and 4
    assert final_labeling.nearest_segments(center, mean, inverse).tolist() == [1, 2]


def test_nearest_segments_agree_with_equation_5_written_out(rng):
    mean, inverse = spread_of(rng, 7)
    center = rng.normal(size=(500, 3)) * 2 + [40, 1, -30]
    segment = np.array([3, 0, 3, 10, 5, 0, 8])
    found = final_labeling.nearest_segments(
        center, np.add(mean, [40, 1, -30]), inverse, segment=segment
    )
    sure = 0
    for n, point in enumerate(center):
        distance = [(point - m - [40, 1, -30]) @ k @ (point - m - [40, 1, -30]) for m, k in
                    zip(mean, inverse, strict=True)]  # fmt: skip
        if np.diff(np.sort(distance))[0] > 1e-3:
            assert found[n] == segment[int(np.argmin(distance))] + 1
            sure += 1
    assert sure > 450
    assert set(found.tolist()) == {1, 4, 6, 9, 11}


def test_a_frame_is_labeled_and_cleaned(rng):
    index, _ = noise(rng, 2)
    mean, inverse = spread_of(rng, 4)
    center = index * 0.3 - [13.0, 1.5, 211.0]
    label = final_labeling.nearest_segments(center, mean, inverse)
    lines = lines_of_index(index)
    found = final_labeling.label_frame(center, lines, mean, inverse)
    np.testing.assert_array_equal(found, final_labeling.clean_labels(label, lines))


def test_what_does_not_fit_is_refused(rng):
    index, label = noise(rng, 3)
    mean, inverse = spread_of(rng, 4)
    lines = lines_of_index(index)
    with pytest.raises(ValueError, match="do not fit; pass a label for each"):
        final_labeling.clean_labels(label[1:], lines)
    with pytest.raises(ValueError, match="labels from 0 to 300 are no labels"):
        final_labeling.clean_labels(np.where(label == 1, 300, 0), lines)
    with pytest.raises(ValueError, match="not in order"):
        lines_of_index(index[::-1])
    with pytest.raises(ValueError, match=r"segments of shape \(3,\) do not fit"):
        final_labeling.nearest_segments(index, mean, inverse, segment=np.arange(3))
    with pytest.raises(ValueError, match="label nothing; fit first"):
        final_labeling.nearest_segments(index, mean * np.nan, inverse)
