import threading

import numpy as np
import pytest

from tasks.geometry.projection import Projection, one_to_one_radius, project_points
from tasks.geometry.voxels import VoxelGrid, count_voxels, decode_runs, surface_voxels
from tasks.reconstruction.boxes.carving import _bend_box
from tasks.reconstruction.boxes.lens_bounds import lens_table
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tests.twins import voxels as naive

LENSES = {
    "none": [],
    "barrel": [-0.32, 0.11, 0.003, -0.004],
    "folding": [-0.45, 0.02, -0.002, 0.001],
    "pincushion": [0.35, 0.2, 0.01, 0.012, 0.1],
    "rational": [0.4, 0.1, 0.001, 0.002, 0.02, 0.9, 0.3, 0.05],
}


@pytest.fixture
def rng():
    return np.random.default_rng(73)


def look_at(position, target, roll=0.0):
    """Return (3, 4) the pose of a camera at a position that looks at a target."""
    ahead = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    right = np.cross(ahead, [0.03, 1.0, 0.01])
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    turn = [[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    rotation = np.array(turn) @ np.stack([right, down, ahead])
    return np.concatenate([rotation, -rotation @ np.reshape(position, (3, 1))], axis=1)


def random_camera(rng, grid, lens, *, inside=False, scale=1):
    """Return a camera, as the naive twin takes it, in or around the grid's box."""
    origin, voxel, shape = grid
    size = np.array(shape) * voxel
    middle = np.array(origin) + size / 2
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    far = 0.3 * size.min() if inside else rng.uniform(0.8, 2.0) * np.linalg.norm(size)
    position = middle + direction * far
    target = middle + rng.uniform(-0.25, 0.25, 3) * size
    columns, rows = scale * int(rng.integers(30, 48)), scale * int(rng.integers(21, 34))
    focal = rng.uniform(0.5, 1.1) * columns
    intrinsic = np.array(
        [
            [focal, rng.uniform(-2, 2), columns / 2 + rng.uniform(-3, 3)],
            [0, focal * rng.uniform(0.9, 1.1), rows / 2 + rng.uniform(-3, 3)],
            [0, 0, 1],
        ]
    )
    pose = look_at(position, target, rng.uniform(-0.5, 0.5))
    return {
        "pose": pose,
        "intrinsic": intrinsic,
        "distortion": LENSES[lens],
        "columns": columns,
        "rows": rows,
    }


def projection_of(cameras):
    padded = [list(c["distortion"]) + [0.0] * (8 - len(c["distortion"])) for c in cameras]
    return Projection(
        np.stack([c["pose"] for c in cameras]),
        np.stack([c["intrinsic"] for c in cameras]),
        np.array(padded),
        np.array([(c["columns"], c["rows"]) for c in cameras]),
    )


def blobs(rng, cameras, filled=0.6):
    """Return (camera, row, column) silhouettes of ellipses, some cut out of others."""
    rows = max(c["rows"] for c in cameras) + 2
    columns = max(c["columns"] for c in cameras) + 3
    v, u = np.mgrid[:rows, :columns]
    silhouettes = np.zeros((len(cameras), rows, columns), bool)
    for c, camera in enumerate(cameras):
        for k in range(5):
            middle = rng.uniform(0.2, 0.8, 2) * (camera["rows"], camera["columns"])
            reach = rng.uniform(0.1, 0.5, 2) * filled * (camera["rows"], camera["columns"])
            inside = ((v - middle[0]) / reach[0]) ** 2 + ((u - middle[1]) / reach[1]) ** 2 < 1
            silhouettes[c][inside] = k != 3
    return silhouettes


def carve(silhouettes, cameras, grid, *rule):
    """Return the dense hull of one frame."""
    runs = carve_visual_hull(
        silhouettes, projection_of(cameras), VoxelGrid(*grid), CarvingSettings(*rule)
    )
    return decode_runs(runs, 0)


GRIDS = [
    ((-0.4, 0.1, -0.6), 0.07, (13, 15, 36)),
    ((0.4, -1.2, 2.0), 0.05, (33, 5, 9)),
    ((-0.2, -0.1, -0.3), 0.1, (1, 2, 3)),
    ((-0.31, 0.02, -0.52), 0.031, (20, 37, 70)),
    ((-1.0, 0.0, -0.7), 0.0403, (41, 34, 33)),
]


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(
    "grid", [*GRIDS[:3], *(pytest.param(g, marks=pytest.mark.compiled) for g in GRIDS[3:])]
)
def test_the_hull_is_that_of_testing_every_voxel(rng, grid, lens):
    kept = 0
    for filled, rule in [(0.9, (0, 1)), (1.5, (0, 3)), (0.9, (1, 2)), (1.1, (2, 4)), (2.5, (1, 1))]:
        cameras = [
            random_camera(rng, grid, name, inside=c == 2)
            for c, name in enumerate([lens, "none", lens, "barrel", lens])
        ]
        silhouettes = blobs(rng, cameras, filled)
        fast = carve(silhouettes, cameras, grid, *rule)
        slow = naive.carve(silhouettes, cameras, grid, *rule)
        np.testing.assert_array_equal(fast, slow)
        kept += 0 < slow.sum() < slow.size
    assert kept >= 3 or slow.size < 100


@pytest.mark.compiled
def test_many_random_captures_are_carved_as_voxel_by_voxel(rng):
    lenses = list(LENSES)
    kept = 0
    for trial in range(60):
        shape = tuple(int(n) for n in rng.integers(1, 75, 3))
        voxel = rng.uniform(0.01, 0.05)
        grid = (tuple(rng.uniform(-1, 1, 3)), voxel, shape)
        count = int(rng.integers(2, 8))
        cameras = [
            random_camera(rng, grid, lenses[rng.integers(5)], inside=rng.random() < 0.2)
            for _ in range(count)
        ]
        rule = (trial % 3, int(rng.integers(1, count + 1)))
        silhouettes = blobs(rng, cameras, rng.uniform(0.6, 3.0))
        fast = carve(silhouettes, cameras, grid, *rule)
        slow = naive.carve(silhouettes, cameras, grid, *rule)
        np.testing.assert_array_equal(fast, slow)
        kept += 0 < slow.sum() < slow.size
    assert kept > 30


@pytest.mark.compiled
@pytest.mark.parametrize("lens", LENSES)
def test_bounds_hold_where_pixels_are_as_small_as_voxels(rng, lens):
    # wide views of stripes in all directions: a box's image must hold to a fraction of a pixel
    grid = ((-0.8, -0.7, -0.9), 0.02, (83, 71, 90))
    for slope in ((1, 0), (0, 1), (1, 1), (1, -1)):
        cameras = [random_camera(rng, grid, lens, scale=20) for _ in range(2)]
        for camera in cameras:
            camera["intrinsic"][:2, :2] *= 0.8
        # along the grid's axes, both sides of a box's image are as long as their bounds
        cameras[0]["pose"] = np.concatenate([np.eye(3), [[0.05], [0.03], [2.0]]], axis=1)
        rows, columns = (max(c[name] for c in cameras) for name in ("rows", "columns"))
        v, u = np.mgrid[:rows, :columns]
        width = rng.integers(20, 60)
        silhouettes = np.stack([(slope[0] * u + slope[1] * v) % width < width / 2] * 2)
        fast = carve(silhouettes, cameras, grid, 0, 1)
        slow = naive.carve(silhouettes, cameras, grid, 0, 1)
        np.testing.assert_array_equal(fast, slow)
        assert 0 < slow.sum() < slow.size


@pytest.mark.parametrize("lens", list(LENSES)[1:])
def test_a_bent_box_lies_within_its_bounds_and_nearly_fills_small_ones(rng, lens):
    cameras = ring(2, lens=lens)
    axes = tuple(np.array([-1.0, 1.0]) for _ in range(3))
    table = lens_table(projection_of(cameras), axes)
    edge, bend = table[1, 7, :2]
    k1, k2, p1, p2, k3, k4, k5, k6 = (*LENSES[lens], *[0.0] * (8 - len(LENSES[lens])))
    corners = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)])
    steps = np.concatenate([corners, rng.uniform(-1, 1, (40, 2))])
    filled = []
    for _ in range(200):
        middle, half = rng.uniform(-0.6, 0.6, 2) * edge, rng.uniform(0, 0.1, 2) * edge
        half *= 0.01 if len(filled) % 2 else 1.0
        a, b = (middle + steps * half).T
        s = a * a + b * b
        f = (1 + k1 * s + k2 * s**2 + k3 * s**3) / (1 + k4 * s + k5 * s**2 + k6 * s**3)
        u = a * f + 2 * p1 * a * b + p2 * (s + 2 * a * a)
        v = b * f + p1 * (s + 2 * b * b) + 2 * p2 * a * b
        place, reach = _bend_box(table, 1, tuple(middle), tuple(half), bend)
        found = abs(np.stack([u - place[0], v - place[1]])).max(axis=1)
        assert (found <= np.multiply(reach, 1 + 1e-9)).all()
        filled.append((found / reach).min())
    assert min(filled[1::2]) > 0.85


