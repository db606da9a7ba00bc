"""Tell two hands, or two feet, apart through their contacts, once for the whole take.

Where two hands meet, pass and part, one lump shows, and nothing in it says which is which. But what
moves goes on to move: the motions before a contact and after it, as they are and exchanged, are
compared as those of bodies that are pushed at random (white noise of acceleration, Kalman 1960).
Between contacts other evidence tells. The likeliest sequence over the whole take is chosen (Viterbi
1967).
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from tasks.geometry.runs import runs

Floats = NDArray[np.float64]
Stretch = tuple[int, int]
"""The first frame, and the frame after the last one."""

TOUCHING = 0.07
"""Two that are nearer are one lump [statures]. 12 cm: two feet side by side are now one lump, now
two."""

PASSING = 0.12
"""Two that come so near in a frame may have been exchanged in it [statures]. Fast feet pass each
other between two frames."""

_AROUND_S = 0.1
"""How long around that frame they are farther apart [s]. Chosen, not measured."""

_PUSHED = 1.0
"""Spectral density of acceleration [statures**2 / s**3]. With 0.5 and 2, nearly all contacts of the
captures that doubt is learned from tell the same."""

_EXACT = 0.012
"""How exact a place is, a standard deviation [statures]. 2 cm."""

_MIXED = 0.11
"""Lumps of two that are nearer push or draw each other [statures]. About the widths of the balls
that they are gathered in."""

_NOTHING_KNOWN = 3.0
"""Standard deviation of a place and of a velocity of which nothing is known [statures, and a
second]. A fast dance."""

_WINDOW_S = 0.3
"""How long before and after a contact motion is followed [s]. Chosen, not measured."""

_NEVER_ONE = 10.0
"""Cost of an exchange of two that never were one lump [nats]. What was followed in two lumps was
exchanged once in the captures that doubt is learned from and the shared ones, by feet at 4 m/s;
motion told it with 18."""

_MOST_TOLD = 12.0
"""What a contact tells at most [nats]. What was followed may be no hand at all."""


def stretches_between(position: Floats, rate_hz: float) -> list[Stretch]:
    """Return the stretches of two paths between contacts; frames with one unseen are in them.

    Parameters
    ----------
    position : (time, 2, 3) float64
        Statures; NaN where unseen.
    rate_hz
        Frames a second.
    """
    apart = np.linalg.norm(position[:, 0] - position[:, 1], axis=1)
    seen = np.flatnonzero(np.isfinite(apart))
    if not len(seen):
        return []
    way = apart[seen]
    around = max(1, round(_AROUND_S * rate_hz))
    least = way == minimum_filter1d(way, 2 * around + 1, mode="nearest")
    free = (way >= TOUCHING) & ~(least & (way < PASSING))
    return [(int(seen[first]), int(seen[end - 1]) + 1) for first, end in runs(free)]


def tell_turns(position: Floats, stretches: Sequence[Stretch], rate_hz: float) -> Floats:
    """Return (stretch - 1,) how much likelier two were exchanged between stretches [nats].

    Parameters
    ----------
    position, rate_hz
        As for `stretches_between`.
    stretches
        In their order, at least one.
    """
    found = [
        _turn(position, before, after, rate_hz)
        - _NEVER_ONE * _are_whole(position[before[1] : after[0]])
        for before, after in itertools.pairwise(stretches)
    ]
    return np.clip(np.array(found), -_MOST_TOLD, _MOST_TOLD)


def choose_states(cost: Floats, turn: Floats) -> NDArray[np.bool_]:
    """Return (stretch,) which stretches are exchanged, at the least cost of all (Viterbi).

    Parameters
    ----------
    cost : (stretch, 2) float64
        Of each as it is, and exchanged [nats]; at least one stretch.
    turn : (stretch - 1,) float64
        As `tell_turns` returns it.
    """
    total, back = cost[0].copy(), []
    for own, gain in zip(cost[1:], turn, strict=True):
        ways = total[:, None] + np.array([[0.0, -gain], [-gain, 0.0]])
        back.append(ways.argmin(axis=0))
        total = ways.min(axis=0) + own
    states = [int(total.argmin())]
    for choice in reversed(back):
        states.append(int(choice[states[-1]]))
    return np.array(states[::-1], np.bool_)


def find_exchanged(
    position: Floats, aside: Floats, rate_hz: float, initial_frame: int,
    initial_cost: float = np.inf,
) -> NDArray[np.bool_]:  # fmt: skip
    """Return (time,) in which frames two paths have each other's places.

    Parameters
    ----------
    position, rate_hz
        As for `stretches_between`.
    aside : (time,) float64
        What the sides cost as they are, less what they cost exchanged [nats].
    initial_frame
        Here the two are who they are taken for.
    initial_cost
        What it costs that they are not [nats]; by default they surely are.
    """
    exchanged = np.zeros(len(position), np.bool_)
    stretches = stretches_between(position, rate_hz)
    if not stretches or (len(stretches) < 2 and initial_cost == np.inf):
        return exchanged
    cost = np.zeros((len(stretches), 2))
    cost[:, 1] = [-aside[first:end].sum() for first, end in stretches]
    away = [max(first - initial_frame, initial_frame - end + 1, 0) for first, end in stretches]
    cost[int(np.argmin(away)), 1] += initial_cost
    states = choose_states(cost, tell_turns(position, stretches, rate_hz))
    ends = [(end + first) // 2 for (_, end), (first, _) in itertools.pairwise(stretches)]
    for state, (first, end) in zip(
        states, itertools.pairwise([0, *ends, len(position)]), strict=True
    ):
        exchanged[first:end] = state
    return exchanged


def _are_whole(position: Floats) -> bool:
    """Return whether the two are two lumps in all frames in which both are seen."""
    apart = np.linalg.norm(position[:, 0] - position[:, 1], axis=1)
    return bool((apart[np.isfinite(apart)] >= TOUCHING).all())


def _turn(position: Floats, before: Stretch, after: Stretch, rate_hz: float) -> float:
    """Return how much likelier motion is if the two are exchanged between two stretches [nats]."""
    most = max(2, round(_WINDOW_S * rate_hz))
    there = range(max(before[0], before[1] - most), before[1])
    back = range(min(after[1], after[0] + most) - 1, after[0] - 1, -1)
    first, spread = _follow(position, there, rate_hz)
    last, other = _follow(position, back, rate_hz)
    turned = np.diag([1.0, -1.0])  # followed backwards
    ahead, pushed = _go_on((after[0] - before[1] + 1) / rate_hz)
    weight = np.linalg.inv(ahead @ spread @ ahead.T + pushed + turned @ other @ turned)
    off = (turned @ last)[None] - (ahead @ first)[:, None]
    cost = 0.5 * np.einsum("pqik,ij,pqjk->pq", off, weight, off)
    return float(np.trace(cost) - cost[0, 1] - cost[1, 0])


def _follow(position: Floats, frames: range, rate_hz: float) -> tuple[Floats, Floats]:
    """Return (2, 2, 3) place and velocity of both in the last frame, and (2, 2) their spread."""
    found, spread = np.zeros((2, 2, 3)), np.eye(2) * _NOTHING_KNOWN**2
    ahead, pushed = _go_on(1.0 / rate_hz)
    for frame in frames:
        found, spread = ahead @ found, ahead @ spread @ ahead.T + pushed
        place = position[frame]
        apart = float(np.linalg.norm(place[0] - place[1]))
        if np.isfinite(apart):
            noise = _EXACT + max(_MIXED - apart, 0.0)
            gain = spread[:, :1] / (spread[0, 0] + noise**2)
            found = found + gain * (place - found[:, 0])[:, None]
            spread = spread - gain @ spread[:1]
    return found, spread


def _go_on(gone_s: float) -> tuple[Floats, Floats]:
    """Return how place and velocity go on for a time, and how far they spread meanwhile."""
    cubic, square = gone_s**3 / 3.0, gone_s**2 / 2.0
    pushed = _PUSHED * np.array([[cubic, square], [square, gone_s]])
    return np.array([[1.0, gone_s], [0.0, 1.0]]), pushed
