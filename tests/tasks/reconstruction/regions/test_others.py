"""Another body that moves in the volume, in hulls of boxes."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from storage import create_archive
from storage.blocks import read_block, write_block
from tasks.geometry.voxels import VoxelGrid, encode_runs, take_frame, voxel_index, voxel_numbers
from tasks.reconstruction import still_things
from tasks.reconstruction.regions.others import find_others

GRID = VoxelGrid((-1.0, 0.0, -0.7), 0.05, (41, 36, 29))
FRAMES = 12


def walker(x, z):
    """Return (time, x, y, z) a body at places (time,) in the grid, with a stick of its own."""
    marks = np.zeros((FRAMES, *GRID.shape), bool)
    for t in range(FRAMES):
        marks[t, x[t] : x[t] + 6, 0:32, z[t] : z[t] + 5] = True
    return marks


T = np.arange(FRAMES)
MIDDLE = walker(13 + np.abs(7 - 3 * T % 14), 12 + T // 4)
ASIDE = walker(30 + T // 4, 3 + T)


def others(occupied, given=None):
    hulls = encode_runs(occupied)
    return find_others(lambda n: take_frame(hulls, n), FRAMES, GRID, range(0, FRAMES, 4), given)


def marks_of(runs):
    marks = np.zeros((FRAMES, *GRID.shape), bool)
    for t in range(FRAMES):
        marks[(t, *voxel_index(runs, t).T)] = True
    return marks


def test_of_two_who_are_always_apart_the_one_in_the_middle_stays():
    found, [said] = others(MIDDLE | ASIDE)
    np.testing.assert_array_equal(marks_of(found), ASIDE)
    assert "nearer to the middle of the volume, at x = 0.13, z = 0.00 m" in said


def test_the_one_with_the_joints_that_were_placed_stays():
    joints = np.full((21, 3), np.nan)
    joints[3] = 0.7, 1.2, 0.1  # aside, in frame 6
    found, [said] = others(MIDDLE | ASIDE, (6, joints))
    np.testing.assert_array_equal(marks_of(found), MIDDLE)
    assert "the one with the joints of initial.json, at x =" in said


def test_what_is_small_goes_with_the_nearer_body():
    ball, stone = np.zeros((2, FRAMES, *GRID.shape), bool)
    ball[:, 38, 30:33, 3 + T[0] : 6] = True
    stone[:, 3, 20, 14] = True
    found, _ = others(MIDDLE | ASIDE | ball | stone)
    np.testing.assert_array_equal(marks_of(found), (ASIDE | ball) & ~stone)


def test_two_who_touch_stay_and_it_is_said():
    near = ASIDE.copy()
    near[4] = walker(np.full(FRAMES, 22), np.full(FRAMES, 12))[4]
    found, [said] = others(MIDDLE | near)
    assert found is None
    assert "apart in 2 of 3 frames looked at, and touch, or one is away, in the others" in said


def test_two_who_touch_in_a_frame_that_is_not_looked_at_stay_too():
    near = ASIDE.copy()
    near[5] = walker(np.full(FRAMES, 22), np.full(FRAMES, 12))[5]
    found, [said] = others(MIDDLE | near)
    assert found is None
    assert "apart in 11 of 12 frames" in said


def torn():
    """Return the halves of one body, one above the other, both as high as a body may be."""
    marks = MIDDLE.copy()
    marks[:, :, 14:17] = False
    return marks


@pytest.mark.parametrize(
    "occupied", [MIDDLE, torn(), MIDDLE | (ASIDE & (np.arange(36) < 8)[:, None])],
    ids=["one", "halves", "a stool"],
)  # fmt: skip
def test_one_body_is_left_alone(occupied):
    assert others(occupied) == (None, ())


def test_empty_frames_are_no_second_body():
    occupied = MIDDLE.copy()
    occupied[3:5] = False
    assert others(occupied) == (None, ())


def test_who_changes_places_at_once_is_not_followed():
    both = np.concatenate([(MIDDLE | ASIDE)[:6], (MIDDLE | walker(T, 24 - T))[6:]])
    found, [said] = others(both)
    assert found is None
    assert "cannot be followed" in said


def test_numbers_of_voxels_are_those_of_the_hull():
    hulls = encode_runs(MIDDLE | ASIDE)
    found, _ = others(MIDDLE | ASIDE)
    for t in range(FRAMES):
        own = voxel_numbers(take_frame(found, t))
        assert np.isin(own, voxel_numbers(take_frame(hulls, t))).all()
        assert len(own) == 6 * 32 * 5


@pytest.mark.parametrize("apart", [True, False])
def test_the_stage_writes_the_other_or_that_there_are_two(tmp_path, monkeypatch, apart):
    near = ASIDE.copy()
    if not apart:
        near[4] = walker(np.full(FRAMES, 22), np.full(FRAMES, 12))[4]
    archive = create_archive(tmp_path / "archive")
    monkeypatch.setattr(still_things, "capture_of", lambda *_: SimpleNamespace(initial=None))
    monkeypatch.setattr(still_things, "grid_of", lambda _: GRID)
    runs = encode_runs(MIDDLE | near)
    arrays = {"start": runs.start, "length": runs.length, "offset": runs.offset}
    hull = write_block(archive.place, "work/h", (0, FRAMES), arrays, time.monotonic()).block
    made = still_things.find_still_take(str(tmp_path / "archive"), "", "", [hull], "work/s")
    wrote = read_block(archive.place, made.block)
    assert len(made.notes) == 1
    assert wrote["unexplained"].tolist() == [not apart] * FRAMES
    assert ("moving_start" in wrote) is apart
    if apart:
        other = encode_runs(ASIDE)
        np.testing.assert_array_equal(wrote["moving_start"], other.start)
        np.testing.assert_array_equal(wrote["moving_length"], other.length)
        np.testing.assert_array_equal(wrote["moving_offset"], other.offset)
