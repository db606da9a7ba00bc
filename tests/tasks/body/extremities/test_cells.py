import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from tasks.body.extremities.cells import _find_neighbors, find_ends, gather_cells, sum_balls

SIZE_M = 0.02


@pytest.fixture
def rng():
    return np.random.default_rng(23)


def cloud(rng, count=700):
    return rng.uniform([-0.1, 0.4, -0.3], [0.12, 0.5, -0.12], (count, 3))


def test_cells_hold_what_was_put_into_them(rng):
    place, ratio = cloud(rng), rng.uniform(-1, 2, (2, 700))
    cells = gather_cells(place, ratio, SIZE_M)
    cube, number = np.unique(np.floor(place / SIZE_M), axis=0, return_inverse=True)
    assert len(cells.count) == len(cube) < 500
    for n in range(0, len(cube), 7):
        own = number.ravel() == n
        c = np.argmin(np.linalg.norm(cells.center - place[own].mean(axis=0), axis=1))
        np.testing.assert_allclose(cells.center[c], place[own].mean(axis=0))
        assert cells.count[c] == own.sum()
        hot = np.maximum(ratio[:, own], 0.0)
        np.testing.assert_allclose(cells.mass[:, c], ratio[:, own].sum(axis=1))
        np.testing.assert_allclose(cells.hot[:, c], hot.sum(axis=1), atol=1e-12)
        for table in range(2):
            middle = place[own].mean(axis=0)
            if hot[table].sum() > 0:
                middle = hot[table] @ place[own] / hot[table].sum()
            np.testing.assert_allclose(cells.hot_center[table, c], middle)


@pytest.mark.parametrize("radius", [0.013, 0.05])
def test_sums_in_balls_are_those_over_all_cells(rng, radius):
    cells = gather_cells(cloud(rng), rng.uniform(-1, 2, (2, 700)), SIZE_M)
    near = rng.integers(0, len(cells.count), 25)
    place = cells.center[near] + rng.normal(0, 0.02, (25, 3))
    place[0] += 1.0
    mass, middle = sum_balls(
        cells, near, place, radius, (cells.hot_center[1], cells.mass[0], cells.count)
    )
    filled = 0
    for b in range(25):
        inside = np.linalg.norm(cells.hot_center[1] - place[b], axis=1) < radius
        filled += inside.any()
        assert mass[b] == pytest.approx(cells.mass[0, inside].sum())
        wanted = place[b]
        if inside.any():
            wanted = np.average(cells.hot_center[1, inside], axis=0, weights=cells.count[inside])
        np.testing.assert_allclose(middle[b], wanted)
    assert 5 < filled < 25


def test_neighbors_are_all_cells_that_touch_in_order(rng):
    cells = gather_cells(cloud(rng), np.zeros((1, 700)), SIZE_M)
    beside, length, count = _find_neighbors(cells.place, cells.column, cells.center)
    for cell in range(len(count)):
        away = np.abs(cells.place - cells.place[cell]).max(axis=1)
        wanted = np.flatnonzero(away == 1)
        np.testing.assert_array_equal(beside[cell, : count[cell]], wanted)
        way = np.linalg.norm(cells.center[wanted] - cells.center[cell], axis=1)
        np.testing.assert_allclose(length[cell, : count[cell]], way)
    assert count.min() < 8 < 20 < count.max()


def star(lengths):
    """Return points along bent arms from a middle, 5 mm apart."""
    ways = [[(1, 0, 0)], [(-1, 0, 0), (0, 0, -1)], [(0, 1, 0)], [(0, -1, 0), (0.6, 0, 0.8)]]
    points, tips = [], []
    for steps, length in zip(ways, lengths, strict=True):
        at = np.zeros(3)
        for step in steps:
            along = np.arange(0.0, length / len(steps), 0.005)[:, None] * np.array(step, float)
            points.append(at + along)
            at = points[-1][-1]
        tips.append(at)
    return np.concatenate(points), np.array(tips)


def test_ends_are_where_arms_end_the_longest_first():
    place, tips = star((0.3, 0.62, 0.42, 0.5))
    cells = gather_cells(place, np.zeros((1, len(place))), SIZE_M)
    ends = cells.center[find_ends(cells, 0.1, 0.1, 9)]
    np.testing.assert_allclose(ends, tips[[1, 3, 2, 0]], atol=0.03)
    assert len(find_ends(cells, 0.1, 0.1, 2)) == 2
    assert len(find_ends(cells, 0.45, 0.1, 9)) < 4


def test_ends_are_the_farthest_along_the_surface(rng):
    place, _ = star((0.3, 0.62, 0.42, 0.5))
    place = place + rng.normal(0, 0.01, place.shape)
    cells = gather_cells(place, np.zeros((1, len(place))), SIZE_M)
    first = find_ends(cells, 0.1, 0.1, 1)[0]
    near = KDTree(cells.place).query_pairs(1.8, output_type="ndarray")
    way = np.linalg.norm(cells.center[near[:, 0]] - cells.center[near[:, 1]], axis=1)
    graph = csr_matrix((way, near.T), (len(cells.count),) * 2)
    root = np.argmin(np.linalg.norm(cells.center - np.median(cells.center, axis=0), axis=1))
    length = dijkstra(graph, directed=False, indices=root)
    assert first == np.argmax(np.where(np.isfinite(length), length, -1.0))
