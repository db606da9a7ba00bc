"""Histograms of colors, and what a color says of a group."""

import numpy as np
import pytest

from tasks.body.anatomy.colors import color_cells, count_colors, learn_likeness, log_ratio

WHITE, PURPLE, RED = (230, 230, 225), (70, 20, 90), (200, 30, 30)


def colors(rng, *pairs):
    """Return noisy colors: pairs of a color and how many."""
    clean = np.concatenate([np.tile(color, (count, 1)) for color, count in pairs])
    return np.clip(clean + rng.normal(0, 3, clean.shape), 0, 255).astype(np.uint8)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def test_cells_are_those_of_the_formula_in_single_precision(rng):
    color = rng.integers(0, 256, (4000, 3)).astype(np.uint8)
    color[:9] = np.outer(np.arange(9), [1, 1, 2])
    r, g, b = color.astype(np.float32).T
    total = np.maximum(r + g + b, 24.0)
    red, blue = (r - g) / total / 0.02, (r + g - 2.0 * b) / (2.0 * total) / 0.02
    light = (0.3 * r + 0.59 * g + 0.11 * b) / 32
    i, j, k = (np.floor(np.add(v, zero, dtype=np.float64)).astype(int)
               for v, zero in ((red, 50), (blue, 50), (light, 0)))  # fmt: skip
    cell = (np.clip(i, 0, 99) * 150 + np.clip(j, 0, 149)) * 8 + np.clip(k, 0, 7)
    np.testing.assert_array_equal(color_cells(color), cell)
    assert len(np.unique(cell)) > 2000


def test_light_changes_chromaticity_little():
    dim = color_cells(np.array([(100, 50, 50)], np.uint8))
    bright = color_cells(np.array([(102, 51, 51)], np.uint8))
    other = color_cells(np.array([(50, 100, 50)], np.uint8))
    assert dim == bright != other


def test_counts_spread_but_add_up(rng):
    cell = color_cells(colors(rng, (WHITE, 40), (PURPLE, 60)))
    count = count_colors(cell)
    assert count.sum() == pytest.approx(100, rel=1e-6)
    assert count[cell].min() > 0


def test_a_color_speaks_for_the_group_that_wears_it(rng):
    color = colors(rng, (WHITE, 100), (PURPLE, 900))
    group = np.repeat([0, 1], [100, 900])
    likeness = learn_likeness(color, group, 3, most=5.0)
    white, purple = color_cells(np.array([WHITE, PURPLE], np.uint8))
    assert likeness[white, 0] == pytest.approx(5.0)
    assert likeness[white, 1] == pytest.approx(0.2)
    assert likeness[purple, 0] == pytest.approx(0.2)
    assert 1.0 < likeness[purple, 1] < 1.2
    assert (likeness[:, 2] == 1).all()
    never = color_cells(np.array([RED], np.uint8))[0]
    np.testing.assert_allclose(likeness[never, :2], 1.0, atol=0.01)


def test_what_is_in_no_group_is_somewhere(rng):
    color = colors(rng, (WHITE, 100), (PURPLE, 100))
    likeness = learn_likeness(color, np.repeat([0, -1], 100), 1, most=5.0)
    white, purple = color_cells(np.array([WHITE, PURPLE], np.uint8))
    assert likeness[white, 0] == pytest.approx(2.0, rel=0.05)
    assert likeness[purple, 0] == pytest.approx(0.2)


def test_the_ratio_is_of_shares_not_of_counts():
    own, other = np.array([1.0, 1.0, 0.0]), np.array([100.0, 50.0, 50.0])
    ratio = log_ratio(own, other)
    np.testing.assert_allclose(np.exp(ratio[:2]), [1.0, 2.0], rtol=1e-3)
    assert ratio[2] < -8
