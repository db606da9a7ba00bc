"""The likeliest paths of two points through candidates that come and go (Viterbi 1967).

In every frame a point is at one of the frame's candidates or unseen. Unseen it is a ghost: it
keeps the place and the time at which it was last seen, from which the cost of the next place
follows. Ghosts are the places of the best paths so far, a handful; with enough of them the
result is exact. Both points together are one state, so that what they cost together counts.
Costs are negative logarithms of likelihoods; a forward and a backward pass over the same
states give the probability of each place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """How points move; lengths in statures."""

    speed: float = 0.85
    """Typical speed in statures a second, 1.4 m/s: the hands of twelve generated dancers move
    at 0.5 to 0.7 half of the time, and faster than 1.3 a tenth of it."""

    fastest: float = 6.0
    """No point moves faster than this: a thrown punch is half as fast."""

    noise: float = 0.015
    """How exact a place is: 2.5 cm."""

    widest: float = 0.3
    """Typical distance after a long time: half of an arm's reach."""

    jump: float = 8.0
    """The most that a way may cost, in nats: that of four unseen frames."""

    settled_s: float = 0.1
    """A movement goes on for this long at most: dancers' hands turn within it."""

    lasting: float = 0.7
    """How much of its velocity a point that is not seen keeps, each frame."""

    alone: float = 0.09
    """Two points that are nearer may be one: a hand's length."""

    alike: float = 0.06
    """Places this near each other say the same: 10 cm, half of a hand's length."""

    ghosts: int = 6
    """Places at which an unseen point is remembered."""


