"""One instant of a real dancer, brought as a capture with the masks of its makers."""

import dataclasses
import shutil

import numpy as np
import pytest

from storage import create_archive
from storage.blocks import read_block
from storage.formats.calibration.reading import read_calibration
from storage.formats.calibration.toml import write_calibration
from storage.formats.capture.capture import read_capture
from storage.recordings import digest_capture
from tasks.capture.films import grid_of
from tasks.checks.agreement import AgreementSettings
from tasks.checks.take_silhouettes import check_take
from tasks.geometry.voxels import VoxelRuns, decode_runs
from tasks.reconstruction.carving import CarvingSettings, carve_block
from tasks.reconstruction.coloring import ColoringSettings, color_block
from tasks.reconstruction.silhouettes import SilhouetteSettings, extract_block
from tests.figures.real_dancer import DATA, MARKS

pytestmark = MARKS


@pytest.fixture(scope="module")
def reference():
    """Return the voxels of the reference hull as a set of their centers in whole centimetres."""
    with np.load(DATA / "hull_1cm_reference.npz") as arrays:
        return arrays["xyz"].astype(float)


@pytest.fixture(scope="module")
def capture(tmp_path_factory, reference):
    """Return the folder of a capture: pixel centers of its calibration are at halves, ours not."""
    folder = tmp_path_factory.mktemp("captures") / "dancer"
    low, high = reference.min(axis=0).round(2) - 0.105, reference.max(axis=0).round(2) + 0.105
    folder.mkdir()
    (folder / "capture.toml").write_text(
        f"[volume]\ncenter_m = {((low + high) / 2).tolist()}\nsize_m = {(high - low).tolist()}\n"
        'voxel_m = 0.01\n[video]\nfps = 25.0\nup = "y"\nunit = "m"\n'
    )
    cameras, _ = read_calibration(DATA / "calibration", up="y", unit_m=1.0)
    moved = []
    for camera in cameras:
        inner = camera.intrinsics.copy()
        inner[:2, 2] -= 0.5
        moved.append(dataclasses.replace(camera, intrinsics=inner, size=(780, 582)))
        for kind, into, mark in (("images", "videos", ""), ("silhouettes",) * 2 + ("silh_",)):
            [picture] = (DATA / kind).glob(f"{mark}{camera.name}_*")
            (folder / into / camera.name).mkdir(parents=True)
            shutil.copy(picture, folder / into / camera.name / f"0{picture.suffix}")
    write_calibration(folder / "calibration.toml", moved)
    return folder


def test_masks_carve_the_reference_hull_to_the_voxel(capture, reference, tmp_path):
    archive, digest = tmp_path / "archive", digest_capture(capture)
    place = create_archive(archive).place
    source = read_capture(capture)
    assert (source.backgrounds, len(source.masks)) == ((), 8)
    shared = {"archive": str(archive), "capture": str(capture), "digest": digest}
    seen = extract_block(
        **shared, into="work/dancer/a.npz", start=0, end=1, settings=SilhouetteSettings()
    ).block
    notes = check_take(**shared, blocks=[seen], settings=AgreementSettings(), by="mask")
    assert not [note for note in notes if "grow_px" in note]  # they are a pixel or two too wide
    hulls = carve_block(
        **shared, silhouettes=seen, into="work/dancer/b.npz", settings=CarvingSettings()
    ).block
    grid = grid_of(source)
    hull = decode_runs(VoxelRuns(**read_block(place, hulls), shape=grid.shape), 0)
    wanted = np.zeros(grid.shape, bool)
    index = (reference - grid.origin_m) / grid.voxel_m
    np.testing.assert_allclose(index, index.round(), atol=1e-3)
    wanted[tuple(index.round().astype(int).T)] = True
    np.testing.assert_array_equal(hull, wanted)
    assert hull.sum() == 98_714
    colored = color_block(
        **shared, silhouettes=seen, hulls=hulls, into="work/dancer/c.npz",
        settings=ColoringSettings(),
    ).block  # fmt: skip
    color = read_block(place, colored)["color"].astype(int)
    red = color[:, 0] > 1.5 * color[:, 1:].max(axis=1)
    assert 0.3 < red.mean() < 0.8  # she wears a red dress
