"""Projection, its inverse and the camera value, against OpenCV and against laws."""

import cv2
import numpy as np
import pytest

from storage.formats.calibration.camera import (
    Y_UP_FROM,
    Camera,
    nearest_rotation,
    rotation_from_vector,
    scale_world,
    turn_y_up,
    vector_from_rotation,
)
from tests.twins.lens import (
    bend,
    camera_center,
    image_from_world,
    project,
    undistort,
    viewing_ray,
    widest_radius,
)

MATRIX = np.array([[610.0, 0, 333.0], [0, 590.0, 229.0], [0, 0, 1]])
LENSES = {
    "none": [],
    "four": [-0.21, 0.06, 0.003, -0.002],
    "five": [-0.21, 0.06, 0.003, -0.002, 0.01],
    "folding": [-0.08, 0, 0, 0],
    "eight": [-0.3, 0.2, 0.002, 0.001, -0.05, -0.1, 0.15, 0.02],
}


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def a_pose(rng):
    return cv2.Rodrigues(rng.normal(0, 1, 3))[0], rng.normal([0, 0, 9], 1)


def a_camera(rng, **changes):
    rotation, translation = a_pose(rng)
    given = {"name": "c", "size": (640, 480), "intrinsics": MATRIX, "distortion": LENSES["five"],
             "rotation": rotation, "translation": translation} | changes  # fmt: skip
    return Camera(**given)


@pytest.mark.parametrize("lens", LENSES)
def test_projection_agrees_with_opencv(rng, lens):
    distortion = np.array(LENSES[lens])
    rotation, translation = a_pose(rng)
    points = rng.uniform(-2, 2, (7, 11, 3))
    pixel, depth = project(points, MATRIX, distortion, rotation, translation)
    expected, _ = cv2.projectPoints(
        points.reshape(-1, 3), cv2.Rodrigues(rotation)[0], translation, MATRIX,
        distortion if lens != "none" else None,
    )  # fmt: skip
    assert np.isfinite(pixel).all()
    np.testing.assert_allclose(pixel.reshape(-1, 2), expected[:, 0], atol=1e-6)
    np.testing.assert_allclose(depth, points @ rotation[2] + translation[2], atol=1e-12)


def test_projection_without_distortion_is_the_matrix(rng):
    matrix = MATRIX.copy()
    matrix[0, 1] = 7.0  # skew, which OpenCV leaves out
    rotation, translation = a_pose(rng)
    points = rng.uniform(-2, 2, (13, 3))
    pixel, _ = project(points, matrix, np.zeros(0), rotation, translation)
    whole = image_from_world(matrix, rotation, translation) @ np.c_[points, np.ones(13)].T
    np.testing.assert_allclose(pixel, (whole[:2] / whole[2]).T, atol=1e-9)


def test_points_behind_the_camera_are_not_filmed():
    points = np.array([[0.1, 0, -3.0], [0.1, 0, 0.0], [0.1, 0, 3.0]])
    pixel, depth = project(points, MATRIX, np.array(LENSES["four"]), np.eye(3), np.zeros(3))
    assert np.isnan(pixel[:2]).all()
    assert np.isfinite(pixel[2]).all()
    np.testing.assert_array_equal(depth, [-3.0, 0.0, 3.0])


def test_points_beyond_the_fold_of_a_lens_are_not_filmed():
    distortion = np.array([-0.08, 0, 0, 0])
    widest = widest_radius(distortion)
    assert widest == pytest.approx(np.sqrt(1 / 0.24))  # where r - 0.08 r^3 is largest
    points = np.array([[0.99 * widest, 0, 1.0], [1.01 * widest, 0, 1.0], [3.5, 0, 1.0]])
    pixel, _ = project(points, MATRIX, distortion, np.eye(3), np.zeros(3))
    assert np.isfinite(pixel[0]).all()
    assert np.isnan(pixel[1:]).all()
    folded, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, distortion)
    assert 0 < folded[2, 0, 0] < 640  # which OpenCV films in the middle of the image


