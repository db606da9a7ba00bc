"""Search takes for everything that moves like a query (retrieval paper, section 3).

Distance of two poses (3.2): d = sum_k w_k |p_k - q_k| / sum_k w_k over the joints with weight
that both takes have, in statures, normalized about the hips, or about the shoulders where
only arm, hand or head joints have weight (3.3). With a path weight, the distance of the path
channels is added; with `mirror`, the query's mirror image is searched for as well. Both go
beyond the paper.
"""

import itertools
import math
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.motion.stature import joints_present
from tasks.retrieval.normalization import (
    INDEX_RATE_HZ,
    OTHER_SIDE,
    PARTS,
    PATH_ROWS,
    SHOULDER_ROWS,
    clip_samples,
    frame_of_sample,
    mirror_rows,
    pack_motion,
)
from tasks.retrieval.segments import PackedTake
from tasks.retrieval.warping import Clip, select_matches, shortest_match, warm_up, warp
from tasks.retrieval.weighting import SearchSettings, joint_weights

_UPPER_JOINTS = {*PARTS["arms"], *PARTS["head"]}
SHOULDERS = tuple(JOINTS.index(name) for name in ("RShoulder", "LShoulder"))
_HIPS = tuple(JOINTS.index(name) for name in ("RHip", "LHip"))
NOTHING_IN_COMMON = "it has no joint with weight that the query has too"
NO_SHOULDERS = "it lacks a shoulder, and the arms and head are compared from the shoulders"
_PIECE = 1 << 12
"""How many samples a piece of a take has at least. A longer take is cut for several threads."""
_PIECE_IN_QUERIES = 16
"""How many times as long as the query a piece is at least [times]. Warming up costs a piece an
eighth at most then."""


@dataclass(frozen=True, eq=False)
class Query:
    """A clip of a take, to search with."""

    rows: NDArray[np.float32]
    """(row, sample) of the clip."""
    joints_present: NDArray[np.bool_]
    """(21,) of the whole take."""
    name: str = "query"
    """What an error calls it."""
    start: int = 0
    """The first frame of the clip, in the frames of its take."""
    rate_hz: float = INDEX_RATE_HZ
    """Frames a second of its take."""


@dataclass(frozen=True)
class Match:
    """A clip found, in the frames of its take."""

    take: str
    start: int
    end: int
    distance: float
    mirrored: bool = False


@dataclass(frozen=True)
class Found:
    """What a search found, and what it could not look at."""

    matches: list[Match]
    """By distance, then take, then start."""
    skipped: dict[str, str]
    """Why a take could not be compared, by its name."""
    too_short: frozenset[str] = frozenset()
    """Those of them that are whole, and in which no match can be."""
    certain_below: float = math.inf
    """Every match nearer than this is found, and stays: infinite when the search is done."""


@dataclass(frozen=True, eq=False)
class Version:
    """The query as danced, or its mirror image."""

    rows: NDArray[np.float32]
    weights: NDArray[np.float32]
    joints_present: NDArray[np.bool_]
    mirrored: bool


def clip_take(take: PackedTake, start: int, end: int) -> Query:
    """Return the clip of frames `start` to `end`, inclusive, of a take as a query.

    Raises
    ------
    ValueError
        If the clip is empty or reaches beyond the take.
    """
    first, last = clip_samples(start, end, take.rate_hz, take.frames)
    rows = take.rows[:, first : last + 1]
    return Query(rows, take.joints_present, f"{take.name}:{start}-{end}", start, take.rate_hz)


def clip_motion(
    position: NDArray[np.floating],
    rate_hz: float,
    stature_m: float,
    clip: tuple[int, int] | None = None,
    *,
    name: str = "query",
) -> Query:
    """Return a clip of a motion that is in no archive as a query, by default all of it.

    Parameters
    ----------
    position : (time, 21, 3) float, m
        The whole motion; NaN where a joint is missing.
    stature_m
        The stature of its dancer.
    clip
        The first and last frame.

    Raises
    ------
    ValueError
        If the clip, the rate or the stature is impossible.
    """
    rows = pack_motion(position, rate_hz, stature_m)
    frames = len(position)
    take = PackedTake(name, rows, rate_hz, frames, joints_present(position))
    return clip_take(take, *(clip or (0, frames - 1)))


