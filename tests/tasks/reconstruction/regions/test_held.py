"""What is held, in hulls of boxes: told from arms, sleeves and legs."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

from storage import create_archive
from storage.blocks import read_block, write_block
from tasks.geometry.voxels import VoxelGrid, encode_runs, take_frame, voxel_numbers
from tasks.reconstruction import still_things
from tasks.reconstruction.regions import held
from tasks.reconstruction.regions.held import find_held
from tasks.reconstruction.still_things import find_held_things

GRID = VoxelGrid((0.0, 0.0, 0.0), 0.02, (90, 110, 60))


def body():
    """Return a trunk with an arm that is stretched along x, down to the floor."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[20:36, 0:80, 24:36] = True
    occupied[36:67, 63:68, 28:33] = True
    return occupied


def rod(length):
    """Return an upright rod of two centimeters at the end of the hand."""
    things = np.zeros(GRID.shape, bool)
    things[66, 66 : 66 + length, 30] = True
    return things


def fan():
    """Return a half disc of 0.3 m that the hand holds at its middle."""
    x, y, z = np.indices(GRID.shape)
    return (z == 30) & (x >= 67) & (np.hypot(x - 66, y - 65) <= 16)


def umbrella():
    """Return a thick dome on a stick."""
    x, y, z = np.indices(GRID.shape)
    return rod(26) | ((np.hypot(x - 66, z - 30) <= 16) & (y >= 90) & (y < 96))


def found(occupied, *, known=False):
    """Return (x, y, z) what is held, and whether that is clear."""
    held = find_held(encode_runs(occupied[None]), GRID, known=known)
    marks = np.zeros(GRID.shape, bool)
    marks[occupied] = held.is_held
    return marks, held.is_clear


@pytest.mark.parametrize(
    ("thing", "share"), [(rod(40), 0.6), (fan(), 0.8), (umbrella(), 0.95)],
    ids=["sword", "fan", "umbrella"],
)  # fmt: skip
@pytest.mark.parametrize("known", [True, False])
def test_what_a_hand_holds_is_found_and_nothing_of_the_body(thing, share, known):
    thing = thing & ~body()
    held, clear = found(body() | thing, known=known)
    assert clear
    assert not (held & ~thing).any()
    assert held.sum() > share * thing.sum()  # a hand's length of it may be left to the hand


def sleeve():
    """Return a sheet of cloth that hangs from all of the arm."""
    cloth = np.zeros(GRID.shape, bool)
    cloth[40:66, 40:63, 30] = True
    return cloth


def thin_arm():
    """Return a child's forearm and hand, 0.24 m, as thin as a rod."""
    arm = np.zeros(GRID.shape, bool)
    arm[67:79, 65, 30] = True
    return arm


def leg():
    """Return a leg beside the trunk that hangs on it by a thread, down to the floor."""
    marks = np.zeros(GRID.shape, bool)
    marks[4:14, 0:44, 25:35] = True
    marks[14:20, 42, 30] = True
    return marks


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("more", [sleeve, thin_arm, leg], ids=["sleeve", "thin arm", "leg"])
def test_sleeves_thin_arms_and_legs_are_no_things(more, known):
    held, clear = found(body() | more(), known=known)
    assert not held.any()
    assert not clear


def test_a_thick_thing_on_a_thin_neck_is_held_where_one_is_known():
    thing = np.zeros(GRID.shape, bool)
    thing[72:88, 60:80, 22:40] = True
    thing[67:72, 65, 30] = True
    assert not found(body() | thing)[0].any()
    held, clear = found(body() | thing, known=True)
    assert not clear
    assert not (held & ~thing).any()
    assert held[74:].sum() == thing[74:].sum()


@pytest.mark.parametrize("known", [True, False])
def test_an_empty_frame_holds_nothing(known):
    held, clear = found(np.zeros(GRID.shape, bool), known=known)
    assert not held.any()
    assert not clear


def test_large_voxels_tell_no_thing_from_an_arm():
    coarse = VoxelGrid(GRID.origin_m, 0.03, GRID.shape)
    held = find_held(encode_runs((body() | rod(40))[None]), coarse)
    assert not held.is_held.any()
    assert not held.is_clear


def take(swords):
    """Return hulls of twenty frames, a sword in some of them."""
    whole = [body() | rod(40) if n in swords else body() for n in range(20)]
    return encode_runs(np.stack(whole))


def test_a_thing_that_is_seen_in_some_frames_is_found_in_each_of_them():
    hulls = take(range(4, 16))
    held, hidden, notes = find_held_things(lambda n: take_frame(hulls, n), 20, GRID)
    assert held is not None
    assert not hidden.any()
    one = find_held(take_frame(hulls, 4), GRID, known=True)
    wanted = voxel_numbers(take_frame(hulls, 4))[one.is_held]
    for frame in range(20):
        own = voxel_numbers(take_frame(held, frame))
        np.testing.assert_array_equal(own, wanted if 4 <= frame < 16 else [])
    assert len(wanted)
    assert "in 12 of 20 frames" in notes[0]


def test_what_is_seen_in_two_frames_may_be_noise():
    hulls = take((3, 9))
    held, hidden, notes = find_held_things(lambda n: take_frame(hulls, n), 20, GRID)
    assert held is None
    assert not hidden.any()
    assert notes == ()


@pytest.mark.parametrize(
    ("thing", "hides"), [(rod(40), False), (fan(), True), (umbrella(), False)],
    ids=["sword", "fan", "umbrella"],
)  # fmt: skip
def test_a_fan_hides_the_hand_that_holds_it_and_a_stick_does_not(thing, hides):
    hulls = encode_runs(np.repeat((body() | thing)[None], 20, axis=0))
    _, hidden, [note] = find_held_things(lambda n: take_frame(hulls, n), 20, GRID)
    assert hidden.all() if hides else not hidden.any()
    assert ("In 20 of them the hand that holds it is a guess" in note) is hides


def test_the_rim_of_a_chair_that_flickers_is_not_held(tmp_path, monkeypatch):
    whole = np.stack([np.roll(body(), t, axis=0) for t in range(20)])
    whole[:, 2:14, 0:40, 2:14] = True
    whole[::4, 14, 0:40, 8] = True
    archive = create_archive(tmp_path / "archive")
    monkeypatch.setattr(still_things, "capture_of", lambda *_: SimpleNamespace(initial=None))
    monkeypatch.setattr(still_things, "grid_of", lambda _: GRID)
    runs = encode_runs(whole)
    arrays = {"start": runs.start, "length": runs.length, "offset": runs.offset}
    hull = write_block(archive.place, "work/h", (0, 20), arrays, time.monotonic()).block
    made = still_things.find_still_take(str(tmp_path / "archive"), "", "", [hull], "work/s")
    assert ["stands still" in note for note in made.notes] == [True]
    assert "moving_start" not in read_block(archive.place, made.block)


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("marked", [0, 1])
def test_marks_grow_by_a_cross_and_a_cube_in_turn(steps, marked):
    marks = np.full((13, 17, 14), marked, np.uint8)  # its rim is marked whole, or not at all
    marks[4:-4, 4:-4, 4:-4] = np.random.default_rng(steps).random((5, 9, 6)) < 0.1
    wanted = marks > 0
    for step in range(steps):
        near = ndimage.generate_binary_structure(3, 1 if step % 2 == 0 else 3)
        wanted = ndimage.binary_dilation(wanted, near)
    np.testing.assert_array_equal(held._grown(marks, steps), wanted)
