"""The lines of a camera's check lie where OpenCV films the volume's edges and the floor."""

import cv2
import numpy as np
import pytest

from storage.formats.capture.capture import read_capture
from storage.formats.capture.capture_toml import Volume
from tasks.checks.pictures import CheckSettings, draw_camera_check, draw_capture_checks
from tests.figures.calibration_files import looking_at

VOLUME = Volume((0.1, 1.0, -0.2), (1.6, 2.0, 1.2), 0.01)
GRAY = np.full((480, 640, 3), 128, np.uint8)


@pytest.fixture
def camera():
    return looking_at("a", (3.5, 1.6, 0.4), distortion=(-0.2, 0.05, 0, 0))


def filmed(camera, points):
    pixel, _ = cv2.projectPoints(
        np.array(points, float), cv2.Rodrigues(camera.rotation)[0], camera.translation,
        camera.intrinsics, camera.distortion,
    )  # fmt: skip
    return np.rint(pixel[:, 0]).astype(int)


def darkest_near(picture, column, row):
    return picture[row - 2 : row + 3, column - 2 : column + 3].min(axis=(0, 1))


def test_the_edges_of_the_volume_are_drawn_where_they_are_filmed(camera):
    picture = draw_camera_check(GRAY, camera, VOLUME)
    assert picture.shape == (480, 640, 3)
    share = np.linspace(0.05, 0.95, 12)[:, None]
    low, high = np.array([-0.7, 0.0, -0.8]), np.array([0.9, 2.0, 0.4])
    drawn = 0
    for corner, other in [(low, [-0.7, 0, 0.4]), (low, [-0.7, 2, -0.8]), (high, [0.9, 2, -0.8])]:
        for column, row in filmed(camera, corner + share * (np.array(other) - corner)):
            if 3 <= column < 637 and 3 <= row < 477:
                assert darkest_near(picture, column, row).max() < 90
                drawn += 1
    assert drawn > 20
    assert abs(picture[3, 320].astype(int) - 160).max() < 3  # above it, only the paled gray


def test_the_axes_stand_on_the_floor_in_their_colors(camera):
    picture = draw_camera_check(GRAY, camera, VOLUME).astype(int)
    middle = np.array([0.1, 0.0, -0.2])
    for axis, strongest in enumerate((0, 1, 2)):
        ((column, row),) = filmed(camera, [middle + 0.3 * np.eye(3)[axis]])
        near = picture[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3)
        stands_out = near[:, strongest] - np.delete(near, strongest, axis=1).max(axis=1)
        assert stands_out.max() > 50


def test_small_backgrounds_are_enlarged_and_the_lines_with_them():
    tiny = looking_at("a", (3.5, 1.6, 0.4))
    object.__setattr__(tiny, "size", (160, 120))
    object.__setattr__(tiny, "intrinsics", np.diag([0.25, 0.25, 1.0]) @ tiny.intrinsics)
    picture = draw_camera_check(GRAY[:120, :160], tiny, VOLUME, title="a: sees 9 %")
    assert picture.shape == (480, 640, 3)
    assert picture[20, 600].min() > 240  # the title's paper
    ((column, row),) = filmed(tiny, [[-0.7, 0.9, -0.8]]) * 4
    assert darkest_near(picture, column, row).max() < 90


def test_a_camera_that_looks_away_gets_a_picture_without_lines():
    away = looking_at("a", (3.5, 1.6, 0.4), (9.0, 1.6, 0.4))
    picture = draw_camera_check(GRAY, away, VOLUME, settings=CheckSettings(pale=0.0))
    assert abs(picture.astype(int) - 128).max() <= 1


def test_a_camera_within_the_volume_draws_what_lies_ahead():
    inside = looking_at("a", (0.1, 1.0, 0.1), (0.1, 0.5, -0.2))
    picture = draw_camera_check(GRAY, inside, VOLUME)
    assert (abs(picture.astype(int) - 160).max(axis=-1) > 20).mean() > 0.002


def test_a_background_of_another_size_is_refused(camera):
    with pytest.raises(ValueError, match=r"shape \(480, 600, 3\), but camera 'a' films uint8 of"):
        draw_camera_check(GRAY[:, :600], camera, VOLUME)


@pytest.mark.data
def test_every_camera_of_a_capture_gets_its_picture(shared_data):
    capture = read_capture(shared_data / "captures" / "kimono")
    pictures = draw_capture_checks(capture)
    assert list(pictures) == [f"cam{number}" for number in range(1, 9)]
    assert all(picture.shape == (480, 640, 3) for picture in pictures.values())
