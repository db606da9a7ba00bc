"""Silhouettes drawn from known cameras agree, and each planted mistake is named for what it is."""

import dataclasses

import cv2
import numpy as np
import pytest

from tasks.checks import agreement
from tasks.checks.agreement import AgreementSettings, check_agreement
from tasks.checks.hulls.bounds import (
    fitting_box,
    grid_corners,
    is_inside,
    main_parts,
    parts_of,
)
from tasks.checks.hulls.voxel_consistency import hull_of, make_scene, measure_voxel_consistency
from tasks.geometry.projection import Projection
from tasks.geometry.voxels import volume_grid
from tests.figures.calibration_files import looking_at

ROWS, COLUMNS, FRAMES = 96, 128, 3
NAMES = [f"cam{n}" for n in range(1, 8)]
GRID = volume_grid((0.0, 1.0, 0.0), (2.4, 2.2, 2.0), 0.02)
pytestmark = pytest.mark.compiled  # the votes of a hundred hulls


def ball_body(frame):
    """Return (ball, 3) centers and (ball,) radii of a body that walks and lifts an arm."""
    sway = np.array([0.35 * frame - 0.3, 0.0, 0.2 * frame - 0.25])
    limbs = [
        ((0, 1.65, 0), (0, 1.65, 0.02), 0.12),
        ((0, 0.95, 0), (0, 1.4, 0), 0.15),
        ((0.1, 0.1, 0.1 * frame), (0.08, 0.9, 0), 0.08),
        ((-0.12, 0.1, 0.0), (-0.08, 0.9, 0), 0.08),
        ((0.1, 1.4, 0), (0.65, 1.2 + 0.15 * frame, 0.1), 0.06),
        ((-0.1, 1.4, 0), (-0.3, 0.9, 0.25), 0.06),
    ]
    share = np.linspace(0, 1, 25)[:, None]
    centers = [np.array(a) + share * (np.array(b) - np.array(a)) for a, b, _ in limbs]
    return np.concatenate(centers) + sway, np.repeat([r for *_, r in limbs], 25)


def drawn(camera, centers, radii):
    """Return the silhouette of balls, drawn with OpenCV (a ball is filmed nearly round)."""
    pixel, _ = cv2.projectPoints(
        centers, cv2.Rodrigues(camera.rotation)[0], camera.translation, camera.intrinsics, None
    )
    depth = (centers @ camera.rotation.T + camera.translation)[:, 2]
    image = np.zeros((ROWS, COLUMNS), np.uint8)
    for (u, v), size in zip(pixel[:, 0], camera.intrinsics[0, 0] * radii / depth, strict=True):
        place = (round(u * 16), round(v * 16))
        cv2.circle(image, place, round(size * 16), 1, -1, cv2.LINE_8, 4)
    return image.astype(bool)


def small_camera(name, place):
    camera = looking_at(name, place, (0.0, 1.0, 0.0))
    object.__setattr__(camera, "size", (COLUMNS, ROWS))
    inner = [[110.0, 0, (COLUMNS - 1) / 2], [0, 110.0, (ROWS - 1) / 2], [0, 0, 1]]
    object.__setattr__(camera, "intrinsics", np.array(inner))
    return camera


def projection_of(cameras, turned=None, degrees=0.0):
    poses = np.stack([np.column_stack([c.rotation, c.translation]) for c in cameras])
    if turned is not None:
        poses[turned] = cv2.Rodrigues(np.radians([0.0, degrees, 0.0]))[0] @ poses[turned]
    size = np.full((len(cameras), 2), (COLUMNS, ROWS))
    inner = np.stack([c.intrinsics for c in cameras])
    return Projection(poses, inner, np.zeros((len(cameras), 0)), size)


@pytest.fixture(scope="module")
def cameras():
    angle = np.arange(len(NAMES)) * 2 * np.pi / len(NAMES)
    height = (1.2, 2.6, 1.9, 1.2, 2.4, 2.8, 1.5)
    places = np.stack([3.4 * np.sin(angle), height, 3.4 * np.cos(angle)], axis=1)
    return [small_camera(name, place) for name, place in zip(NAMES, places, strict=True)]


@pytest.fixture(scope="module")
def silhouettes(cameras):
    return np.stack([[drawn(c, *ball_body(t)) for c in cameras] for t in range(FRAMES)])


