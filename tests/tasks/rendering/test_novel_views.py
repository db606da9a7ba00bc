"""Novel views: what is nearer covers, sizes and directions are a camera's, no holes."""

import itertools
import math

import numpy as np
import pytest

from tasks.rendering.drawing.floors import cast_shadow
from tasks.rendering.drawing.point_rendering import (
    BALL,
    draw_balls,
    project_balls,
    smooth_surface,
)
from tasks.rendering.novel_views import ViewSettings, aim_camera, render_view

BARE = ViewSettings(floor_m=None)
SIZE = (56, 40)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def sphere(radius: float, voxel_m: float, middle=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Centers of the surface voxels of a ball of voxels."""
    span = range(-math.ceil(radius), math.ceil(radius) + 1)
    cells = {c for c in itertools.product(span, repeat=3) if np.dot(c, c) <= radius**2}
    near = [s * row for s in (1, -1) for row in np.eye(3, dtype=int)]
    shell = [c for c in sorted(cells) if any(tuple(np.add(c, n)) not in cells for n in near)]
    return np.array(shell) * voxel_m + np.array(middle)


def paint(center, rgb):
    return np.tile(np.array(rgb, np.uint8), (len(center), 1))


def covered(image, settings=BARE):
    return (image != np.array(settings.background)).any(axis=2)


def naive_balls(ball, color, shape, slack):
    """Every pixel asks every ball: depth of the nearest, then the mean of those near it."""
    image = np.zeros((*shape, 4))
    for row, column in np.ndindex(*shape):
        u, v, ru, rv, far, thick = ball.T.astype(np.float64)
        bulge = 1.0 - ((column - u) / ru) ** 2 - ((row - v) / rv) ** 2
        hit = (bulge >= 0.0) & (far > 0.0)
        if hit.any():
            near = far[hit] - thick[hit] * np.sqrt(bulge[hit])
            weight = (bulge[hit] ** 2 + 1e-4) * (near <= near.min() + slack)
            image[row, column, :3] = weight @ color[hit] / weight.sum()
            image[row, column, 3] = 1.0
    return image


def test_balls_cover_each_other_as_in_the_naive_twin(rng):
    ball = np.column_stack(
        [
            rng.uniform(-3, 33, 60),
            rng.uniform(-3, 27, 60),
            rng.uniform(1, 5, 60),
            rng.uniform(1, 5, 60),
            rng.uniform(0.5, 1.5, 60) * (rng.random(60) < 0.9),
            np.full(60, 0.2),
        ]
    ).astype(np.float32)
    color = rng.uniform(0, 255, (60, 3)).astype(np.float32)
    expected = naive_balls(ball, color, (24, 30), 0.05)
    drawn = draw_balls(ball, color, (24, 30), 0.05, 2)
    assert drawn is not None
    part, (top, left) = drawn
    whole = np.zeros((24, 30, 4))
    whole[top : top + part.shape[0], left : left + part.shape[1]] = part
    np.testing.assert_allclose(whole, expected, atol=0.02)
    assert 0.3 < expected[..., 3].mean() < 0.99


def test_the_nearer_of_two_bodies_covers_the_farther():
    near = sphere(4, 0.02, (0.0, 0.0, 0.5))
    far = sphere(4, 0.02, (0.0, 0.0, -0.5))
    center = np.concatenate([far, near])
    color = np.concatenate([paint(far, (255, 0, 0)), paint(near, (0, 0, 255))])
    for azimuth, channel in ((0.0, 2), (math.pi, 0)):
        camera = aim_camera((0.0, 0.0, 0.0), azimuth, 0.0, 2.0, SIZE)
        for order in (slice(None), slice(None, None, -1)):
            image = render_view(center[order], color[order], 0.02, *camera, SIZE, settings=BARE)
            assert image[20, 28, channel] > 100
            assert image[20, 28, 2 - channel] == 0


@pytest.mark.parametrize("distance_m", [0.6, 1.0, 3.0])
def test_a_sphere_is_a_whole_disc_of_the_right_size_and_place(distance_m):
    target = np.array([0.3, 0.9, -0.2])
    camera = aim_camera(target, 0.7, 0.3, distance_m, SIZE)
    center = sphere(8, 0.02, target)
    image = render_view(
        center, paint(center, (90, 30, 20)), 0.02, *camera, SIZE, settings=BARE
    ).astype(float)
    dark = (249.0 - image[..., 1]) / (249.0 - image[20, 28, 1])
    radius_m = (3 * len(sphere_cells(8)) / (4 * math.pi)) ** (1 / 3) * 0.02
    radius = camera[0][0, 0] * math.tan(math.asin(radius_m / distance_m))
    row, column = np.mgrid[: SIZE[1], : SIZE[0]]
    away = np.hypot(row - 19.5, column - 27.5)
    assert (dark[away < radius - 1.5] > 0.5).all()
    assert (dark[away > radius + 1.5] == 0.0).all()
    assert (dark * row).sum() / dark.sum() == pytest.approx(19.5, abs=0.8)
    assert (dark * column).sum() / dark.sum() == pytest.approx(27.5, abs=0.8)


def sphere_cells(radius: int) -> list[tuple[int, ...]]:
    span = range(-radius, radius + 1)
    return [c for c in itertools.product(span, repeat=3) if np.dot(c, c) <= radius**2]


def test_balls_of_a_sphere_lie_on_it_with_normals_outwards():
    center = sphere(8, 0.02, (1.0, 2.0, 3.0))
    place, normal, openness = smooth_surface(center, 0.02)
    out = center - [1.0, 2.0, 3.0]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    assert np.einsum("vi,vi->v", normal, out).min() > 0.97
    rough = np.linalg.norm(center - [1.0, 2.0, 3.0], axis=1)
    smooth = np.linalg.norm(place - [1.0, 2.0, 3.0], axis=1)
    assert smooth.std() < 0.75 * rough.std()
    assert smooth.mean() + BALL * 0.02 == pytest.approx(8.2 * 0.02, abs=0.006)
    assert 0.35 < openness.min() <= openness.max() < 0.7


def test_what_a_surface_encloses_counts_as_occupied():
    cells = np.array(list(itertools.product(range(7), range(8), range(9))))
    shell = ((cells == 0) | (cells == [6, 7, 8])).any(axis=1)
    whole = [part[shell] for part in smooth_surface(cells * 0.1, 0.1)]
    hollow = smooth_surface(cells[shell] * 0.1, 0.1)
    np.testing.assert_allclose(hollow[1], whole[1], atol=1e-6)
    np.testing.assert_allclose(hollow[2], whole[2], atol=1e-6)


def test_a_leaning_plane_has_no_holes_at_any_distance():
    span = range(-9, 10)
    cells = np.array([c for c in itertools.product(span, repeat=3) if sum(c) == 0])
    toward = math.atan2(1.0, math.sqrt(2.0))
    for distance_m in (0.25, 0.6, 2.5):
        camera = aim_camera((0.0, 0.0, 0.0), math.pi / 4, toward, distance_m, SIZE)
        image = render_view(
            cells * 0.02, paint(cells, (9, 9, 9)), 0.02, *camera, SIZE, settings=BARE
        )
        half = min(15, int(0.1 / distance_m * camera[0][0, 0]))
        middle = covered(image)[20 - half : 20 + half, 28 - half : 28 + half]
        assert (image[20 - half : 20 + half, 28 - half : 28 + half] < 60).all()
        assert middle.all()


def test_up_is_up_and_right_is_right_in_the_picture():
    for azimuth, right in ((0.0, (1, 0, 0)), (math.pi / 2, (0, 0, -1))):
        camera = aim_camera((0.0, 1.0, 0.0), azimuth, 0.0, 3.0, SIZE)
        for offset, axis, sign in (((0, 1, 0), 0, -1), (right, 1, 1)):
            center = sphere(2, 0.04, np.array([0.0, 1.0, 0.0]) + 0.4 * np.array(offset))
            image = render_view(center, paint(center, (9,) * 3), 0.04, *camera, SIZE, settings=BARE)
            place = np.argwhere(covered(image)).mean(axis=0) - [19.5, 27.5]
            assert place[axis] * sign == pytest.approx(0.4 / 3.0 * camera[0][0, 0], abs=0.6)
            assert place[1 - axis] == pytest.approx(0.0, abs=0.6)


def test_the_view_angle_spans_the_picture_from_above_too():
    lens, rotation, translation = aim_camera(
        (0.0, 0.0, 0.0), 0.0, math.pi / 2, 2.0, SIZE, view_angle=math.pi / 2
    )
    np.testing.assert_allclose(-rotation.T @ translation, [0.0, 2.0, 0.0], atol=1e-12)
    x = lens @ (rotation @ [0.0, 0.0, 2.0] + translation)
    assert x[1] / x[2] == pytest.approx(39.5)


def test_the_floor_is_seen_below_the_horizon_and_darkest_under_the_body():
    camera = aim_camera((0.0, 0.5, 0.0), 0.0, 0.2, 3.0, SIZE)
    empty = render_view(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), 0.05, *camera, SIZE)
    assert not covered(empty)[:8].any()
    assert covered(empty)[24:].any()
    body = sphere(4, 0.05, (0.0, 0.2, 0.0))
    shadow = cast_shadow(body, 0.05, np.zeros(2), 0.0)
    assert shadow.argmax() == shadow.size // 2
    assert shadow[0, 0] < 0.01 < 0.5 < shadow.max() <= 1.0
    higher = cast_shadow(body + np.array([0.0, 0.5, 0.0]), 0.05, np.zeros(2), 0.0)
    assert higher.max() < 0.8 * shadow.max()
    for height, elevation in ((0.5, -0.5), (-2.0, 0.2)):
        beneath = aim_camera((0.0, height, 0.0), 0.0, elevation, 3.0, SIZE)
        image = render_view(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), 0.05, *beneath, SIZE)
        assert not covered(image).any()


def test_a_body_behind_or_beside_the_camera_is_not_drawn():
    body = sphere(4, 0.05)
    for place in ((0.0, 0.0, 5.0), (9.0, 0.0, 0.0)):
        camera = aim_camera((0.0, 0.0, 0.0), 0.0, 0.0, 3.0, SIZE)
        image = render_view(body + place, paint(body, (9,) * 3), 0.05, *camera, SIZE, settings=BARE)
        assert not covered(image).any()


def test_the_side_toward_the_camera_is_seen():
    body = sphere(8, 0.02)
    color = np.where(body[:, 2:] >= 0.0, [200, 0, 0], [0, 0, 200]).astype(np.uint8)
    for azimuth, channel in ((0.0, 0), (math.pi, 2)):
        camera = aim_camera((0.0, 0.0, 0.0), azimuth, 0.0, 1.0, SIZE)
        middle = render_view(body, color, 0.02, *camera, SIZE, settings=BARE)[17:23, 25:31]
        assert (middle[..., channel] > 100).all()
        assert (middle[..., 2 - channel] == 0).all()


def test_fine_pixels_share_the_edges_of_the_picture():
    lens = np.array([[50.0, 0.0, 7.0], [0.0, 40.0, 5.0], [0.0, 0.0, 1.0]])
    ball = project_balls(np.array([[0.2, -0.1, 2.0], [0.0, 0.0, -2.0]]), lens, 0.1, 2)
    # pixel (12, 3) is fine pixels 24-25 and 6-7
    np.testing.assert_allclose(ball[0], [24.5, 6.5, 5.0, 4.0, 2.0, 0.1], rtol=1e-6)
    assert ball[1, 4] == 0.0


def test_far_voxels_are_not_lost_between_pixels():
    lens, rotation, translation = aim_camera((0.0, 0.0, 0.0), 0.0, 0.0, 50.0, SIZE)
    ball = project_balls(np.array([[0.0, 0.0, 50.0]]), lens, 0.009, 2)
    assert ball[0, 2:4].min() >= math.sqrt(0.5)
    assert rotation.shape + translation.shape == (3, 3, 3)


def test_what_cannot_be_drawn_is_said_all_at_once():
    camera = aim_camera((0.0, 0.0, 0.0), 0.0, 0.0, 3.0, SIZE)
    with pytest.raises(
        ValueError,
        match=r"center \(4, 2\) .*; color \(4, 3\) int64 .*; voxel_m 0 .*; size \(0, 9\)",
    ):
        render_view(np.zeros((4, 2)), np.zeros((4, 3), int), 0, *camera, (0, 9))  # type: ignore
    with pytest.raises(ValueError, match=r"ambient is 1\.5, it must be a number 0 or more"):
        ViewSettings(ambient=1.5)
    with pytest.raises(ValueError, match="no camera sees"):
        aim_camera((0, 0, 0), 0.0, 0.0, 0.0, SIZE)
