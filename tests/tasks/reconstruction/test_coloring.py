import numpy as np
import pytest

from storage.schema import NO_CAMERA
from tasks.geometry.projection import (
    Projection,
    camera_centers,
    nearest_pixels,
    project_points,
)
from tasks.geometry.voxels import VoxelGrid, encode_runs, voxel_centers
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tasks.reconstruction.coloring import ColoringSettings, color_surface
from tests.twins import voxels as naive

SHAPE = (13, 15, 11)
GRID = ((-0.3, 0.2, -0.25), 0.05, SHAPE)


@pytest.fixture
def rng():
    return np.random.default_rng(19)


def camera_at(position, target, *, size=(41, 33), focal=38.0, distortion=()):
    """Return a camera, as the naive twin takes it, that looks at a target."""
    ahead = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    right = np.cross(ahead, [0.02, 1.0, 0.03])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    pose = np.concatenate([rotation, -rotation @ np.reshape(position, (3, 1))], axis=1)
    columns, rows = size
    intrinsic = np.array([[focal, 0.2, columns / 2], [0, focal, rows / 2], [0, 0, 1]])
    return {
        "pose": pose,
        "intrinsic": intrinsic,
        "distortion": list(distortion),
        "columns": columns,
        "rows": rows,
    }


def ring(count, *, target=(0.0, 0.55, 0.0), distance=1.6, **how):
    """Return cameras around a target, every second one higher."""
    angles = 2 * np.pi * (np.arange(count) + 0.3) / count
    return [
        camera_at(
            np.add(target, [distance * np.cos(a), (0.1, 0.9)[c % 2], distance * np.sin(a)]),
            target,
            **how,
        )
        for c, a in enumerate(angles)
    ]


def projection_of(cameras):
    return Projection(
        np.stack([c["pose"] for c in cameras]),
        np.stack([c["intrinsic"] for c in cameras]),
        np.array([c["distortion"] for c in cameras]),
        np.array([(c["columns"], c["rows"]) for c in cameras]),
    )


def figure(rng):
    """Return occupied voxels: boxes that hide each other, a hole, single voxels, a border."""
    occupied = np.zeros(SHAPE, bool)
    occupied[1:5, 3:9, 2:8] = True
    occupied[2:4, 4:6, 2:5] = False
    occupied[7:10, 2:12, 4:9] = True
    occupied[6, 13, 9] = occupied[11:, 8, 3] = occupied[12, :2, 10] = True
    return occupied | (rng.random(SHAPE) < 0.01)


def shades(rng, count):
    """Return images of few colors, so that candidates are often equally near."""
    return (rng.integers(0, 4, (count, 33, 41, 3)) * 70).astype(np.uint8)


@pytest.mark.parametrize(("lift", "filled"), [(0.0, 0.7), (1.3, 0.7), (2.0, 0.7), (2.0, 0.02)])
@pytest.mark.parametrize("distortion", [(), (-0.2, 0.05, 0.003, -0.002)], ids=["none", "bent"])
def test_colors_and_cameras_are_those_of_the_twin(rng, lift, filled, distortion):
    cameras = ring(5, distortion=distortion)
    cameras.append(camera_at([0.0, 0.5, 0.03], [-0.3, 0.4, 0.0], distortion=distortion))
    occupied, images = figure(rng), shades(rng, 6)
    silhouettes = rng.random((6, 33, 41)) < filled
    found = color_surface(
        encode_runs(occupied[None]),
        VoxelGrid(*GRID),
        images,
        silhouettes,
        projection_of(cameras),
        ColoringSettings(lift),
    )
    index, color, camera = naive.color(occupied, GRID, images, silhouettes, cameras, lift)
    np.testing.assert_array_equal(found.index, index)
    np.testing.assert_array_equal(found.camera, camera)
    np.testing.assert_array_equal(found.color, color)
    assert len(np.unique(camera)) >= 5
    assert 20 < (camera == NO_CAMERA).sum() < len(camera) - 5


