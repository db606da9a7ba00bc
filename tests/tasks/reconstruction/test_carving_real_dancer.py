"""One instant of a real dancer before eight cameras (`data/dancer8`)."""

import re

import cv2
import numpy as np
import pytest

from storage.schema import NO_CAMERA
from tasks.geometry.projection import Projection
from tasks.geometry.voxels import VoxelGrid, count_voxels, decode_runs
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tasks.reconstruction.coloring import ColoringSettings, color_surface
from tests.figures.real_dancer import DATA, MARKS

pytestmark = MARKS


@pytest.fixture(scope="module")
def matrices():
    texts = [path.read_text() for path in sorted((DATA / "calibration").glob("*.xml"))]
    numbers = [re.findall(r"-?\d+\.\d+", text.split("<camera>")[1]) for text in texts]
    return np.array(numbers, float).reshape(8, 3, 4)


@pytest.fixture(scope="module")
def silhouettes():
    paths = sorted((DATA / "silhouettes").glob("*.pbm"))
    return np.stack([cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 0 for path in paths])


@pytest.fixture(scope="module")
def reference():
    """Return the grid around the reference hull, and its voxels in it."""
    with np.load(DATA / "hull_1cm_reference.npz") as arrays:
        centers = arrays["xyz"].astype(float)
    origin = centers.min(axis=0).round(2) - 0.1
    shape = tuple((np.ptp(centers, axis=0) / 0.01).round().astype(int) + 21)
    occupied = np.zeros(shape, bool)
    occupied[tuple(((centers - origin) / 0.01).round().astype(int).T)] = True
    return VoxelGrid(tuple(origin), 0.01, shape), occupied


def projection_of(matrices, *, center=0.0):
    """Return the cameras of 3x4 matrices whose pixels have their centers at `center`."""
    inner, poses = [], []
    for matrix in matrices:
        intrinsic, rotation, place = cv2.decomposeProjectionMatrix(matrix)[:3]
        intrinsic = np.triu(intrinsic / intrinsic[2, 2])
        intrinsic[:2, 2] -= center
        inner.append(intrinsic)
        poses.append(np.concatenate([rotation, -rotation @ place[:3] / place[3]], axis=1))
    size = np.full((len(matrices), 2), (780, 582))
    return Projection(np.stack(poses), np.stack(inner), np.zeros((len(matrices), 0)), size)


def test_the_strict_hull_is_the_reference_where_pixel_centers_are_at_halves(
    matrices, silhouettes, reference
):
    grid, wanted = reference
    projection = projection_of(matrices, center=0.5)
    runs = carve_visual_hull(silhouettes, projection, grid, CarvingSettings())
    np.testing.assert_array_equal(decode_runs(runs, 0), wanted)
    assert count_voxels(runs)[0] == 98_714


def test_half_a_pixel_is_all_that_the_hull_differs_from_the_reference(
    matrices, silhouettes, reference
):
    grid, wanted = reference
    runs = carve_visual_hull(silhouettes, projection_of(matrices), grid, CarvingSettings())
    hull = decode_runs(runs, 0)
    assert ((hull & ~wanted).sum(), (wanted & ~hull).sum()) == (3377, 2884)


def test_nearly_all_of_the_tolerant_hull_is_seen(matrices, silhouettes, reference):
    grid, _ = reference
    projection = projection_of(matrices, center=0.5)
    paths = sorted((DATA / "images").glob("*.png"))
    images = np.stack([cv2.imread(str(path))[..., ::-1] for path in paths])
    hull = carve_visual_hull(silhouettes, projection, grid, CarvingSettings(misses_allowed=1))
    found = color_surface(hull, grid, images, silhouettes, projection, ColoringSettings())
    assert (found.camera == NO_CAMERA).mean() < 0.03
    red = found.color[:, 0] > 1.5 * found.color[:, 1:].max(axis=1)
    assert 0.3 < red.mean() < 0.8  # she wears a red dress