def search_takes(
    query: Query,
    takes: Iterable[PackedTake],
    settings: SearchSettings | None = None,
    *,
    threads: int | None = None,
) -> Found:
    """Return the matches of a query in takes.

    Parameters
    ----------
    query
        The clip to search with, from `clip_take`.
    takes
        Where to search; the query's own take may be among them, and its clip is then found
        with distance 0.
    threads
        How many work side by side; by default one a processor. It changes no result.

    Raises
    ------
    ValueError
        If a setting has no meaning, or the query lacks a value that would be compared.
    """
    settings = settings or SearchSettings()
    weights = joint_weights(settings)
    shoulders = about_shoulders(weights)
    versions = query_versions(query, weights, mirror=settings.mirror)
    searched: list[tuple[PackedTake, list[tuple[Clip, bool]]]] = []
    skipped: dict[str, str] = {}
    too_short: set[str] = set()
    compared = np.zeros(len(JOINTS), bool)
    for take in takes:
        common = [(v, (v.weights > 0) & v.joints_present & take.joints_present) for v in versions]
        in_common = any(joints.any() for _, joints in common)
        why = _why_not(query, take, settings.steps, shoulders=shoulders, in_common=in_common)
        if why:
            skipped[take.name] = why
            if in_common and _is_too_short(query, take, settings.steps):
                too_short.add(take.name)
            continue
        clips = []
        for version, joints in common:
            if joints.any():
                compared |= joints[OTHER_SIDE] if version.mirrored else joints
                clip = make_clip(version, joints, settings.path_weight, shoulders=shoulders)
                clips.append((clip, version.mirrored))
        searched.append((take, clips))
    if searched:
        check_query(query, compared, shoulders=shoulders, path=settings.path_weight > 0)
    matches = _search_all(searched, settings, threads or os.cpu_count() or 1)
    return Found(best_matches(matches, settings.top), skipped, frozenset(too_short))


def best_matches(matches: Iterable[Match], top: int) -> list[Match]:
    """Return at most so many matches in the order of an answer: distance, then take, then start."""
    return sorted(matches, key=lambda match: (match.distance, match.take, match.start))[:top]


def about_shoulders(weights: NDArray[np.float32]) -> bool:
    """Say whether the origin is the shoulders: only arm, hand and head joints have weight."""
    return {JOINTS[k] for k in np.flatnonzero(weights)} <= _UPPER_JOINTS


def query_versions(query: Query, weights: NDArray[np.float32], *, mirror: bool) -> list[Version]:
    """Return the query, and its mirror image if that is searched for too."""
    versions = [Version(query.rows, weights, query.joints_present, False)]
    if mirror:
        other = weights[OTHER_SIDE], query.joints_present[OTHER_SIDE]
        versions.append(Version(mirror_rows(query.rows), *other, True))
    return versions


def _why_not(
    query: Query, take: PackedTake, steps: str, *, shoulders: bool, in_common: bool
) -> str | None:
    """Return why a take cannot be searched, or None."""
    if not in_common:
        return NOTHING_IN_COMMON
    if shoulders and not take.joints_present[list(SHOULDERS)].all():
        return NO_SHOULDERS
    if _is_too_short(query, take, steps):
        return say_too_short(take.rows.shape[1], shortest_match(query.rows.shape[1], steps))
    return None


def say_too_short(samples: int, shortest: int) -> str:
    """Return why a take of that many samples cannot be searched for matches of that many."""
    return (
        f"it is too short: {samples / INDEX_RATE_HZ:.1f} s, and the shortest "
        f"match of this query has {shortest / INDEX_RATE_HZ:.1f} s"
    )


def _is_too_short(query: Query, take: PackedTake, steps: str) -> bool:
    """Say whether a take is shorter than every match of the query."""
    return take.rows.shape[1] < shortest_match(query.rows.shape[1], steps)


def make_clip(
    version: Version, joints: NDArray[np.bool_], path_weight: float, *, shoulders: bool
) -> Clip:
    """Return a query ready to be warped: the rows of these joints, and of the path."""
    chosen = np.flatnonzero(joints)
    row = (3 * chosen[:, None] + np.arange(3)).ravel()
    middle = np.tile(np.arange(SHOULDER_ROWS.start, SHOULDER_ROWS.stop), len(chosen))
    origin = middle if shoulders else np.full(len(row), -1)
    weights = version.weights[chosen].astype(np.float64)
    weights /= weights.sum()
    frames = version.rows[row]
    if shoulders:
        frames = frames - version.rows[origin]
    if path_weight > 0:
        path = np.arange(PATH_ROWS.start, PATH_ROWS.stop)
        frames = np.concatenate([frames, version.rows[path]])
        row, origin = np.append(row, path), np.append(origin, np.full(3, -1))
        weights = np.append(weights, path_weight)
    columns = np.stack([row, origin], axis=1)
    return np.ascontiguousarray(frames.T), weights.astype(np.float32), columns.astype(np.int64)


