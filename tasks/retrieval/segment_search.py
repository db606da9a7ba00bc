"""Search segments of many takes for everything that moves like a query, as `search_takes` does.

The answer is that of a scan of all takes, to the last bit; how it is reached is said in `pruned`.
First the best places of a sketch are warped: what is found there is shown at once, and it gives a
distance within which the best matches are. Within it, every end is bounded; what may be a match is
warped in the order of how near it may be, so that what was found becomes certain from the nearest
on, and the distance falls for all that is left.
"""

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.retrieval.normalization import OTHER_SIDE
from tasks.retrieval.pruned import pruning, sketching
from tasks.retrieval.pruned.choosing import (
    Candidates,
    certain_threshold,
    choose_matches,
    join_candidates,
)
from tasks.retrieval.pruned.pruning import Live, Portion, make_portion
from tasks.retrieval.searching import (
    NO_SHOULDERS,
    NOTHING_IN_COMMON,
    SHOULDERS,
    Found,
    Match,
    Query,
    Version,
    about_shoulders,
    best_matches,
    check_query,
    make_clip,
    query_versions,
    say_too_short,
)
from tasks.retrieval.segments import Segment
from tasks.retrieval.warping import shortest_match
from tasks.retrieval.weighting import SearchSettings, joint_weights

_SPARE = 1.5
"""How many places are looked at first [times the matches asked for]. Chosen: some overlap."""
_FIRST_LOOK = 1 / 16
"""Which share of all samples looking at them may cost; where it is more, all is scanned."""
_HOPELESS = 0.55
"""From which threshold on all is scanned [the median distance]. Measured on real dance: bounds
leave nearly all of it from 0.6 on."""
_LEFT_EARLY = 0.4
"""Which share of the rows is warped before a tile is left, where the threshold is nothing; it grows
as the threshold over the median distance. Measured: 0.5 to 0.6 at 0.1, all at 0.6."""
_BATCHES = (0.03, 0.1, 0.2, 0.4, 0.7, 1.0)
"""Up to which shares of what is live an answer is given again. Chosen."""


def search_segments(
    query: Query,
    segments: Sequence[Segment],
    settings: SearchSettings | None = None,
    *,
    threads: int | None = None,
) -> Found:
    """Return the matches of a query in the takes of segments, those of `search_takes`.

    Parameters
    ----------
    query
        The clip to search with, from `clip_take`.
    segments
        Where to search. Those without summaries are scanned.
    threads
        How many work side by side; by default one a processor. It changes no result.

    Raises
    ------
    ValueError
        If a setting has no meaning, or the query lacks a value that would be compared.
    ArchiveError
        If what is read of a segment is not what was written.
    """
    found = Found([], {})
    for found in search_gradually(query, segments, settings, threads=threads):  # noqa: B007
        pass
    return found


def search_gradually(
    query: Query,
    segments: Sequence[Segment],
    settings: SearchSettings | None = None,
    *,
    threads: int | None = None,
) -> Iterator[Found]:
    """Yield answers that become better, the last one that of `search_segments`.

    Each holds what is found until then; its matches nearer than `certain_below` are those of the
    last answer. One may stop at any time. Parameters and errors are those of `search_segments`.
    """
    settings = settings or SearchSettings()
    weights = joint_weights(settings)
    shoulders = about_shoulders(weights)
    versions = query_versions(query, weights, mirror=settings.mirror)
    portions: list[Portion] = []
    skipped: dict[str, str] = {}
    too_short: set[str] = set()
    compared = np.zeros(len(JOINTS), bool)
    numbers = itertools.accumulate((len(s.names) for s in segments), initial=0)
    for segment, number in zip(segments, numbers, strict=False):
        comparison = _Comparison(query, versions, segment, settings, shoulders=shoulders)
        portions += comparison.portions(number)
        skipped |= comparison.skipped
        too_short |= comparison.too_short
        compared |= comparison.compared
    if portions:
        check_query(query, compared, shoulders=shoulders, path=settings.path_weight > 0)
    best = _Best(segments, settings, query.rows.shape[1])
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        for certain in _look(portions, best, pool.map):
            yield Found(best.matches(), skipped, frozenset(too_short), certain)


