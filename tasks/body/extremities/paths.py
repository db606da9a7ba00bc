"""The likeliest paths of two points through candidates that come and go (Viterbi 1967).

In every frame a point is at one of the frame's candidates or unseen. Unseen it is a ghost: it
keeps the place and the time at which it was last seen, from which the cost of the next place
follows. Ghosts are the places of the best paths so far, a handful; with enough of them the
result is exact. Both points together are one state, so that what they cost together counts.
Costs are negative logarithms of likelihoods; a forward and a backward pass over the same
states give the probability of each place.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.engine.settings import Count, NotNegative, Positive, Share, check_ranges

Floats = NDArray[np.float64]


PACE_HZ = 30.0
"""Frames a second for which costs of a frame are given. They are chosen for films of this rate; at
another rate a frame costs in proportion to how long it lasts."""

FARTHEST_ASIDE = 1.5
"""How far to a side a place counts at most [typical distances to its side]. Chosen by eye on the
shared captures; not measured."""

LOOSELY = 4.0
"""How many times as far as a place is exact a way may exceed the fastest. 1 in 16 000 places is so
far off."""


@dataclass(frozen=True)
class Motion:
    """How points move; lengths in statures.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    speed: Positive = 0.85
    """Typical speed [statures a second]. 1.4 m/s: the hands of twelve generated dancers move at 0.5
    to 0.7 half of the time, and faster than 1.3 a tenth of it."""

    fastest: Positive = 6.0
    """The most a point moves [statures a second]. A thrown punch is half as fast."""

    noise: Positive = 0.015
    """How exact a place is, a standard deviation [statures]. 2.5 cm."""

    widest: Positive = 0.3
    """Typical distance after a long time [statures]. Half of an arm's reach."""

    jump: Positive = 8.0
    """The most that a way may cost [nats]. As much as four unseen frames."""

    settled_s: NotNegative = 0.1
    """How long a movement goes on at most. Dancers' hands turn within it."""

    lasting: Share = 0.7
    """How much of its velocity a point that is not seen keeps, each frame. Chosen by eye on the
    shared captures; not measured."""

    alone: Positive = 0.09
    """How near two points may be one [statures]. A hand's length."""

    alike: Positive = 0.06
    """How near each other places say the same [statures]. 10 cm, half of a hand's length."""

    ghosts: Count = 6
    """Places at which an unseen point is remembered. Chosen by eye on the shared captures; not
    measured."""

    def __post_init__(self) -> None:
        check_ranges(self)


class _Rule(NamedTuple):
    """How points move, and what costs what, as numbers for kernels."""

    step_s: float
    speed: float
    fastest: float
    noise: float
    widest: float
    jump: float
    settled_s: float
    lasting: float
    alone: float
    alike: float
    ghosts: int
    unseen: tuple[float, float]
    together: float


_X, _Y, _Z, _UNSEEN, _PARENT, _VELOCITY = range(6)
"""The numbers of a slot. A slot is where a point may be in a frame: a candidate or a ghost. It has
its place, for how many frames it was not seen, the slot that a ghost had in the frame before (-1
for a candidate), and the velocity (3) of the best way there, statures a second."""


def best_paths(
    place: tuple[Sequence[Floats], Sequence[Floats]],
    cost: tuple[Sequence[Floats], Sequence[Floats]],
    start: tuple[Floats, Floats],
    initial_frame: int,
    step_s: float,
    motion: Motion,
    unseen: tuple[float, float],
    *,
    together: float = 0.0,
) -> tuple[Floats, Floats, Floats]:
    """Return the likeliest paths of two points, forward and backward from the initial frame.

    Parameters
    ----------
    place
        For each point, for each frame, (candidate, 3) places in statures.
    cost
        For each point, for each frame, (candidate,) nats each costs.
    start
        (3,) where each point is in the initial frame; NaN: there is no such point.
    initial_frame
        From here paths run to the end, and back to the beginning.
    step_s
        Seconds a frame.
    motion
        How points move.
    unseen
        What a frame in which it is not seen costs each point, nats.
    together
        What a frame costs in which both are at one place.

    Returns
    -------
    position : (time, 2, 3) float64
        Statures; NaN where unseen.
    weight : (time, 2) float64
        Probability that the point is there, or as near as `Motion.alike`.
    cost : (2,) float64
        What the paths cost from the initial frame on, and back from it.
    """
    frames = len(place[0])
    begin = np.zeros((2, frames + 1), np.int64)
    begin[0, 1:], begin[1, 1:] = (np.cumsum([len(spots) for spots in own]) for own in place)
    begin[1] += begin[0, -1]
    candidate = np.column_stack(
        [np.concatenate([*place[0], *place[1]]), np.concatenate([*cost[0], *cost[1]])]
    ).astype(np.float64)
    rule = _Rule(
        float(step_s), motion.speed, motion.fastest, motion.noise, motion.widest, motion.jump,
        motion.settled_s, motion.lasting, motion.alone, motion.alike, motion.ghosts,
        (float(unseen[0]), float(unseen[1])), float(together),
    )  # fmt: skip
    position, weight = np.full((frames, 2, 3), np.nan), np.zeros((frames, 2))
    totals = np.zeros(2)
    ways = [range(initial_frame, frames), range(initial_frame, -1, -1)]
    for part in sorted((0, 1), key=lambda part: len(ways[part])):  # the longer way's start stays
        order = np.array(ways[part])
        first, moves, states = _lay_out(begin, order, rule.ghosts)
        slot, move, own, best = _walk(
            candidate, begin, order, np.array(start, np.float64), (first, moves, states), rule
        )
        likely = _probabilities(first, moves, states, move, own)
        path = _trace((first, moves, states), move, best)
        position[order], weight[order] = _read(slot, first, states, likely, path, rule.alike)
        totals[part] = best[states[-2] :].min()
    return position, weight, totals


