import numpy as np
import pytest

from tasks.geometry.voxels import (
    VoxelGrid,
    VoxelRuns,
    count_voxels,
    decode_runs,
    encode_runs,
    join_runs,
    padded_crop,
    surface_index,
    surface_voxels,
    take_frame,
    volume_grid,
    voxel_centers,
    voxel_index,
)
from tasks.reconstruction.boxes.bits import read_bits
from tests.twins import voxels as naive

SHAPE = (5, 7, 9)


@pytest.fixture
def rng():
    return np.random.default_rng(41)


def boxes(rng, frames=4):
    """Return frames with boxes cut in and out: long runs, short runs and neighbors."""
    occupied = np.zeros((frames, *SHAPE), bool)
    for t in range(frames):
        for k in range(5):
            a = rng.integers(0, SHAPE)
            b = a + rng.integers(1, 5, 3)
            occupied[t, a[0] : b[0], a[1] : b[1], a[2] : b[2]] = k % 3 != 2
    return occupied


@pytest.mark.parametrize("density", [0.0, 0.3, 0.8, 1.0])
def test_runs_are_those_of_a_walk_over_every_voxel(rng, density):
    occupied = rng.random((3, *SHAPE)) < density
    runs = encode_runs(occupied)
    start, length, offset = naive.encode(occupied)
    np.testing.assert_array_equal(runs.start, start)
    np.testing.assert_array_equal(runs.length, length)
    np.testing.assert_array_equal(runs.offset, offset)


@pytest.mark.parametrize("density", [0.0, 0.3, 0.8, 1.0])
def test_decoded_runs_are_what_was_encoded(rng, density):
    occupied = rng.random((3, *SHAPE)) < density
    runs = encode_runs(occupied)
    for t in range(3):
        np.testing.assert_array_equal(decode_runs(runs, t), occupied[t])


@pytest.mark.parametrize("density", [0.02, 0.5, 0.98, 1.0])
def test_bits_are_read_as_the_voxels_they_stand_for(rng, density):
    shape, begin = (5, 7, 150), np.array([1, 2, 32])
    bits = rng.random((3, 4, 96)) < density
    occupied = np.zeros((1, *shape), bool)
    occupied[0, 1:4, 2:6, 32:128] = bits
    powers = 2 ** np.arange(32, dtype=np.uint64)
    words = (bits.reshape(3, 4, 3, 32) * powers).sum(axis=3).astype(np.uint32)
    runs, wanted = read_bits(words, begin, shape), encode_runs(occupied)
    for name in ("start", "length", "offset"):
        np.testing.assert_array_equal(getattr(runs, name), getattr(wanted, name))


def test_voxels_come_in_the_order_of_argwhere(rng):
    occupied = boxes(rng)
    runs = encode_runs(occupied)
    for t in range(len(occupied)):
        np.testing.assert_array_equal(voxel_index(runs, t), np.argwhere(occupied[t]))
    np.testing.assert_array_equal(count_voxels(runs), occupied.sum(axis=(1, 2, 3)))


@pytest.mark.parametrize("first", [0, 2, 5])
@pytest.mark.parametrize("step", [1, 2, 7, 100000])
def test_of_every_so_many_voxels_one_is_given(rng, first, step):
    occupied = boxes(rng)
    runs = encode_runs(occupied)
    for t in range(len(occupied)):
        wanted = np.argwhere(occupied[t])[first::step]
        np.testing.assert_array_equal(voxel_index(runs, t, first=first, step=step), wanted)


def test_surface_is_where_a_neighbor_is_empty_or_outside_the_grid(rng):
    occupied = np.concatenate([boxes(rng), np.ones((1, *SHAPE), bool)])
    runs = encode_runs(occupied)
    inner = 0
    for t in range(len(occupied)):
        surface = naive.surface(occupied[t])
        np.testing.assert_array_equal(surface_voxels(runs, t), surface[occupied[t]])
        np.testing.assert_array_equal(surface_index(runs, t), np.argwhere(surface))
        inner += (occupied[t] & ~surface).sum()
    assert inner > 100


