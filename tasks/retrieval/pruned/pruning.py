"""Find all matches within a distance in a part of a segment, warping only where one can be.

First every end is bounded by blocks of 8 x 8 frames, then what is left by blocks of 4 x 4, and what
is left then is warped by the same kernel as in a scan, with all the frames before it in which a
match may begin: not fewer, for a scan takes the start with the least sum, be it nearer from another
start. So what is found is the scan's to the last bit. Where the first bound leaves so much that the
rest would cost more than a scan, all is scanned.

Everything here is a function of the query, a portion and a distance: portions can be searched
in any order, on any machine.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.retrieval.pruned.bounds import CoarseClip, bound_ends, coarsen, nearest_match
from tasks.retrieval.pruned.choosing import Candidates, certain_threshold, join_candidates
from tasks.retrieval.segments import Segment
from tasks.retrieval.warping import Clip, warm_up, warp_spans

COARSE, FINE = 8, 4
"""The samples of a block in the first and in the second bound."""
JOB = 1 << 16
"""How many samples one thread is given at a time, at least."""
_JOB_IN_QUERIES = 16
"""How many times as long as the query what a thread is given is at least [times]."""

_JOINT, _CELL, _COARSE_JOINT, _COARSE_CELL = 0.30, 1.05, 0.35, 7.0
"""What a joint's distance and the rest of a pair of frames cost, and of a pair of blocks. Measured,
in nanoseconds; only their ratios count."""
_NOTHING = np.empty(0)
"""Of blocks of which nothing is known yet."""
_CHEAP = 250.0
"""What a sample costs in a scan that is not worth pruning [as the costs]. Feet in 110 frames."""
_MANY = 1 << 12
"""From how many matches on only those are kept that can be among the best."""
_GAIN = 0.8
"""What pruning must be expected to cost of a scan at most. Chosen: what is expected errs."""
_CERTAIN_GAIN = 0.25
"""Up to which share of a scan even the greatest cost of pruning needs no trial. Chosen."""
_TRIED = 16
"""Of how many windows one is tried. Chosen: it costs a hundredth of a scan then."""
_WINDOW = 8
"""How long a window of a trial is [times the frames in which a match may begin]."""


@dataclass(frozen=True, eq=False)
class Portion:
    """The takes of a segment in which the same joints are compared."""

    segment: Segment
    first_number: int
    """The number of the segment's first take, among all that are searched."""
    takes: NDArray[np.int64]
    """(take,) Their places in the segment, ascending."""
    clips: Sequence[Clip]
    """The query and, where it is looked for, its mirror image, ready to be warped."""
    mirrored: Sequence[bool]
    """Which of the clips is the mirror image."""
    steps: str
    coarse: Mapping[int, Sequence[CoarseClip]]
    """The clips in blocks, by their length; empty where nothing can be bounded."""

    @property
    def ranges(self) -> NDArray[np.int64]:
        """(run, 2) The samples of takes that follow each other."""
        first = self.segment.first[self.takes]
        end = first + self.segment.samples[self.takes]
        cut = np.flatnonzero(np.diff(self.takes) > 1)
        return np.stack([first[np.r_[0, cut + 1]], end[np.r_[cut, len(end) - 1]]], axis=1)

    @property
    def samples(self) -> int:
        """How many samples are searched."""
        return int(self.segment.samples[self.takes].sum())

    @property
    def frames(self) -> int:
        """How many frames the query has."""
        return len(self.clips[0][0])


def make_portion(
    segment: Segment,
    first_number: int,
    takes: NDArray[np.int64],
    clips: Sequence[tuple[Clip, bool]],
    steps: str,
) -> Portion:
    """Return a portion; it can be bounded where its segment has summaries, and its clips allow it.

    Parameters
    ----------
    clips
        Each with whether it is the mirror image.
    """
    coarse: dict[int, Sequence[CoarseClip]] = {}
    if steps == "slope" and segment.summaries:
        for length in (COARSE, FINE):
            blocks = [coarsen(clip, length) for clip, _ in clips]
            coarse[length] = [each for each in blocks if each is not None]
        if any(len(each) < len(clips) for each in coarse.values()):
            coarse = {}
    versions, mirrored = [clip for clip, _ in clips], [mirror for _, mirror in clips]
    return Portion(segment, first_number, takes, versions, mirrored, steps, coarse)