def check_query(query: Query, compared: NDArray[np.bool_], *, shoulders: bool, path: bool) -> None:
    """Raise a ValueError that names every joint and frame the query lacks."""

    def without(rows: NDArray[np.float32]) -> NDArray[np.bool_]:
        return np.any(~np.isfinite(rows), axis=0)

    def joint(index: int) -> NDArray[np.bool_]:
        return without(query.rows[3 * index : 3 * index + 3])

    def where(missing: NDArray[np.bool_]) -> str:
        first, last = (
            query.start + frame_of_sample(int(sample), query.rate_hz)
            for sample in np.flatnonzero(missing)[[0, -1]]
        )
        return f"frame {first}" if first == last else f"frames {first}-{last}"

    hips = joint(_HIPS[0]) | joint(_HIPS[1])
    missing = {"the hips": hips}
    if shoulders:
        missing["the shoulders"] = without(query.rows[SHOULDER_ROWS]) & ~hips
    missing |= {JOINTS[k]: joint(int(k)) & ~hips for k in np.flatnonzero(compared)}
    if path:
        missing["the path"] = without(query.rows[PATH_ROWS]) & ~hips
    faults = [f"{name} (in {where(at)})" for name, at in missing.items() if at.any()]
    if faults:
        raise ValueError(
            f"the query {query.name} lacks {', '.join(faults)}; "
            "choose another clip, or give such a joint the weight 0"
        )


def _search_all(
    searched: list[tuple[PackedTake, list[tuple[Clip, bool]]]],
    settings: SearchSettings,
    threads: int,
) -> list[Match]:
    """Return the best matches of every take: long ones cut in pieces, then takes side by side."""
    searched = sorted(searched, key=lambda item: -item[0].rows.shape[1])
    matches: list[Match] = []
    with ThreadPoolExecutor(threads) as pool:
        short = []
        for take, clips in searched:
            pieces = _pieces(take, clips[0][0], settings.steps, threads)
            if len(pieces) > 1:
                matches += _search_take(take, clips, settings, pieces, pool.map)
            else:
                short.append((take, clips, settings, pieces, map))
        for found in pool.map(lambda work: _search_take(*work), short):
            matches += found
    return matches


def _pieces(take: PackedTake, clip: Clip, steps: str, threads: int) -> list[tuple[int, int, int]]:
    """Return the spans in which a take is warped, to the same results as in one."""
    samples, frames = take.rows.shape[1], len(clip[0])
    count = min(2 * threads, samples // max(_PIECE, _PIECE_IN_QUERIES * frames))
    if threads == 1 or steps != "slope" or count < 2:
        return [(0, 0, samples)]
    ends = np.linspace(0, samples, count + 1).astype(int).tolist()
    return [
        (max(0, first - warm_up(frames)), first, last) for first, last in itertools.pairwise(ends)
    ]


def _search_take(
    take: PackedTake,
    clips: list[tuple[Clip, bool]],
    settings: SearchSettings,
    pieces: list[tuple[int, int, int]],
    each: Callable[..., Iterable[Any]],
) -> list[Match]:
    """Return the best matches of one take."""
    samples = take.rows.shape[1]
    distance = np.empty((len(clips), samples), np.float32)
    start = np.empty((len(clips), samples), np.int32)

    def work(job: tuple[int, tuple[int, int, int]]) -> None:
        version, span = job
        clip = clips[version][0]
        warp(clip, take.rows, span, distance[version], start[version], steps=settings.steps)

    for _ in each(work, [(v, span) for v in range(len(clips)) for span in pieces]):
        pass
    threshold = math.inf if settings.threshold is None else settings.threshold
    found = select_matches(distance, start, take.rate_hz, threshold=threshold, top=settings.top)
    return [
        Match(
            take.name,
            frame_of_sample(first, take.rate_hz),
            min(frame_of_sample(last, take.rate_hz), take.frames - 1),
            near,
            clips[version][1],
        )
        for version, first, last, near in found
    ]