def test_what_was_filmed_together_agrees(cameras, silhouettes):
    before = silhouettes.copy()
    found = check_agreement(silhouettes, projection_of(cameras), GRID, NAMES)
    assert (found.faults, found.notes, found.empty) == ((), (), ())
    assert found.explained.min() > 0.95
    assert found.overlap.min() > 0.6
    np.testing.assert_allclose(found.silhouette, silhouettes.mean(axis=(0, 2, 3)))
    np.testing.assert_array_equal(silhouettes, before)


@pytest.mark.parametrize("pair", [(0, 3), (1, 2), (4, 6)])
def test_two_exchanged_films_are_both_named(cameras, silhouettes, pair):
    order = np.arange(len(NAMES))
    order[list(pair)] = pair[::-1]
    found = check_agreement(silhouettes[:, order], projection_of(cameras), GRID, NAMES)
    assert len(found.faults) == 1
    first, second = (NAMES[c] for c in pair)
    assert f"films of camera '{first}' and '{second}' are exchanged" in found.faults[0]


def test_a_camera_that_was_turned_is_named(cameras, silhouettes):
    found = check_agreement(silhouettes, projection_of(cameras, 2, 6.0), GRID, NAMES)
    assert len(found.faults) == 1
    assert found.faults[0].startswith("camera 'cam3' disagrees with the others")


def test_somebody_else_in_one_picture_is_a_note(cameras, silhouettes):
    seen = silhouettes.copy()
    seen[:, 4, 40:, :14] = True
    found = check_agreement(seen, projection_of(cameras), GRID, NAMES)
    assert found.faults == ()
    assert found.notes[0].startswith("Camera 'cam5' disagrees with the others")
    assert found.explained[[0, 1, 2, 3, 5, 6]].min() > 0.95


def test_films_that_belong_to_no_camera_are_said_to_be_mixed_up(cameras, silhouettes):
    rolled = np.roll(silhouettes, 2, axis=1)
    found = check_agreement(rolled, projection_of(cameras), GRID, NAMES)
    assert len(found.faults) == 1
    assert "films and calibrations of several cameras are mixed up" in found.faults[0]


def test_a_calibration_that_is_off_everywhere_is_a_note(cameras, silhouettes):
    rng = np.random.default_rng(3)
    poses = projection_of(cameras).camera_from_world.copy()
    for pose in poses:
        pose[:] = cv2.Rodrigues(rng.normal(0, 1.0 / 110, 3))[0] @ pose
    good = projection_of(cameras)
    bad = Projection(poses, good.intrinsics, good.distortion, good.image_size)
    found = check_agreement(silhouettes, bad, GRID, NAMES)
    assert found.faults == ()
    assert len(found.notes) == 1
    assert 0.6 < found.explained.min() < 0.85


@pytest.mark.parametrize(("value", "said"), [
    (False, "camera 'cam2' sees nobody in any of the 3 frames"),
    (True, "silhouette of camera 'cam2' is 100% of its picture"),
])  # fmt: skip
def test_a_camera_of_no_use_is_named_and_the_others_judged(cameras, silhouettes, value, said):
    seen = silhouettes.copy()
    seen[:, 1] = value
    found = check_agreement(seen, projection_of(cameras), GRID, NAMES)
    assert len(found.faults) == 1
    assert said in found.faults[0]
    assert np.isnan(found.explained[1])
    assert np.nanmin(found.explained) > 0.95


def test_a_camera_that_looks_elsewhere_may_see_nobody(cameras, silhouettes):
    seen = silhouettes.copy()
    seen[:, 1] = False
    found = check_agreement(seen, projection_of(cameras, 1, 60.0), GRID, NAMES)
    assert found.faults == ()
    assert "the performer is beside its picture" in found.notes[0]


def test_too_few_cameras_that_see_somebody_are_refused(cameras, silhouettes):
    seen = silhouettes.copy()
    seen[:, 2:] = False
    found = check_agreement(seen, projection_of(cameras), GRID, NAMES)
    assert "and 2 cameras are left, where at least 3 are wanted" in found.faults[0]
    assert found.empty == (0, 1, 2)


def test_frames_without_anybody_are_a_note(cameras, silhouettes):
    seen = silhouettes.copy()
    seen[1] = False
    found = check_agreement(seen, projection_of(cameras), GRID, NAMES)
    assert (found.faults, found.empty) == ((), (1,))
    assert found.notes == (
        "Nothing is carved in 1 of the 3 frames looked at: nobody is seen there.",
    )


