"""Measure the search against the core's square roots and against peers, in one run.

    python -m tests.benchmarks.similarity.search [--json FILE] [--sizes 10000 100000 1000000]

One thread is measured by its processor time, the best of several; two by the clock.
"""

import argparse
import importlib.util
import json
import math
import multiprocessing
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.retrieval.searching import Query, search_takes
from tasks.retrieval.segments import PackedTake
from tasks.retrieval.warping import warp
from tests.benchmarks.history import keep_ratios
from tests.benchmarks.similarity.motions import (
    SETTINGS,
    compared_rows,
    make_query,
    make_take,
    pack_query,
)

FRAMES = 170
JOINTS = 18
LIBROSA_FRAMES = 10_000


def main() -> None:
    """Run every benchmark and print one table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--memory", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory:
        sys.stdout.write(f"{memory_growth(options.memory)}\n")
        return
    figures = kernel_figures()
    for frames in options.sizes:
        figures += peer_figures(frames) if has_peer("dtaidistance") else []
    figures += librosa_figures() if has_peer("librosa") else []
    figures.append(memory_figure(max(options.sizes)))
    header = {
        "what": "what",
        "shosa": "shosa",
        "peer": "peer",
        "ratio": "ratio",
        "target": "target",
    }
    for line in [header, *figures]:
        sys.stdout.write(
            f"{line['what']:64} {line['shosa']:>14} {line['peer']:>14} {line['ratio']:>8}  "
            f"{line['target']}\n"
        )
    keep_ratios("search", {line["what"]: float(line["ratio"]) for line in figures if line["ratio"]})
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


def has_peer(name: str) -> bool:
    """Return whether a peer is installed, and say so where it is not."""
    if importlib.util.find_spec(name):
        return True
    sys.stdout.write(f"{name} is not installed, so nothing is compared with it.\n")
    return False


def kernel_figures() -> list[dict[str, Any]]:
    """Compare the whole kernel, recurrence and all, with the core's square-root rate."""
    rng = np.random.default_rng(0)
    clip = (
        rng.normal(size=(FRAMES, 3 * JOINTS)).astype(np.float32),
        np.full(JOINTS, 1 / JOINTS, np.float32),
        np.stack([np.arange(3 * JOINTS), np.full(3 * JOINTS, -1)], axis=1),
    )
    rows = rng.normal(size=(3 * JOINTS, 100_000)).astype(np.float32)
    distance, start = np.empty(100_000, np.float32), np.empty(100_000, np.int32)
    roots, frames = 0.0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        limit = build_limit(Path(folder))
        for _ in range(7):  # turn by turn: others may use the machine too
            roots = max(roots, limit())
            seconds = thread_seconds(lambda: warp(clip, rows, (0, 0, 100_000), distance, start))
            frames = max(frames, 100_000 / seconds)
    rate = frames * FRAMES * JOINTS
    return [
        row("kernel, distances/s : square roots/s, one core", f"{rate:.3g}", f"{roots:.3g}",
            rate / roots, ">= 0.55"),
        row(f"kernel, {FRAMES} frames x {JOINTS} joints, one core", f"{frames:,.0f} f/s", "",
            None, ""),
    ]  # fmt: skip