def test_places_on_the_border_of_pixels_and_depth_zero_are_those_of_the_definition():
    # whole centimeters before cameras with whole focal lengths: many exact halves
    grid = ((-0.25, -0.25, -0.5), 0.25, (5, 7, 9))
    pose = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    back = np.concatenate([np.diag([-1.0, 1.0, -1.0]), [[0], [0], [0.5]]], axis=1)
    intrinsic = np.array([[4.0, 0, 3.5], [0, 4.0, 2.5], [0, 0, 1]])
    cameras = [
        {"pose": p, "intrinsic": intrinsic, "distortion": [], "columns": 8, "rows": 6}
        for p in (pose, back)
    ]
    silhouettes = np.indices((2, 6, 8)).sum(axis=0) % 3 > 0
    for rule in [(0, 1), (1, 1), (0, 2)]:
        slow = naive.carve(silhouettes, cameras, grid, *rule)
        np.testing.assert_array_equal(carve(silhouettes, cameras, grid, *rule), slow)
        assert slow.any()


def ring(count, *, lens="barrel", target=(0.0, 0.0, 0.0), distance=3.0):
    """Return cameras around a target that all see a meter around it."""
    cameras = []
    for c in range(count):
        angle = 2 * np.pi * (c + 0.3) / count
        offset = [distance * np.cos(angle), 0.8 * (c % 2), distance * np.sin(angle)]
        intrinsic = np.array([[75.0, 0.4, 31.0], [0, 74.0, 24.0], [0, 0, 1]])
        cameras.append(
            {
                "pose": look_at(np.add(target, offset), target),
                "intrinsic": intrinsic,
                "distortion": LENSES[lens],
                "columns": 63,
                "rows": 51,
            }
        )
    return cameras


