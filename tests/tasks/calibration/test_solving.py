"""Cameras from corners whose truth is known: right where they can be, refused where they cannot."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from storage.formats.calibration.camera import Camera
from tasks.calibration.adjustment import adjust_rig
from tasks.calibration.boards import Board, turn_of
from tasks.calibration.finding import Sighting
from tasks.calibration.rigs import Rig, View, pose_of, residuals, vector_of
from tasks.calibration.solving import calibrate_views
from tests.figures.board_pictures import board_poses, camera_from_world, lying, pixels, ring

BOARD = Board(6, 5, 0.1)
HALF_TURN = Board(6, 4, 0.1)
FLOOR = 99
NOISE_PX = 0.1


def sighted(cameras, poses, board, *, rng, partial=False, noise=NOISE_PX):
    """What cameras see of boards in some poses, by moment; corners called at random where that is
    all that a picture tells."""
    sightings = []
    for number, camera in enumerate(cameras):
        views = []
        for moment, pose in poses.items():
            pixel = pixels(camera, pose, board.points_m)
            turn = board.turns()[rng.integers(len(board.turns()))]
            pixel = pixel[turn] + rng.normal(0, noise, pixel.shape)
            seen = np.isfinite(pixel).all(axis=1)
            if seen.all() or (partial and seen.sum() > 8):
                views.append(View(number, moment, np.flatnonzero(seen), pixel[seen]))
        picture = np.full((camera.height, camera.width), 99, np.uint8)
        sightings.append(Sighting(camera.size, views, len(poses), picture))
    return sightings


def moments(count, board, **how):
    """Boards held up before the cameras, and one on the floor."""
    poses = board_poses(count, **how)
    for pose in poses:
        pose[:3, 3] -= pose[:3, :3] @ board.middle_m
    return {**dict(enumerate(poses)), FLOOR: lying(board)}


def in_floors_world(camera, board):
    """The camera in the world of the board on the floor: x along its rows, y up, its middle 0."""
    board_in_world = lying(board)
    world_from_floor = np.eye(4)
    x, y, z = board_in_world[:3, :3].T
    world_from_floor[:3, :3] = np.column_stack([x, -z, y])
    world_from_floor[:3, 3] = board_in_world[:3, :3] @ board.middle_m + board_in_world[:3, 3]
    return camera_from_world(camera) @ world_from_floor


def errors(found, truth, board):
    """(camera, 3): place mm, turn degrees, focal length percent; the nearer of both half turns."""
    worst = []
    for spin in (np.eye(4), np.diag([-1.0, 1.0, -1.0, 1.0])):
        rows = []
        for mine, true in zip(found, truth, strict=True):
            wanted = in_floors_world(true, board) @ spin
            place = mine.center_m - np.linalg.inv(wanted)[:3, 3]
            turn = cv2.Rodrigues(mine.rotation @ wanted[:3, :3].T)[0]
            focal = mine.intrinsics[0, 0] / true.intrinsics[0, 0] - 1
            rows.append(
                (1000 * np.linalg.norm(place), np.degrees(np.linalg.norm(turn)), 100 * focal)
            )
        worst.append(abs(np.array(rows)))
    return min(worst, key=lambda rows: rows[:, 0].max())


NAMES = ("cam1", "cam2", "cam3", "cam4")


@pytest.mark.parametrize(
    ("board", "partial"),
    [(BOARD, False), (HALF_TURN, False), (Board(6, 5, 0.1, "DICT_4X4_50"), True)],
    ids=["checkerboard", "alike after half a turn", "parts of a ChArUco board"],
)
def test_cameras_are_where_they_are(board, partial):
    rng = np.random.default_rng(4)
    cameras = ring(4, size=(640, 480), focal=560, radius=2.6)
    poses = moments(12, board, seed=2, spread=0.5, tilt=0.6)
    sightings = sighted(cameras, poses, board, rng=rng, partial=partial)
    found = calibrate_views(NAMES, sightings, board, on_floor=FLOOR)
    assert found.faults == []
    off = errors(found.cameras, cameras, board)
    assert off[:, 0].max() < 6.0
    assert off[:, 1].max() < 0.4
    assert off[:, 2].max() < 0.4
    # two coordinates, each as noisy
    assert [each.rms_px for each in found.results] == pytest.approx(
        [NOISE_PX * 2**0.5] * 4, rel=0.2
    )
    # what is said of the focal length is about how far it is off
    assert all(each.focal_error * 100 < 0.4 for each in found.results)


def test_slopes_are_those_of_small_changes():
    """The derivative that is put together of OpenCV's against differences of the errors."""
    import tasks.calibration.adjustment as module

    rng = np.random.default_rng(1)
    cameras = ring(2)
    poses = moments(3, BOARD)
    views = [v for s in sighted(cameras, poses, BOARD, rng=rng) for v in s.views]
    rig = true_rig(cameras, poses)
    layout = module._lay_out(rig, views, 0, lenses_stay=False)
    numbers = module._numbers_of(rig, layout)
    prior = module._Prior(rig.lenses, [c.size for c in cameras], [1.0, 1.1], layout)

    def off(changed):
        moved = module._rig_of(changed, layout, rig)
        return np.concatenate(
            [module._errors(moved, views, BOARD.points_m), prior.off(moved.lenses)]
        )

    blocks, rows = module._slopes(rig, views, BOARD.points_m, layout, bends=False)
    slopes = module._stacked(blocks, prior, rows, layout.size).toarray()
    for n in range(layout.size):
        step = np.zeros(layout.size)
        step[n] = 1e-6 * max(1.0, abs(numbers[n]))
        numeric = (off(numbers + step) - off(numbers - step)) / (2 * step[n])
        assert slopes[:, n] == pytest.approx(numeric, rel=1e-4, abs=1e-3 * abs(numeric).max())


