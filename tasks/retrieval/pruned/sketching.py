"""Guess where the best matches are: the query, warped onto the means of a few frames.

What is guessed decides how fast a search is, never what it finds.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.retrieval.pruned.pruning import COARSE, Portion, cut_ranges, spans_before
from tasks.retrieval.pruned.summaries import MEAN_STEP
from tasks.retrieval.warping import warm_up, warp_spans

_LONG = 96
"""From how many frames on a query is sketched by two blocks at a time. Chosen."""
_JOB = 1 << 14
"""How many blocks of a sketch one thread is given at a time. Chosen."""


@dataclass(frozen=True, eq=False)
class Guesses:
    """Places where a match probably ends, of one version in one portion."""

    portion: Portion
    version: int
    sample: NDArray[np.int64]
    distance: NDArray[np.float32]
    """Of the means: near the match's, mostly below it."""
    median: float
    """The median distance of all places, not only of these."""

    def keep(self, kept: NDArray[np.bool_]) -> "Guesses":
        """Return those of a mask."""
        sample, distance = self.sample[kept], self.distance[kept]
        return Guesses(self.portion, self.version, sample, distance, self.median)


def sketch_length(frames: int) -> int:
    """Return how many samples a block of the sketch has."""
    return COARSE * (2 if frames >= _LONG else 1)


def sketching_jobs(portion: Portion) -> list[tuple[int, NDArray[np.int64]]]:
    """Return what one thread sketches at a time: the version, and spans of blocks."""
    length = sketch_length(portion.frames)
    ranges = portion.ranges
    blocks = np.stack([ranges[:, 0] // length, -(-ranges[:, 1] // length)], axis=1)
    spans = cut_ranges(blocks, _JOB, -(-warm_up(portion.frames) // length))
    return [(version, part) for version in range(len(portion.clips)) for part in spans]


def sketch_job(portion: Portion, version: int, spans: NDArray[np.int64]) -> Guesses:
    """Return the best end of each part of the spans that is as long as the query."""
    query, weights, columns = portion.clips[version]
    length = sketch_length(portion.frames)
    low, high = int(spans[0, 0]), int(spans[-1, 2])
    rows = np.empty((len(columns), high - low), np.float32)
    mean = portion.segment.summaries[f"mean_{COARSE}"].view()
    mean.flags.writeable = False  # one type, mapped or not: compiled once
    _sketch(mean, columns, (low, length // COARSE), rows)
    last = (portion.segment.first + portion.segment.samples - 1)[portion.takes] // length
    rows[:, last[(last >= low) & (last < high)] - low] = np.nan  # no path goes on to the next take
    blocks = -(-len(query) // length)
    ends = np.linspace(0, len(query), blocks + 1).astype(int)
    means = np.add.reduceat(query, ends[:-1]) / np.diff(ends)[:, None].astype(np.float32)
    plain = np.stack([np.arange(len(columns)), np.full(len(columns), -1)], axis=1)
    distance, start = np.empty(high - low, np.float32), np.empty(high - low, np.int32)
    distance[:] = np.inf
    warp_spans((means.astype(np.float32), weights, plain), rows, spans - low, distance, start)
    finite = distance[np.isfinite(distance)]
    median = float(np.median(finite[::8])) if len(finite) else math.inf
    edges = np.arange(0, high - low, blocks)
    nearest = np.repeat(np.minimum.reduceat(distance, edges), np.diff(np.append(edges, high - low)))
    best = np.flatnonzero((distance == nearest) & np.isfinite(distance))
    return Guesses(portion, version, (best + low) * length, distance[best], median)


def spans_around(guesses: Guesses) -> NDArray[np.int64]:
    """Return spans of samples in which to look for the matches guessed: (begin, first end, end)."""
    length, portion = sketch_length(guesses.portion.frames), guesses.portion
    fine = np.unique(guesses.sample[:, None] + np.arange(-length, 3 * length, 4)) // 4
    samples = portion.segment.rows.shape[1]
    inside = (fine >= 0) & (4 * fine < samples)
    spans = spans_before(portion, np.unique(fine[inside]), 4) * 4
    return np.minimum(spans, samples)


@njit(cache=True, nogil=True)
def _sketch(mean: Any, columns: Any, place: Any, rows: Any) -> None:
    """Write means of one or two blocks from block `first` on, less their origin, in statures."""
    first, per = place
    last = mean.shape[1] - 1
    for c in range(len(columns)):
        out = rows[c]
        out[:] = np.float32(0)
        for side in range(2):
            row = mean[columns[c, side]]
            scale = (MEAN_STEP if side == 0 else -MEAN_STEP) / np.float32(per)
            if columns[c, side] < 0:
                continue
            if per == 1:
                for b in range(len(out)):
                    out[b] += scale * np.float32(row[first + b])
                continue
            whole = min(len(out), (last + 1) // 2 - first)  # the very last may be half a block
            pair = row[2 * first :]
            for b in range(whole):
                out[b] += scale * (np.float32(pair[2 * b]) + np.float32(pair[2 * b + 1]))
            for b in range(whole, len(out)):
                out[b] += scale * np.float32(2) * np.float32(pair[2 * b])
