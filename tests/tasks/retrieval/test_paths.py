import numpy as np
import pytest

from tasks.retrieval.paths import TURN_LEVER, path_channel


@pytest.fixture
def rng():
    return np.random.default_rng(44)


def walk(turn_rate, forward, side, samples=25, rate_hz=30.0):
    """Return the channel of someone who goes at constant speed and turns at constant rate."""
    angle = 0.4 + turn_rate * np.arange(samples) / rate_hz
    left = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    ahead = np.stack([-np.cos(angle), np.sin(angle)], axis=1)
    fine = np.cumsum(np.repeat(forward * ahead + side * left, 200, axis=0), axis=0)
    return path_channel(fine[::200] / 200 / rate_hz, left, rate_hz)


def test_going_straight_is_told_forward_and_sideways():
    np.testing.assert_allclose(walk(0.0, 0.8, 0.0), [[0.8] * 25, [0] * 25, [0] * 25], atol=1e-9)
    np.testing.assert_allclose(walk(0.0, 0.0, 0.3), [[0] * 25, [0.3] * 25, [0] * 25], atol=1e-9)


@pytest.mark.parametrize("turn_rate", [2.0, -2.0, 14.0])
def test_turning_left_is_told_from_turning_right(turn_rate):
    channel = walk(turn_rate, 0.0, 0.0)
    np.testing.assert_allclose(channel[2], turn_rate * TURN_LEVER)


def test_a_circle_goes_forward_all_the_way():
    channel = walk(1.0, 0.5, 0.0)
    np.testing.assert_allclose(channel[0, 3:-3], 0.5, rtol=0.02)
    np.testing.assert_allclose(channel[1, 3:-3], 0, atol=0.02)


def test_the_window_is_three_samples_each_way_and_one_sided_at_the_ends(rng):
    middle = rng.normal(size=(19, 2))
    left = np.tile([0.0, 1.0], (19, 1))
    channel = path_channel(middle, left, 30.0)
    np.testing.assert_allclose(channel[0, 8], -(middle[11, 0] - middle[5, 0]) / 0.2)
    np.testing.assert_allclose(channel[1, 0], (middle[3, 1] - middle[0, 1]) / 0.1)
    np.testing.assert_allclose(channel[1, 17], (middle[18, 1] - middle[14, 1]) * 30 / 4)


def test_what_is_missing_is_missing_in_its_window(rng):
    middle, left = rng.normal(size=(2, 19, 2))
    middle[9] = left[9] = np.nan
    missing = np.isnan(path_channel(middle, left, 30.0)).any(axis=0)
    assert np.flatnonzero(missing).tolist() == [6, 9, 12]


def test_a_single_sample_stands_still():
    channel = path_channel(np.ones((1, 2)), np.array([[0.0, 1.0]]), 30.0)
    np.testing.assert_array_equal(channel, np.zeros((3, 1)))
