"""Closed surfaces: every edge twice, the volume that the voxels say, colors of the nearest."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.exporting.surfaces import SurfaceSettings, closed_surface, nearest_colors
from tests.conftest import cases

RAW = SurfaceSettings(smoothing_steps=0)
TOUCHING = {
    "one voxel": [(0, 0, 0)],
    "along an edge": [(0, 0, 0), (1, 1, 0)],
    "across an edge": [(1, 0, 0), (0, 1, 0)],
    "at a corner": [(0, 0, 0), (1, 1, 1)],
    "across a corner": [(1, 0, 0), (0, 1, 1)],
    "around two holes that touch at an edge": [
        cell
        for cell in itertools.product(range(4), range(4), range(3))
        if cell not in ((1, 1, 1), (2, 2, 1))
    ],
    "checkerboard": [c for c in itertools.product(range(3), range(4), range(5)) if sum(c) % 2],
}


def assert_closed(face: np.ndarray) -> None:
    """Every directed edge once, and once the other way; one fan of triangles at each vertex."""
    edges = [(t[k], t[(k + 1) % 3]) for t in face.tolist() for k in range(3)]
    assert len(set(edges)) == len(edges)
    assert set(edges) == {(b, a) for a, b in edges}
    assert all(a != b for a, b in edges)
    after: dict[int, dict[int, int]] = {}
    for a, b, c in face.tolist():
        for x, y, z in ((a, b, c), (b, c, a), (c, a, b)):
            after.setdefault(x, {})[y] = z
    for ring in after.values():
        start = at = next(iter(ring))
        for _ in ring:
            at, last = ring[at], at
            assert last == start or at != ring[start]
        assert at == start


def volume(vertex: np.ndarray, face: np.ndarray) -> float:
    a, b, c = np.moveaxis(vertex[face], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def naive_volume(cells: list[tuple[int, int, int]]) -> float:
    """What one, two or three occupied corners cut off each tetrahedron of the lattice."""
    occupied, total = set(cells), 0.0
    near = {tuple(np.add(c, d)) for c in cells for d in itertools.product((-1, 0), repeat=3)}
    for cell in near:
        for order in itertools.permutations(np.eye(3, dtype=int)):
            corners = np.cumsum([cell, *order], axis=0)
            inside = sum(tuple(corner) in occupied for corner in corners.tolist())
            total += (0.0, 1 / 8, 1 / 2, 7 / 8, 1.0)[inside] / 6.0
    return total


def test_cells_that_touch_in_any_way_have_a_closed_surface():
    for cells in TOUCHING.values():
        vertex, face = closed_surface(np.array(cells), (0.0, 0.0, 0.0), 1.0, settings=RAW)
        assert_closed(face)
        assert set(face.ravel()) == set(range(len(vertex)))
        assert volume(vertex, face) == pytest.approx(naive_volume(cells))


@pytest.mark.drawn
@settings(max_examples=cases(60))
@given(st.sets(st.tuples(st.integers(-2, 1), st.integers(3, 5), st.integers(0, 4)), min_size=1))
def test_any_voxels_have_a_closed_surface_with_their_volume(cells):
    vertex, face = closed_surface(np.array(sorted(cells)), (0.0, 0.0, 0.0), 1.0, settings=RAW)
    assert_closed(face)
    assert volume(vertex, face) == pytest.approx(naive_volume(sorted(cells)))


def test_a_box_lies_where_its_voxels_end():
    cells = np.array(list(itertools.product(range(6), range(7), range(9))))
    vertex, face = closed_surface(cells, (1.0, 2.0, 3.0), 0.5, settings=RAW)
    np.testing.assert_allclose(vertex.min(axis=0), [0.75, 1.75, 2.75])
    np.testing.assert_allclose(vertex.max(axis=0), [3.75, 5.25, 7.25])
    assert 0.9 < volume(vertex, face) / (len(cells) * 0.125) < 1.0


def test_a_smoothed_sphere_keeps_its_volume_and_loses_its_stairs():
    span = np.arange(-11, 12)
    cells = np.array([c for c in itertools.product(span, repeat=3) if np.dot(c, c) < 10.0**2])
    spread, size = [], []
    for chosen in (RAW, SurfaceSettings()):
        vertex, face = closed_surface(cells, (0.0, 0.0, 0.0), 0.01, settings=chosen)
        assert_closed(face)
        size.append(volume(vertex, face) / (len(cells) * 1e-6))
        normal = np.cross(
            vertex[face[:, 1]] - vertex[face[:, 0]], vertex[face[:, 2]] - vertex[face[:, 0]]
        )
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        out = vertex[face].mean(axis=1)
        spread.append(np.einsum("fi,fi->f", normal, out / np.linalg.norm(out, axis=1)[:, None]))
    assert size == pytest.approx([1.0, 1.0], abs=0.03)
    assert abs(size[1] - size[0]) < 0.01
    assert spread[1].min() > 0.7 > 0.2 > spread[0].min()
    assert spread[1].mean() > 0.95


def test_order_and_repetition_of_voxels_do_not_matter():
    rng = np.random.default_rng(5)
    cells = rng.integers(0, (4, 5, 6), (40, 3))
    again = np.concatenate([cells, cells[:7]])[rng.permutation(47)]
    for one, other in zip(
        closed_surface(cells, (0, 0, 0), 0.1), closed_surface(again, (0, 0, 0), 0.1), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_no_voxels_have_no_surface():
    vertex, face = closed_surface(np.zeros((0, 3), int), (0.0, 0.0, 0.0), 0.01)
    assert vertex.shape == (0, 3)
    assert face.shape == (0, 3)
    assert nearest_colors(vertex, np.zeros((0, 3)), np.zeros((0, 3), np.uint8)).shape == (0, 3)


def test_vertices_take_the_color_of_the_nearest_voxel():
    rng = np.random.default_rng(6)
    center, color = rng.random((17, 3)), rng.integers(0, 256, (17, 3)).astype(np.uint8)
    vertex = rng.random((29, 3))
    nearest = np.argmin(((vertex[:, None] - center) ** 2).sum(axis=2), axis=1)
    np.testing.assert_array_equal(nearest_colors(vertex, center, color), color[nearest])


def test_what_is_no_voxels_is_refused():
    with pytest.raises(ValueError, match=r"shape \(4, 2\) and type int64 .* integer index"):
        closed_surface(np.zeros((4, 2), np.int64), (0, 0, 0), 0.01)
    with pytest.raises(ValueError, match="type float64"):
        closed_surface(np.zeros((4, 3)), (0, 0, 0), 0.01)
    with pytest.raises(ValueError, match=r"voxel_m 0\.0 must be larger"):
        closed_surface(np.zeros((4, 3), int), (0, 0, 0), 0.0)
    with pytest.raises(ValueError, match="no colored voxel"):
        nearest_colors(np.zeros((4, 3)), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
