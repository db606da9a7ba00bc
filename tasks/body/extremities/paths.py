"""The likeliest paths of two points through candidates that come and go (Viterbi 1967).

In every frame a point is at one of the frame's candidates or unseen. Unseen it is a ghost: it
keeps the place and the time at which it was last seen, from which the cost of the next place
follows. Ghosts are the places of the best paths so far, a handful; with enough of them the
result is exact. Both points together are one state, so that what they cost together counts.
Costs are negative logarithms of likelihoods; a forward and a backward pass over the same
states give the probability of each place.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.extremities.moves import (
    PARENT,
    UNSEEN,
    VELOCITY,
    Motion,
    Rule,
    aim_slots,
    cost_moves,
    cost_states,
    open_slots,
)
from tasks.engine.kernels import njit

Floats = NDArray[np.float64]

PACE_HZ = 30.0
"""Frames a second for which costs of a frame are given. They are chosen for films of this rate; at
another rate a frame costs in proportion to how long it lasts."""

FARTHEST_ASIDE = 1.5
"""How far to a side a place counts at most [typical distances to its side]. Chosen by eye on the
shared captures; not measured."""


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
    rule = Rule(
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
    slot, move = np.zeros((first[1, -1], VELOCITY + 3)), np.full(moves[1, -1], np.inf)
    own, best = np.zeros(states[-1]), np.zeros(states[-1])
    for point in range(2):
        for k in range(UNSEEN):
            slot[first[point, 0], k] = start[point, k]
        slot[first[point, 0], PARENT] = -1.0
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
            open_slots(before, after, spots, alone, cost, rule)
            cost_moves(before, after, len(spots), cost, rule)
            aim_slots(before, after, len(spots), alone, cost, rule)
        here = own[states[t] : states[t + 1]].reshape(
            first[0, t + 1] - first[0, t], first[1, t + 1] - first[1, t]
        )
        cost_states(
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
            if own[chosen, UNSEEN]:
                continue
            for k in range(UNSEEN):
                position[t - 1, point, k] = own[chosen, k]
            for n in range(len(own)):
                x, y, z = (
                    own[n, 0] - own[chosen, 0],
                    own[n, 1] - own[chosen, 1],
                    own[n, 2] - own[chosen, 2],
                )
                if not own[n, UNSEEN] and np.sqrt(x * x + y * y + z * z) < alike:
                    weight[t - 1, point] += chance[:, n].sum() if point else chance[n].sum()
            weight[t - 1, point] = min(weight[t - 1, point], 1.0)
    return position, weight