@pytest.mark.parametrize("lens", LENSES)
def test_bending_grows_with_the_radius_up_to_the_widest_and_not_beyond(lens):
    distortion = np.array(LENSES[lens])
    distortion[2:4] = 0
    widest = widest_radius(distortion)
    radius = np.linspace(0, min(widest, 50.0), 4001)
    bent = bend(np.stack([radius, 0 * radius], -1), distortion)[:, 0]
    assert (np.diff(bent) > 0).all()
    if np.isfinite(widest):
        beyond = bend(np.array([[widest, 0], [widest * 1.01, 0]]), distortion)[:, 0]
        assert beyond[1] < beyond[0]
    assert np.isfinite(widest) == (lens in ("folding", "eight"))


@pytest.mark.parametrize("lens", LENSES)
def test_undistortion_undoes_bending_to_the_last_digits(lens):
    distortion = np.array(LENSES[lens])
    pixel = np.stack(np.meshgrid(np.arange(0, 640, 40.0), np.arange(0, 480, 50.0)), axis=-1)
    plane = undistort(pixel, MATRIX, distortion)
    assert plane.shape == pixel.shape
    again = bend(plane, distortion) @ MATRIX[:2, :2].T + MATRIX[:2, 2]
    np.testing.assert_allclose(again, pixel, atol=1e-9)
    if lens != "none":
        assert abs(plane - undistort(pixel, MATRIX, np.zeros(0))).max() > 0.01


def test_a_pixel_that_no_point_reaches_has_no_direction():
    plane = undistort(np.array([[333.0, 229.0], [9000.0, 0.0]]), MATRIX, np.array([-0.08, 0, 0, 0]))
    np.testing.assert_allclose(plane[0], 0, atol=1e-12)
    assert np.isnan(plane[1]).all()


def test_a_point_lies_on_the_ray_of_its_pixel(rng):
    distortion = np.array(LENSES["eight"])
    rotation, translation = a_pose(rng)
    points = rng.uniform(-2, 2, (17, 3))
    pixel, _ = project(points, MATRIX, distortion, rotation, translation)
    ray = viewing_ray(pixel, MATRIX, distortion, rotation)
    away = points - camera_center(rotation, translation)
    np.testing.assert_allclose(ray, away / np.linalg.norm(away, axis=-1, keepdims=True), atol=1e-9)


def test_centers_and_matrices_of_several_cameras_are_those_of_each(rng):
    poses = [a_pose(rng) for _ in range(4)]
    rotation, translation = (np.array(each) for each in zip(*poses, strict=True))
    matrices = image_from_world(np.tile(MATRIX, (4, 1, 1)), rotation, translation)
    assert matrices.shape == (4, 3, 4)
    centers = camera_center(rotation, translation)
    whole = np.c_[centers, np.ones(4)]
    np.testing.assert_allclose(np.einsum("cij,cj->ci", matrices, whole), 0, atol=1e-9)


def test_too_many_coefficients_are_refused():
    with pytest.raises(ValueError, match=r"distortion has shape \(9,\); a row of at most 8"):
        bend(np.zeros((1, 2)), np.zeros(9))


def test_a_camera_copies_what_it_is_given_and_keeps_it(rng):
    distortion = np.array([0.1, 0, 0, 0, 0, 0, 0, 0])
    matrix = MATRIX.copy()
    camera = a_camera(rng, distortion=distortion, intrinsics=matrix)
    distortion[0] = matrix[0, 0] = 5
    assert camera.intrinsics[0, 0] == 610
    assert camera.distortion.tolist() == [0.1, 0, 0, 0]
    assert (camera.width, camera.height) == (640, 480)
    with pytest.raises(ValueError, match="read-only"):
        camera.rotation[0, 0] = 2
    np.testing.assert_allclose(camera.rotation @ camera.center_m, -camera.translation)


@pytest.mark.parametrize(("given", "kept"), [([], 0), ([0] * 5, 0), ([1], 4), ([0] * 4 + [1], 5),
                                             ([0] * 7 + [1], 8), ([1] + [0] * 13, 4)])  # fmt: skip
