"""Measure the pruned search against the plain scan, in one run, on real dance repeated.

    python -m tests.benchmarks.similarity.index [--frames 100000 1000000] [--data FOLDER]
        [--queries N]

The archive is motion capture, repeated with variations: other speed, limb lengths, style, noise and
side, so that a query of it has near matches; one of a dance that is left out has none (hostile).
One thread is measured by its processor time, two by the clock. Every answer is compared.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.motion.importing import ImportSettings, read_joint_track
from tasks.motion.stature import joints_present, take_stature
from tasks.retrieval.normalization import PATH_ROWS, ROWS, mirror_rows, pack_motion
from tasks.retrieval.pruned import pruning
from tasks.retrieval.pruned.summaries import summarize_rows
from tasks.retrieval.searching import (
    Found,
    Query,
    about_shoulders,
    make_clip,
    query_versions,
    search_takes,
)
from tasks.retrieval.segment_search import search_gradually, search_segments
from tasks.retrieval.segments import ALIGNMENT, PackedTake, Segment
from tasks.retrieval.warping import Clip, warp
from tasks.retrieval.weighting import SearchSettings, joint_weights
from tests.benchmarks.recordings import data_folder

SEGMENT = 1 << 20
"""How many samples a segment has."""
HELD_OUT = "martial_06"
"""The dance that hostile queries are of, and that is in no archive."""


Archive = tuple[list[Segment], list[PackedTake]]
"""The same takes side by side, and each by itself."""


@dataclass(frozen=True, eq=False)
class Dance:
    """A real dance, packed."""

    name: str
    rows: NDArray[np.float32]
    present: NDArray[np.bool_]


def main() -> None:
    """Run every benchmark and print one table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    data = data_folder() / "mocap"
    parser.add_argument("--data", type=Path, default=data, help="a folder of BVH files")
    parser.add_argument("--frames", type=int, nargs="+", default=[100_000, 300_000, 1_000_000])
    parser.add_argument("--queries", type=int, default=2, help="how many of each kind")
    parser.add_argument("--lengths", type=int, nargs="+", default=[60, 170, 400])
    parser.add_argument("--parts", nargs="+", default=["whole", "feet"])
    options = parser.parse_args()
    files = sorted(options.data.glob("*/*.bvh"))
    if not files:
        sys.stdout.write(f"There are no BVH files in {options.data}; nothing is measured.\n")
        return
    dances = [read_dance(path) for path in files]
    warm_up_kernels(dances[0])
    for frames in options.frames:
        begin = time.thread_time()
        segments = make_archive(dances, frames)
        made = time.thread_time() - begin
        begin = time.thread_time()
        segments = [replace(each, summaries=summarize_rows(each.rows)) for each in segments]
        built = time.thread_time() - begin
        takes = [take for segment in segments for take in takes_of(segment)]
        samples = sum(each.rows.shape[1] for each in segments)
        kept = sum(array.nbytes for each in segments for array in each.summaries.values())
        sys.stdout.write(
            f"\n{samples:,} samples in {len(takes)} takes, made in {made:.0f} s; "
            f"index {kept / samples:.1f} B/frame, {built / samples * 1e9:.0f} ns/frame\n"
        )
        for part in options.parts:
            for length in options.lengths:
                for kind in ("near", "hostile"):
                    for number in range(options.queries):
                        query = make_query(dances, length, kind, number)
                        measure(
                            query, (segments, takes), SearchSettings(part), f"{part:5} {kind:7}"
                        )


def read_dance(path: Path) -> Dance:
    """Return a file as a packed take."""
    track, _ = read_joint_track(path, ImportSettings())
    rows = pack_motion(track.position, track.rate_hz, take_stature(track.position))
    return Dance(path.stem, rows, joints_present(track.position))


def make_archive(dances: list[Dance], frames: int, seed: int = 5) -> list[Segment]:
    """Return at least so many frames of varied dances, without the one held out."""
    rng = np.random.default_rng(seed)
    kept = [dance for dance in dances if dance.name != HELD_OUT]
    segments: list[Segment] = []
    while frames > 0:
        room = min(SEGMENT, frames)
        takes: list[NDArray[np.float32]] = []
        while room > 0:
            takes.append(vary(kept[rng.integers(len(kept))].rows, rng))
            room -= takes[-1].shape[1]
        segments.append(lay_side_by_side(takes, f"{len(segments)}", kept[0].present))
        frames -= segments[-1].rows.shape[1]
    return segments


