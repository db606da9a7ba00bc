"""From the share that is told on, a line meets no voxel of the surface; and much is told."""

import numpy as np
import pytest

from tasks.reconstruction.sight.clear_lines import clear_shares
from tests.twins import voxels as naive

SHAPE = (9, 14, 11)


@pytest.fixture
def rng():
    return np.random.default_rng(31)


def some_lines(rng, lines):
    """Return a crop with a hull of boxes, its surface, and where lines begin."""
    crop = np.zeros(SHAPE, bool)
    for _ in range(3):
        low = rng.integers(2, 5, 3)
        crop[tuple(map(slice, low, low + rng.integers(1, 5, 3)))] = True
    crop &= rng.random(SHAPE) < 0.9
    return (
        crop,
        np.argwhere(naive.surface(crop)),
        rng.uniform(-0.5, np.array(SHAPE) - 0.5, (lines, 3)),
    )


def meets(crop, start, camera, shares):
    """Return whether a line has a point in a voxel at some of the shares of its way."""
    point = start + shares[:, None] * (camera - start)
    index = np.floor(point + 0.5).astype(int)
    index = index[((index >= 0) & (index < crop.shape)).all(axis=1)]
    return bool(crop[tuple(index.T)].any())


@pytest.mark.parametrize("away", [400.0, 25.0, 12.0])
def test_a_clear_line_meets_no_surface(rng, away):
    blocked = clear = told = 0
    for _ in range(8):
        crop, place, start = some_lines(rng, 40)
        surface = naive.surface(crop)
        toward = rng.normal(size=(3, 3))
        toward /= np.linalg.norm(toward, axis=1)[:, None]
        cameras = np.array(SHAPE) / 2 + away * toward
        share, saved = clear_shares(place, start, cameras, SHAPE)
        assert share.shape == (3, 40)
        np.testing.assert_array_equal(saved > 0, (share < 1).any(axis=1))
        for own, camera in zip(share - saved[:, None], cameras, strict=True):
            for begin, first in zip(start, own, strict=True):
                before = np.linspace(0.0, max(float(first), 0.0), 300)
                assert not meets(
                    surface, begin, camera, np.linspace(max(float(first), 0.0), 1.0, 2000)
                )
                blocked += meets(surface, begin, camera, before)
                clear += first <= 0
                told += first < 1
    assert told > 900
    assert clear > 150
    assert blocked > 80


def test_of_a_camera_that_is_not_before_the_hull_nothing_is_known(rng):
    _, place, start = some_lines(rng, 5)
    cameras = np.array([[4.0, 6.0, 5.0], [4.0, 15.0, 5.0], [4.0, 60.0, 5.0]])
    share, saved = clear_shares(place, start, cameras, SHAPE)
    assert (saved[:2] == 0).all()
    assert (share[:2] == 1).all()
    assert (share[2] < 1).all()


def test_a_line_is_blocked_by_what_is_before_it_only():
    place = np.array([[4, 6, 5]])
    start = np.array([[4.0, 1.0, 5.0], [4.0, 10.0, 5.0], [0.0, 1.0, 0.0]])
    [far], [saved] = clear_shares(place, start, np.array([[4.0, 206.0, 5.0]]), SHAPE)
    assert far[0] == pytest.approx(1.0 - (200.0 - np.sqrt(2.75)) / 205.0, abs=1e-3)
    assert far[0] - saved == pytest.approx(1.0 - (200.0 - np.sqrt(0.75)) / 205.0, abs=1e-3)
    assert (far[1:] <= 0).all()
