"""Drop recordings into a served inbox, kill what works on them at random, and see all come through.

    python -m tests.benchmarks.running.soak [--takes 200] [--captures 3] [--kills 100] [--every 10]

At the end nothing is missing, doubled or left over, and `verify` finds no fault.
"""

import argparse
import math
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from datetime import timedelta
from pathlib import Path

from flows.server import is_healthy
from flows.service.processes import served_processes
from storage import open_archive
from storage.formats.motion.trc import write_trc
from storage.schema import JOINTS
from storage.upkeep.garbage import collect_garbage
from tasks.checks.upkeep import verify_archive
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import okuri48
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import TK, generate_performance
from tests.conftest import swaying_body

ROOT = Path(__file__).parents[3]
HANGING_S = 3600.0
"""After so long without a new take it hangs [s]. Chosen: far above the longest pause."""
SETTLE_S = 2.0
PAUSES_S = (1.0, 30.0)
"""Between two kills, since server and worker are there again [s]. Chosen: the next run is about to
begin, is at work, or has ended."""
KINDS = ("prefect.engine", "worker start", "server start")


def main() -> None:
    """Serve, drop, kill, wait, verify; print what was seen, and fail where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--takes", type=int, default=200)
    parser.add_argument("--captures", type=int, default=3)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--every", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        faults = soak(Path(folder), options)
    for fault in faults:
        say(f"BAD  {fault}")
    sys.exit(bool(faults))


def soak(folder: Path, options: argparse.Namespace) -> list[str]:
    """Do all of it in a folder; return what is wrong at the end."""
    inbox, archive = folder / "inbox", folder / "archive"
    inbox.mkdir()
    wanted = [f"walk{n:04}" for n in range(options.takes)]
    wanted += [f"capture{n}" for n in range(options.captures)]
    serve, url = start(folder, options.every)
    begin, kills = time.perf_counter(), Counter[str]()
    seen, since = 0, time.monotonic()
    try:
        for there, kills in drop_and_kill(folder, options, url, wanted):  # noqa: B007 - told after it
            if len(there) != seen:
                seen, since = len(there), time.monotonic()
            if serve.poll() is not None or (seen and time.monotonic() - since > HANGING_S):
                break
        said = ", ".join(f"{count} x {kind}" for kind, count in kills.items())
        say(f"{seen} takes in {time.perf_counter() - begin:.0f} s; killed: {said}")
    finally:
        serve.terminate()
        serve.wait()
    faults = list(examine(archive, wanted))
    if left := ours(folder):
        faults.append(f"processes are left over: {left}")
    if (inbox / "quarantine").exists():
        faults.append(f"in quarantine is {os.listdir(inbox / 'quarantine')}")
    return faults


def drop_and_kill(
    folder: Path, options: argparse.Namespace, url: str, wanted: Sequence[str]
) -> Iterator[tuple[list[str], Counter[str]]]:
    """Yield, every second, the takes that are there, and what was killed, until all is."""
    archive, draw = folder / "archive", random.Random(options.seed)
    waiting, kills = drops(folder, options), Counter[str]()
    there: list[str] = []
    last, pause_s = time.monotonic(), 0.0
    while not set(wanted) <= set(there) or sum(kills.values()) < options.kills:
        if not is_up(folder, url):
            last = time.monotonic()  # else a busy machine does nothing but start servers
        if time.monotonic() - last > pause_s:
            # spread over the kills, so that each meets work
            for _ in range(math.ceil(len(wanted) / max(1, options.kills))):
                next(waiting, None)
            if sum(kills.values()) < options.kills and there:
                kills.update(kill_one(folder, draw))
            last, pause_s = time.monotonic(), draw.uniform(*PAUSES_S)
        there = open_archive(archive).takes() if (archive / "archive.json").exists() else []
        yield there, kills
        time.sleep(1)


def start(folder: Path, every_s: float) -> tuple[subprocess.Popen[bytes], str]:
    """Serve the archive of a folder; return what does, and the address of the server's API."""
    port = free_port()
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PREFECT_")}
    environment |= {"PREFECT_HOME": str(folder / "home"), "PYTHONPATH": str(ROOT)}
    command = [
        *(sys.executable, "-m", "flows.command.main", "serve", str(folder / "archive")),
        *("--inbox", str(folder / "inbox"), "--port", str(port)),
        *("--every", str(every_s), "--settle", str(SETTLE_S)),
    ]
    return subprocess.Popen(command, env=environment), f"http://127.0.0.1:{port}/api"


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def drops(folder: Path, options: argparse.Namespace) -> Iterator[None]:
    """Drop a recording a step, as people do: a file grows where it lies, a folder is copied in."""
    inbox = folder / "inbox"
    for number in range(options.captures):
        write_capture(folder / "films" / f"capture{number}", number)
    captures = iter(range(options.captures))
    apart = math.ceil(options.takes / max(1, options.captures))
    for number in range(options.takes):
        if number % apart == 0 and (capture := next(captures, None)) is not None:
            shutil.copytree(folder / "films" / f"capture{capture}", inbox / f"capture{capture}")
            yield
        write_trc(inbox / f"walk{number:04}.trc", swaying_body(number, 90), JOINTS, 30.0)
        yield


def write_capture(folder: Path, seed: int) -> None:
    """Film a short dance with a few small cameras."""
    folder.parent.mkdir(exist_ok=True)
    track = generate_performance([okuri48()], TK, rate_hz=10.0).position[seed : seed + 60]
    ring = RingSettings(cameras=5, size=(80, 60), radius_m=3.5)
    cameras = generate_cameras(ring, center_m=(0.0, 0.9, 0.0), seed=seed)
    film_capture(folder, track, 10.0, cameras=cameras, settings=FilmSettings(voxel_m=0.05))


def is_up(folder: Path, url: str) -> bool:
    """Say whether the server answers and there is a worker."""
    return is_healthy(url) and any("worker start" in said for said in ours(folder).values())


def kill_one(folder: Path, draw: random.Random) -> list[str]:
    """Kill a process at random, of a kind at random that there is; return its kind."""
    running = ours(folder)
    there = [kind for kind in KINDS if any(kind in said for said in running.values())]
    if not there:
        return []
    kind = draw.choice(there)
    os.kill(
        draw.choice([number for number, said in running.items() if kind in said]), signal.SIGKILL
    )
    return [kind]


def ours(folder: Path) -> dict[int, str]:
    """Return the processes that the supervisor of a folder started, and what they run."""
    found = {each.number: each.said for each in served_processes(str(folder / "home"))}
    return {n: said for n, said in found.items() if any(kind in said for kind in KINDS)}


def examine(location: Path, wanted: list[str]) -> Iterator[str]:
    """Yield what is missing, doubled, left over or damaged, a sentence each."""
    archive = open_archive(location)
    records = {record.take: record for record in archive.records()}
    for name in wanted:
        if name not in records:
            yield f"{name} is missing"
        elif records[name].number != 1:
            yield f"{name} was published {records[name].number} times"
    for name in records.keys() - set(wanted):
        yield f"{name} was never dropped"
    _, faults, _ = verify_archive(str(location))
    yield from faults
    garbage = collect_garbage(archive.place, older_than=timedelta(0))
    say(f"killed runs left {len(garbage)} files, which `gc` removed")
    for folder in ("takes", "index"):
        held = {path.parent.name for path in (location / folder).glob("*/*")}
        if strange := held - set(wanted):
            yield f"{folder} still holds {sorted(strange)[:3]}"


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
