"""The frames of a take from the blocks of its stages."""

import gc
import itertools
import time
import weakref

import numpy as np
import pytest

import tasks.reconstruction.voxel_frames
from storage import create_archive
from storage.blocks import Block, write_block
from tasks.geometry.voxels import VoxelGrid, encode_runs, surface_index, surface_voxels, take_frame
from tasks.reconstruction.voxel_frames import VoxelFrames

GRID = VoxelGrid((0.0, 0.0, 0.0), 0.1, (4, 5, 6))
EDGES = (0, 3, 4, 8)  # of three blocks


@pytest.fixture
def occupied():
    occupied = np.random.default_rng(8).random((8, *GRID.shape)) < 0.6
    occupied[5] = False
    return occupied


@pytest.fixture
def frames(tmp_path, occupied):
    """The frames, cut into blocks; a voxel's color and camera say where it is."""
    place = create_archive(tmp_path / "archive").place
    hulls, colors = [], []
    for first, end in itertools.pairwise(EDGES):
        runs = encode_runs(occupied[first:end])
        arrays = {"start": runs.start, "length": runs.length, "offset": runs.offset}
        hulls.append(
            write_block(place, f"work/h{first}", (first, end), arrays, time.monotonic()).block
        )
        surface = [surface_index(runs, n) for n in range(runs.frames)]
        arrays = {
            "is_surface": np.concatenate([surface_voxels(runs, n) for n in range(runs.frames)]),
            "color": np.concatenate(surface).astype(np.uint8),
            "camera": np.concatenate(surface).sum(axis=1).astype(np.uint8),
            "offset": np.cumsum([0, *map(len, surface)]),
        }
        colors.append(
            write_block(place, f"work/c{first}", (first, end), arrays, time.monotonic()).block
        )
    return VoxelFrames(place, GRID, hulls, colors)


@pytest.fixture
def read(monkeypatch):
    """The paths of the blocks that are read."""
    read = []

    def counted(place, block, names=None):
        read.append(block.path)
        return original(place, block, names)

    original = tasks.reconstruction.voxel_frames.read_block
    monkeypatch.setattr(tasks.reconstruction.voxel_frames, "read_block", counted)
    return read


@pytest.mark.parametrize("order", [range(8), (7, 0, 5, 3, 4, 2, 6, 1)], ids=["forward", "mixed"])
def test_every_frame_is_found_in_its_block_in_whatever_order(frames, occupied, order):
    assert len(frames) == 8
    for frame in order:
        index = frames.index(frame)
        np.testing.assert_array_equal(index, np.argwhere(occupied[frame]))
        is_surface, color, camera = frames.surface(frame)
        np.testing.assert_array_equal(
            is_surface, surface_voxels(encode_runs(occupied[frame : frame + 1]), 0)
        )
        np.testing.assert_array_equal(color, index[is_surface])
        np.testing.assert_array_equal(camera, index[is_surface].sum(axis=1))
    both = encode_runs(occupied)
    for frame, hull in enumerate(frames.hulls(2, 5), 2):
        np.testing.assert_array_equal(hull.start, take_frame(both, frame).start)


@pytest.mark.parametrize("order", [range(8), (7, 0, 5, 3, 4, 2, 6, 1)], ids=["forward", "mixed"])
@pytest.mark.parametrize("what", ["still", "moving", "both"])
def test_what_is_not_the_performer_is_left_out_of_every_frame(frames, occupied, order, what):
    rng, place = np.random.default_rng(2), frames._place
    still, moving = rng.random(GRID.shape) < 0.3, rng.random(occupied.shape) < 0.2
    still &= what != "moving"
    moving &= what != "still"
    one, all_frames = encode_runs(still[None]), encode_runs(moving & occupied)
    arrays = {"start": one.start, "length": one.length}
    if what != "still":
        names = ("start", "length", "offset")
        arrays |= {f"moving_{name}": getattr(all_frames, name) for name in names}
    block = write_block(place, "work/still", (0, 8), arrays, time.monotonic()).block
    without = VoxelFrames(place, GRID, frames._hulls, frames._colors, block)
    for frame in order:
        things = still | moving[frame]
        kept = ~things[occupied[frame]]
        np.testing.assert_array_equal(without.kept(frame), kept)
        index = np.argwhere(occupied[frame] & ~things)
        np.testing.assert_array_equal(without.index(frame), index)
        alone = encode_runs(occupied[frame : frame + 1] & ~things)
        np.testing.assert_array_equal(without.hull(frame).start, alone.start)
        np.testing.assert_array_equal(without.hull(frame).length, alone.length)
        is_surface, color, camera = without.surface(frame)
        whole = surface_voxels(encode_runs(occupied[frame : frame + 1]), 0)
        np.testing.assert_array_equal(is_surface, whole[kept])
        np.testing.assert_array_equal(color, index[is_surface])
        np.testing.assert_array_equal(camera, index[is_surface].sum(axis=1))
    assert frames.kept(3) is None
    with pytest.raises(IndexError, match="frame 8 is not one of 0 to 7"):
        without.kept(8)


@pytest.mark.parametrize("frame", [-1, 8])
def test_a_frame_that_is_not_there_is_refused(frames, frame):
    with pytest.raises(IndexError, match=f"frame {frame} is not one of 0 to 7"):
        frames.index(frame)


def test_two_blocks_are_held_and_read_once_while_they_are(frames, read):
    for frame in (2, 3, 2, 3, 4, 3, 4):  # 0 goes when 4 is read
        frames.surface(frame)
    assert read == ["work/h0", "work/c0", "work/h3", "work/c3", "work/h4", "work/c4"]
    frames.surface(0)
    assert read[6:] == ["work/h0", "work/c0"]


def test_colors_are_read_only_where_they_are_asked_for(frames, read):
    for frame in range(8):
        frames.hull(frame)
        frames.index(frame)
    assert read == ["work/h0", "work/h3", "work/h4"]
    frames.surface(3)
    assert read[3:] == ["work/c3"]


def test_frames_and_what_they_hold_are_freed_at_once(tmp_path):
    """Not when the garbage collector comes: a block of a take is 30 MB."""
    gc.disable()
    try:
        refs = [Block("work/h0", 0, 1, "")]
        frames = VoxelFrames(create_archive(tmp_path / "archive").place, GRID, refs, refs)
        gone = weakref.ref(frames)
        del frames
        assert gone() is None
    finally:
        gc.enable()