def balls(points, radius, eye, ray):
    """Return (pixel,) the first ball met by each ray from an eye, or -1."""
    along = (points - eye) @ ray.T
    apart = ((points - eye) ** 2).sum(axis=1)[:, None] - along**2
    inside = radius[:, None] ** 2 - apart
    depth = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), np.inf)
    return np.where(np.isfinite(depth).any(axis=0), depth.argmin(axis=0), -1)


def body():
    """Return balls (ball, 3), their radii and parts: a trunk, a head and four limbs."""
    limbs = [
        ([0, 0.8, 0], [0, 1.3, 0], 0.15),
        ([0, 1.52, 0.03], [0, 1.58, 0.03], 0.11),
        ([0.2, 1.35, 0], [0.72, 1.2, 0.25], 0.055),
        ([-0.2, 1.35, 0], [-0.6, 1.6, -0.25], 0.055),
        ([0.1, 0.75, 0], [0.25, 0.06, 0.1], 0.075),
        ([-0.1, 0.75, 0], [-0.2, 0.06, -0.2], 0.075),
    ]
    share = np.linspace(0, 1, 25)[:, None]
    points = [np.add(a, share * np.subtract(b, a)) for a, b, _ in limbs]
    return (
        np.concatenate(points),
        np.repeat([r for *_, r in limbs], 25),
        np.repeat(np.arange(len(limbs)), 25),
    )


@pytest.mark.compiled
def test_a_rendered_body_is_colored_with_the_right_parts_colors(rng):
    points, radius, part = body()
    paint = rng.integers(0, 256, (6, 3)).astype(np.uint8)
    cameras = ring(
        8,
        target=(0.0, 0.9, 0.0),
        distance=3.4,
        size=(320, 240),
        focal=340.0,
        distortion=(-0.08,),
    )
    images = np.zeros((8, 240, 320, 3), np.uint8)
    silhouettes = np.zeros((8, 240, 320), bool)
    for c, camera in enumerate(cameras):
        ray = rays(camera)
        rotation, moved = camera["pose"][:, :3], camera["pose"][:, 3]
        ball = balls(points, radius, -rotation.T @ moved, ray @ rotation).reshape(240, 320)
        silhouettes[c] = ball >= 0
        images[c][ball >= 0] = paint[part[ball[ball >= 0]]]
    projection = projection_of(cameras)
    grid = VoxelGrid((-1.0, 0.0, -0.6), 0.01, (201, 175, 121))
    hull = carve_visual_hull(silhouettes, projection, grid, CarvingSettings())
    found = color_surface(hull, grid, images, silhouettes, projection, ColoringSettings())
    centers = voxel_centers(grid, found.index)
    far = np.linalg.norm(centers[:, None] - points, axis=2) - radius
    right = (found.color == paint[part[far.argmin(axis=1)]]).all(axis=1)
    seen = found.camera != NO_CAMERA
    assert len(seen) > 5000
    assert seen.mean() > 0.98
    assert right.mean() > 0.93


def rays(camera):
    """Return (pixel, 3) unit lines of sight before a camera, its radial lens undone."""
    v, u = np.mgrid[: camera["rows"], : camera["columns"]].astype(float)
    inner = camera["intrinsic"]
    b = (v - inner[1, 2]) / inner[1, 1]
    a = (u - inner[0, 2] - inner[0, 1] * b) / inner[0, 0]
    x, y = a.copy(), b.copy()
    for _ in range(50):
        f = 1 + camera["distortion"][0] * (x * x + y * y)
        x, y = a / f, b / f
    ray = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    return ray / np.linalg.norm(ray, axis=1, keepdims=True)


