"""Holes of silhouettes: a print of the stage's color is filled, the gap beside an arm is not."""

import cv2
import numpy as np
import pytest

from tasks.capture.films import projection_of
from tasks.geometry.projection import project_points
from tasks.geometry.voxels import volume_grid
from tasks.reconstruction.regions.holes import fill_holes
from tasks.studio.cameras import RingSettings, generate_cameras

GRID = volume_grid((0.0, 1.0, 0.0), (1.2, 2.0, 1.2), 0.02)
CAMERAS = projection_of(generate_cameras(RingSettings(cameras=8, spread=0.0)))
SIZE = (8, 240, 320)


def column(x, half_m, low_m=0.5, high_m=1.5):
    """Return points of an upright round column."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.stack([x + half_m * np.cos(angle), half_m * np.sin(angle)])
    return np.array([[a, y, b] for y in (low_m, high_m) for a, b in ring.T])


def draw(*bodies):
    """Return the silhouettes of convex bodies, each given by points of its surface."""
    silhouettes = np.zeros(SIZE, np.uint8)
    for points in bodies:
        pixel, _ = project_points(points, CAMERAS)
        for silhouette, own in zip(silhouettes, pixel, strict=True):
            cv2.fillConvexPoly(silhouette, cv2.convexHull(own.round().astype(np.int32)), 1)
    return silhouettes.view(np.bool_)


def cut_print(silhouettes, half_m, width=0.6):
    """Cut a patch of a column's surface out of the silhouettes that see it; return which do."""
    around = np.linspace(-width, width, 9)
    patch = np.array(
        [[half_m * np.sin(a), y, half_m * np.cos(a)] for y in (0.9, 1.1) for a in around]
    )
    pixel, _ = project_points(patch, CAMERAS)
    seeing = []
    for c, (silhouette, own) in enumerate(zip(silhouettes, pixel, strict=True)):
        place = -CAMERAS.camera_from_world[c, :, :3].T @ CAMERAS.camera_from_world[c, :, 3]
        if (
            patch[:, [0, 2]] @ place[[0, 2]]
        ).min() <= 1.2 * half_m**2:  # the patch goes round the outline: an open bay
            continue
        hole = np.zeros(silhouette.shape, np.uint8)
        cv2.fillConvexPoly(hole, cv2.convexHull(own.round().astype(np.int32)), 1)
        silhouette &= hole == 0
        seeing.append(c)
    return seeing


def test_a_print_that_several_cameras_see_is_filled_in_each_of_them():
    whole = draw(column(0.0, 0.15))
    printed = whole.copy()
    seeing = cut_print(printed, 0.15)
    assert len(seeing) >= 2
    lost = (whole & ~printed).sum(axis=(1, 2))
    filled = fill_holes(printed, CAMERAS, GRID)
    assert (whole <= printed).all()
    assert (printed & ~whole).sum() <= 4  # a slit beside the outline
    np.testing.assert_allclose(filled, lost, atol=4)
    assert (filled[seeing] > 20).all()


def test_the_gap_between_an_arm_and_a_trunk_stays():
    trunk, arm = column(-0.1, 0.13), column(0.32, 0.05)
    bridges = [
        np.array([[x, y, z] for x in (-0.1, 0.34) for y in (low, low + 0.1) for z in (-0.04, 0.04)])
        for low in (0.5, 1.4)
    ]
    silhouettes = draw(trunk, arm, *bridges)
    before = silhouettes.copy()
    inner = cv2.connectedComponents((~silhouettes[0]).view(np.uint8), connectivity=4)[0]
    assert inner == 3  # itself, the stage, and the gap
    assert not fill_holes(silhouettes, CAMERAS, GRID).any()
    np.testing.assert_array_equal(silhouettes, before)


@pytest.mark.parametrize("value", [False, True], ids=["nobody", "everything"])
def test_silhouettes_without_holes_stay(value):
    silhouettes = np.full(SIZE, value)
    assert not fill_holes(silhouettes, CAMERAS, GRID).any()
    assert (silhouettes == value).all()


def test_a_hole_that_nobody_contradicts_stays():
    """Two other cameras at least have to see what is behind it."""
    whole = draw(column(0.0, 0.15))
    printed = whole.copy()
    [c, *_] = cut_print(printed, 0.15, width=0.3)
    others = [n for n in range(8) if n != c]
    printed[others] = False
    before = printed.copy()
    assert not fill_holes(printed, CAMERAS, GRID).any()
    np.testing.assert_array_equal(printed, before)