def film(points, cameras):
    """Return silhouettes of a dense set of points: the pixels of each, and around them."""
    silhouettes = np.zeros((len(cameras), 51, 63), bool)
    for c, camera in enumerate(cameras):
        u, v, _, seen = naive.project(points, camera)
        assert seen.all()
        silhouettes[c, np.floor(v + 0.5).astype(int), np.floor(u + 0.5).astype(int)] = True
    return silhouettes


def test_a_filmed_ball_and_a_filmed_box_lie_within_their_hulls():
    grid = ((-0.6, -0.6, -0.6), 0.05, (25, 24, 23))
    index = np.indices(grid[2]).reshape(3, -1).T
    points = np.array(grid[0]) + index * grid[1]
    cameras = ring(6)
    for inside in (
        np.linalg.norm(points - [0.05, 0.02, -0.1], axis=1) < 0.34,
        (abs(points - [0.1, 0.0, 0.05]) < [0.31, 0.22, 0.13]).all(axis=1),
    ):
        hull = carve(film(points[inside], cameras), cameras, grid, 0, 6).ravel()
        assert hull[inside].all()
        assert inside.sum() < hull.sum() < 2.0 * inside.sum()


def test_one_more_camera_never_adds_a_voxel_where_enough_cameras_saw_it_before(rng):
    # with min_cameras = 1 and no misses allowed, a voxel that no camera saw before may appear
    grid = GRIDS[0]
    cameras = [random_camera(rng, grid, "barrel", inside=c == 1) for c in range(6)]
    silhouettes = blobs(rng, cameras, 2.0)
    index = np.indices(grid[2]).reshape(3, -1).T
    points = np.array(grid[0]) + index * grid[1]
    seen = np.array([naive.project(points, camera)[3] for camera in cameras])
    removed = 0
    for misses in (0, 1):
        for count in (3, 4, 5):
            before = carve(silhouettes[:count], cameras[:count], grid, misses, 2)
            after = carve(silhouettes[: count + 1], cameras[: count + 1], grid, misses, 2)
            enough = (seen[:count].sum(axis=0) >= 2).reshape(grid[2])
            assert not (after & ~before & enough).any()
            removed += (before & ~after).sum()
    assert removed > 100