@pytest.mark.parametrize("moved", [(0.0, 0.7, 0.0), (1.1, 0.0, 0.0), (6.0, 0.0, 0.0)])
def test_a_volume_beside_the_performer_is_told_where_to_be(cameras, silhouettes, moved):
    center = tuple(np.array([0.0, 1.0, 0.0]) + moved)
    grid = volume_grid(center, (2.4, 2.2, 2.0), 0.02)
    found = check_agreement(silhouettes, projection_of(cameras), grid, NAMES)
    assert len(found.faults) == 1
    numbers = found.faults[0].split("center_m = [")[1].split("]")
    told = np.array(numbers[0].split(","), float)
    size = np.array(numbers[1].split("[")[1].split(","), float)
    balls = [ball_body(t) for t in range(FRAMES)]
    low = np.min([(c - r[:, None]).min(axis=0) for c, r in balls], axis=0)
    high = np.max([(c + r[:, None]).max(axis=0) for c, r in balls], axis=0)
    assert (told - size / 2 <= low + 0.01).all()
    assert (told + size / 2 >= high - 0.01).all()
    assert (size <= high - low + 0.5).all()


def test_a_few_voxels_outside_the_volume_are_not_said(cameras, silhouettes, monkeypatch):
    """The volume ends lower and lower in the performer's head."""

    def shares():
        for rows in range(GRID.shape[1] - 40, GRID.shape[1]):
            grid = dataclasses.replace(GRID, shape=(GRID.shape[0], rows, GRID.shape[2]))
            found = check_agreement(silhouettes[:1], projection_of(cameras), grid, NAMES)
            for said in (*found.faults, *found.notes):
                if "outside the volume" in said:
                    yield float(said.split("%")[0])

    smallest = min(shares())
    assert smallest < 0.5
    monkeypatch.setattr(agreement, "_LEAST_OUTSIDE", (smallest + 0.1) / 100)
    assert min(shares()) > smallest


def test_a_giant_is_told_from_a_wrong_unit(cameras, silhouettes):
    projection = projection_of(cameras)
    poses = projection.camera_from_world * [1.0, 1.0, 1.0, 2.0]
    larger = dataclasses.replace(projection, camera_from_world=poses)
    found = check_agreement(silhouettes, larger, GRID, NAMES)
    assert "outside the volume" in found.faults[0]
    assert any("would be 3." in note and "another unit" in note for note in found.notes)
    assert not check_agreement(silhouettes, projection, GRID, NAMES).notes


def test_arrays_that_do_not_fit_are_refused(cameras, silhouettes):
    projection = projection_of(cameras)
    with pytest.raises(ValueError, match=r"\(time, 7, 96, 128\) bool is wanted"):
        check_agreement(silhouettes[:, :5], projection, GRID, NAMES)
    with pytest.raises(ValueError, match="3 frames and 6 names are given for 7 cameras"):
        check_agreement(silhouettes, projection, GRID, NAMES[:6])


def test_the_kept_voxels_give_the_hull_that_testing_each_voxel_gives(cameras, silhouettes):
    projection = projection_of(cameras)
    scene = make_scene(silhouettes[:1], projection, (0.0, 1.0, 0.0), range(len(NAMES)))
    [voxels] = measure_voxel_consistency(
        scene, np.array([-1.0, 0.0, -1.0]), np.array([1.0, 2.0, 1.0])
    )
    inside = np.ones((len(NAMES), len(voxels.points)), bool)
    for c, camera in enumerate(cameras):
        pixel, _ = cv2.projectPoints(
            voxels.points, cv2.Rodrigues(camera.rotation)[0], camera.translation,
            camera.intrinsics, None,
        )  # fmt: skip
        u, v = np.floor(pixel[:, 0] + 0.5).astype(int).T
        filmed = (u >= 0) & (u < COLUMNS) & (v >= 0) & (v < ROWS)
        inside[c, filmed] = silhouettes[0, c, v[filmed], u[filmed]]
    np.testing.assert_array_equal(hull_of(voxels, range(7), 3), inside.all(axis=0))
    chosen = [0, 2, 3, 6]
    np.testing.assert_array_equal(hull_of(voxels, chosen, 3), inside[chosen].all(axis=0))
    assert ((~inside).sum(axis=0) <= 2).all()
    edge = scene.voxel_m
    assert 0.01 < edge < 0.03
    volume = hull_of(voxels, range(7), 3).sum() * edge**3
    assert 0.05 < volume < 0.2  # a body of balls, and what the silhouettes leave around it


