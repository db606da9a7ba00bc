"""Measure digitizing, films to joints: `python -m tests.benchmarks.voxels.digitization [CAPTURE]`.

By the store functions that the flow calls, without Prefect, in a process of its own each: the clock
and the processor time of every stage and of all, and the most memory that the process held, for the
capture and for one whose films are ten times as long. What is written beside the stages from the
initial model to the poses counts as theirs. By default a generated dancer in a kimono before
eight cameras of 320 x 240, in voxels of 1 cm.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from flows import chain
from storage import create_archive, open_archive
from storage.formats.capture.capture import read_capture
from storage.formats.pictures.video import open_video, read_frames
from storage.formats.pictures.video_writing import write_video
from storage.recordings import Recording, digest_capture
from tasks.settings import Settings, settings_of_stages
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import demo_performances
from tasks.takes.assembling import assemble_take
from tasks.takes.beginning import beginning_beside
from tasks.takes.publishing import publish_take
from tests.benchmarks.history import keep_ratios

FRAMES, RATE_HZ, LONGER = 150, 30.0, 10
_SORTS = 10


def make_capture(folder: Path) -> Path:
    """Film a generated dancer; return the capture."""
    takes, _ = demo_performances(rate_hz=RATE_HZ)
    position = stretch_arms_first(takes[3].performance.position, RATE_HZ)[:FRAMES]
    film_capture(folder / "short", position, RATE_HZ, settings=FilmSettings(clothes="kimono"))
    return folder / "short"


def lengthen(capture: Path, into: Path) -> Path:
    """Write a capture whose films repeat those of another."""
    shutil.copytree(capture, into)
    source = read_capture(capture)
    for path in source.videos:
        video = open_video(path)
        frames = read_frames(video, 0, source.frames)
        film = into / path.relative_to(capture)
        film.unlink()
        repeated = (frame for _ in range(LONGER) for frame in frames)
        write_video(film.with_suffix(".mp4"), repeated, source.fps)
    return into


def used() -> float:
    """Return the processor time of this process, seconds."""
    spent = resource.getrusage(resource.RUSAGE_SELF)
    return spent.ru_utime + spent.ru_stime


def digitize(capture: Path, archive: str) -> dict[str, Any]:
    """Digitize a capture; return clock and processor milliseconds a frame of each stage."""
    opened, settings = create_archive(archive), Settings()
    source = read_capture(capture)
    recording = Recording(
        str(capture), digest_capture(capture), source.take, source.metadata, kind="capture"
    )
    spent: dict[str, list[float]] = {}

    last, told = (time.monotonic(), used()), ""

    def tell(stage: str, _frame: float) -> None:
        """Add what passed since this stage told the last time; two blocks of it run at once."""
        nonlocal last, told
        now = time.monotonic(), used()
        if stage == told:
            took = (now[0] - last[0], now[1] - last[1])
            spent[stage] = [a + b for a, b in zip(spent.get(stage, (0.0, 0.0)), took, strict=True)]
        last, told = now, stage

    named = (archive, str(capture), recording.digest, source.take)
    tables = settings_of_stages(settings)
    begun = (time.monotonic(), used())
    with beginning_beside(*named, tables) as begin:
        blocks, _ = chain.digitize(
            opened.location, recording, settings,
            run=lambda function, **parameters: function(**parameters), tell=tell, begin=begin,
        )  # fmt: skip
        clock, processor = time.monotonic(), used()
        draft = assemble_take(
            *named, blocks, settings=tables, changed={}, code="", notes=[],
            begun=begin(blocks).result(),
        )  # fmt: skip
    publish_take(archive, draft, over=0)
    spent["assembling"] = [time.monotonic() - clock, used() - processor]
    spent["all"] = [time.monotonic() - begun[0], used() - begun[1]]
    frames = source.frames
    return {
        "frames": frames,
        "clock_ms": {stage: 1e3 * both[0] / frames for stage, both in spent.items()},
        "processor_ms": {stage: 1e3 * both[1] / frames for stage, both in spent.items()},
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "runs_on_dense": _share_of_dense(archive, source.take),
    }


def _share_of_dense(archive: str, take: str) -> float:
    """Return how many times smaller the occupied voxels are on disk than dense."""
    found = open_archive(archive).take(take)
    stored = sum(
        each["bytes"] for name, each in found.record.files.items() if name.startswith("voxels/run_")
    )
    return found.record.frames * int(np.prod(found.occupied(0).shape)) / stored


def measure(capture: Path, archive: Path) -> dict[str, Any]:
    """Digitize a capture in a process of its own, after one that compiled everything."""
    command = [sys.executable, "-m", __spec__.name, "--once", str(capture), str(archive)]
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # `flows` says so, but numpy comes first
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=alone)
    return json.loads(done.stdout)


def sorting_ms() -> float:
    """Return the least processor time in which numpy sorts a million numbers."""
    numbers = np.random.default_rng(0).random(1_000_000)
    best = np.inf
    for _ in range(_SORTS):
        begun = time.process_time()
        np.sort(numbers)
        best = min(best, time.process_time() - begun)
    return 1e3 * best


def main() -> None:
    """Write one JSON object: the figures of the capture and of the long one."""
    if sys.argv[1:2] == ["--once"]:
        json.dump(digitize(Path(sys.argv[2]), sys.argv[3]), sys.stdout)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        capture = Path(sys.argv[1]).absolute() if len(sys.argv) > 1 else make_capture(folder)
        measure(capture, folder / "warm")
        short = measure(capture, folder / "a")
        long = measure(lengthen(capture, folder / "long"), folder / "b")
    colored = ("silhouettes", "carving", "coloring")
    both = {"": short, "_of_ten_times_the_frames": long}
    summary = {
        **{
            f"frames_a_second_to_colors{which}": 1e3 / sum(run["clock_ms"][s] for s in colored)
            for which, run in both.items()
        },
        **{
            f"frames_a_second_to_joints{which}": 1e3 / run["clock_ms"]["all"]
            for which, run in both.items()
        },
        "memory_of_ten_times_the_frames": long["peak_mb"] / short["peak_mb"],
    }
    json.dump({"digitizing": summary, "short": short, "long": long}, sys.stdout, indent=2)
    sys.stdout.write("\n")
    sorted_ms = sorting_ms()
    keep_ratios(
        "digitization",
        {
            f"{what}, {run['frames']} frames": ratio
            for run in (short, long)
            for what, ratio in (
                ("sorting a million numbers : a frame", sorted_ms / run["processor_ms"]["all"]),
                ("processors in use", run["processor_ms"]["all"] / run["clock_ms"]["all"]),
            )
        },
    )


if __name__ == "__main__":
    main()
