"""What is put back of a hull from the frames around it, against counts of the dense hulls."""

import numpy as np
import pytest

from tasks.body.initial.held_hulls import (
    OWN,
    PUT_BACK,
    beyond_others,
    farthest_lost,
    frames_around,
    held_crop,
    pieces_of_body,
)
from tasks.geometry.voxels import decode_runs, padded_crop
from tests.figures.initial_figures import runs_of


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize(
    ("frame", "frames", "reach", "around"),
    [
        (10, 30, 2, [8, 9, 10, 11, 12]),
        (10, 30, 1, [9, 10, 11]),
        (10, 30, 8, [2, 6, 10, 14, 18]),
        (0, 30, 2, [0, 1, 2, 3, 4]),
        (29, 30, 2, [25, 26, 27, 28, 29]),
        (7, 30, 0, [7]),
        (1, 3, 2, [0, 1, 2]),
        (0, 1, 2, [0]),
    ],
)
def test_frames_around_one_are_evenly_spread_and_exist(frame, frames, reach, around):
    assert frames_around(frame, frames, reach) == around


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_what_more_than_half_of_the_frames_occupy_is_put_back(rng, count):
    dense = rng.random((6, 5, 7, 3)) < rng.uniform(0.2, 0.8, (5, 7, 3))
    around = list(range(1, count + 1))
    crop, begin = held_crop(runs_of(*dense), 0, around)
    found = np.zeros(np.array(dense.shape[1:]) + 2, np.uint8)
    end = begin + 1 + crop.shape
    found[tuple(slice(b + 1, e) for b, e in zip(begin, end, strict=True))] = crop
    assert not found[[0, -1]].any()
    assert not found[:, :, [0, -1]].any()
    for at in np.ndindex(*dense.shape[1:]):
        times = sum(int(dense[number][at]) for number in around)
        true = OWN if dense[0][at] else PUT_BACK if 2 * times > count else 0
        assert found[at[0] + 1, at[1] + 1, at[2] + 1] == true
    assert (crop == PUT_BACK).any()


def test_a_frame_alone_stays_as_it_is(rng):
    runs = runs_of(*(rng.random((2, 5, 7, 3)) < 0.3))
    held, begin = held_crop(runs, 1, [1])
    crop, first = padded_crop(runs, 1)
    np.testing.assert_array_equal(held, crop * OWN)
    np.testing.assert_array_equal(begin, first)
    assert held.sum() == OWN * decode_runs(runs, 1).sum() > 0


def test_the_farthest_lost_voxel_is_measured_from_what_the_frame_has(rng):
    body = np.argwhere(rng.random((9, 11, 8)) < 0.4)
    is_own = body[:, 1] < 4
    apart = np.linalg.norm(body[~is_own][:, None] - body[is_own][None], axis=2)
    assert farthest_lost(body, is_own) == pytest.approx(apart.min(axis=1).max())
    assert farthest_lost(body, is_own) > 4
    assert farthest_lost(body, np.ones(len(body), bool)) == 0.0
    assert farthest_lost(body, np.zeros(len(body), bool)) == np.inf


def naive_beyond(bodies):
    def apart(own, other):
        return max(min(np.linalg.norm(a - b) for b in own) for a in other)

    return [
        sorted(max(0.0, apart(one, other) - apart(other, one)) for other in bodies)[-2]
        for one in bodies
    ]


def test_what_two_others_have_and_a_frame_lacks_is_measured(rng):
    bodies = [np.argwhere(rng.random((9, 5, 7)) < 0.2) for _ in range(4)]
    bodies[2] = bodies[2][bodies[2][:, 0] < 5]
    found = beyond_others(bodies, 1)
    np.testing.assert_allclose(found, naive_beyond(bodies))
    assert found[2] > 2 > max(found[0], found[1], found[3])


def test_what_moves_is_not_taken_for_lost():
    trunk = np.argwhere(np.ones((4, 30, 5))) + np.array([20, 0, 0])
    arm = np.argwhere(np.ones((15, 2, 3)))
    limbs = [arm + np.array([24, height, 1]) for height in (10, 14, 17, 20, 28)]
    bodies = [np.concatenate([trunk, limb]) for limb in limbs]
    assert beyond_others(bodies, 1).max() == 0
    assert beyond_others([*bodies, trunk], 1).tolist() == [0, 0, 0, 0, 0, 15]
    assert beyond_others([*bodies[:1], trunk, trunk], 1).max() == 0  # only one has too much
    assert beyond_others([bodies[0], trunk], 1).tolist() == [0, 0]
    assert beyond_others([*bodies, trunk], 3)[-1] == pytest.approx(15, abs=3)


def test_pieces_within_the_outline_from_above_are_of_the_body():
    boxes = [
        ((40, 20, 10), 0),
        ((10, 10, 9), 0),
        ((10, 10, 9), 35),
        ((3, 3, 2), 0),
        ((6, 5, 4), 36),
    ]
    index = [
        np.argwhere(np.ones(box)) + np.array([first, 30 * number, 0])
        for number, (box, first) in enumerate(boxes)
    ]
    piece = np.repeat(range(1, len(boxes) + 1), [len(part) for part in index])
    kept = pieces_of_body(np.concatenate(index), piece, 0.02)
    assert kept.tolist() == [False, True, True, False, False, True]


@pytest.mark.parametrize(
    ("size", "place", "kept"),
    [
        ((9, 35, 9), (30, 0, 4), True),
        ((9, 35, 9), (48, 0, 4), False),  # farther off than a thigh is long
        ((9, 35, 9), (30, 10, 4), False),  # above the floor
        ((20, 8, 20), (30, 0, 0), False),  # flat
        ((5, 30, 5), (30, 0, 4), False),  # thin
    ],
    ids=["shank", "far", "hangs", "flat", "thin"],
)
def test_a_piece_beside_the_body_is_kept_where_it_stands_like_a_shank(size, place, kept):
    body = np.argwhere(np.ones((20, 100, 18)))
    other = np.argwhere(np.ones(size)) + np.array(place)
    piece = np.repeat([1, 2], [len(body), len(other)])
    found = pieces_of_body(np.concatenate([body, other]), piece, 0.02)
    assert found.tolist() == [False, True, kept]