@njit(cache=True, nogil=True)
def _lay_out(begin: Any, order: Any, ghosts: Any) -> Any:
    """Return where each frame's slots and moves of both points, and its states, begin.

    The first frame is what the points start from; frames that are walked through follow.
    """
    frames = len(order)
    count = np.ones((2, frames + 1), np.int64)
    for t in range(frames):
        for point in range(2):
            found = begin[point, order[t] + 1] - begin[point, order[t]]
            count[point, t + 1] = found + min(ghosts, count[point, t])
    first, moves = np.zeros((2, frames + 2), np.int64), np.zeros((2, frames + 2), np.int64)
    states = np.zeros(frames + 2, np.int64)
    for t in range(frames + 1):
        for point in range(2):
            first[point, t + 1] = first[point, t] + count[point, t]
            before = count[point, t - 1] if t else 0
            moves[point, t + 1] = moves[point, t] + before * count[point, t]
        states[t + 1] = states[t] + count[0, t] * count[1, t]
    for t in range(frames + 2):
        first[1, t] += first[0, -1]
        moves[1, t] += moves[0, -1]
    return first, moves, states


@njit(cache=True, nogil=True)
def _walk(candidate: Any, begin: Any, order: Any, start: Any, layout: Any, rule: Any) -> Any:
    """Return the slots, the costs of moves and states, and that of the best way to each state."""
    first, moves, states = layout
    slot, move = np.zeros((first[1, -1], _VELOCITY + 3)), np.full(moves[1, -1], np.inf)
    own, best = np.zeros(states[-1]), np.zeros(states[-1])
    for point in range(2):
        for k in range(_UNSEEN):
            slot[first[point, 0], k] = start[point, k]
        slot[first[point, 0], _PARENT] = -1.0
    for t in range(1, len(order) + 1):
        found = np.empty((2, 2), np.int64)
        for point in range(2):
            found[point, 0], found[point, 1] = (
                begin[point, order[t - 1]],
                begin[point, order[t - 1] + 1],
            )
            last = best[states[t - 1] : states[t]].reshape(
                first[0, t] - first[0, t - 1], first[1, t] - first[1, t - 1]
            )
            alone = _least(last, point)
            before = slot[first[point, t - 1] : first[point, t]]
            after = slot[first[point, t] : first[point, t + 1]]
            cost = move[moves[point, t] : moves[point, t + 1]].reshape(len(before), len(after))
            spots = candidate[found[point, 0] : found[point, 1]]
            _open(before, after, spots, alone, cost, rule)
            _cost_moves(before, after, len(spots), cost, rule)
            _aim(before, after, len(spots), alone, cost, rule)
        here = own[states[t] : states[t + 1]].reshape(
            first[0, t + 1] - first[0, t], first[1, t + 1] - first[1, t]
        )
        _cost_states(
            candidate[found[0, 0] : found[0, 1]], candidate[found[1, 0] : found[1, 1]], here, rule
        )
        _add_steps(first, moves, states, move, t, best)
        for n in range(states[t], states[t + 1]):
            best[n] += own[n]
    return slot, move, own, best


@njit(cache=True, nogil=True, inline="always")
def _least(best: Any, point: Any) -> Any:
    """Return the least cost of each slot of a point, wherever the other point is."""
    alone = np.full(best.shape[point], np.inf)
    for i in range(best.shape[0]):
        for j in range(best.shape[1]):
            k = j if point else i
            alone[k] = min(alone[k], best[i, j])
    return alone


