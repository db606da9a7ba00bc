import numpy as np
import pytest

from tasks.studio.stage.outer_points import outer_vertices, windings

CUBE = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0], indexing="ij"), -1).reshape(-1, 3)
SIDES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@pytest.fixture
def rng():
    return np.random.default_rng(2)


def test_a_surface_goes_once_around_what_is_inside_it(rng):
    point = rng.uniform(-0.5, 1.5, (200, 3))
    inside = ((point > 0.0) & (point < 1.0)).all(axis=1)
    found = windings(point, CUBE[SIDES])
    np.testing.assert_allclose(found, inside.astype(float), atol=1e-9)
    assert 0 < inside.sum() < len(inside)


def test_vertices_inside_another_part_are_not_outer():
    through = CUBE * [0.2, 0.2, 2.0] + [0.3, 0.4, 0.5]  # a bar from inside the cube to outside
    vertex = np.concatenate([CUBE, through])[None].repeat(3, axis=0)
    triangle = np.concatenate([SIDES, SIDES + 8])
    outer = outer_vertices(vertex, triangle)
    assert outer[:8].all()
    np.testing.assert_array_equal(outer[8:], through[:, 2] > 1.0)


def test_a_part_does_not_hide_itself_nor_what_it_hides_half_of_the_time():
    bent = np.concatenate([CUBE, CUBE * [0.2, 0.2, 0.5] + [0.3, 0.4, 0.2]])
    bent[9, 2] = 1.5
    alone = np.concatenate([SIDES, SIDES + 8, [[0, 8, 9], [0, 9, 8]]])  # one part of two shells
    assert outer_vertices(bent[None], alone).all()
    aside = np.concatenate([CUBE, CUBE * 0.2 + [0.3, 0.4, 3.0]])[None].repeat(5, axis=0)
    aside[:2, 8:, 2] -= 2.6
    assert outer_vertices(aside, np.concatenate([SIDES, SIDES + 8])).all()


def test_what_is_hidden_for_a_moment_is_outer():
    aside = CUBE * 0.2 + [0.3, 0.4, 3.0]
    vertex = np.concatenate([CUBE, aside])[None].repeat(5, axis=0)
    vertex[2, 8:, 2] -= 2.6
    triangle = np.concatenate([SIDES, SIDES + 8])
    assert outer_vertices(vertex, triangle).all()
    assert not outer_vertices(vertex[2:3], triangle)[8:].any()
