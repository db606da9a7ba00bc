"""What a doctor says of hulls that hold more than a body, from silhouettes of boxes."""

import cv2
import numpy as np
import pytest

from tasks.capture.films import projection_of
from tasks.checks.bodies import held_notes
from tasks.geometry.voxels import VoxelGrid, voxel_centers
from tasks.studio.cameras import RingSettings, generate_cameras
from tests.tasks.reconstruction.regions.test_held import GRID, body, rod

CAMERAS = generate_cameras(
    RingSettings(cameras=6, radius_m=4.4, size=(640, 480), distortion=(0.0, 0.0)),
    center_m=(0.9, 1.1, 0.6),
)


def filmed(occupied, grid=GRID):
    """Return (camera, row, column) the voxels as each camera films them, no pixel left out."""
    place = voxel_centers(grid, np.argwhere(occupied))
    seen = np.zeros((len(CAMERAS), 480, 640), np.bool_)
    for picture, camera in zip(seen, CAMERAS, strict=True):
        at = (place @ camera.rotation.T + camera.translation) @ camera.intrinsics.T
        column, row = np.rint(at[:, :2] / at[:, 2:]).astype(int).T
        picture[row, column] = True
        marks = picture.view(np.uint8)
        picture[:] = cv2.morphologyEx(marks, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
    return seen


@pytest.mark.parametrize(("with_sword", "said"), [(0, False), (1, False), (2, True), (5, True)])
def test_a_sword_is_told_from_two_frames_on(with_sword, said):
    bare, armed = filmed(body()), filmed(body() | rod(42))
    frames = np.stack([armed] * with_sword + [bare] * (8 - with_sword))
    notes = held_notes(frames, projection_of(CAMERAS), GRID)
    assert bool(notes) == said
    if said:
        assert f"it is seen in {with_sword} of 8 frames" in notes[0]


def test_nobody_holds_nothing():
    nobody = np.zeros((3, len(CAMERAS), 480, 640), np.bool_)
    assert held_notes(nobody, projection_of(CAMERAS), GRID) == ()
    coarse = VoxelGrid((0.0, 0.0, 0.0), 0.04, (45, 55, 30))
    armed = np.stack([filmed(body() | rod(42))] * 3)
    assert held_notes(armed, projection_of(CAMERAS), coarse) == ()  # arms are thin there, too