@njit(cache=True, nogil=True, inline="always")
def _order(cost: Any) -> Any:
    """Return the numbers of some costs, the least first, equal ones as they come."""
    order = np.empty(len(cost), np.int64)
    for n in range(len(cost)):
        k = n
        while k > 0 and cost[n] < cost[order[k - 1]]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = n
    return order


@njit(cache=True, nogil=True, inline="always")
def _open(before: Any, after: Any, spots: Any, best: Any, cost: Any, rule: Any) -> None:
    """Write the slots of a frame: its candidates, and ghosts of the best slots before."""
    seen = len(spots)
    for n in range(seen):
        for k in range(3):
            after[n, k] = spots[n, k]
        after[n, _PARENT] = -1.0
    kept = _order(best)
    for n in range(len(after) - seen):
        parent = kept[n]
        for k in range(3):
            after[seen + n, k] = before[parent, k]
            after[seen + n, _VELOCITY + k] = rule.lasting * before[parent, _VELOCITY + k]
        after[seen + n, _UNSEEN] = before[parent, _UNSEEN] + 1.0
        after[seen + n, _PARENT] = parent
        cost[parent, seen + n] = 0.0


@njit(cache=True, nogil=True, inline="always")
def _cost_moves(before: Any, after: Any, seen: Any, cost: Any, rule: Any) -> None:
    """Write what the ways to candidates cost; ways that are too long keep infinity."""
    noise = np.sqrt(2.0) * rule.noise
    one_step = math.hypot(noise, rule.speed * rule.step_s)
    for b in range(len(before)):
        time_s = rule.step_s * (before[b, _UNSEEN] + 1.0)
        settled = min(time_s, rule.settled_s)
        spread = math.hypot(noise, min(rule.speed * time_s, rule.widest))
        wide = 3 * np.log(max(spread / one_step, 1.0))
        for n in range(seen):
            x, y, z = (
                after[n, _X] - before[b, _X],
                after[n, _Y] - before[b, _Y],
                after[n, _Z] - before[b, _Z],
            )
            way = np.sqrt(x * x + y * y + z * z)
            x, y, z = (
                x - before[b, _VELOCITY] * settled,
                y - before[b, _VELOCITY + 1] * settled,
                z - before[b, _VELOCITY + 2] * settled,
            )
            off = min(way, np.sqrt(x * x + y * y + z * z)) / spread
            if not way > rule.fastest * time_s + LOOSELY * rule.noise:
                cost[b, n] = min(0.5 * (off * off) + wide, rule.jump)


@njit(cache=True, nogil=True, inline="always")
def _aim(before: Any, after: Any, seen: Any, alone: Any, cost: Any, rule: Any) -> None:
    """Write the velocity at which the best way comes to each candidate."""
    for n in range(seen):
        source = 0
        for b in range(1, len(before)):
            if alone[b] + cost[b, n] < alone[source] + cost[source, n]:
                source = b
        time_s = rule.step_s * (before[source, _UNSEEN] + 1.0)
        for k in range(3):
            after[n, _VELOCITY + k] = (after[n, k] - before[source, k]) / time_s


@njit(cache=True, nogil=True, inline="always")
def _cost_states(right: Any, left: Any, cost: Any, rule: Any) -> None:
    """Write what each pair of slots costs by itself, of candidates and of unseen points."""
    for i in range(cost.shape[0]):
        for j in range(cost.shape[1]):
            cost[i, j] = right[i, 3] if i < len(right) else rule.unseen[0]
            cost[i, j] += left[j, 3] if j < len(left) else rule.unseen[1]
            if rule.together and i < len(right) and j < len(left):
                x, y, z = (
                    right[i, 0] - left[j, 0],
                    right[i, 1] - left[j, 1],
                    right[i, 2] - left[j, 2],
                )
                way = np.sqrt(x * x + y * y + z * z) / rule.alone
                cost[i, j] += rule.together * max(1.0 - way * way, 0.0)