@pytest.mark.compiled
def test_more_misses_and_fewer_needed_cameras_never_remove_a_voxel(rng):
    grid = GRIDS[0]
    cameras = [random_camera(rng, grid, "barrel") for _ in range(5)]
    silhouettes = blobs(rng, cameras, 1.5)
    hulls = {(m, n): carve(silhouettes, cameras, grid, m, n) for m in range(3) for n in range(1, 6)}
    for m in range(3):
        for n in range(1, 6):
            for looser in [(m + 1, n), (m, n - 1)]:
                if looser in hulls:
                    assert not (hulls[m, n] & ~hulls[looser]).any()
    assert len({hull.sum() for hull in hulls.values()}) > 5


def test_moving_the_grid_and_the_cameras_together_changes_nothing():
    # by binary fractions, so that no number is rounded
    shift = np.array([2.0, -4.0, 8.0])
    rotation = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    intrinsic = np.array([[33.0, 0, 20.3], [0, 33.0, 15.2], [0, 0, 1]])
    grids = [((-0.5, -0.5, -0.5), 0.0625, (17, 15, 19))]
    grids.append((tuple(np.array(grids[0][0]) + shift), *grids[0][1:]))
    hulls = []
    for k, grid in enumerate(grids):
        poses = []
        for turn in (np.eye(3), rotation, rotation @ rotation):
            t = np.array([0.125, -0.0625, 2.0])
            poses.append(np.concatenate([turn, (t - k * turn @ shift)[:, None]], axis=1))
        cameras = [
            {"pose": p, "intrinsic": intrinsic, "distortion": [-0.1], "columns": 41, "rows": 31}
            for p in poses
        ]
        silhouettes = blobs(np.random.default_rng(5), cameras, 1.6)
        hulls.append(carve(silhouettes, cameras, grid, 0, 2))
    np.testing.assert_array_equal(*hulls)
    assert 0 < hulls[0].sum() < hulls[0].size


def test_nothing_is_left_of_empty_silhouettes_and_all_of_full_ones():
    grid = ((-0.2, -0.2, -0.2), 0.05, (9, 8, 7))
    cameras = ring(4)
    empty = np.zeros((4, 51, 63), bool)
    assert not carve(empty, cameras, grid, 0, 2).any()
    assert carve(~empty, cameras, grid, 0, 2).all()
    assert carve(empty, cameras, grid, 4, 2).all()