@dataclass(frozen=True, eq=False)
class Live:
    """The blocks of a portion in which a match of one version may end."""

    portion: Portion
    version: int
    length: int
    """How many samples the blocks have."""
    block: NDArray[np.int64]
    """Ascending."""
    nearest: NDArray[np.float64]
    """How near a match that ends there is at least [statures]."""

    def keep(self, kept: NDArray[Any]) -> "Live":
        """Return those of a mask, or of places."""
        block, nearest = self.block[kept], self.nearest[kept]
        return Live(self.portion, self.version, self.length, block, nearest)

    def spans(self) -> NDArray[np.int64]:
        """Return spans of blocks, as `spans_before`."""
        return spans_before(self.portion, self.block, self.length)

    def samples(self) -> int:
        """Return how many samples there are in the spans."""
        spans = self.spans()
        return int((spans[:, 2] - spans[:, 0]).sum()) * self.length


def find_candidates(portion: Portion, threshold: float, top: int) -> Candidates:
    """Return the matches of a portion within a distance.

    This is the unit in which a search is shared out: it needs the portion and the numbers only.
    Where the matches are many, only those that can be among the `top` best are returned.

    Raises
    ------
    ArchiveError
        If what is read of the segment is not what was written.
    """
    if math.isfinite(threshold) and portion.coarse:
        live = join_live([bound_job(portion, *job, threshold) for job in bounding_jobs(portion)])
        if pays(live, threshold):
            return join_candidates([warp_live(refine(part, threshold), threshold) for part in live])
    found = [scan_job(portion, *job, threshold, top) for job in scanning_jobs(portion)]
    return join_candidates(found)


def join_live(parts: Sequence[Live]) -> list[Live]:
    """Return what the jobs left of a portion, as one for each version."""
    return [
        Live(
            parts[0].portion,
            version,
            parts[0].length,
            np.concatenate([part.block for part in parts if part.version == version]),
            np.concatenate([part.nearest for part in parts if part.version == version]),
        )
        for version in sorted({part.version for part in parts})
    ]


def is_cheap(portion: Portion) -> bool:
    """Say whether a scan costs so little that bounds gain nothing, or little."""
    return scan_cost(portion.frames, len(portion.clips[0][1])) < _CHEAP


def scan_cost(frames: int, joints: int) -> float:
    """Return what a sample costs in a scan."""
    return frames * (joints * _JOINT + _CELL)


def bound_cost(frames: int, joints: int, length: int) -> float:
    """Return what a sample costs in a bound."""
    return frames / length**2 * (joints * _COARSE_JOINT + _COARSE_CELL)