def test_a_wall_hides_what_is_behind_it_from_the_camera_before_it():
    occupied = np.zeros(SHAPE, bool)
    occupied[2, 1:14, 1:10] = True
    occupied[8:10, 6:9, 4:7] = True
    cameras = [camera_at([-2.5, 0.55, 0.01], [0, 0.55, 0.01], distortion=[0.0])]
    images = np.full((1, 33, 41, 3), 90, np.uint8)
    everywhere = np.ones((1, 33, 41), bool)
    found = color_surface(
        encode_runs(occupied[None]),
        VoxelGrid(*GRID),
        images,
        everywhere,
        projection_of(cameras),
        ColoringSettings(),
    )
    wall = found.index[:, 0] == 2
    assert (found.camera[wall] == 0).mean() > 0.9
    assert (found.camera[~wall] == NO_CAMERA).all()
    assert (found.color == 90).all()


def test_what_no_camera_sees_at_all_is_black_and_marked(rng):
    cameras = ring(3, distortion=[0.0])
    for occupied in (figure(rng), np.zeros(SHAPE, bool)):
        found = color_surface(
            encode_runs(occupied[None]),
            VoxelGrid(*GRID),
            shades(rng, 3),
            np.zeros((3, 33, 41), bool),
            projection_of(cameras),
            ColoringSettings(),
        )
        assert len(found.color) == naive.surface(occupied).sum()
        assert not found.color.any()
        assert (found.camera == NO_CAMERA).all()


@pytest.mark.parametrize("distortion", [(), (-0.2, 0.05, 0.003, -0.002)], ids=["none", "bent"])
def test_the_nearest_pixel_is_that_of_the_projected_point(rng, distortion):
    projection = projection_of(ring(5, distortion=distortion))
    points = rng.normal(0, 1.5, (211, 3))  # before the cameras, beside their images, behind them
    filmed, depth = project_points(points, projection)
    wanted = np.floor(np.nan_to_num(filmed, nan=-1.0) + 0.5)[..., ::-1]
    np.testing.assert_array_equal(nearest_pixels(points, projection), wanted)
    assert 0.1 < np.isnan(filmed).mean() < 0.9
    assert (depth < 0).any()


def test_cameras_stand_where_their_poses_say():
    cameras = ring(4, distortion=[0.0])
    for center, camera in zip(camera_centers(projection_of(cameras)), cameras, strict=True):
        place = camera["pose"] @ np.append(center, 1.0)
        np.testing.assert_allclose(place, 0, atol=1e-12)


def test_what_does_not_fit_together_is_refused_with_every_fault():
    hull = encode_runs(np.zeros((2, *SHAPE), bool))
    projection = projection_of(ring(3, distortion=[0.0]))
    message = (
        r"cannot be colored: the hull has 2 frames .* wanted is one on \(13, 15, 11\); images "
        r"are float64 .* \(3, 33 or more, 41 or more, 3\) uint8; silhouettes are bool of shape "
        r"\(2, 33, 41\), wanted is \(3, 33 or more, 41 or more\) bool"
    )
    with pytest.raises(ValueError, match=message):
        color_surface(
            hull,
            VoxelGrid(*GRID),
            np.zeros((3, 33, 41, 3)),
            np.zeros((2, 33, 41), bool),
            projection,
            ColoringSettings(),
        )
    many = Projection(
        np.repeat(projection.camera_from_world, 85, axis=0),
        np.repeat(projection.intrinsics, 85, axis=0),
        np.repeat(projection.distortion, 85, axis=0),
        np.repeat(projection.image_size, 85, axis=0),
    )
    with pytest.raises(ValueError, match="there are 255 cameras, wanted are fewer than 255"):
        color_surface(
            encode_runs(np.zeros((1, *SHAPE), bool)),
            VoxelGrid(*GRID),
            np.zeros((255, 33, 41, 3), np.uint8),
            np.zeros((255, 33, 41), bool),
            many,
            ColoringSettings(),
        )
    with pytest.raises(ValueError, match="lift_voxels is nan, it must be a number 0 or more"):
        ColoringSettings(float("nan"))
