"""Choose the best matches of many takes, and a distance beyond which none can be among them.

Matches are chosen in the order of distance, and one that shares a frame of its take with a better
one is dropped. What is chosen of the matches within a distance does not depend on those beyond it:
so it is enough to know all within the last one's.

How near the last one is at most can be told from a few matches, if no match can share frames with
two of them: of those, each is chosen or has a better one in its place, and never the same. They
are so where more samples lie between them than the longest match has.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.retrieval.normalization import INDEX_RATE_HZ


@dataclass(frozen=True, eq=False)
class Candidates:
    """Matches that may overlap, an element each."""

    take: NDArray[np.int64]
    """A number of the take, among all that are searched."""
    start: NDArray[np.int64]
    """In samples of the take, as the end."""
    end: NDArray[np.int64]
    distance: NDArray[np.float32]
    mirrored: NDArray[np.bool_]
    rate_hz: NDArray[np.float64]
    """Frames a second of the take."""

    def __len__(self) -> int:
        return len(self.take)

    def keep(self, kept: NDArray[Any]) -> "Candidates":
        """Return those of a mask, or of places."""
        return Candidates(
            self.take[kept],
            self.start[kept],
            self.end[kept],
            self.distance[kept],
            self.mirrored[kept],
            self.rate_hz[kept],
        )


def join_candidates(parts: Sequence[Candidates]) -> Candidates:
    """Return many candidates as one."""
    none = np.empty(0, np.int64)
    nothing = Candidates(none, none, none, np.empty(0, np.float32), none > 0, none / 1.0)
    every = [nothing, *parts]
    return Candidates(
        np.concatenate([part.take for part in every]),
        np.concatenate([part.start for part in every]),
        np.concatenate([part.end for part in every]),
        np.concatenate([part.distance for part in every]),
        np.concatenate([part.mirrored for part in every]),
        np.concatenate([part.rate_hz for part in every]),
    )


def frames_of_samples(
    samples: NDArray[np.int64], rate_hz: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the frames nearest to samples, as `normalization.frame_of_sample`."""
    return np.floor(samples * rate_hz / INDEX_RATE_HZ + 0.5).astype(np.int64)


def choose_matches(
    candidates: Candidates, top: int
) -> tuple[Candidates, NDArray[np.int64], NDArray[np.int64]]:
    """Return the nearest candidates that share no frame, and the frames of each.

    Returns
    -------
    chosen
        The `top` nearest, and all that are as near as the last of them: by distance, then start,
        then end.
    first, last : (match,) int64
        The frames of their takes.
    """
    order = np.lexsort((candidates.mirrored, candidates.end, candidates.start, candidates.distance))
    ordered = candidates.keep(order)
    first, last = (
        frames_of_samples(side, ordered.rate_hz) for side in (ordered.start, ordered.end)
    )
    chosen = _choose(ordered, first, last, np.zeros(len(order), np.int64), top, ties=True)
    return ordered.keep(chosen), first[chosen], last[chosen]


def certain_threshold(candidates: Candidates, frames: int, top: int) -> float:
    """Return a distance within which the `top` best matches are, infinite where none is known.

    Parameters
    ----------
    frames
        The length of the query.
    """
    if len(candidates) < top:
        return math.inf
    ordered = candidates.keep(np.argsort(candidates.distance, kind="stable"))
    shared = np.ceil(INDEX_RATE_HZ / ordered.rate_hz).astype(np.int64)  # samples of a frame
    gap = 2 * frames + 2 * shared + 2
    chosen = _choose(ordered, ordered.start, ordered.end, gap, top, ties=False)
    return float(ordered.distance[chosen[-1]]) if len(chosen) == top else math.inf


def _choose(
    ordered: Candidates,
    low: NDArray[np.int64],
    high: NDArray[np.int64],
    gap: NDArray[np.int64],
    top: int,
    *,
    ties: bool,
) -> NDArray[np.int64]:
    """Return the places of those that no better one overlaps, in order."""
    if not len(ordered):
        return np.empty(0, np.int64)
    chosen = np.empty(len(ordered) if ties else min(top, len(ordered)), np.int64)
    arrays = ordered.take, low, high, gap, ordered.distance
    count = _choose_disjoint(arrays, top, ties, chosen)
    return chosen[:count]


@njit(cache=True, nogil=True)
def _choose_disjoint(arrays: Any, top: Any, ties: Any, chosen: Any) -> Any:
    """Choose what is `gap` away from all chosen before it; return how many were chosen.

    `by_place` holds those chosen by take and place, so that only two neighbors are looked at.
    """
    take, low, high, gap, distance = arrays
    by_place = np.empty(len(chosen), np.int64)
    count = 0
    for c in range(len(take)):
        if count >= top and not (ties and distance[c] == distance[chosen[top - 1]]):
            break
        a, b = 0, count
        while a < b:
            middle = (a + b) // 2
            m = by_place[middle]
            if take[m] < take[c] or (take[m] == take[c] and low[m] <= low[c]):
                a = middle + 1
            else:
                b = middle
        if a > 0:
            m = by_place[a - 1]
            if take[m] == take[c] and high[m] + gap[c] >= low[c]:
                continue
        if a < count:
            m = by_place[a]
            if take[m] == take[c] and low[m] <= high[c] + gap[c]:
                continue
        for k in range(count, a, -1):
            by_place[k] = by_place[k - 1]
        by_place[a] = c
        chosen[count] = c
        count += 1
    return count
