"""Tests of the arrays of films and voxels: what is written against dense arrays, through a take."""

import dataclasses

import numpy as np
import pytest
import zarr

from storage import create_archive
from storage.archive import Take
from storage.arrays import silhouettes as silhouette_arrays
from storage.arrays import voxels as voxel_arrays
from storage.arrays.cameras import write_cameras
from storage.arrays.silhouettes import write_silhouettes
from storage.arrays.voxels import write_voxels
from storage.errors import ArchiveError
from storage.formats.calibration.camera import Camera
from storage.provenance import Provenance
from storage.publication import describe_files, version_folder
from tests.figures.archives.takes import write_version

SHAPE = (5, 7, 6)
ORIGIN, VOXEL = (-0.31, 0.02, 1.5), 0.03
FRAMES = 9
EMPTY = (0, 4, 8)  # first, middle, last
SIZES = [(40, 30), (36, 34), (24, 18)]


@pytest.fixture
def dense():
    """Occupied voxels, their surface flags, and color and camera of each surface voxel."""
    rng = np.random.default_rng(20030602)
    occupied = rng.random((FRAMES, *SHAPE)) < 0.6
    occupied[list(EMPTY)] = False
    surface = occupied & (rng.random(occupied.shape) < 0.4)
    color = rng.integers(0, 256, (*occupied.shape, 3), np.uint8)
    camera = rng.integers(0, 4, occupied.shape).astype(np.uint8)
    return occupied, surface, color, camera


@pytest.fixture
def silhouettes():
    return np.random.default_rng(7).random((FRAMES, 3, 34, 40)) < 0.3


def runs_of(occupied):
    """Start, length and frame of each run, one voxel after another."""
    runs = []
    for t, frame in enumerate(occupied):
        for number in np.flatnonzero(frame):
            follows = runs and runs[-1][0] == t and sum(runs[-1][1:]) == number
            if follows and number % SHAPE[2]:
                runs[-1][2] += 1
            else:
                runs.append([t, int(number), 1])
    return np.array(runs, np.int64).reshape(-1, 3).T


def offsets(counts):
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def pieces(values, seed):
    """Cut an array into stretches of any length, some empty."""
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(values) + 1, 6))
    return np.split(values, cuts)


def write_take(place, dense, silhouettes):
    """Write a version with cameras, silhouettes and voxels; return its take."""
    occupied, surface, color, camera = dense
    record = write_version(place, "okuri48")
    folder = version_folder("okuri48", record.version)
    provenance = Provenance("test", {}, {})
    write_cameras(place, folder, cameras(), provenance)
    write_silhouettes(
        place, folder, iter(np.split(silhouettes, [2, 2, 7])), silhouettes.shape,
        cameras=[camera.name for camera in cameras()], rate_hz=25.0, provenance=provenance,
    )  # fmt: skip
    frame, start, length = runs_of(occupied)
    flat = occupied.reshape(FRAMES, -1)
    parts = {
        "run_start": start.astype(np.uint32),
        "run_length": length.astype(np.uint16),
        "is_surface": surface[occupied],
        "color": color[surface],
        "camera": camera[surface],
    }
    write_voxels(
        place, folder,
        {
            "run": offsets(np.bincount(frame, minlength=FRAMES)),
            "voxel": offsets(flat.sum(axis=1)),
            "surface": offsets(surface.reshape(FRAMES, -1).sum(axis=1)),
        },
        {name: pieces(values, n) for n, (name, values) in enumerate(parts.items())},
        attributes={
            "origin_m": list(ORIGIN), "voxel_m": VOXEL, "shape": list(SHAPE), "no_camera": 255,
            "provenance": provenance.attributes(),
        },
        array_attributes={"color": {"provenance": Provenance("coloring", {}, {}).attributes()}},
        rate_hz=25.0,
    )  # fmt: skip
    files = describe_files(place, "okuri48", record.version)
    stages = ["cameras", "silhouettes", "voxels"]
    return Take(place, dataclasses.replace(record, stages=stages, files=files))


def cameras():
    rng = np.random.default_rng(3)
    found = []
    for n, (size, number) in enumerate(zip(SIZES, (4, 5, 8), strict=True)):
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))
        fx, fy, cx, cy = rng.uniform(20, 40, 4)
        intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        lens = rng.uniform(-0.1, 0.1, number)
        found.append(Camera(f"cam{n}", size, intrinsics, lens, rotation, rng.normal(size=3)))
    return found


@pytest.fixture
def place(tmp_path):
    return create_archive(tmp_path / "archive").place


@pytest.fixture(params=["one chunk", "many chunks and files"])
def take(place, dense, silhouettes, request, monkeypatch):
    if request.param != "one chunk":
        monkeypatch.setattr(voxel_arrays, "_CHUNK", 13)
        monkeypatch.setattr(voxel_arrays, "_SHARD", 4 * 13)
        monkeypatch.setattr(silhouette_arrays, "_PICTURES_BYTES", 5 * 3 * 34 * 40)
        monkeypatch.setattr(silhouette_arrays, "_PICTURES_READ", 2)
    return write_take(place, dense, silhouettes)


