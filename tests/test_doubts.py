import numpy as np
import pytest

from tasks.geometry.doubts import cut_off_at, unexplained_share


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


def test_of_many_voxels_an_even_part_is_looked_at(rng, blobs):
    center = np.repeat(rng.normal(size=(100, 3)), 700, axis=0)
    share = unexplained_share(center, *blobs)
    assert share == pytest.approx(unexplained_share(center[::700], *blobs), abs=0.01)


def test_nobody_leaves_nothing_unexplained(blobs):
    assert unexplained_share(np.zeros((0, 3)), *blobs) == 0.0


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