def test_zeros_behind_the_last_coefficient_do_not_count(rng, given, kept):
    assert len(a_camera(rng, distortion=given).distortion) == kept


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": " "}, "the name ' ' cannot be that of a video file"),
        ({"name": "a\n"}, r"the name 'a\\n' cannot be"),
        ({"size": (640, 0)}, r"the image size \(640, 0\) is no width and height"),
        ({"size": (640.0, 480)}, r"the image size \(640.0, 480\)"),
        ({"intrinsics": np.eye(2)}, r"intrinsics has shape \(2, 2\), \(3, 3\) is wanted"),
        ({"intrinsics": MATRIX * 2}, "not of the form"),
        ({"intrinsics": np.diag([5.0, -5, 1])}, "focal lengths 5 and -5 are not larger than 0"),
        (
            {"rotation": np.eye(3) * 1.1},
            "its rotation is no rotation matrix: R times its transpose is off by 0.21",
        ),
        ({"rotation": np.diag([1.0, 1, -1])}, "the rotation mirrors"),
        ({"translation": [0, np.nan, 0]}, "translation is not finite"),
        ({"distortion": [[1.0]]}, r"distortion has shape \(1, 1\), a row of coefficients"),
        ({"distortion": [np.inf]}, "distortion is not finite"),
        ({"distortion": np.ones(12)}, "distortion has 12 coefficients, of which at most 8"),
        ({"name": "", "size": (0, 0)}, "the name '' .*; the image size"),
    ],
)
def test_a_camera_that_cannot_be_is_refused_with_all_its_faults(rng, changes, message):
    with pytest.raises(ValueError, match=message):
        a_camera(rng, **changes)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.7, 3.0, np.pi - 1e-9, np.pi])
def test_rotations_and_vectors_agree_with_opencv_and_undo_each_other(rng, angle):
    for axis in [*np.eye(3), *-np.eye(3), *rng.normal(0, 1, (5, 3))]:
        vector = axis / np.linalg.norm(axis) * angle
        rotation = rotation_from_vector(vector)
        np.testing.assert_allclose(rotation, cv2.Rodrigues(vector)[0], atol=1e-14)
        again = vector_from_rotation(rotation)
        assert np.linalg.norm(again) <= np.pi + 1e-12
        np.testing.assert_allclose(rotation_from_vector(again), rotation, atol=1e-14)
        if angle < 3.1:
            np.testing.assert_allclose(again, vector, atol=1e-14)


def test_a_rounded_rotation_becomes_the_nearest_one(rng):
    rotation = a_pose(rng)[0]
    near = nearest_rotation(rotation.round(3))
    np.testing.assert_allclose(near @ near.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(near, rotation, atol=1e-3)
    assert np.linalg.det(near) == pytest.approx(1)


@pytest.mark.parametrize("up", Y_UP_FROM)
def test_turning_the_world_moves_no_pixel_and_brings_up_to_y(rng, up):
    camera = a_camera(rng)
    turned = turn_y_up(camera, up)
    point = rng.uniform(-1, 1, 3)
    axis = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}[up[-1]]
    axis = np.array(axis) * (-1.0 if up[0] == "-" else 1.0)
    moved = Y_UP_FROM[up] @ point
    assert np.linalg.det(Y_UP_FROM[up]) == pytest.approx(1)
    assert moved[1] == pytest.approx(point @ axis)
    before, after = (
        project(place, each.intrinsics, each.distortion, each.rotation, each.translation)
        for place, each in ((point, camera), (moved, turned))
    )
    np.testing.assert_allclose(after[0], before[0], atol=1e-9)


def test_turning_about_no_axis_is_refused(rng):
    with pytest.raises(ValueError, match="up = 'w' is no axis; x, y, z, -x, -y, -z are"):
        turn_y_up(a_camera(rng), "w")


def test_a_larger_world_has_its_cameras_farther_apart(rng):
    camera = a_camera(rng)
    np.testing.assert_allclose(scale_world(camera, 0.01).center_m, camera.center_m / 100)