@dataclass(frozen=True, eq=False)
class _Slots:
    """Where one point may be in a frame: its candidates, then its ghosts."""

    place: Floats
    """(slot, 3)"""
    unseen: NDArray[np.intp]
    """(slot,) frames since it was seen; 0: a candidate."""
    parent: NDArray[np.intp]
    """(slot,) a ghost's slot in the frame before; -1: a candidate."""
    velocity: Floats
    """(slot, 3) statures a second, by the best way there."""


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
    """Return the likeliest paths of two points, forth and back from the initial frame.

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
        What a frame unseen costs each point, nats.
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
    position, weight = np.full((frames, 2, 3), np.nan), np.zeros((frames, 2))
    totals = np.zeros(2)
    ways = [range(initial_frame, frames), range(initial_frame, -1, -1)]
    for part in sorted((0, 1), key=lambda part: len(ways[part])):  # the longer way's start stays
        order = list(ways[part])
        chain = _Chain(place, cost, start, order, step_s, motion, unseen, together)
        position[order], weight[order], totals[part] = chain.solve()
    return position, weight, totals


class _Chain:
    """The states of all frames in one direction, and what leads from each to each."""

    def __init__(self, place, cost, start, order, step_s, motion, unseen, together) -> None:
        self.motion, self.step_s = motion, step_s
        self.slots: list[tuple[_Slots, _Slots]] = []
        self.moves: list[tuple[Floats, Floats]] = []
        self.costs: list[Floats] = []
        self.totals: list[Floats] = []
        seed = tuple(
            _Slots(s[None], np.zeros(1, np.intp), np.full(1, -1, np.intp), np.zeros((1, 3)))
            for s in start
        )
        best = np.zeros((1, 1))
        before = seed
        for t in order:
            after, moves, own = [], [], []
            for point in range(2):
                alone = best.min(axis=1 - point)
                slots = self._open(before[point], alone, place[point][t])
                after.append(slots)
                moves.append(self._moves(before[point], slots))
                self._aim(before[point], slots, alone[:, None] + moves[point])
                ghosts = len(slots.place) - len(place[point][t])
                own.append(np.concatenate([cost[point][t], np.full(ghosts, unseen[point])]))
            total = own[0][:, None] + own[1][None]
            right, left = len(place[0][t]), len(place[1][t])
            if together and right and left:
                way = np.linalg.norm(place[0][t][:, None] - place[1][t][None], axis=2)
                close = np.maximum(1.0 - (way / motion.alone) ** 2, 0.0)
                total[:right, :left] += together * close
            best = _min_plus(_min_plus(moves[0].T, best), moves[1]) + total
            self.slots.append((after[0], after[1]))
            self.moves.append((moves[0], moves[1]))
            self.costs.append(total)
            self.totals.append(best)
            before = (after[0], after[1])

    def _open(self, before: _Slots, best: Floats, place: Floats) -> _Slots:
        """Return the slots of a frame: its candidates, and ghosts of the best slots before."""
        kept = np.argsort(best, kind="stable")[: self.motion.ghosts]
        return _Slots(
            np.concatenate([place, before.place[kept]]),
            np.concatenate([np.zeros(len(place), np.intp), before.unseen[kept] + 1]),
            np.concatenate([np.full(len(place), -1, np.intp), kept]),
            np.concatenate([np.zeros_like(place), self.motion.lasting * before.velocity[kept]]),
        )

    def _aim(self, before: _Slots, after: _Slots, cost: Floats) -> None:
        """Write the velocity at which the best way comes to each candidate."""
        seen = np.flatnonzero(after.parent < 0)
        source = np.argmin(cost[:, seen], axis=0)
        time_s = self.step_s * (before.unseen[source] + 1.0)
        way = after.place[seen] - before.place[source]
        after.velocity[seen] = way / time_s[:, None]

    def _moves(self, before: _Slots, after: _Slots) -> Floats:
        """Return (slot before, slot after) what each way costs."""
        motion = self.motion
        time_s = self.step_s * (before.unseen + 1.0)[:, None]
        straight = after.place[None] - before.place[:, None]
        way = np.linalg.norm(straight, axis=2)
        carried = before.velocity * np.minimum(time_s, motion.settled_s)
        off = np.minimum(way, np.linalg.norm(straight - carried[:, None], axis=2))
        one_step = np.hypot(np.sqrt(2.0) * motion.noise, motion.speed * self.step_s)
        spread = np.hypot(
            np.sqrt(2.0) * motion.noise, np.minimum(motion.speed * time_s, motion.widest)
        )
        cost = 0.5 * (off / spread) ** 2 + 3.0 * np.log(np.maximum(spread / one_step, 1.0))
        cost = np.minimum(cost, motion.jump)
        cost[way > motion.fastest * time_s + 4.0 * motion.noise] = np.inf
        is_ghost = after.parent >= 0
        cost[:, is_ghost] = np.inf
        cost[after.parent[is_ghost], np.flatnonzero(is_ghost)] = 0.0
        return cost

    def solve(self) -> tuple[Floats, Floats, float]:
        """Return positions, weights and the cost of the best paths."""
        count = len(self.slots)
        position, weight = np.full((count, 2, 3), np.nan), np.zeros((count, 2))
        likely = self._probabilities()
        state = np.unravel_index(int(np.argmin(self.totals[-1])), self.totals[-1].shape)
        for t in range(count - 1, -1, -1):
            for point in range(2):
                slots, slot = self.slots[t][point], state[point]
                if slots.unseen[slot] == 0:
                    position[t, point] = slots.place[slot]
                    seen = slots.unseen == 0
                    near = (
                        np.linalg.norm(slots.place - slots.place[slot], axis=1) < self.motion.alike
                    )
                    weight[t, point] = likely[t].sum(axis=1 - point)[near & seen].sum()
            if t:
                moves = self.moves[t]
                way = self.totals[t - 1] + moves[0][:, state[0], None] + moves[1][None, :, state[1]]
                state = np.unravel_index(int(np.argmin(way)), way.shape)
        return position, np.clip(weight, 0.0, 1.0), float(self.totals[-1].min())

    def _probabilities(self) -> list[Floats]:
        """Return the probability of every state of every frame (forward-backward)."""
        steps = [(np.exp(-m[0]), np.exp(-m[1])) for m in self.moves]
        own = [np.exp(-(c - c.min())) for c in self.costs]
        forward, ahead = [], np.ones((1, 1))
        for (right, left), cost in zip(steps, own, strict=True):
            ahead = (right.T @ ahead @ left) * cost
            ahead = ahead / max(ahead.sum(), 1e-300)
            forward.append(ahead)
        back = np.ones_like(forward[-1])
        likely = [forward[-1]]
        for t in range(len(forward) - 1, 0, -1):
            right, left = steps[t]
            back = right @ (back * own[t]) @ left.T
            back = back / max(back.sum(), 1e-300)
            both = forward[t - 1] * back
            likely.append(both / max(both.sum(), 1e-300))
        return likely[::-1]


def _min_plus(a: Floats, b: Floats) -> Floats:
    """Return the matrix product in which sums are minima and products are sums."""
    return np.min(a[:, :, None] + b[None], axis=1)
