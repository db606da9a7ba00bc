"""Cameras that were turned and moved come back, compared with where they were when they filmed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tasks.capture.refining import refine_cameras
from tasks.capture.tangency import find_outline
from tasks.geometry.projection import Projection, camera_centers
from tests.figures.balls import CAMERA, CAMERAS, draw

pytestmark = pytest.mark.compiled  # silhouettes of sixteen moments are drawn and compared


@pytest.fixture(scope="module")
def packed():
    return draw([np.linspace(0, 100, 16)] * CAMERAS)


def shaken(turned_deg, moved_m):
    """The cameras, each turned (camera, 3) and moved (camera, 3)."""
    pose = CAMERA.camera_from_world.copy()
    for each, center, turn, shift in zip(
        pose, camera_centers(CAMERA), turned_deg, moved_m, strict=True
    ):
        each[:, :3] = Rotation.from_rotvec(turn, degrees=True).as_matrix() @ each[:, :3]
        each[:, 3] = -each[:, :3] @ (center + shift)
    return Projection(pose, CAMERA.intrinsics, CAMERA.distortion, CAMERA.image_size)


def refine(packed, projection):
    return refine_cameras(
        [find_outline(packed[:, c], projection, c) for c in range(CAMERAS)], projection
    )


def farthest_off(projection):
    """The largest error of a camera's place [m] and direction [degrees], whatever the world's."""
    ours, true = camera_centers(projection), camera_centers(CAMERA)
    a, b = ours - ours.mean(axis=0), true - true.mean(axis=0)
    turn, _ = Rotation.align_vectors(b, a)
    size = np.sqrt((b**2).sum() / (a**2).sum())
    away = np.linalg.norm(size * turn.apply(a) - b, axis=1).max()
    axes = turn.apply(projection.camera_from_world[:, 2, :3].copy())
    cosine = (axes * CAMERA.camera_from_world[:, 2, :3]).sum(axis=1)
    return away, np.degrees(np.arccos(cosine.clip(-1, 1))).max()


def test_one_camera_that_was_turned_is_the_one_that_is_turned_back(packed):
    turned = np.zeros((CAMERAS, 3))
    turned[2] = (0.5, 1.5, 0.0)
    found = refine(packed, shaken(turned, np.zeros((CAMERAS, 3))))
    assert found.before_px.argmax() == found.turned_deg.argmax() == 2
    assert found.before_px[2] > 1.0
    assert found.after_px.max() < 0.4
    assert farthest_off(found.projection)[1] < 0.5


def test_all_cameras_that_were_shaken_come_back(packed):
    rng = np.random.default_rng(4)
    off = shaken(rng.normal(0, 0.7, (CAMERAS, 3)), rng.normal(0, 0.02, (CAMERAS, 3)))
    found = refine(packed, off)
    away, turned = farthest_off(found.projection)
    assert found.before_px.min() > 4 * found.after_px.max()
    assert (away, turned) < (0.04, 0.6)
    assert turned < 0.4 * farthest_off(off)[1]


def test_cameras_that_stand_where_they_should_are_left_nearly_there(packed):
    found = refine(packed, CAMERA)
    assert found.before_px.max() < 0.3
    assert found.moved_m.max() < 0.05
    assert found.turned_deg.max() < 0.5


@pytest.mark.parametrize("what", ["one moment", "a camera sees nobody"])
def test_too_little_tells_nothing(packed, what):
    seen = packed[:1].copy() if what == "one moment" else packed.copy()
    if what != "one moment":
        seen[:, 3] = 0
    assert refine(seen, CAMERA) is None
