"""Four real cameras whose makers give their values and the corners of a board on the floor."""

import re

import cv2
import numpy as np
import pytest

from storage.formats.pictures.video import open_video, read_frames
from tasks.calibration.adjustment import adjust_rig
from tasks.calibration.boards import Board, find_checkers_slowly, find_corners
from tasks.calibration.finding import Sighting
from tasks.calibration.floors import camera_centers, floor_on
from tasks.calibration.rigs import Rig, View, pose_of, solve_poses, vector_of, view_rms_px
from tasks.calibration.solving import calibrate_views

pytestmark = pytest.mark.data

BOARD = Board(8, 6, 0.115)
SIZE = (644, 486)


@pytest.fixture
def makers(shared_data):
    """Lenses, poses in the world of the board on the floor (x, y up, z), corners, films."""
    lenses, poses, corners, films = [], [], [], []
    for folder in sorted((shared_data / "rigs" / "bini").glob("cam?")):
        text = (folder / "boardcorners.xml").read_text()
        found = re.findall(r"<Corner_\d+>\s*([^<]+)</", text)
        corners.append(np.array([[float(word) for word in each.split()] for each in found]))
        file = cv2.FileStorage(str(folder / "config.xml"), cv2.FILE_STORAGE_READ)
        matrix, bent, turn, shift = (
            file.getNode(name).mat().astype(float)
            for name in ("CameraMatrix", "DistortionCoeffs", "RotationValues", "TranslationValues")
        )
        lenses.append([*np.diag(matrix)[:2], *matrix[:2, 2], *bent.ravel()])
        pose = pose_of(np.concatenate([turn.ravel(), shift.ravel() / 1000]))
        # theirs: x down the rows, y along a row, z up, from the first corner
        theirs_from_board = np.diag([0.0, 0, -1, 1])
        theirs_from_board[[0, 1], [1, 0]] = 1
        poses.append(pose @ theirs_from_board)
        films.append(folder / "checkerboard.avi")
    return np.array(lenses), np.array(poses), corners, films


def adjusted(lenses, corners, **how):
    """The rig of one board on the floor, in its world."""
    views = [View(n, 0, np.arange(48), each) for n, each in enumerate(corners)]
    seen = [solve_poses(view, lenses[n], BOARD, within=1.0)[0] for n, view in enumerate(views)]
    start = Rig(lenses, np.array(seen), {0: np.eye(4)})
    found = adjust_rig(start, views, BOARD, [SIZE] * 4, still=0, **how)
    return floor_on(found.rig, BOARD, 0), view_rms_px(found.rig, views, BOARD), found.focal_error


def apart(rig, poses):
    """(camera, 2) how far places [mm] and directions [degrees] are from the makers'."""
    theirs = floor_on(Rig(rig.lenses, poses, {0: np.eye(4)}), BOARD, 0)
    places = np.linalg.norm(camera_centers(rig) - camera_centers(theirs), axis=1)
    turns = [
        np.linalg.norm(vector_of(mine @ np.linalg.inv(other))[:3])
        for mine, other in zip(rig.camera_from_world, theirs.camera_from_world, strict=True)
    ]
    return np.column_stack([1000 * places, np.degrees(turns)])


def test_with_the_makers_lenses_cameras_are_where_the_makers_put_them(makers):
    lenses, poses, corners, _ = makers
    rig, rms, _ = adjusted(lenses, corners, lenses_stay=True)
    assert rms.max() < 0.7  # their corners are whole pixels
    assert apart(rig, poses)[:, 0].max() < 12
    assert apart(rig, poses)[:, 1].max() < 0.2


def test_one_board_gives_lenses_roughly_and_says_so(makers):
    lenses, _, corners, _ = makers
    guessed = lenses.copy()
    guessed[:, :2] *= 1.1
    guessed[:, 4:] = 0
    rig, _rms, error = adjusted(guessed, corners)
    off = abs(rig.lenses[:, 0] / lenses[:, 0] - 1)
    assert (off < 3 * error).all()
    assert error.min() > 0.01


def test_the_corners_are_those_of_the_makers_where_squares_are_large_enough(makers):
    _, _, corners, films = makers
    off = {}
    for n in (1, 2):
        gray = cv2.cvtColor(read_frames(open_video(films[n]), 0, 1)[0], cv2.COLOR_RGB2GRAY)
        _, found = find_corners(gray, BOARD) or find_checkers_slowly(gray, BOARD)
        orders = [turn[::step] for turn in BOARD.turns() for step in (1, -1)]
        off[n] = min(np.sqrt(((found[t] - corners[n]) ** 2).sum(axis=1).mean()) for t in orders)
    assert max(off.values()) < 1.3


def test_a_board_on_the_floor_alone_is_refused_with_what_to_do(makers):
    _lenses, _, corners, _ = makers
    sightings = [
        Sighting(SIZE, [View(n, 0, np.arange(48), each)], 1, np.zeros(SIZE[::-1], np.uint8))
        for n, each in enumerate(corners)
    ]
    found = calibrate_views(("cam1", "cam2", "cam3", "cam4"), sightings, BOARD, on_floor=0)
    assert found.cameras == []
    assert any(
        "share 1 moment, from which it cannot be told on which side" in f for f in found.faults
    )
