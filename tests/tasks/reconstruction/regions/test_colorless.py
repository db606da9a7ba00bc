"""Before a gray wall gray limbs are found where all cameras see something, and shadows are not."""

import cv2
import numpy as np
import pytest

from tasks.capture.backgrounds import Background, make_background
from tasks.capture.films import projection_of
from tasks.geometry.projection import nearest_pixels
from tasks.geometry.voxels import VoxelGrid
from tasks.reconstruction.regions.colorless import (
    expect_performer,
    has_no_color,
    shadows_reach_m,
    what_differs,
)
from tasks.reconstruction.silhouettes import (
    SilhouetteSettings,
    extract_silhouettes,
    looked_at_twice,
)
from tasks.studio.cameras import RingSettings, generate_cameras

GRAY, GREEN = (128.0, 128.0, 130.0), (62.0, 140.0, 76.0)
GRID = VoxelGrid((-0.79, 0.01, -0.89), 0.02, (80, 90, 91))
SIZE = (100, 140)
"""Rows and columns of the images."""


def plate(color, rng, noise):
    image = np.array(color) + rng.normal(0.0, noise, (*SIZE, 3))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def box(low, high, step=0.006):
    """Return points (point, 3) that fill a box of the world, m."""
    axes = [np.arange(a, b + step / 2, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


RED = box((-0.15, 0.9, -0.1), (0.15, 1.4, 0.1))  # a trunk that any rule finds,
ARM = box((0.15, 1.2, -0.05), (0.6, 1.3, 0.05))  # an arm and
LEG = box((-0.08, 0.0, -0.08), (0.08, 0.9, 0.08))  # a leg in gray,
SHADOW = box((0.1, 0.0, -0.2), (0.7, 0.0, 0.2))  # and what the floor shows of them


@pytest.fixture(scope="module")
def projection():
    ring = RingSettings(cameras=6, size=SIZE[::-1])
    return projection_of(generate_cameras(ring, center_m=np.array([0.0, 0.8, 0.0]), seed=3))


@pytest.fixture(scope="module")
def scene(projection):
    """Films of one frame and backgrounds of gray cameras, and what shows arm and leg, and all."""
    rng = np.random.default_rng(11)
    films, backgrounds, gray, whole, shadow = [], [], [], [], []

    def filmed(points, camera):
        pixel = nearest_pixels(points, projection)[camera]
        there = np.zeros(SIZE, np.uint8)
        there[tuple(pixel[pixel[:, 0] >= 0].T)] = 1
        return cv2.morphologyEx(there, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0

    for camera in range(projection.cameras):
        image = plate(GRAY, rng, 2.5).astype(float)
        arm, leg, trunk, floor = (filmed(part, camera) for part in (ARM, LEG, RED, SHADOW))
        body = arm | leg | trunk
        image[floor] *= 0.65
        image[arm | leg] *= 0.78  # the wall's color, in a shadow
        image[trunk] = (176, 38, 48)
        films.append(np.rint(image).astype(np.uint8)[None])
        backgrounds.append(make_background(plate(GRAY, rng, 1.0)[None]))
        gray.append((arm | leg) & ~trunk)
        whole.append(body)
        shadow.append(floor & ~body)
    return films, backgrounds, np.array(gray), np.array(whole), np.array(shadow)


def test_gray_limbs_are_found_and_shadows_are_not(scene, projection):
    films, backgrounds, gray, whole, shadow = scene
    expected = expect_performer(films, backgrounds, projection, GRID)
    first, second = (
        np.stack(
            [
                extract_silhouettes(film, background, expected=each)[0]
                for film, background, each in zip(films, backgrounds, those, strict=True)
            ]
        )
        for those in ([None] * len(films), expected)
    )
    assert (first & gray).sum() < 0.2 * gray.sum()  # else the case proves nothing
    assert (second & gray).sum() > 0.9 * gray.sum()
    assert (second & whole).sum() > 0.9 * (second | whole).sum()
    differing = np.stack([what_differs(*pair)[0] for pair in zip(films, backgrounds, strict=True)])
    assert (differing & shadow).sum() > 0.9 * shadow.sum()
    assert (second & shadow).sum() < 0.1 * shadow.sum()


def test_where_nothing_is_expected_silhouettes_are_as_they_were(scene):
    films, backgrounds, *_ = scene
    nothing = np.zeros((1, *SIZE), bool)
    for pair in zip(films, backgrounds, strict=True):
        alone, again = extract_silhouettes(*pair), extract_silhouettes(*pair, expected=nothing)
        np.testing.assert_array_equal(again, alone)
        assert alone.any()


def test_one_camera_that_sees_nothing_expects_nothing_anywhere(scene, projection):
    films, backgrounds, *_ = scene
    empty = np.broadcast_to(np.rint(backgrounds[2].color).astype(np.uint8), films[2].shape)
    blind = [*films[:2], np.ascontiguousarray(empty), *films[3:]]
    assert not expect_performer(blind, backgrounds, projection, GRID).any()


def test_what_is_expected_differs(scene, projection):
    films, backgrounds, *_ = scene
    expected = expect_performer(films, backgrounds, projection, GRID)
    for camera, pair in enumerate(zip(films, backgrounds, strict=True)):
        assert not (expected[camera] & ~what_differs(*pair)).any()


def test_shadows_reach_higher_to_cameras_that_look_down(projection):
    high = RingSettings(cameras=6, size=SIZE[::-1], heights_m=(4.0, 4.0))
    above = projection_of(generate_cameras(high, center_m=np.array([0.0, 0.8, 0.0]), seed=3))
    assert shadows_reach_m(projection, GRID) < 0.2 < shadows_reach_m(above, GRID)


def test_only_backdrops_without_color_are_looked_at_twice():
    rng = np.random.default_rng(2)
    green, gray, black = (
        make_background(plate(color, rng, 2.0)[None]) for color in (GREEN, GRAY, (9, 9, 9))
    )
    assert looked_at_twice([green, gray, black]) == [False, True, True]
    assert looked_at_twice([gray], SilhouetteSettings(rule="crcb")) == [False]
    half = green.color.copy()
    half[:60] = gray.color[:60]
    assert has_no_color(Background(half, green.noise), 18.0)
