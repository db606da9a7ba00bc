"""What stands still beside a performer, in hulls of boxes."""

import numpy as np
import pytest

from tasks.geometry.voxels import VoxelGrid, decode_runs, encode_runs, take_frame
from tasks.reconstruction.still_things import describe_still_things, find_still_things

GRID = VoxelGrid((-1.0, 0.0, -0.5), 0.05, (40, 36, 21))
FRAMES = 20
CHAIR = np.s_[4:12, 0:16, 4:12]


def hulls(*, body=None, chair=True, arms=False):
    """Return frames with a body that walks along x, where it is not said where it is.

    With arms, something moves on the body that stands where it is said.
    """
    occupied = np.zeros((FRAMES, *GRID.shape), bool)
    for t, frame in enumerate(occupied):
        x = 16 + t if body is None else body
        frame[x : x + 5, 0:32, 6:14] = True
        if arms:
            frame[x - 1 : x + 8, 26 - t : 28 - t, 8 + t % 5 : 10 + t % 5] = True
        if chair:
            frame[CHAIR] = True
    return occupied


def found(occupied):
    each = [take_frame(encode_runs(occupied), t) for t in range(len(occupied))]
    return find_still_things(each, GRID)


def test_a_chair_beside_one_who_walks_is_found_to_the_voxel():
    occupied = hulls()
    occupied[:, 5, 8, 5] = np.arange(FRAMES) % 2 == 0  # a silhouette flickers
    wanted = np.zeros(GRID.shape, bool)
    wanted[CHAIR] = True
    things = found(occupied)
    np.testing.assert_array_equal(decode_runs(things, 0), wanted)
    [said] = describe_still_things(things, GRID)
    assert "128 liters" in said
    assert "x = -0.62, z = -0.12 m, up to 0.75 m high" in said


def test_a_chair_that_the_performer_touches_for_a_while_is_found_without_the_performer():
    occupied = hulls()
    occupied[5:10, 12:40, 10:14, 6:10] = True  # a hand on the chair
    wanted = np.zeros(GRID.shape, bool)
    wanted[CHAIR] = True
    np.testing.assert_array_equal(decode_runs(found(occupied), 0), wanted)


def test_of_two_that_never_move_the_larger_is_the_performer():
    wanted = np.zeros(GRID.shape, bool)
    wanted[CHAIR] = True
    np.testing.assert_array_equal(decode_runs(found(hulls(body=20)), 0), wanted)


@pytest.mark.parametrize(
    "occupied",
    [
        pytest.param(hulls(chair=False), id="nothing there"),
        pytest.param(hulls(body=20, chair=False, arms=True), id="the performer keeps in place"),
        pytest.param(hulls(body=12, arms=True), id="the performer sits all the time"),
        pytest.param(np.zeros((FRAMES, *GRID.shape), bool), id="nobody"),
        pytest.param(hulls()[:2], id="two frames"),
    ],
)
def test_nothing_is_found_where_nothing_stands_still_beside_who_moves(occupied):
    things = found(occupied)
    assert not len(things.start)
    assert describe_still_things(things, GRID) == ()
