"""Voxels of what stands still have the label 0, and the others those that they have without it."""

import time

import numpy as np
import pytest

from storage import create_archive
from storage.blocks import read_block, write_block
from tasks.body import final_labeling, initial_model
from tasks.body.final_labeling import label_block
from tasks.geometry.voxels import VoxelGrid, encode_runs
from tasks.reconstruction.voxel_frames import VoxelFrames

GRID = VoxelGrid((0.0, 0.0, 0.0), 0.1, (9, 5, 4))


@pytest.fixture
def scene(tmp_path):
    """Two bodies of one color each, and a thing between; the blocks of their hulls."""
    occupied = np.zeros((2, *GRID.shape), bool)
    occupied[:, :3] = occupied[:, 6:] = True
    things = np.zeros(GRID.shape, bool)
    things[3:6, 1:3] = things[2, 1, 1] = True
    occupied |= things
    archive = str(tmp_path / "archive")
    place = create_archive(archive).place

    def write(name, frames, **arrays):
        return write_block(place, f"work/{name}", frames, arrays, time.monotonic()).block

    runs, alone = encode_runs(occupied), encode_runs(things[None])
    hull = write("h", (0, 2), start=runs.start, length=runs.length, offset=runs.offset)
    still = write("s", (0, 2), start=alone.start, length=alone.length)
    return archive, place, write, hull, still, occupied[0], things


def test_what_is_left_out_has_the_label_0_in_the_archives_order(scene, monkeypatch):
    archive, place, write, hull, still, occupied, things = scene
    monkeypatch.setattr(final_labeling, "capture_of", lambda *_: None)
    monkeypatch.setattr(final_labeling, "grid_of", lambda _: GRID)
    low = np.argwhere(occupied & ~things)[:, 0] < 5
    given = np.where(low, 3, 8).astype(np.uint8)
    initial = write("i", (0, 1), label=given)
    mean = np.zeros((2, 11, 3)) + np.array([0.1, 0.2, 0.15])
    mean[:, 7] = (0.7, 0.2, 0.15)
    mean[:, :2] = mean[:, 3:7] = mean[:, 8:] = 99.0
    inverse = np.broadcast_to(np.eye(3), (2, 11, 3, 3))
    fitted = write("f", (0, 2), blob_mean=mean, blob_inverse=inverse, initial_label=given)
    made = label_block(archive, "", "", [hull], initial, fitted, "work/l", 0, 2, still)
    read = read_block(place, made.block)
    voxel = np.argwhere(occupied)
    wanted = np.where(voxel[:, 0] < 5, 3, 8)
    wanted[things[tuple(voxel.T)]] = 0
    np.testing.assert_array_equal(read["offset"], [0, len(voxel), 2 * len(voxel)])
    for frame in range(2):
        own = read["label"][read["offset"][frame] : read["offset"][frame + 1]]
        np.testing.assert_array_equal(own, wanted)


@pytest.mark.parametrize("whole", [True, False], ids=["all voxels", "those kept"])
def test_a_person_labels_all_voxels(scene, monkeypatch, whole):
    _, place, _, hull, still, occupied, things = scene
    frames = VoxelFrames(place, GRID, [hull], still=still)
    index = np.argwhere(occupied if whole else occupied & ~things)
    label = (1 + index[:, 0]).astype(np.uint8)
    given = type("Given", (), {"frame": 1, "position": np.zeros((21, 3)), "label": label})
    seen = {}

    def model(*given, frame, label):
        seen.update(label=label)
        return initial_model.InitialModel(frame, given[-1], label, 1.0, ())

    monkeypatch.setattr(initial_model, "read_initial", lambda _: given)
    monkeypatch.setattr(initial_model, "model_from_joints", model)
    assert initial_model._given_model("initial.json", frames).frame == 1
    np.testing.assert_array_equal(seen["label"], 1 + np.argwhere(occupied & ~things)[:, 0])