def test_frames_carved_in_threads_are_those_carved_alone(rng):
    grid = GRIDS[0]
    cameras = [random_camera(rng, grid, "barrel") for _ in range(4)]
    projection, box = projection_of(cameras), VoxelGrid(*grid)
    frames = [blobs(rng, cameras, 1.2) for _ in range(6)]
    alone = [carve_visual_hull(f, projection, box, CarvingSettings(0, 2)) for f in frames]
    together = [None] * 6

    def work(frame):
        together[frame] = carve_visual_hull(frames[frame], projection, box, CarvingSettings(0, 2))

    threads = [threading.Thread(target=work, args=(t,)) for t in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.start, other.start)
        np.testing.assert_array_equal(one.length, other.length)
    assert all(count_voxels(one)[0] for one in alone)
    assert surface_voxels(alone[0], 0).any()


@pytest.mark.parametrize("lens", LENSES)
def test_points_are_projected_as_the_twin_projects_them(rng, lens):
    grid = GRIDS[0]
    cameras = [random_camera(rng, grid, lens, inside=c == 1) for c in range(3)]
    points = rng.normal(size=(400, 3)) * 1.5
    pixel, depth = project_points(points, projection_of(cameras))
    for c, camera in enumerate(cameras):
        u, v, d, seen = naive.project(points, camera)
        np.testing.assert_array_equal(np.isfinite(pixel[c]).all(axis=1), seen)
        np.testing.assert_array_equal(pixel[c][seen], np.stack([u, v], axis=1)[seen])
        np.testing.assert_array_equal(depth[c], d)
        assert 0 < seen.sum() < len(points)


def test_a_lens_is_one_to_one_up_to_where_its_radius_turns():
    cameras = ring(5)
    for camera, lens in zip(cameras, LENSES, strict=True):
        camera["distortion"] = LENSES[lens]
    radius = one_to_one_radius(projection_of(cameras))
    wanted = [naive.one_to_one_radius(camera["distortion"]) for camera in cameras]
    np.testing.assert_allclose(radius, wanted, rtol=1e-9)
    assert np.isinf(radius[0])
    assert radius[2] < 1.0
    assert radius[3] == 10.0


def test_silhouettes_that_do_not_fit_the_cameras_are_refused():
    cameras, grid = ring(4), VoxelGrid((0.0, 0.0, 0.0), 0.1, (2, 3, 4))
    projection = projection_of(cameras)
    settings = CarvingSettings()
    for silhouettes, message in [
        (np.zeros((4, 51, 63)), "silhouettes are float64 .* for 4 cameras"),
        (np.zeros((3, 51, 63), bool), r"of shape \(3, 51, 63\), but \(4, row, column\) bool"),
        (np.zeros((4, 50, 63), bool), "50 rows and 63 columns, .* up to 51 and 63"),
    ]:
        with pytest.raises(ValueError, match=message):
            carve_visual_hull(silhouettes, projection, grid, settings)
    with pytest.raises(ValueError, match="there are 4 cameras, but at least min_cameras 5"):
        carve_visual_hull(
            np.zeros((4, 51, 63), bool), projection, grid, CarvingSettings(min_cameras=5)
        )
    with pytest.raises(ValueError, match=r"misses_allowed is -1, .* 0 or more; min_cameras is 0, "):
        CarvingSettings(-1, 0)


def test_arrays_that_are_no_cameras_are_refused_with_every_fault():
    good = projection_of(ring(3))
    pose, inner = good.camera_from_world, good.intrinsics
    with pytest.raises(ValueError, match=r"no 3 cameras: intrinsics has .*; distortion has"):
        Projection(pose, inner[:2], good.distortion[:, None], good.image_size)
    with pytest.raises(ValueError, match=r"camera_from_world must be finite; distortion must"):
        Projection(pose * np.nan, inner, good.distortion + np.inf, good.image_size)
    with pytest.raises(ValueError, match="divide it by its last element; an image must have"):
        Projection(pose, inner * 2, good.distortion, good.image_size * 0)
