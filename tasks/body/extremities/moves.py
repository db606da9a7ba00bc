"""How a point moves from frame to frame, and what its moves cost.

In a frame a point is in one of some slots: at a candidate, or unseen where it was last seen. Costs
are negative logarithms of likelihoods; lengths are in statures.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tasks.engine.kernels import njit
from tasks.engine.settings import Count, NotNegative, Positive, Share, check_ranges

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


class Rule(NamedTuple):
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


X, Y, Z, UNSEEN, PARENT, VELOCITY = range(6)
"""The numbers of a slot. A slot is where a point may be in a frame: a candidate or a ghost. It has
its place, for how many frames it was not seen, the slot that a ghost had in the frame before (-1
for a candidate), and the velocity (3) of the best way there, statures a second."""


@njit(cache=True, nogil=True, inline="always")
def open_slots(before: Any, after: Any, spots: Any, best: Any, cost: Any, rule: Any) -> None:
    """Write the slots of a frame: its candidates, and ghosts of the best slots before."""
    seen = len(spots)
    for n in range(seen):
        for k in range(3):
            after[n, k] = spots[n, k]
        after[n, PARENT] = -1.0
    kept = _order(best)
    for n in range(len(after) - seen):
        parent = kept[n]
        for k in range(3):
            after[seen + n, k] = before[parent, k]
            after[seen + n, VELOCITY + k] = rule.lasting * before[parent, VELOCITY + k]
        after[seen + n, UNSEEN] = before[parent, UNSEEN] + 1.0
        after[seen + n, PARENT] = parent
        cost[parent, seen + n] = 0.0


@njit(cache=True, nogil=True, inline="always")
def cost_moves(before: Any, after: Any, seen: Any, cost: Any, rule: Any) -> None:
    """Write what the ways to candidates cost; ways that are too long keep infinity."""
    noise = np.sqrt(2.0) * rule.noise
    one_step = math.hypot(noise, rule.speed * rule.step_s)
    for b in range(len(before)):
        time_s = rule.step_s * (before[b, UNSEEN] + 1.0)
        settled = min(time_s, rule.settled_s)
        spread = math.hypot(noise, min(rule.speed * time_s, rule.widest))
        wide = 3 * np.log(max(spread / one_step, 1.0))
        for n in range(seen):
            x, y, z = (
                after[n, X] - before[b, X],
                after[n, Y] - before[b, Y],
                after[n, Z] - before[b, Z],
            )
            way = np.sqrt(x * x + y * y + z * z)
            x, y, z = (
                x - before[b, VELOCITY] * settled,
                y - before[b, VELOCITY + 1] * settled,
                z - before[b, VELOCITY + 2] * settled,
            )
            off = min(way, np.sqrt(x * x + y * y + z * z)) / spread
            if not way > rule.fastest * time_s + LOOSELY * rule.noise:
                cost[b, n] = min(0.5 * (off * off) + wide, rule.jump)


@njit(cache=True, nogil=True, inline="always")
def aim_slots(before: Any, after: Any, seen: Any, alone: Any, cost: Any, rule: Any) -> None:
    """Write the velocity at which the best way comes to each candidate."""
    for n in range(seen):
        source = 0
        for b in range(1, len(before)):
            if alone[b] + cost[b, n] < alone[source] + cost[source, n]:
                source = b
        time_s = rule.step_s * (before[source, UNSEEN] + 1.0)
        for k in range(3):
            after[n, VELOCITY + k] = (after[n, k] - before[source, k]) / time_s


@njit(cache=True, nogil=True, inline="always")
def cost_states(right: Any, left: Any, cost: Any, rule: Any) -> None:
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