def test_every_frame_comes_back_as_it_was_dense(take, dense):
    occupied, surface, color, camera = dense
    for t in range(FRAMES):
        voxels = take.voxels(t)
        index = np.argwhere(occupied[t])
        np.testing.assert_array_equal(voxels["index"], index)
        np.testing.assert_allclose(voxels["center"], ORIGIN + VOXEL * index, rtol=0, atol=1e-12)
        is_surface = surface[t][occupied[t]]
        np.testing.assert_array_equal(voxels["is_surface"], is_surface)
        own = np.where(is_surface[:, None], color[t][occupied[t]], 0)
        np.testing.assert_array_equal(voxels["color"], own)
        from_camera = np.where(is_surface, camera[t][occupied[t]], 255)
        np.testing.assert_array_equal(voxels["camera"], from_camera)
        assert "label" not in voxels
        np.testing.assert_array_equal(take.occupied(t), occupied[t])


def test_the_dense_view_has_coordinates_in_metres(take, dense):
    occupied = take.occupied(3)
    x, y, z = np.argwhere(dense[0][3])[17]
    found = occupied.sel(
        x=ORIGIN[0] + x * VOXEL, y=ORIGIN[1] + y * VOXEL, z=ORIGIN[2] + z * VOXEL, method="nearest"
    )
    assert bool(found)
    assert occupied.sizes == {"x": 5, "y": 7, "z": 6}


@pytest.mark.parametrize("frame", EMPTY)
def test_an_empty_frame_has_no_voxels_and_every_variable(take, frame):
    voxels = take.voxels(frame)
    assert voxels.sizes == {"voxel": 0, "space": 3, "axis": 3, "rgb": 3}
    assert voxels["center"].dtype == np.float64
    assert voxels["color"].dtype == np.uint8
    assert not take.occupied(frame).any()


@pytest.mark.parametrize("frame", [-1, FRAMES, -FRAMES])
def test_a_frame_that_is_not_there_is_refused(take, frame):
    for read in (take.voxels, take.occupied):
        with pytest.raises(IndexError, match=f"frame {frame} is not one of the frames 0 to 8"):
            read(frame)


def test_a_plain_zarr_reader_needs_the_words_of_the_module_alone(take, dense):
    """What is written here follows the docstring of storage.arrays.voxels, nothing else."""
    group = zarr.open_group(f"{take.path}/voxels", mode="r")
    arrays = {name: array[:] for name, array in group.arrays()}
    _, ny, nz = group.attrs["shape"]
    for t in range(FRAMES):
        numbers = []
        for run in range(arrays["run_offset"][t], arrays["run_offset"][t + 1]):
            start = int(arrays["run_start"][run])
            numbers += range(start, start + int(arrays["run_length"][run]))
        index = [(n // (ny * nz), n // nz % ny, n % nz) for n in numbers]
        assert index == [tuple(each) for each in np.argwhere(dense[0][t])]
        voxels = slice(*arrays["voxel_offset"][t : t + 2])
        is_surface = arrays["is_surface"][voxels]
        assert is_surface.tolist() == [bool(dense[1][t][each]) for each in index]
        colors = arrays["color"][slice(*arrays["surface_offset"][t : t + 2])]
        on_surface = [each for each, flag in zip(index, is_surface, strict=True) if flag]
        assert colors.tolist() == [dense[2][t][each].tolist() for each in on_surface]
    np.testing.assert_allclose(arrays["time"], np.arange(FRAMES) / 25.0)


def test_each_array_says_where_it_comes_from(take):
    group = zarr.open_group(f"{take.path}/voxels", mode="r")
    assert group.attrs["provenance"]["stage"] == "test"
    assert group["color"].attrs["provenance"]["stage"] == "coloring"


def test_silhouettes_come_back_by_camera_and_frame(take, silhouettes):
    found = take.silhouettes
    assert found.dims == ("time", "camera", "row", "column")
    np.testing.assert_array_equal(found, silhouettes)
    np.testing.assert_array_equal(found.sel(camera="cam1"), silhouettes[:, 1])
    np.testing.assert_allclose(found["time"], np.arange(FRAMES) / 25.0)


def test_cameras_come_back_with_every_number(take):
    found = take.cameras
    assert found["camera"].values.tolist() == ["cam0", "cam1", "cam2"]
    for n, camera in enumerate(cameras()):
        one = found.isel(camera=n)
        np.testing.assert_array_equal(one["intrinsics"], camera.intrinsics)
        np.testing.assert_array_equal(one["rotation"], camera.rotation)
        np.testing.assert_array_equal(one["translation"], camera.translation)
        lens = np.zeros(8)
        lens[: len(camera.distortion)] = camera.distortion
        np.testing.assert_array_equal(one["distortion"], lens)
        assert tuple(one["image_size"].values) == SIZES[n]


def test_a_take_all_of_whose_frames_are_empty_can_be_written_and_read(place, dense, silhouettes):
    take = write_take(place, tuple(np.zeros_like(each) for each in dense), silhouettes)
    assert [take.voxels(t).sizes["voxel"] for t in range(FRAMES)] == [0] * FRAMES
    assert not take.occupied(4).any()


@pytest.mark.parametrize("stage", ["voxels", "silhouettes", "cameras"])
def test_a_stage_that_has_not_run_is_said(place, stage):
    take = Take(place, write_version(place, "okuri48"))
    with pytest.raises(ArchiveError, match=rf"'okuri48' has no {stage}: made from a.bvh, it has"):
        take.voxels(0) if stage == "voxels" else getattr(take, stage)


def test_a_take_stays_frozen_and_opens_its_arrays_once(take):
    assert take.silhouettes is take.silhouettes
    assert take._voxels is take._voxels
    with pytest.raises(dataclasses.FrozenInstanceError):
        take.record = None