@pytest.mark.parametrize("margin", [1, 3])
def test_a_crop_holds_all_voxels_within_empty_layers(rng, margin):
    occupied = boxes(rng)
    runs = encode_runs(occupied)
    for t in range(len(occupied)):
        crop, begin = padded_crop(runs, t, margin=margin)
        np.testing.assert_array_equal(np.argwhere(crop) + begin, np.argwhere(occupied[t]))
        for axis in range(3):
            layers = np.flatnonzero(np.moveaxis(crop, axis, 0).any(axis=(1, 2)))
            assert (layers[0], layers[-1]) == (margin, crop.shape[axis] - margin - 1)


def test_an_empty_frame_has_no_voxels_and_no_surface(rng):
    occupied = boxes(rng, frames=3)
    occupied[1] = False
    runs = encode_runs(occupied)
    assert count_voxels(runs)[1] == 0
    assert voxel_index(runs, 1).shape == (0, 3)
    assert surface_voxels(runs, 1).shape == (0,)
    assert not padded_crop(runs, 1)[0].any()
    assert encode_runs(occupied[:0]).frames == 0


def test_joined_parts_are_the_frames_one_after_another(rng):
    occupied = boxes(rng, frames=5)
    whole = encode_runs(occupied)
    joined = join_runs([encode_runs(occupied[a:b]) for a, b in [(0, 2), (2, 2), (2, 5)]])
    for name in ("start", "length", "offset"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name))
    one = take_frame(whole, 3)
    np.testing.assert_array_equal(decode_runs(one, 0), occupied[3])


def test_a_volume_is_covered_by_a_grid_around_its_center():
    grid = volume_grid([0.5, 1.0, -2.0], [0.3, 0.5, 0.72], 0.1)
    assert grid.shape == (3, 5, 8)
    centers = voxel_centers(grid, np.array([[0, 0, 0], [2, 4, 7], [1, 2, 3]]))
    np.testing.assert_allclose(centers[:2].mean(axis=0), [0.5, 1.0, -2.0])
    np.testing.assert_allclose(centers[2], [0.5, 1.0, -2.05])


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (((0, 0, np.nan), 0.1, (2, 3, 4)), "origin_m .* three finite numbers"),
        (((0, 0, 0), 0.0, (2, 3, 4)), "voxel_m 0.0 must be larger than 0"),
        (((0, 0, 0), 0.1, (2, 0, 4)), "shape .* from 1 to 65535"),
        (((0, 0, 0), 0.1, (2048, 2048, 1024)), r"fewer than 2\*\*32"),
        (((0, 0, 0), -1.0, (2, 0, 4)), "voxel_m .*; shape .*; change the volume"),
    ],
)
def test_what_is_no_grid_is_refused_with_every_fault(grid, message):
    with pytest.raises(ValueError, match=message):
        VoxelGrid(*grid)


def test_wrong_arguments_are_refused_in_words(rng):
    runs = encode_runs(boxes(rng, frames=2))
    with pytest.raises(ValueError, match="frame 2 is not one of the frames 0 to 1"):
        decode_runs(runs, 2)
    with pytest.raises(ValueError, match="add an axis to a single frame"):
        encode_runs(np.zeros(SHAPE, bool))
    with pytest.raises(ValueError, match="on the same grid"):
        join_runs([runs, encode_runs(np.zeros((1, 2, 3, 4), bool))])
    with pytest.raises(ValueError, match="1 starts, 2 lengths"):
        VoxelRuns(runs.start[:1], runs.length[:2], runs.offset[:1], SHAPE)
    with pytest.raises(ValueError, match=r"1 of 3 runs are empty or leave .* is run 1; carve"):
        VoxelRuns(np.array([0, 8, 18]), np.array([9, 2, 9]), np.array([0, 3]), SHAPE)
    with pytest.raises(ValueError, match=r"2 of 3 runs .* is run 0"):
        VoxelRuns(np.array([0, 5 * 7 * 9, 1]), np.array([0, 1, 1]), np.array([0, 3]), SHAPE)
    with pytest.raises(ValueError, match="pass finite sizes larger than 0"):
        volume_grid([0, 0, 0], [1, 1, 1], 0.0)