@njit(cache=True, nogil=True, inline="always")
def _add_steps(first: Any, moves: Any, states: Any, move: Any, t: Any, best: Any) -> None:
    """Write what the best way to each state of a frame costs, without the state's own cost."""
    k, m = first[0, t] - first[0, t - 1], first[1, t] - first[1, t - 1]
    i, j = first[0, t + 1] - first[0, t], first[1, t + 1] - first[1, t]
    right = move[moves[0, t] : moves[0, t + 1]].reshape(k, i)
    left = move[moves[1, t] : moves[1, t + 1]].reshape(m, j)
    last = best[states[t - 1] : states[t]].reshape(k, m)
    after = best[states[t] : states[t + 1]].reshape(i, j)
    half = np.full((i, m), np.inf)
    for b in range(k):
        for n in range(i):
            for o in range(m):
                half[n, o] = min(half[n, o], right[b, n] + last[b, o])
    after[:] = np.inf
    for n in range(i):
        for b in range(m):
            for o in range(j):
                after[n, o] = min(after[n, o], half[n, b] + left[b, o])


@njit(cache=True, nogil=True)
def _probabilities(first: Any, moves: Any, states: Any, move: Any, own: Any) -> Any:
    """Return the probability of every state of every frame (forward-backward)."""
    chance, likely, ahead = np.exp(-move), np.ones(states[-1]), np.ones((1, 1))
    frames = len(states) - 2
    for t in range(1, frames + 1):
        right, left, here = _part(first, moves, states, chance, own, t)
        ahead = (right.T.copy() @ ahead @ left) * here
        ahead /= max(ahead.sum(), 1e-300)
        flat = ahead.ravel()
        for n in range(len(flat)):
            likely[states[t] + n] = flat[n]
    back = np.ones_like(ahead)
    for t in range(frames, 1, -1):
        right, left, here = _part(first, moves, states, chance, own, t)
        back = right @ (back * here) @ left.T.copy()
        back /= max(back.sum(), 1e-300)
        both, flat = likely[states[t - 1] : states[t]], back.ravel()
        for n in range(len(both)):
            both[n] *= flat[n]
        both /= max(both.sum(), 1e-300)
    return likely


@njit(cache=True, nogil=True)
def _part(first: Any, moves: Any, states: Any, chance: Any, own: Any, t: Any) -> Any:
    """Return the chances of both points' moves to a frame, and of its states."""
    k, m = first[0, t] - first[0, t - 1], first[1, t] - first[1, t - 1]
    i, j = first[0, t + 1] - first[0, t], first[1, t + 1] - first[1, t]
    cost = own[states[t] : states[t + 1]]
    return (
        chance[moves[0, t] : moves[0, t + 1]].reshape(k, i),
        chance[moves[1, t] : moves[1, t + 1]].reshape(m, j),
        np.exp(-(cost - cost.min())).reshape(i, j),
    )


@njit(cache=True, nogil=True)
def _trace(layout: Any, move: Any, best: Any) -> Any:
    """Return (time, 2) the slots of the best path."""
    first, moves, states = layout
    frames = len(states) - 2
    path = np.empty((frames, 2), np.int64)
    wide = first[1, frames + 1] - first[1, frames]
    last = np.argmin(best[states[frames] :])
    for t in range(frames, 0, -1):
        path[t - 1, 0], path[t - 1, 1] = last // wide, last % wide
        after = (first[0, t + 1] - first[0, t], wide)
        wide = first[1, t] - first[1, t - 1]
        least, last = np.inf, 0
        for n in range(states[t] - states[t - 1]):
            cost = best[states[t - 1] + n]
            cost += move[moves[0, t] + n // wide * after[0] + path[t - 1, 0]]
            cost += move[moves[1, t] + n % wide * after[1] + path[t - 1, 1]]
            if cost < least:
                least, last = cost, n
    return path


@njit(cache=True, nogil=True)
def _read(slot: Any, first: Any, states: Any, likely: Any, path: Any, alike: Any) -> Any:
    """Return (time, 2, 3) the places of a path, NaN where unseen, and (time, 2) their weights."""
    position, weight = np.full((len(path), 2, 3), np.nan), np.zeros((len(path), 2))
    for t in range(1, len(path) + 1):
        wide = first[1, t + 1] - first[1, t]
        chance = likely[states[t] : states[t + 1]].reshape(-1, wide)
        for point in range(2):
            own = slot[first[point, t] : first[point, t + 1]]
            chosen = path[t - 1, point]
            if own[chosen, _UNSEEN]:
                continue
            for k in range(_UNSEEN):
                position[t - 1, point, k] = own[chosen, k]
            for n in range(len(own)):
                x, y, z = (
                    own[n, 0] - own[chosen, 0],
                    own[n, 1] - own[chosen, 1],
                    own[n, 2] - own[chosen, 2],
                )
                if not own[n, _UNSEEN] and np.sqrt(x * x + y * y + z * z) < alike:
                    weight[t - 1, point] += chance[:, n].sum() if point else chance[n].sum()
            weight[t - 1, point] = min(weight[t - 1, point], 1.0)
    return position, weight