def test_large_silhouettes_are_reduced_with_their_cameras(cameras, silhouettes):
    large = np.kron(silhouettes, np.ones((1, 1, 4, 4), bool))
    one = projection_of(cameras)
    inner = one.intrinsics.copy()
    inner[:, :2] *= 4
    inner[:, :2, 2] += 1.5
    four = Projection(one.camera_from_world, inner, one.distortion, one.image_size * 4)
    scene = make_scene(large, four, (0.0, 1.0, 0.0), range(len(NAMES)))
    assert scene.silhouettes.shape[3] == 256
    assert scene.projection.intrinsics[0].tolist() == [[220, 0, 127.5], [0, 220, 95.5], [0, 0, 1]]
    np.testing.assert_array_equal(scene.silhouettes[:, :, ::2, ::2], silhouettes)
    found = check_agreement(large, four, GRID, NAMES)
    assert (found.faults, found.notes) == ((), ())


@pytest.mark.parametrize("spread", [4, 9, 14])
def test_voxels_less_than_three_apart_are_of_one_part(spread):
    """Each voxel against each other one, joined until nothing changes."""
    rng = np.random.default_rng(spread)
    points = np.unique(rng.integers(0, spread, (60, 3)), axis=0) * 0.02 + [1.0, -2.0, 0.3]
    joined = np.linalg.norm(points[:, None] - points, axis=2) < 3.1 * 0.02
    lowest = np.arange(len(points))
    for _ in points:
        lowest = np.array([lowest[near].min() for near in joined])
    part = parts_of(points, 0.02)
    np.testing.assert_array_equal(part[:, None] == part, lowest[:, None] == lowest)


def test_what_is_wholly_outside_the_volume_is_the_performer_only_where_it_is_the_largest_part():
    """Of three parts a body reaches out of the volume, and another is a phantom beyond it."""
    block = np.stack(np.meshgrid(*[np.arange(9) * 0.02] * 3), axis=-1).reshape(-1, 3)
    _, high = grid_corners(GRID)
    reaching = block + high - [0.08, 1.0, 1.0]
    phantom = block[: len(block) // 2] + high + [0.5, -1.0, -1.0]
    assert 0 < is_inside(reaching, GRID).sum() < len(reaching)
    both = np.concatenate([reaching, phantom])
    np.testing.assert_array_equal(main_parts(both, GRID, 0.02), reaching)
    both = np.concatenate([reaching[: len(reaching) // 4], phantom])
    np.testing.assert_array_equal(main_parts(both, GRID, 0.02), both)
    np.testing.assert_array_equal(main_parts(phantom, GRID, 0.02), phantom)


def test_scraps_of_a_hull_need_no_room():
    body = np.stack(np.meshgrid(*[np.arange(9) * 0.02] * 3), axis=-1).reshape(-1, 3)
    scrap = np.array([[3.0, 1.0, 0.0], [3.0, 1.02, 0.0]])
    np.testing.assert_array_equal(main_parts(np.concatenate([body, scrap]), GRID, 0.02), body)
    center, size = fitting_box(body + np.array([0.0, 0.03, 0.3]), 0.0, 0.1)
    assert center == [0.1, 0.15, 0.4]
    assert size == [0.4, 0.3, 0.4]
    for floor_m, lowest in ((-1.0, -0.1), (0.5, 0.0)):
        center, size = fitting_box(body + np.array([0.0, 0.03, 0.3]), floor_m, 0.1)
        assert center[1] - size[1] / 2 == pytest.approx(lowest)


def test_settings_decide_what_is_said(cameras, silhouettes):
    one, projection = silhouettes[2:, :4], projection_of(cameras[:4])
    strict = AgreementSettings(consistent=0.9999, mixed_up_below=1.0)
    found = check_agreement(one, projection, GRID, NAMES[:4], strict)
    assert "the hull of all cameras explains only" in found.faults[0]
    lenient = AgreementSettings(consistent=0.9999, mixed_up_below=0.0)
    found = check_agreement(one, projection, GRID, NAMES[:4], lenient)
    assert found.faults == ()
    assert "the calibration is off by some pixels" in found.notes[0]