class _Comparison:
    """How the takes of a segment are compared with a query: by which joints, or why not."""

    def __init__(
        self,
        query: Query,
        versions: list[Version],
        segment: Segment,
        settings: SearchSettings,
        *,
        shoulders: bool,
    ) -> None:
        self._segment, self._settings, self._versions = segment, settings, versions
        self._shoulders = shoulders
        has = [(v.weights > 0) & v.joints_present & segment.joints_present for v in versions]
        in_common = np.any([joints.any(axis=1) for joints in has], axis=0)
        lacking = ~np.all(segment.joints_present[:, list(SHOULDERS)], axis=1) & shoulders
        shortest = shortest_match(query.rows.shape[1], settings.steps)
        short = segment.samples < shortest
        good = segment.searched & in_common & ~lacking & ~short
        self.skipped: dict[str, str] = {}
        for place in np.flatnonzero(segment.searched & ~good).tolist():
            if not in_common[place]:
                why = NOTHING_IN_COMMON
            elif lacking[place]:
                why = NO_SHOULDERS
            else:
                why = say_too_short(int(segment.samples[place]), shortest)
            self.skipped[segment.names[place]] = why
        self.too_short = {
            segment.names[place]
            for place in np.flatnonzero(segment.searched & in_common & short).tolist()
        }
        takes = np.flatnonzero(good)
        bits = 1 << np.arange(len(JOINTS) * len(versions), dtype=np.int64)
        patterns = np.concatenate(has, axis=1)[takes] @ bits
        self._joints: list[list[NDArray[np.bool_]]] = []
        self._takes: list[NDArray[np.int64]] = []
        self.compared = np.zeros(len(JOINTS), bool)
        for pattern in np.unique(patterns):
            self._takes.append(takes[patterns == pattern])
            self._joints.append([joints[self._takes[-1][0]] for joints in has])
            for version, joints in zip(versions, self._joints[-1], strict=True):
                self.compared |= joints[OTHER_SIDE] if version.mirrored else joints

    def portions(self, first_number: int) -> list[Portion]:
        """Return the takes with the clips that they are compared with."""
        path_weight = self._settings.path_weight
        portions = []
        for takes, has in zip(self._takes, self._joints, strict=True):
            compared = [(v, j) for v, j in zip(self._versions, has, strict=True) if j.any()]
            clips = [
                (make_clip(v, j, path_weight, shoulders=self._shoulders), v.mirrored)
                for v, j in compared
            ]
            steps = self._settings.steps
            portions.append(make_portion(self._segment, first_number, takes, clips, steps))
        return portions


class _Best:
    """The matches found until now, and the distance within which the best ones are."""

    def __init__(self, segments: Sequence[Segment], settings: SearchSettings, frames: int) -> None:
        self._segments, self._top, self._frames = segments, settings.top, frames
        self._firsts = np.cumsum([0, *(len(segment.names) for segment in segments)])
        self._found = join_candidates([])
        self.threshold = _below(settings.threshold)

    @property
    def top(self) -> int:
        """How many matches are asked for."""
        return self._top

    def add(self, candidates: Candidates) -> None:
        """Take candidates up, and drop those that are none any more."""
        found = join_candidates([self._found, candidates])
        found = found.keep(found.distance <= np.float64(self.threshold))
        certain = certain_threshold(found, self._frames, self._top)
        self.threshold = min(self.threshold, certain)
        self._found = found.keep(found.distance <= np.float64(self.threshold))

    def matches(self) -> list[Match]:
        """Return the best matches of those taken up."""
        chosen, first, last = choose_matches(self._found, self._top)
        matches = []
        for k in range(len(chosen)):
            number = int(chosen.take[k])
            place = int(np.searchsorted(self._firsts, number, "right")) - 1
            segment, take = self._segments[place], number - int(self._firsts[place])
            end = min(int(last[k]), int(segment.frames[take]) - 1)
            near, mirrored = float(chosen.distance[k]), bool(chosen.mirrored[k])
            matches.append(Match(segment.names[take], int(first[k]), end, near, mirrored))
        return best_matches(matches, self._top)


def _below(threshold: float | None) -> float:
    """Return the greatest distance, of single precision, below a threshold."""
    if threshold is None:
        return math.inf
    nearest = np.float32(threshold)
    if np.float64(nearest) >= threshold:
        nearest = np.nextafter(nearest, np.float32(-np.inf))
    return float(nearest)


Each = Callable[..., Iterable[Any]]
_Job = tuple[Portion, int, NDArray[np.int64]]
"""A version of the query, and spans of a portion that one thread looks at."""


def _look(portions: list[Portion], best: _Best, each: Each) -> Iterator[float]:
    """Take up what is found, yielding the distance below which nothing changes any more."""
    bounded = [portion for portion in portions if portion.coarse and not pruning.is_cheap(portion)]
    if bounded and not _few(bounded, best):
        yield from _prune(portions, bounded, best, each)
    else:
        _scan(portions, best, each)
    yield math.inf


def _few(bounded: list[Portion], best: _Best) -> bool:
    """Say whether there is so little to search that looking at the best places first costs much."""
    look = _SPARE * best.top * 2 * bounded[0].frames
    return look > _FIRST_LOOK * sum(portion.samples for portion in bounded)


def _scan(portions: list[Portion], best: _Best, each: Each) -> None:
    """Scan portions."""
    _scan_spans([(p, *job) for p in portions for job in pruning.scanning_jobs(p)], best, each)


