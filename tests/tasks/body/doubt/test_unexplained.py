import numpy as np
import pytest

from tasks.body.doubt.reasons import unexplained_share
from tasks.geometry.sides import cut_off_at, is_cut_off
from tasks.geometry.voxel_lines import lines_of_index


@pytest.fixture
def rng():
    return np.random.default_rng(17)


@pytest.fixture
def blobs(rng):
    mean = rng.normal(size=(5, 3))
    root = rng.normal(size=(5, 3, 3)) + 4 * np.eye(3)
    return mean, root @ root.swapaxes(1, 2)


def test_the_share_is_that_of_voxels_beyond_every_blob(rng, blobs):
    mean, inverse = blobs
    center = rng.normal(size=(400, 3))
    for beyond in (2.0, 4.0):
        far = 0
        for point in center:
            squares = [(point - m) @ w @ (point - m) for m, w in zip(mean, inverse, strict=True)]
            far += min(squares) > beyond**2
        assert unexplained_share(center, mean, inverse, beyond=beyond) == pytest.approx(far / 400)
        assert 0 < far < 400


def test_nobody_leaves_nothing_unexplained(blobs):
    assert unexplained_share(np.zeros((0, 3)), *blobs, beyond=4.0) == 0.0


@pytest.mark.parametrize(
    ("axis", "end", "found"),
    [(0, 0, True), (0, 6, True), (1, 0, False), (1, 4, True), (2, 2, True)],
)
def test_a_performer_is_cut_off_at_every_side_but_the_floor(axis, end, found):
    shape = (7, 5, 3)
    index = np.tile(np.array([3, 2, 1]), (10, 1))
    assert cut_off_at(index, shape) == []
    index[:3, axis] = end
    assert cut_off_at(index, shape) == []  # specks
    index[3, axis] = end
    assert cut_off_at(index, shape) == [(axis, end)] * found


def test_lines_are_cut_off_where_their_voxels_are(rng):
    shape = (9, 8, 7)
    found = []
    for _ in range(60):
        low = rng.integers(0, 3, 3)
        high = low + rng.integers(1, 8, 3)
        occupied = np.zeros(shape, bool)
        occupied[tuple(map(slice, low, high))] = rng.random() < 0.9
        occupied &= rng.random(shape) < 0.15
        index = np.argwhere(occupied)
        found.append(is_cut_off(lines_of_index(index), shape))
        assert found[-1] == bool(cut_off_at(index, shape))
    assert 10 < sum(found) < 50
