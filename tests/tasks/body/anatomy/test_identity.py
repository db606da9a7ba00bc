"""Two that meet are told apart by how they move on, against motions that obey a law."""

import numpy as np
import pytest

from tasks.body.anatomy.identity import (
    choose_states,
    find_exchanged,
    stretches_between,
    tell_turns,
)

FRAMES, MEET = 40, 20
NO_SIDES = np.zeros(FRAMES)


def meet(rate_hz=30.0, *, passing, speed=0.6, beside=0.02, seed=0):
    """Return (time, 2, 3) two that come together along x and pass, or slow down and turn back."""
    way = speed * (np.arange(FRAMES) - MEET) / rate_hz
    along = way if passing else -np.sqrt(way**2 + 0.03**2)
    zero = np.zeros(FRAMES)
    right = np.stack([along, zero + 0.5, zero + beside / 2], axis=1)
    left = np.stack([-along, zero + 0.5, zero - beside / 2], axis=1)
    noise = np.random.default_rng(seed).normal(0.0, 0.004, (FRAMES, 2, 3))
    return np.stack([right, left], axis=1) + noise


def exchanged_after(position, frame):
    """Return positions whose two are exchanged from a frame on."""
    return np.concatenate([position[:frame], position[frame:, ::-1]])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("passing", [True, False])
def test_two_that_meet_keep_who_they_are(passing, seed):
    true = meet(passing=passing, speed=0.6 if passing else 0.15, seed=seed)
    assert not find_exchanged(true, NO_SIDES, 30.0, 0).any()
    found = find_exchanged(exchanged_after(true, MEET), NO_SIDES, 30.0, 0)
    assert (found == (np.arange(FRAMES) >= MEET))[
        [*range(MEET - 3), *range(MEET + 3, FRAMES)]
    ].all()


def test_the_initial_frame_is_right_wherever_it_is():
    mixed = exchanged_after(meet(passing=True), MEET)
    found = find_exchanged(mixed, NO_SIDES, 30.0, FRAMES - 1)
    assert found[: MEET - 3].all()
    assert not found[MEET + 3 :].any()


def test_sides_decide_where_motion_tells_nothing():
    position = meet(passing=True)
    position[MEET - 12 : MEET + 13] = 0.0  # one lump for so long that all motion is over
    for sign in (1.0, -1.0):
        aside = np.where(np.arange(FRAMES) > MEET, 0.3 * sign, 0.0)
        assert find_exchanged(position, aside, 30.0, 0)[-1] == (sign > 0)


def test_a_fast_foot_passes_one_that_stands():
    """It is never one lump with it, and far from it a frame before and after."""
    way = 2.2 * (np.arange(FRAMES) - MEET) / 30.0
    foot = np.stack([way, np.full(FRAMES, 0.1), np.zeros(FRAMES)], axis=1)
    stand = np.tile([0.0, 0.08, 0.08], (FRAMES, 1))
    true = np.stack([foot, stand], axis=1)
    assert not find_exchanged(true, NO_SIDES, 30.0, 0).any()
    found = find_exchanged(exchanged_after(true, MEET + 1), NO_SIDES, 30.0, 0)
    assert not found[:MEET].any()
    assert found[MEET + 1 :].all()


def test_one_that_is_unseen_exchanges_with_nobody():
    position = meet(passing=True, beside=0.4)
    position[MEET - 2 : MEET + 3, 0] = np.nan
    assert stretches_between(position, 30.0) == [(0, FRAMES)]
    assert not find_exchanged(position, np.full(FRAMES, 5.0), 30.0, 0).any()


def test_who_was_taken_for_whom_in_the_initial_frame_is_told_by_the_sides_of_all():
    position = meet(passing=True, beside=0.4)  # never one lump
    for aside, cost, taken in ((0.2, 5.0, True), (0.2, 50.0, False), (-0.2, 5.0, False)):
        found = find_exchanged(position, np.full(FRAMES, aside), 30.0, 0, cost)
        assert (found == taken).all()


def test_nobody_is_exchanged_where_nobody_is_seen():
    assert not find_exchanged(np.full((5, 2, 3), np.nan), np.zeros(5), 30.0, 2).any()
    assert not find_exchanged(np.zeros((5, 2, 3)), np.ones(5), 30.0, 2).any()


@pytest.mark.parametrize("rate_hz", [15.0, 60.0])
def test_what_contacts_tell_is_told_at_any_rate(rate_hz):
    position = exchanged_after(meet(rate_hz, passing=True, speed=0.6 * rate_hz / 30.0), MEET)
    assert tell_turns(position, stretches_between(position, rate_hz), rate_hz).sum() > 0.0


def test_the_likeliest_states_are_those_of_all_sequences():
    rng = np.random.default_rng(4)
    for _ in range(20):
        cost, turn = rng.normal(size=(6, 2)), rng.normal(size=5)
        totals = [
            cost[range(6), states].sum() - turn[np.diff(states) != 0].sum()
            for states in (np.array(list(np.binary_repr(n, 6)), int) for n in range(64))
        ]
        best = np.array(list(np.binary_repr(int(np.argmin(totals)), 6)), int)
        assert (choose_states(cost, turn) == best).all()