def build_limit(folder: Path) -> Callable[[], float]:
    """Return a function that measures packed square roots a second: in C, else in numba."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    program, source = folder / "limit", Path(__file__).with_name("limit.c")
    options = ["-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math"]
    if compiler:
        command = [compiler, *options, str(source), "-o", str(program), "-lm"]
        if subprocess.run(command, check=False).returncode == 0:
            return lambda: float(subprocess.check_output([str(program)]))
    lanes = np.linspace(1.5, 500, 512).astype(np.float32)
    return lambda: 400_000 * 512 / thread_seconds(lambda: _roots(lanes, 400_000), rounds=1)


@njit(fastmath={"nnan"})
def _roots(lanes: Any, rounds: Any) -> None:
    """Take square roots in place, again and again."""
    for _ in range(rounds):
        for i in range(len(lanes)):
            lanes[i] = math.sqrt(lanes[i])


def peer_figures(frames: int) -> list[dict[str, Any]]:
    """Compare packing a query and finding ten matches with dtaidistance, on the same motion."""
    position, stature_m = make_query(FRAMES)
    take, ends = make_take(frames, pack_query(position, stature_m))
    kept = compared_rows()
    query = pack_query(position, stature_m).rows[kept].T.astype(np.float64)
    series = np.ascontiguousarray(take.rows[kept].T, np.float64)
    rounds = 5 if frames <= 100_000 else 2

    def search(threads: int) -> list[int]:
        asked = pack_query(position, stature_m)
        return [m.end for m in search_takes(asked, [take], SETTINGS, threads=threads).matches]

    found, found_by_peer = (
        f"finds {near(search(1), ends)}",
        f"finds {near(align(query, series), ends)}",
    )
    ours = process_seconds(lambda: search(1), 2 * rounds)
    peer = process_seconds(lambda: align(query, series), rounds)
    one = row(f"ten best of {frames:,} frames, one thread : dtaidistance",
              f"{ours:.4f} s", f"{peer:.4f} s", peer / ours, ">= 5")  # fmt: skip
    ours = clock_seconds(lambda: search(2), 2 * rounds)
    peer = align_in_two(query, series, rounds)
    two = row(f"ten best of {frames:,} frames, two threads : two processes",
              f"{ours:.4f} s", f"{peer:.4f} s", peer / ours, ">= 5")  # fmt: skip
    return [
        one,
        two,
        row(f"planted repeats found in {frames:,} frames", found, found_by_peer, None, "10"),
    ]


def align(query: NDArray[np.float64], series: NDArray[np.float64], best: int = 10) -> list[int]:
    """Return the ends of the best matches of dtaidistance, compiled."""
    from dtaidistance.subsequence.dtw import subsequence_alignment

    alignment = subsequence_alignment(query, series, use_c=True)
    return [match.segment[1] for match in alignment.kbest_matches_fast(k=best)]


def align_in_two(query: NDArray[np.float64], series: NDArray[np.float64], rounds: int) -> float:
    """Return the seconds of dtaidistance on both halves at once, in processes that wait for it.

    Five matches of each half, where five copies are: asked for more, it takes ten times as long.
    """
    context = multiprocessing.get_context("fork")
    middle = len(series) // 2
    halves = (series[:middle], series[middle - 2 * FRAMES :])
    gates = [context.Barrier(3) for _ in range(2)]

    def work(half: NDArray[np.float64]) -> None:
        for _ in range(rounds):
            gates[0].wait()
            align(query, half, 5)
            gates[1].wait()

    workers = [context.Process(target=work, args=(half,)) for half in halves]
    for worker in workers:
        worker.start()
    best = math.inf
    for _ in range(rounds):
        gates[0].wait()
        begin = time.perf_counter()
        gates[1].wait()
        best = min(best, time.perf_counter() - begin)
    for worker in workers:
        worker.join()
    return best


def librosa_figures() -> list[dict[str, Any]]:
    """Compare with librosa's subsequence warping on the paper's distance of poses.

    librosa takes the distance as a function of two poses, or all distances at once: then half
    of its time is numpy's, and the memory is all of them.
    """
    import librosa

    position, stature_m = make_query(FRAMES)
    take, _ = make_take(LIBROSA_FRAMES, pack_query(position, stature_m))
    kept = compared_rows()
    steps: dict[str, Any] = {
        "subseq": True,
        "step_sizes_sigma": np.array([[1, 1], [1, 2], [2, 1]]),
        "weights_mul": np.array([2.0, 3.0, 3.0]),
    }

    def align_by_function() -> None:
        query = pack_query(position, stature_m).rows[kept]

        def distance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
            return np.sqrt(((a - b).reshape(JOINTS, 3) ** 2).sum(axis=1)).mean()

        librosa.sequence.dtw(query, take.rows[kept], **{**steps, "metric": distance})

    def align_distances() -> None:
        query = pack_query(position, stature_m).rows[kept].reshape(JOINTS, 3, -1)
        series = take.rows[kept].reshape(JOINTS, 3, -1)
        cost = np.zeros((FRAMES, LIBROSA_FRAMES), np.float32)
        for a, b in zip(query, series, strict=True):
            cost += np.sqrt(((a[:, :, None] - b[:, None]) ** 2).sum(axis=0))
        librosa.sequence.dtw(C=cost / JOINTS, **steps)

    def search() -> None:
        search_takes(pack_query(position, stature_m), [take], SETTINGS, threads=1)

    align_distances()
    search()
    ours = process_seconds(search, 10)
    what = f"best of {LIBROSA_FRAMES:,} frames, one thread : librosa"
    by_function, at_once = (
        process_seconds(align_by_function, 1),
        process_seconds(align_distances, 3),
    )
    return [
        row(
            f"{what}, metric=", f"{ours:.4f} s", f"{by_function:.2f} s", by_function / ours, ">= 50"
        ),
        row(f"{what}, C= by numpy", f"{ours:.4f} s", f"{at_once:.4f} s", at_once / ours, ""),
    ]


def memory_figure(frames: int) -> dict[str, Any]:
    """Measure, in a process of its own, what a search of one long mapped take adds."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.npy"
        take, _ = make_take(frames, pack_query(*make_query(FRAMES)))
        np.save(path, take.rows)
        command = [sys.executable, "-m", __spec__.name, "--memory", str(path)]
        growth = float(subprocess.check_output(command, text=True))
    return row(f"memory beside the mapped rows, {frames:,} frames", f"{growth:.2f} B/frame", "",
               None, "<= 10 B/frame")  # fmt: skip


