"""What pixels look along, against a twin that undoes the lens by another method."""

import cv2
import numpy as np
import pytest

from tasks.geometry.projection import Projection, viewing_rays
from tests.twins.lens import viewing_ray

LENSES = [[0.0] * 5, [-0.1, 0.02, 0.001, -0.002, 0.0], [-0.21, 0.06, 0.003, -0.002, 0.01]]


@pytest.fixture
def projection():
    """Three cameras, each turned in its own way and with another lens."""
    rng = np.random.default_rng(8)
    turns = [cv2.Rodrigues(rng.normal(0, 1, 3))[0] for _ in range(3)]
    pose = np.stack([np.column_stack([turn, rng.normal([0, 0, 9], 1)]) for turn in turns])
    inner = np.array([[610.0, 0, 333.0], [0, 590.0, 229.0], [0, 0, 1]])
    size = np.array([[640, 480]] * 3)
    return Projection(pose, np.array([inner] * 3), np.array(LENSES), size)


@pytest.mark.parametrize("camera", range(3))
def test_rays_are_those_of_a_twin_as_long_as_one_metre_before_the_camera(projection, camera):
    pixel = np.array([[333, 229], [0, 0], [639, 12], [100, 479], [500, 300]])
    ray = viewing_rays(pixel, projection, camera)
    pose = projection.camera_from_world[camera, :, :3]
    own = projection.intrinsics[camera], projection.distortion[camera]
    twin = viewing_ray(pixel.astype(float), *own, pose)
    length = np.linalg.norm(ray, axis=1, keepdims=True)
    np.testing.assert_allclose(ray / length, twin, atol=1e-5)  # less than 0.01 px
    np.testing.assert_allclose(ray @ pose[2], 1.0, atol=1e-12)


def test_of_no_pixel_there_is_no_ray(projection):
    assert viewing_rays(np.zeros((0, 2), np.int32), projection, 1).shape == (0, 3)