def pays(live: Sequence[Live], threshold: float, warped_share: float = 1.0) -> bool:
    """Say whether to refine what the first bound left of a portion costs less than a scan.

    How much the second bound leaves is tried on a sixteenth of it, evenly from all of the portion.

    Parameters
    ----------
    warped_share
        Which share of the pairs of frames is looked at where all is warped within the threshold.
    """
    portion = live[0].portion
    frames, joints = portion.frames, len(portion.clips[0][1])
    scan = scan_cost(frames, joints) * warped_share
    fine = bound_cost(frames, joints, FINE)
    whole = scan * portion.samples * len(live)
    looked_at = sum(part.samples() for part in live)
    if looked_at * (fine + scan) < _CERTAIN_GAIN * whole:
        return True
    if looked_at * fine > _GAIN * whole:
        return False
    window = _WINDOW * warm_up(frames) // COARSE
    tried = warped = 0
    for part in live:
        sample = part.keep(part.block // window % _TRIED == _TRIED // 2)
        tried += sample.samples()
        warped += refine(sample, threshold).samples()
    share = warped / tried if tried else 1.0
    return looked_at * (fine + share * scan) < _GAIN * whole


# ------------------------------------------------------------------ jobs


def scanning_jobs(portion: Portion) -> list[tuple[int, NDArray[np.int64]]]:
    """Return what one thread scans at a time: the version, and spans for `warp_spans`."""
    jobs = []
    for version, clip in enumerate(portion.clips):
        size = max(JOB, _JOB_IN_QUERIES * len(clip[0]))
        back = warm_up(len(clip[0]))
        cut = portion.steps == "slope"
        jobs += [(version, spans) for spans in cut_ranges(portion.ranges, size, back, cut=cut)]
    return jobs


def bounding_jobs(portion: Portion) -> list[tuple[int, NDArray[np.int64]]]:
    """Return what one thread bounds at a time: the version, and spans of blocks."""
    ranges = portion.ranges
    blocks = np.stack([ranges[:, 0] // COARSE, -(-ranges[:, 1] // COARSE)], axis=1)
    back = -(-warm_up(portion.frames) // COARSE)
    size = max(JOB, _JOB_IN_QUERIES * portion.frames) // COARSE
    spans = cut_ranges(blocks, size, back)
    return [(version, part) for version in range(len(portion.clips)) for part in spans]


def cut_ranges(
    ranges: NDArray[np.int64], size: int, back: int, *, cut: bool = True
) -> list[NDArray[np.int64]]:
    """Return spans (begin, first written, end) of about `size`, each with `back` before it."""
    length = ranges[:, 1] - ranges[:, 0]
    pieces = np.maximum(1, -(-length // size)) if cut else np.ones(len(ranges), np.int64)
    whole = np.repeat(np.arange(len(ranges)), pieces)
    place = np.arange(len(whole)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first, share, count = ranges[whole, 0], length[whole], pieces[whole]
    written, end = first + share * place // count, first + share * (place + 1) // count
    spans = np.stack([np.maximum(first, written - back), written, end], axis=1)
    group = np.cumsum(end - written) // size
    return np.split(spans, np.flatnonzero(np.diff(group)) + 1)


def scan_job(
    portion: Portion, version: int, spans: NDArray[np.int64], threshold: float, top: int
) -> Candidates:
    """Return the matches that end in spans, of those within the threshold.

    Where they are many, only those that can be among the `top` best.
    """
    distance, start = _warp(portion, version, spans, threshold)
    low, high = int(spans[0, 1]), int(spans[-1, 2])
    near = low + np.flatnonzero(distance[low:high] <= _finite(threshold))
    if len(near) > _MANY:
        edges = np.arange(low, high, 2 * portion.frames)
        nearest = np.minimum.reduceat(distance[low:high], edges - low)
        nearest = np.repeat(nearest, np.diff(np.append(edges, high)))
        best = near[distance[near] == nearest[near - low]]
        some = _candidates(portion, version, best, distance, start)
        certain = certain_threshold(some, portion.frames, top)
        near = near[distance[near] <= _finite(certain)]
    return _candidates(portion, version, near, distance, start)


def bound_job(portion: Portion, version: int, spans: NDArray[np.int64], threshold: float) -> Live:
    """Return the blocks of spans in which a match within the threshold may end."""
    ends = [np.arange(first, last) for _, first, last in spans.tolist()]
    return _bound(Live(portion, version, COARSE, np.concatenate(ends), _NOTHING), spans, threshold)


def refine(live: Live, threshold: float) -> Live:
    """Return the blocks of `FINE` samples, of live ones, in which a match may end."""
    block = live.block[live.nearest <= threshold]
    ratio = live.length // FINE
    asked = (block[:, None] * ratio + np.arange(ratio)).ravel()
    asked = asked[asked * FINE < live.portion.segment.rows.shape[1]]
    parts = Live(live.portion, live.version, FINE, asked, _NOTHING)
    return _bound(parts, parts.spans(), threshold)


def _bound(asked: Live, spans: NDArray[np.int64], threshold: float) -> Live:
    """Return those of the blocks that the bound leaves, and how near what ends there may be."""
    portion, length = asked.portion, asked.length
    clip = portion.coarse[length][asked.version]
    mean, spread = (portion.segment.summaries[f"{name}_{length}"] for name in ("mean", "spread"))
    excess = np.empty(mean.shape[1], np.float32)
    bound_ends(clip, mean, spread, spans, threshold, excess)
    block = asked.block[excess[asked.block] <= 0]
    nearest = nearest_match(clip, threshold, excess[block])
    return Live(portion, asked.version, length, block, nearest)


def warp_live(live: Live, threshold: float) -> Candidates:
    """Return the matches within the threshold that end in live blocks."""
    portion, length = live.portion, live.length
    block = live.block[live.nearest <= threshold]
    if not len(block):
        return join_candidates([])
    spans = spans_before(portion, block, length) * length
    spans[:, 2] = np.minimum(spans[:, 2], portion.segment.rows.shape[1])
    distance, start = _warp(portion, live.version, spans, threshold)
    ends = (block[:, None] * length + np.arange(length)).ravel()
    ends = ends[ends < len(distance)]
    ends = ends[distance[ends] <= _finite(threshold)]
    return _candidates(portion, live.version, ends, distance, start)


def _finite(threshold: float) -> np.float64:
    """Return a threshold that no infinite distance is within."""
    return np.float64(min(threshold, np.finfo(np.float32).max))


def _warp(
    portion: Portion, version: int, spans: NDArray[np.int64], threshold: float
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return distances and starts by sample; infinite between the spans, undefined beyond.

    What is read is checked first: what has changed could also hide a match.
    """
    samples = portion.segment.rows.shape[1]
    if portion.segment.check is not None:
        for begin, _, end in spans.tolist():
            portion.segment.check(begin, end)
    distance, start = np.empty(samples, np.float32), np.empty(samples, np.int32)
    for first, last in zip(spans[:-1, 2].tolist(), spans[1:, 1].tolist(), strict=True):
        distance[first:last] = np.inf
    rows, clip, steps = portion.segment.rows, portion.clips[version], portion.steps
    warp_spans(clip, rows, spans, distance, start, steps=steps, threshold=threshold)
    return distance, start


def _candidates(
    portion: Portion,
    version: int,
    ends: NDArray[np.int64],
    distance: NDArray[np.float32],
    start: NDArray[np.int32],
) -> Candidates:
    """Return the matches that end at samples of the segment."""
    segment = portion.segment
    take = np.searchsorted(segment.first, ends, "right") - 1
    return Candidates(
        take + portion.first_number,
        start[ends] - segment.first[take],
        ends - segment.first[take],
        distance[ends],
        np.full(len(ends), portion.mirrored[version]),
        segment.rate_hz[take],
    )


def spans_before(portion: Portion, block: NDArray[np.int64], length: int) -> NDArray[np.int64]:
    """Return spans of blocks in which every match that ends in the given blocks lies.

    Parameters
    ----------
    block
        Blocks of `length` samples, ascending.

    Returns
    -------
    (span, 3) int64
        Apart from each other: the first block, the first of the given, and the one after the last.
    """
    if not len(block):
        return np.empty((0, 3), np.int64)
    first = portion.segment.first
    begin = first[np.searchsorted(first, block * length, "right") - 1]  # no match begins before
    begin = np.maximum(begin, block * length - warm_up(portion.frames)) // length
    cut = np.flatnonzero(begin[1:] > block[:-1] + 1) + 1
    low, high = np.append(0, cut), np.append(cut, len(block)) - 1
    return np.stack([begin[low], block[low], block[high] + 1], axis=1)
