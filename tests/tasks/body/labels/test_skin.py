import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from storage.schema import NO_CAMERA
from tasks.body.labels import skin as skin_labeling
from tasks.geometry.voxel_lines import lines_of_index


@pytest.fixture
def rng():
    return np.random.default_rng(48)


def block(*sides):
    return (
        np.stack(np.meshgrid(*map(range, sides), indexing="ij"), -1).reshape(-1, 3).astype(np.int32)
    )


def skin_scene():
    """Return a surface of three skin patches in a row, 20 voxels apart, on a band of clothes."""
    index = block(60, 4, 1)
    is_skin = index[:, 0] % 20 < 5
    return index, index * 0.01, is_skin


def track(scene, place, *, reach_m=0.08, least_voxels=12):
    index, center, is_skin = scene
    return skin_labeling.track_skin(
        index, center, is_skin, np.array(place), reach_m=reach_m, least_voxels=least_voxels
    )


@pytest.mark.parametrize("reach_m", [0.08, 1.0], ids=["one in reach", "all in reach"])
def test_face_and_hands_keep_the_nearest_region_of_skin(reach_m):
    index, center, is_skin = skin_scene()
    place = [[0.0, 0, 0], [0.45, 0, 0], [0.2, 0.05, 0]]
    found = track((index, center, is_skin), place, reach_m=reach_m)
    wanted = np.where(is_skin, np.array([1, 7, 5])[index[:, 0] // 20], 0)
    np.testing.assert_array_equal(found.label, wanted)
    assert found.found.all()
    np.testing.assert_allclose(found.place[:, 0], [0.02, 0.42, 0.22])


def test_a_hand_out_of_reach_or_too_small_keeps_its_place():
    scene = skin_scene()
    far = track(scene, [[0.0, 0, 0], [0.35, 0, 0], [0.2, 0, 0]], reach_m=0.04)
    assert far.found.tolist() == [True, False, True]
    np.testing.assert_array_equal(far.place[1], [0.35, 0, 0])
    wanted = np.where(scene[2], np.array([1, 0, 7])[[0, 2, 1]][scene[0][:, 0] // 20], 0)
    np.testing.assert_array_equal(far.label, wanted)
    few = track(scene, [[0.0, 0, 0]] * 3, least_voxels=21)
    assert not few.found.any()
    none = track((*scene[:2], np.zeros(240, bool)), [[0.0, 0, 0]] * 3)
    assert not none.label.any()
    assert not none.found.any()


@pytest.mark.parametrize("density", [0.01, 0.05, 0.3])
def test_regions_of_skin_are_those_of_all_pairs_within_two_voxels(rng, density):
    index = np.add(np.argwhere(rng.random((19, 23, 17)) < density), [30, 2, 600]).astype(np.int32)
    region, size = skin_labeling._skin_regions(index)
    pairs = KDTree(index).query_pairs(2.0, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(index),) * 2)
    count, wanted = connected_components(graph, directed=False)
    assert len(set(zip(region.tolist(), wanted.tolist(), strict=True))) == count == len(size)
    np.testing.assert_array_equal(size, np.bincount(region))
    assert count > 1 or density > 0.1


@pytest.mark.parametrize("density", [0.0, 0.6])
def test_skin_is_what_has_its_colors_and_was_seen(rng, density):
    index = np.argwhere(rng.random((7, 5, 11)) < density).astype(np.int32)
    is_surface = rng.random(len(index)) < 0.5
    color = rng.integers(0, 256, (is_surface.sum(), 3)).astype(np.uint8)
    camera = rng.choice(np.array([0, 3, NO_CAMERA], np.uint8), len(color))
    table = rng.random((64, 64, 64)) < 0.5
    found = skin_labeling._find_skin(lines_of_index(index).table, is_surface, color, camera, table)
    wanted = np.flatnonzero(is_surface)[table[tuple(color.T // 4)] & (camera != NO_CAMERA)]
    np.testing.assert_array_equal(found[0], wanted)
    np.testing.assert_array_equal(found[1], index[wanted])
    assert len(wanted) > 20 or not density


def test_hands_that_touch_share_their_region():
    index, center, is_skin = skin_scene()
    found = track((index, center, is_skin), [[0.0, 0, 0], [0.195, 0, 0], [0.245, 0, 0]])
    middle = index[:, 0] // 20 == 1
    wanted = np.where(is_skin & middle, np.where(index[:, 0] <= 22, 5, 7), 0)
    np.testing.assert_array_equal(np.where(middle, found.label, 0), wanted)