def true_rig(cameras, poses):
    lenses = [
        [*np.diag(c.intrinsics)[:2], *c.intrinsics[:2, 2], *np.pad(c.distortion, (0, 1))]
        for c in cameras
    ]
    return Rig(np.array(lenses), np.array([camera_from_world(c) for c in cameras]), dict(poses))


def test_a_corner_that_is_far_off_moves_nothing():
    rng = np.random.default_rng(1)
    cameras, poses = ring(3, size=(640, 480), focal=560), moments(8, BOARD)
    sizes = [c.size for c in cameras]
    views = [v for s in sighted(cameras, poses, BOARD, rng=rng) for v in s.views]
    wrong = views[0].pixel.copy()
    wrong[3] += (40, -25)
    rig = true_rig(cameras, poses)
    good = adjust_rig(rig, views, BOARD, sizes, still=0).rig
    bad = adjust_rig(rig, [replace(views[0], pixel=wrong), *views[1:]], BOARD, sizes, still=0).rig
    assert bad.lenses[:, 0] == pytest.approx(good.lenses[:, 0], rel=2e-3)
    off = np.linalg.norm(residuals(bad, views[:1], BOARD)[0], axis=1)
    assert off.max() < 5 * NOISE_PX  # of the true corners


def test_a_turn_of_the_corners_is_a_turn_of_the_board():
    assert len(BOARD.turns()) == 1
    assert len(Board(5, 5, 1.0).turns()) == 2
    assert len(Board(4, 4, 1.0).turns()) == 4
    for board in (HALF_TURN, Board(5, 5, 0.3), Board(4, 4, 0.2)):
        for turn in board.turns():
            pose = turn_of(board, turn)
            moved = board.points_m @ pose[:3, :3].T + pose[:3, 3]
            assert moved == pytest.approx(board.points_m[turn])
            assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_poses_are_the_same_as_six_numbers():
    pose = board_poses(1)[0]
    assert pose_of(vector_of(pose)) == pytest.approx(pose)


def refused(sightings, board=BOARD, names=NAMES):
    found = calibrate_views(names, sightings, board, on_floor=None)
    assert found.cameras == []
    return found.faults


def test_a_camera_that_sees_the_board_alone_is_named():
    cameras, poses = ring(4, size=(640, 480), focal=560), moments(7, BOARD, tilt=0.6)
    sightings = sighted(cameras, poses, BOARD, rng=np.random.default_rng(0))
    apart = replace(
        sightings[2], views=[replace(v, moment=v.moment + 1000) for v in sightings[2].views]
    )
    [fault] = refused([*sightings[:2], apart, sightings[3]])
    assert (
        "'cam3' is not tied to 'cam1', 'cam2', 'cam4': no moment shows the board in both" in fault
    )
    assert "hold it where cameras of both see it" in fault


def test_two_groups_without_a_tie_are_named():
    cameras, poses = ring(4, size=(640, 480), focal=560), moments(7, BOARD, tilt=0.6)
    sightings = sighted(cameras, poses, BOARD, rng=np.random.default_rng(0))
    second = [
        replace(s, views=[replace(v, moment=v.moment + 1000) for v in s.views])
        for s in sightings[2:]
    ]
    [fault] = refused([*sightings[:2], *second])
    assert "'cam3', 'cam4' are not tied to 'cam1', 'cam2'" in fault


