import numpy as np
import pytest

from tasks.geometry.voxel_lines import labeled_centers, lines_of, lines_of_index, marked_centers
from tasks.geometry.voxels import VoxelGrid, encode_runs, voxel_centers

GRID = VoxelGrid((-1.3, 0.2, 7.7), 0.07, (5, 7, 11))


@pytest.fixture
def rng():
    return np.random.default_rng(91)


@pytest.mark.parametrize("density", [0.0, 0.1, 0.7, 1.0])
def test_lines_are_the_runs_of_the_voxels(rng, density):
    occupied = rng.random((1, *GRID.shape)) < density
    index = np.argwhere(occupied[0])
    lines = lines_of(encode_runs(occupied))
    np.testing.assert_array_equal(lines.table, lines_of_index(index).table)
    found = [(x, y, z + k) for x, y, z, length, _ in lines.table.tolist() for k in range(length)]
    assert found == [tuple(voxel) for voxel in index.tolist()]
    assert lines.voxels == len(index)
    first = np.concatenate([[0], np.cumsum(lines.table[:, 3])])[:-1]
    np.testing.assert_array_equal(lines.table[:, 4], first)


def test_centers_of_some_voxels_are_those_of_all_where_they_are_some(rng):
    occupied = rng.random((1, *GRID.shape)) < 0.6
    runs, index = encode_runs(occupied), np.argwhere(occupied[0])
    center = voxel_centers(GRID, index)
    label = rng.integers(0, 5, len(index)).astype(np.uint8)
    found, value = labeled_centers(GRID, lines_of(runs), label, (1, 4))
    np.testing.assert_array_equal(found, center[(label == 1) | (label == 4)])
    np.testing.assert_array_equal(value, label[(label == 1) | (label == 4)])
    np.testing.assert_array_equal(marked_centers(GRID, runs, label == 2), center[label == 2])
    assert 10 < len(found) < len(index)


def test_only_one_frame_has_lines(rng):
    with pytest.raises(
        ValueError, match="runs of 2 frames were given where those of one are wanted; pass what"
    ):
        lines_of(encode_runs(rng.random((2, 3, 4, 5)) < 0.5))
