"""The share of a volume that a camera sees is that which OpenCV films."""

import cv2
import numpy as np
import pytest

from storage.formats.calibration.camera import scale_world
from storage.formats.capture.camera_views import share_seen
from storage.formats.capture.capture_toml import Volume
from tests.figures.calibration_files import looking_at, rig


def test_the_share_seen_is_that_of_points_that_opencv_films_in_the_image():
    volume = Volume((0.1, 1.0, -0.2), (4.0, 2.0, 4.4), 0.02)
    steps = np.linspace(-0.5, 0.5, 41)
    grid = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)
    points = grid * volume.size_m + volume.center_m
    for camera in rig((-0.05, 0, 0, 0)):
        seen = points @ camera.rotation.T + camera.translation
        points_ahead = points[(seen[:, 2] > 0) & (abs(seen[:, :2]) < 1.5 * seen[:, 2:]).all(1)]
        pixel, _ = cv2.projectPoints(
            points_ahead, cv2.Rodrigues(camera.rotation)[0], camera.translation,
            camera.intrinsics, camera.distortion,
        )  # fmt: skip
        column, row = pixel[:, 0].T
        inside = (column > -0.5) & (column < 639.5) & (row > -0.5) & (row < 479.5)
        expected = inside.sum() / len(points)
        assert 0.2 < expected < 0.9
        assert share_seen(camera, volume) == pytest.approx(expected, abs=0.05)


def test_points_that_a_lens_folds_into_the_image_are_not_seen():
    camera = looking_at("a", (0.0, 1.0, 0.0), (0.0, 1.0, -5.0), distortion=(-0.08, 0, 0, 0))
    # 3.5 times as far aside as ahead: OpenCV films it near the middle
    beside = Volume((3.5, 1.0, -1.0), (0.05, 0.05, 0.05), 0.01)
    folded, _ = cv2.projectPoints(
        np.array([[3.5, 1.0, -1.0]]), cv2.Rodrigues(camera.rotation)[0], camera.translation,
        camera.intrinsics, camera.distortion,
    )  # fmt: skip
    assert (folded > 0).all()
    assert (folded[0, 0] < [640, 480]).all()
    assert share_seen(camera, beside) == 0.0


def test_a_volume_behind_the_camera_is_not_seen():
    camera = looking_at("a", (0.0, 1.0, 5.0), (0.0, 1.0, 9.0))
    assert share_seen(camera, Volume((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), 0.01)) == 0.0
    assert scale_world(camera, 2.0).size == (640, 480)