def _scan_spans(jobs: list[_Job], best: _Best, each: Each) -> None:
    """Scan spans of portions."""

    def scan(job: _Job) -> Candidates:
        portion, version, spans = job
        return pruning.scan_job(portion, version, spans, best.threshold, best.top)

    for found in each(scan, jobs):
        best.add(found)


def _prune(
    portions: list[Portion], bounded: list[Portion], best: _Best, each: Each
) -> Iterator[float]:
    """Guess, bound, scan where it costs less, and warp what is left from the nearest on."""
    median = _look_first(bounded, best, each)
    yield 0.0
    if not best.threshold < _HOPELESS * median:
        _scan(portions, best, each)
        return
    threshold = best.threshold
    jobs = [(p, *job) for p in bounded for job in pruning.bounding_jobs(p)]

    def bound(job: _Job) -> Live:
        portion, version, spans = job
        return pruning.bound_job(portion, version, spans, threshold)

    left = list(each(bound, jobs))
    live: list[Live] = []
    scanned = [portion for portion in portions if portion not in bounded]
    for portion in bounded:
        parts = pruning.join_live([part for part in left if part.portion is portion])
        if pruning.pays(parts, threshold, min(1.0, _LEFT_EARLY + threshold / median)):
            live += parts
        else:
            scanned.append(portion)
    _scan(scanned, best, each)
    yield from _refine(live, best, each)


def _look_first(bounded: list[Portion], best: _Best, each: Each) -> float:
    """Warp the places where the best matches probably are; return the sketch's median distance."""
    jobs = [(p, *job) for p in bounded for job in sketching.sketching_jobs(p)]
    guesses = list(each(lambda job: sketching.sketch_job(*job), jobs))
    distance = np.concatenate([guess.distance for guess in guesses])
    count = min(len(distance), math.ceil(_SPARE * best.top))
    if not count:
        return 0.0
    limit = np.partition(distance, count - 1)[count - 1]
    looked_at: list[_Job] = []
    for guess in guesses:
        near = guess.distance <= limit
        if near.any():
            spans = sketching.spans_around(guess.keep(near))
            looked_at.append((guess.portion, guess.version, spans))
    _scan_spans(looked_at, best, each)
    return float(np.median([guess.median for guess in guesses]))


def _refine(live: list[Live], best: _Best, each: Each) -> Iterator[float]:
    """Bound what is live by smaller blocks, then warp it in the order of how near it may be."""
    jobs = [job for part in live for job in _Clusters(part).jobs()]
    parts = list(each(lambda job: pruning.refine(job, best.threshold), jobs))
    clusters = [_Clusters(part) for part in parts if len(part.block)]
    if not clusters:
        return
    nearest = np.concatenate([part.nearest for part in clusters])
    order = np.argsort(nearest, kind="stable")
    cost = np.cumsum(np.concatenate([part.samples for part in clusters])[order])
    cuts = [int(np.searchsorted(cost, share * cost[-1], "left")) + 1 for share in _BATCHES]
    offsets = np.cumsum([0, *(len(part.nearest) for part in clusters)])
    for first, last in itertools.pairwise([0, *cuts]):
        chosen = np.zeros(len(nearest), bool)
        chosen[order[first:last]] = True
        chosen &= nearest <= best.threshold
        jobs = []
        for part, (low, high) in zip(clusters, itertools.pairwise(offsets), strict=True):
            jobs += part.jobs(chosen[low:high])
        for found in each(lambda job: pruning.warp_live(job, best.threshold), jobs):
            best.add(found)
        if last < len(order):
            yield min(best.threshold, float(nearest[order[last]]))


class _Clusters:
    """Live blocks in groups that lie apart, so that nothing is looked at twice."""

    def __init__(self, live: Live) -> None:
        spans = live.spans()
        first = np.searchsorted(live.block, spans[:, 1])
        self._live, self._blocks = live, np.diff(np.append(first, len(live.block)))
        self.samples = (spans[:, 2] - spans[:, 0]) * live.length
        none = np.empty(0)
        self.nearest = np.minimum.reduceat(live.nearest, first) if len(first) else none

    def jobs(self, chosen: NDArray[np.bool_] | None = None) -> list[Live]:
        """Return the chosen clusters, or all, in parts of which one thread takes one at a time."""
        chosen = np.ones(len(self.nearest), bool) if chosen is None else chosen
        if not chosen.any():
            return []
        live = self._live.keep(np.repeat(chosen, self._blocks))
        group = np.cumsum(self.samples[chosen]) // pruning.JOB
        cuts = np.cumsum(self._blocks[chosen])[:-1][np.diff(group) > 0]
        return [live.keep(part) for part in np.split(np.arange(len(live.block)), cuts)]