def memory_growth(path: Path) -> float:
    """Return the bytes a frame by which the process grows at most during a search."""
    rows = np.load(path, mmap_mode="r")
    query: Query = pack_query(*make_query(FRAMES))
    take = PackedTake("mapped", rows, 30.0, rows.shape[1], np.ones(21, bool))
    short = PackedTake("short", rows[:, :2000], 30.0, 2000, np.ones(21, bool))
    search_takes(query, [short], SETTINGS)  # compiles
    rows.sum()  # maps every page
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = peak_bytes()
    search_takes(query, [take], SETTINGS)
    return (peak_bytes() - before) / rows.shape[1]


def peak_bytes() -> int:
    """Return the largest resident size of this process, as the operating system counts it."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError("the system counts no peak of memory")


def near(found: list[int], planted: list[int]) -> int:
    """Return how many of the planted copies have a match that ends near theirs."""
    return sum(any(abs(end - other) < FRAMES / 3 for other in found) for end in planted)


def row(what: str, ours: str, peer: str, ratio: float | None, target: str) -> dict[str, Any]:
    """Return a line of the table."""
    shown = "" if ratio is None else f"{ratio:.2f}" if ratio < 10 else f"{ratio:.1f}"
    return {"what": what, "shosa": ours, "peer": peer, "ratio": shown, "target": target}


def thread_seconds(work: Callable[[], Any], rounds: int = 2) -> float:
    """Return the least processor time of this thread."""
    return _least(work, rounds, time.thread_time)


def process_seconds(work: Callable[[], Any], rounds: int) -> float:
    """Return the least processor time of this process, of all its threads."""
    return _least(work, rounds, time.process_time)


def clock_seconds(work: Callable[[], Any], rounds: int) -> float:
    """Return the least time by the clock."""
    return _least(work, rounds, time.perf_counter)


def _least(work: Callable[[], Any], rounds: int, clock: Callable[[], float]) -> float:
    """Return the least time of several rounds."""
    best = math.inf
    for _ in range(rounds):
        begin = clock()
        work()
        best = min(best, clock() - begin)
    return best


if __name__ == "__main__":
    main()
