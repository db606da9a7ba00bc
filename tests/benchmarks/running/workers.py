"""Take in the same recordings with one worker and with two, through the inbox of `shosa serve`.

    python -m tests.benchmarks.running.workers files|captures [--count 400] [--limit 1] [--shared]

The second worker joins by `--join`, from a folder of its own as another machine has. On Linux each
worker, with all that it starts, is held to half of the processors (with `--shared`: to none), so
that two are to one as two machines are. The lines say how many runs each worker took.
"""

import argparse
import functools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from http import HTTPStatus
from pathlib import Path
from types import MappingProxyType
from typing import Any

from storage import open_archive
from storage.formats.capture.capture import read_capture
from storage.formats.motion.trc import write_trc
from storage.formats.pictures.video import open_video, read_frames
from storage.formats.pictures.video_writing import write_video
from storage.schema import JOINTS
from tests.benchmarks.recordings import data_folder
from tests.benchmarks.running.overhead import ROOT
from tests.benchmarks.running.soak import HANGING_S, free_port, say
from tests.conftest import swaying_body

CAPTURES = ("plain", "kimono", "martial", "lunge")
FRAMES = 60
"""How much of each capture is digitized. Chosen: half a minute of work each on one processor."""
FILES = 400
EVERY_S, SETTLE_S = 20.0, 2.0
LOOK_S = 0.2


def main() -> None:
    """Measure with one worker, then with two, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=("files", "captures"))
    parser.add_argument("--count", type=int, help="400 motion files of --frames, or 4 captures")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--limit", type=int, default=1, help="runs at once, of each worker")
    parser.add_argument("--shared", action="store_true", help="workers share all processors")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recordings = make_recordings(Path(folder) / "recordings", options)
        took = [
            take_in(Path(folder) / f"with-{workers}", recordings, workers, options)
            for workers in options.workers
        ]
    say(f"{took[0] / took[-1]:.2f} times as fast with {options.workers[-1]} workers")


def make_recordings(folder: Path, options: argparse.Namespace) -> Path:
    """Make what is taken in, and return the folder."""
    folder.mkdir()
    if options.kind == "files":
        for number in range(options.count or FILES):
            body = swaying_body(number, options.frames)
            write_trc(folder / f"walk{number:04}.trc", body, JOINTS, 30.0)
        return folder
    for name in CAPTURES[: options.count]:
        shorten(data_folder() / "captures" / name, folder / name)
    return folder


def shorten(capture: Path, into: Path, length: int = FRAMES) -> None:
    """Write a capture with the first frames of the films of another."""
    source = read_capture(capture)
    films = {path.relative_to(capture) for path in source.videos}
    for path in (each for each in capture.rglob("*") if each.is_file()):
        copy = into / path.relative_to(capture)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path.relative_to(capture) not in films:
            shutil.copyfile(path, copy)
            continue
        frames = read_frames(open_video(path), 0, length)
        write_video(copy.with_suffix(".mp4"), iter(frames), source.fps)


def take_in(folder: Path, recordings: Path, workers: int, options: argparse.Namespace) -> float:
    """Serve, drop the recordings, and wait until all are in; return how long that took [s]."""
    inbox, archive = folder / "inbox", folder / "archive"
    shutil.copytree(recordings, inbox / ".copied")  # a name with a dot is left alone
    wanted = {path.stem for path in recordings.iterdir()}
    with serving(folder, workers=workers, limit=options.limit, shared=options.shared) as url:
        begin = time.monotonic()
        for path in sorted((inbox / ".copied").iterdir()):
            path.rename(inbox / path.name)
        wait(lambda: wanted <= set(open_archive(archive).takes()), "not all is taken in")
        took = time.monotonic() - begin
        wait(lambda: not running(url), "a run does not end")
        runs = runs_by_worker(url)
        took = length_of_runs(url) or took
    if (inbox / "quarantine").exists():
        raise SystemExit(f"in quarantine is {os.listdir(inbox / 'quarantine')}")
    shares = "; ".join(
        f"{worker}: {', '.join(f'{count} {name}' for name, count in sorted(own.items()))}"
        for worker, own in sorted(runs.items())
    )
    say(
        f"{workers} worker{'s' * (workers > 1)}: {len(wanted)} {options.kind} in {took:.1f} s, "
        f"{len(wanted) / took * 60:.1f} a minute; {shares}"
    )
    if len([own for own in runs.values() if own]) < workers:
        raise SystemExit("a worker took no run")
    return took


@contextmanager
def serving(
    folder: Path,
    *,
    workers: int = 1,
    limit: int = 1,
    every_s: float = EVERY_S,
    shared: bool = True,
    roots: Sequence[Path] = (),
    settings: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[str]:
    """Serve the archive of a folder with so many workers; give the address of the server's API."""
    port = free_port()
    url = f"http://127.0.0.1:{port}/api"
    serve = [sys.executable, "-m", "flows.command.main", "serve", str(folder / "archive")]
    serve += ["--inbox", str(folder / "inbox"), "--limit", str(limit)]
    serve += ["--every", str(every_s), "--settle", str(SETTLE_S)]
    for root in roots:
        serve += ["--root", str(root)]
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PREFECT_")}
    kept |= {"PYTHONPATH": str(ROOT), **settings}
    children: list[subprocess.Popen[bytes]] = []
    try:
        for number in range(workers):
            own = ["--port", str(port)] if number == 0 else ["--join", url]
            children.append(
                subprocess.Popen(
                    [*serve, *own],
                    env={**kept, "PREFECT_HOME": str(folder / f"home-{number}")},
                    preexec_fn=None if shared else functools.partial(hold, number),
                )
            )
            wait(functools.partial(is_online, url, number + 1), "a worker does not come up")
        wait(lambda: runs_by_worker(url), "nothing is scanned")
        yield url
    finally:
        for child in reversed(children):
            child.terminate()
            child.wait()


