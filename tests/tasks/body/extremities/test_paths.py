from itertools import product

import numpy as np
import pytest

from tasks.body.extremities.moves import Motion
from tasks.body.extremities.paths import best_paths

PLAIN = Motion(settled_s=0.0, ghosts=60)
"""Without velocities the cost of a path is a sum, and with enough ghosts no path is lost."""
STEP_S = 0.05
UNSEEN = (0.9, 1.3)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def scene(rng, frames, most):
    """Return places and costs of a few candidates a frame, and where both points start."""
    start = rng.normal(0, 0.1, (2, 3))
    place = [
        [start[p] + rng.normal(0, 0.07, (rng.integers(1, most + 1), 3)) for _ in range(frames)]
        for p in range(2)
    ]
    cost = [[rng.uniform(0, 1.2, len(spot)) for spot in spots] for spots in place]
    return place, cost, start


def price(path, place, cost, start, together):
    """Return what a path, (time, 2) candidates or -1, costs; written from the docstrings."""
    total = 0.0
    for point in range(2):
        at, seen = start[point], -1
        for t, choices in enumerate(path):
            choice = choices[point]
            if choice < 0:
                total += UNSEEN[point]
                continue
            total += cost[point][t][choice]
            way = np.linalg.norm(place[point][t][choice] - at)
            time_s = (t - seen) * STEP_S
            noise = 2**0.5 * PLAIN.noise
            spread = np.hypot(noise, min(PLAIN.speed * time_s, PLAIN.widest))
            shortest = np.hypot(noise, PLAIN.speed * STEP_S)
            if way > PLAIN.fastest * time_s + 4 * PLAIN.noise:
                return np.inf
            longer = max(3 * np.log(spread / shortest), 0.0)
            total += min((way / spread) ** 2 / 2 + longer, PLAIN.jump)
            at, seen = place[point][t][choice], t
    for t, (a, b) in enumerate(path):
        if a >= 0 and b >= 0:
            apart = np.linalg.norm(place[0][t][a] - place[1][t][b])
            total += together * max(1 - (apart / PLAIN.alone) ** 2, 0.0)
    return total


@pytest.mark.parametrize("seed", range(6))
def test_the_path_and_its_weights_are_those_of_all_paths_tried(seed):
    rng = np.random.default_rng(seed)
    place, cost, start = scene(rng, 4, 2)
    choices = [
        list(product(range(-1, len(place[0][t])), range(-1, len(place[1][t])))) for t in range(4)
    ]
    paths = list(product(*choices))
    prices = np.array([price(path, place, cost, start, 0.8) for path in paths])
    best = paths[int(np.argmin(prices))]
    position, weight, total = best_paths(
        (place[0], place[1]),
        (cost[0], cost[1]),
        (start[0], start[1]),
        0,
        STEP_S,
        PLAIN,
        UNSEEN,
        together=0.8,
    )
    assert total[0] == pytest.approx(prices.min())
    likely = np.exp(prices.min() - prices)
    for t, point in product(range(4), range(2)):
        if best[t][point] < 0:
            assert np.isnan(position[t, point]).all()
            assert weight[t, point] == 0.0
            continue
        spot = place[point][t]
        np.testing.assert_array_equal(position[t, point], spot[best[t][point]])
        near = np.linalg.norm(spot - position[t, point], axis=1) < PLAIN.alike
        agree = np.array([path[t][point] >= 0 and near[path[t][point]] for path in paths])
        assert weight[t, point] == pytest.approx((likely * agree).sum() / likely.sum())
    assert len(paths) > 100


def test_paths_run_back_from_the_initial_frame_as_they_run_on(rng):
    place, cost, start = scene(rng, 7, 3)
    begin = (start[0], start[1])
    there = best_paths((place[0], place[1]), (cost[0], cost[1]), begin, 2, STEP_S, Motion(), UNSEEN)
    back = best_paths(
        (place[0][::-1], place[1][::-1]),
        (cost[0][::-1], cost[1][::-1]),
        begin,
        4,
        STEP_S,
        Motion(),
        UNSEEN,
    )
    np.testing.assert_allclose(there[0], back[0][::-1])
    np.testing.assert_allclose(there[1], back[1][::-1])
    np.testing.assert_allclose(there[2], back[2][::-1])


def crossing(frames=21, rate=30.0):
    """Return two points that pass each other 5 cm apart, at two statures a second."""
    x = (np.arange(frames) - frames // 2) * 2.0 / rate / 2
    one = np.stack([x, np.full(frames, 0.6), np.zeros(frames)], axis=1)
    return one, one * [-1, 1, 1] + [0.0, 0.03, 0.0]


def test_points_that_cross_go_on(rng):
    one, two = crossing()
    both = [np.stack([a, b])[rng.permutation(2)] for a, b in zip(one, two, strict=True)]
    free = [np.zeros(2)] * len(both)
    position, _, _ = best_paths(
        (both, both), (free, free), (one[0], two[0]), 0, 1 / 30, Motion(), (2.0, 2.0), together=1.6
    )
    np.testing.assert_array_equal(position[:, 0], one)
    np.testing.assert_array_equal(position[:, 1], two)


def test_a_point_that_is_hidden_comes_back_where_it_was(rng):
    still = np.array([[0.3, 0.5, 0.0], [-0.3, 0.5, 0.1]])
    place = [still + rng.normal(0, 0.005, (2, 3)) for _ in range(15)]
    left = [p if not 4 <= t < 9 else p[:1] for t, p in enumerate(place)]
    cost = [np.full(len(p), 0.3) for p in left]
    position, weight, _ = best_paths(
        (left, left),
        (cost, cost),
        (still[0], still[1]),
        0,
        1 / 30,
        Motion(),
        (2.0, 2.0),
        together=2.5,
    )
    unseen = np.isnan(position[:, 1, 0])
    np.testing.assert_array_equal(unseen, (np.arange(15) >= 4) & (np.arange(15) < 9))
    assert (weight[unseen, 1] == 0).all()
    np.testing.assert_allclose(position[~unseen, 1], np.tile(still[1], (10, 1)), atol=0.03)
    assert np.isfinite(position[:, 0]).all()


def test_equal_ways_share_the_weight():
    """Two places as near as each other, for one point: neither is worth more than half."""
    spot = [np.array([[0.1, 0, 0], [-0.1, 0, 0]])]
    _, weight, _ = best_paths(
        (spot, [np.empty((0, 3))]),
        ([np.zeros(2)], [np.empty(0)]),
        (np.zeros(3), np.full(3, np.nan)),
        0,
        1 / 30,
        Motion(),
        (30.0, 0.0),
    )
    assert weight[0, 0] == pytest.approx(0.5)