def test_a_camera_of_another_time_is_at_odds():
    cameras, poses = ring(4, size=(640, 480), focal=560), moments(7, BOARD, tilt=0.6)
    sightings = sighted(cameras, poses, BOARD, rng=np.random.default_rng(0))
    late = replace(
        sightings[1], views=[replace(v, moment=(v.moment + 1) % 7) for v in sightings[1].views]
    )
    [fault] = refused([sightings[0], late, *sightings[2:]])
    assert "'cam2' is at odds with 'cam1', 'cam3', 'cam4'" in fault
    assert "give offset_s in capture.toml" in fault


@pytest.mark.parametrize("board", [BOARD, Board(5, 6, 0.1)], ids=["6x5", "5x6"])
def test_mirrored_pictures_are_told(board):
    cameras, poses = ring(4, size=(640, 480), focal=560), moments(7, board, tilt=0.6)
    sightings = sighted(cameras, poses, board, rng=np.random.default_rng(0))
    order = np.arange(board.corners).reshape(board.rows, board.columns)
    # in a mirrored picture they are called so that the dark squares are the same ones
    dark = np.indices(np.add(order.shape, 1)).sum(axis=0) % 2
    mirror = order[:, ::-1] if (dark[:, ::-1] == dark).all() else order[::-1]
    mirror = mirror.ravel()
    views = [replace(v, pixel=(v.pixel * [-1, 1] + [639, 0])[mirror]) for v in sightings[3].views]
    [fault] = refused([*sightings[:3], replace(sightings[3], views=views)], board)
    assert "'cam4' and 'cam1', 'cam2', 'cam3' fit each other only where" in fault
    assert "film without mirroring" in fault


def test_one_moment_does_not_tell_sides_of_a_board_that_looks_alike_turned():
    cameras, poses = ring(2, size=(640, 480), focal=560), moments(8, HALF_TURN, tilt=0.6)
    both = sighted(cameras, poses, HALF_TURN, rng=np.random.default_rng(0))
    apart = [v if v.moment == 3 else replace(v, moment=v.moment + 1000) for v in both[1].views]
    faults = refused([both[0], replace(both[1], views=apart)], HALF_TURN, NAMES[:2])
    assert any(
        "'cam1' and 'cam2' share 1 moment, from which it cannot be told on which side" in fault
        and "odd one way and even the other" in fault
        for fault in faults
    )


def test_a_board_that_only_faces_the_camera_gives_no_focal_length():
    [camera] = ring(1, size=(640, 480), focal=560)
    ahead, place = np.diag([1.0, -1, -1]), np.array([0.0, 1.0, 3.0])
    camera = Camera("cam1", camera.size, camera.intrinsics, camera.distortion, ahead, place)
    poses = {
        n: pose_of(np.array([np.pi, 0, 0, x, 1.3, 0.0]))
        for n, x in enumerate((-0.4, -0.25, -0.1, 0))
    }
    sightings = sighted([camera], poses, BOARD, rng=np.random.default_rng(0), noise=0.3)
    [fault] = refused(sightings, names=("cam1",))
    assert "camera 'cam1': its focal length is not determined" in fault
    assert "tilted by 30 to 45 degrees" in fault


def test_a_bent_board_is_told_and_by_how_much():
    rng = np.random.default_rng(0)
    cameras, poses = ring(3, size=(640, 480), focal=560), moments(7, BOARD, tilt=0.6)
    x = BOARD.points_m[:, 0] / BOARD.middle_m[0] - 1
    bent = BOARD.points_m + np.column_stack([0 * x, 0 * x, 0.008 * x * x])
    sightings = sighted(cameras, poses, BOARD, rng=rng)
    for camera, seen in zip(cameras, sightings, strict=True):
        off = [pixels(camera, poses[v.moment], bent) - v.pixel for v in seen.views]
        seen.views[:] = [
            replace(v, pixel=v.pixel + o + rng.normal(0, NOISE_PX, o.shape))
            for v, o in zip(seen.views, off, strict=True)
            if np.isfinite(o).all()
        ]
    [fault] = refused(sightings, names=NAMES[:3])
    assert "the board is bent: it stands out of its plane by about 8 mm" in fault
    assert "stiff, flat plate" in fault


def test_without_a_floor_up_is_as_the_cameras_stand():
    cameras, poses = ring(4, size=(640, 480), focal=560), moments(8, BOARD, tilt=0.6)
    del poses[FLOOR]
    found = calibrate_views(
        NAMES, sighted(cameras, poses, BOARD, rng=np.random.default_rng(3)), BOARD
    )
    assert found.faults == []
    heights = [c.center_m[1] for c in cameras]
    assert np.diff([c.center_m[1] for c in found.cameras]) == pytest.approx(
        np.diff(heights), abs=0.03
    )
    assert "Nothing says where the floor is and which way is up" in found.guessed
    assert "--floor-frame CAMERA:FRAME" in found.guessed