def lay_side_by_side(
    takes: list[NDArray[np.float32]], name: str, present: NDArray[np.bool_]
) -> Segment:
    """Return takes as a segment."""
    samples = np.array([take.shape[1] for take in takes])
    room = (samples // ALIGNMENT + 1) * ALIGNMENT
    first = np.cumsum(room) - room
    rows = np.full((ROWS, room.sum()), np.nan, np.float32)
    for at, take in zip(first, takes, strict=True):
        rows[:, at : at + take.shape[1]] = take
    count = len(takes)
    return Segment(
        rows,
        [f"{name}-{k}" for k in range(count)],
        first,
        samples,
        samples,
        np.full(count, 30.0),
        np.tile(present, (count, 1)),
        np.ones(count, bool),
    )


def takes_of(segment: Segment) -> list[PackedTake]:
    """Return the takes of a segment, each in memory of its own."""
    takes = []
    for place, name in enumerate(segment.names):
        first, samples = int(segment.first[place]), int(segment.samples[place])
        rows = np.ascontiguousarray(segment.rows[:, first : first + samples])
        takes.append(PackedTake(name, rows, 30.0, samples, segment.joints_present[place]))
    return takes


def vary(rows: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a dance again: at another speed, by another body, in another style, or mirrored."""
    frames = rows.shape[1]
    speed = np.exp(np.interp(np.arange(frames), *_knots(rng, frames, 60, 0.15)))
    at = np.concatenate([[0], np.cumsum(1 / speed)])
    at = np.interp(np.arange(int(at[-1])), at, np.arange(len(at)))
    before = np.minimum(at.astype(np.int64), frames - 2)
    share = (at - before).astype(np.float32)
    varied = rows[:, before] * (1 - share) + rows[:, before + 1] * share
    varied[: PATH_ROWS.start] *= np.repeat(rng.normal(1, 0.04, ROWS // 3 - 1), 3)[:, None]
    for row in range(PATH_ROWS.start):
        varied[row] += np.interp(np.arange(len(at)), *_knots(rng, len(at), 45, 0.012))
    varied += rng.normal(0, 0.002, varied.shape).astype(np.float32)
    varied = np.ascontiguousarray(varied, np.float32)
    return mirror_rows(varied) if rng.random() < 0.5 else varied


def _knots(
    rng: np.random.Generator, frames: int, step: int, amplitude: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return places and values of a curve that turns every `step` frames."""
    count = frames // step + 2
    return np.arange(count) * step, rng.normal(0, amplitude, count)


def make_query(dances: list[Dance], length: int, kind: str, number: int) -> Query:
    """Return a clip of a dance of the archive, or of the one that is held out."""
    rng = np.random.default_rng(100 * length + number)
    held_out = kind == "hostile"
    chosen = [d for d in dances if (d.name == HELD_OUT) == held_out and d.rows.shape[1] > length]
    dance = chosen[rng.integers(len(chosen))]
    first = int(rng.integers(dance.rows.shape[1] - length))
    return Query(dance.rows[:, first : first + length], dance.present, dance.name)


def warm_up_kernels(dance: Dance) -> None:
    """Compile, or load, every kernel."""
    segment = lay_side_by_side([dance.rows] * 9, "warm", dance.present)
    segment = replace(segment, summaries=summarize_rows(segment.rows))
    for part in ("whole", "feet"):
        query = Query(dance.rows[:, 10:40], dance.present)
        search_segments(query, [segment], SearchSettings(part, top=2))
        search_takes(query, takes_of(segment), SearchSettings(part, top=2), threads=1)


def measure(query: Query, archive: Archive, settings: SearchSettings, what: str) -> None:
    """Print a line about one query: the scan's time, the pruned search's, and what was left."""
    segments, takes = archive
    samples = sum(segment.rows.shape[1] for segment in segments)

    def prune(threads: int) -> Found:
        return search_segments(query, segments, settings, threads=threads)

    scan, expected = timed(
        time.process_time, lambda: search_takes(query, takes, settings, threads=1)
    )
    pruned, found = timed(time.process_time, lambda: prune(1), rounds=2)
    two, again = timed(time.perf_counter, lambda: prune(2), rounds=2)
    if not found == again == expected:
        raise SystemExit("the pruned search found something else")
    begin = time.perf_counter()
    next(iter(search_gradually(query, segments, settings)))
    shown = time.perf_counter() - begin
    tau = expected.matches[-1].distance if expected.matches else math.nan
    coarse, fine = shares_left(query, segments, settings, tau)
    share = tau / median(query, segments[0], settings)
    sys.stdout.write(
        f"{what} {query.rows.shape[1]:4} frames, tau/median {share:.2f}: "
        f"{scan / samples * 1e9:5.0f} -> {pruned / samples * 1e9:5.0f} ns/frame, "
        f"{scan / pruned:5.2f}x; two threads {two:.3f} s, first answer {shown:.3f} s; "
        f"left by 8 x 8 {coarse:.3f}, by 4 x 4 {fine:.3f}\n"
    )
    sys.stdout.flush()


def shares_left(
    query: Query, segments: list[Segment], settings: SearchSettings, tau: float
) -> tuple[float, float]:
    """Return the share of the first segment that each bound leaves within the last match's."""
    segment = segments[0]
    takes = np.arange(len(segment.names))
    portion = pruning.make_portion(
        segment, 0, takes, [(clip_of(query, segment, settings), False)], settings.steps
    )
    if not portion.coarse:
        return 1.0, 1.0
    jobs = pruning.bounding_jobs(portion)
    [live] = pruning.join_live([pruning.bound_job(portion, *job, tau) for job in jobs])
    left = pruning.refine(live, tau)
    coarse, fine = (len(part.block) * part.length / portion.samples for part in (live, left))
    return coarse, fine


def clip_of(query: Query, segment: Segment, settings: SearchSettings) -> Clip:
    """Return a query ready to be warped."""
    weights = joint_weights(settings)
    [version] = query_versions(query, weights, mirror=False)
    joints = (weights > 0) & query.joints_present & segment.joints_present[0]
    return make_clip(version, joints, 0.0, shoulders=about_shoulders(weights))


def median(query: Query, segment: Segment, settings: SearchSettings) -> float:
    """Return the median distance of a match, of some takes."""
    samples = min(50_000, segment.rows.shape[1])
    distance, start = np.empty(samples, np.float32), np.empty(samples, np.int32)
    warp(clip_of(query, segment, settings), segment.rows, (0, 0, samples), distance, start)
    return float(np.median(distance[np.isfinite(distance)]))


def timed(
    clock: Callable[[], float], work: Callable[[], Any], rounds: int = 1
) -> tuple[float, Any]:
    """Return the least time of several rounds, and what came of it."""
    best, result = math.inf, None
    for _ in range(rounds):
        begin = clock()
        result = work()
        best = min(best, clock() - begin)
    return best, result


if __name__ == "__main__":
    main()