def hold(number: int) -> None:
    """Hold a process, and those it starts, to the first or the second half of the processors."""
    all_of = sorted(os.sched_getaffinity(0))
    half = max(1, len(all_of) // 2)
    os.sched_setaffinity(0, all_of[half * number : half * (number + 1)])


def is_online(url: str, workers: int) -> bool:
    """Say whether so many workers ask for runs."""
    try:
        found = ask(url, "work_pools/shosa/workers/filter", {})
    except OSError:
        return False
    return sum(each["status"] == "ONLINE" for each in found) >= workers


def runs_by_worker(url: str) -> dict[str, Counter[str]]:
    """Return how many runs of which flow each worker has taken, but scans that found nothing."""
    asked = {"filter": {"event": {"name": ["prefect.worker.submitted-flow-run"]}}}
    taken: dict[str, Counter[str]] = {}
    page = ask(url, "events/filter", asked)
    events = page["events"]
    while page.get("next_page"):
        page = ask(page["next_page"], "")
        events += page["events"]
    for event in events:
        worker = event["resource"]["prefect.resource.name"]
        flow = next(
            (
                each["prefect.resource.name"]
                for each in event["related"]
                if each["prefect.resource.role"] == "flow"
            ),
            "run",
        )
        taken.setdefault(worker, Counter())[flow] += 1
    return taken


def running(url: str) -> int:
    """Return how many runs of recordings are not over."""
    states = {"type": {"any_": ["SCHEDULED", "PENDING", "RUNNING"]}}
    wanted = {"flow_runs": {"state": states, "name": {"like_": "ingest walk"}}}
    digitized = {"flow_runs": {"state": states, "name": {"like_": "digitize"}}}
    return sum(ask(url, "flow_runs/count", each) for each in (wanted, digitized))


def length_of_runs(url: str) -> float:
    """Return how long it took from the first start of a run of recordings to the last end [s].

    What comes before is waiting: the scan that sees them settled comes in its time. 0 where scans
    took all in by themselves.
    """
    runs = ask(url, "flow_runs/filter", {"limit": 200})
    of_recordings = [
        run for run in runs if run["deployment_id"] and run["name"].startswith(("ingest", "digit"))
    ]
    if not of_recordings:
        return 0.0
    first = min(datetime.fromisoformat(run["start_time"]) for run in of_recordings)
    ends = [datetime.fromisoformat(run["end_time"]) for run in of_recordings if run["end_time"]]
    return (max(ends) - first).total_seconds()


def is_of(folder: Path, process: Any) -> bool:
    """Say whether a process was started for this folder."""
    return process.environment.get("PREFECT_HOME", "").startswith(str(folder))


def is_first(processes: dict[int, Any], number: int) -> bool:
    """Say whether a process is a server or a worker, and not a child of one."""
    return any(kind in processes[number].said for kind in ("server start", "worker start"))


def ask(url: str, path: str, body: Any = None) -> Any:
    """Return what the server answers."""
    request = urllib.request.Request(f"{url}/{path}" if path else url)
    if body is not None:
        request.data = json.dumps(body).encode()
        request.add_header("content-type", "application/json")
    while True:
        try:
            with urllib.request.urlopen(request, timeout=60.0) as answer:
                said = answer.read()
            return json.loads(said) if said else None
        except urllib.error.HTTPError as error:
            if error.code != HTTPStatus.SERVICE_UNAVAILABLE:  # a busy server is to be asked again
                raise
        time.sleep(LOOK_S)


def wait(is_so: Callable[[], Any], otherwise: str) -> None:
    """Wait until something is so."""
    until = time.monotonic() + HANGING_S
    while not is_so():
        if time.monotonic() > until:
            raise SystemExit(otherwise)
        time.sleep(LOOK_S)


if __name__ == "__main__":
    main()
