"""What Prefect costs beyond the work itself: processor time and database a motion file.

    python -m tests.benchmarks.running.overhead [--files 100] [--frames 300]

A server of its own is started; what it and `shosa ingest` spend on many files, less what they spend
on one, is compared with the plain functions called one after another.
"""

import argparse
import os
import resource
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

from flows.server import ServerError, check_url
from storage.formats.motion.trc import write_trc
from storage.schema import JOINTS
from tests.conftest import swaying_body

ROOT = Path(__file__).parents[3]
PLAIN = "plain"
"""The argument by which this program calls the functions themselves, in a process of its own."""
TICKS = os.sysconf("SC_CLK_TCK")
SETTLED_S = 5.0
"""The server writes events for some seconds after a run [s]."""


def main() -> None:
    """Measure, and print a table."""
    if sys.argv[1:2] == [PLAIN]:
        from tests.figures.archives.imported import take_in_plainly

        take_in_plainly(*sys.argv[2:])
        return
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=100)
    parser.add_argument("--frames", type=int, default=300)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        measure(Path(name), options.files, options.frames)


def measure(folder: Path, files: int, frames: int) -> None:
    """Take files in with Prefect and without."""
    for number in range(files + 2):
        few = "first" if number == 0 else "one" if number == 1 else "many"
        (folder / few).mkdir(exist_ok=True)
        path = folder / few / f"walk{number:04}.trc"
        write_trc(path, swaying_body(number, frames), JOINTS, 30.0)
    home, url, server = start_server(folder)
    environment = {**os.environ, "PREFECT_API_URL": url, "PREFECT_HOME": str(folder / "other")}
    environment["PYTHONPATH"] = str(ROOT)
    ingest = [sys.executable, "-m", "flows.command.main", "--quiet", "ingest"]
    plain = [sys.executable, "-m", "tests.benchmarks.running.overhead", PLAIN]
    spent: dict[str, list[float]] = {}
    try:
        for few in ("first", "one", "many"):  # in the first run kernels and the database are made
            before = [used_by(server.pid), size_of(home)]
            client = run([*ingest, str(folder / "archive"), str(folder / few)], environment)
            settle(server.pid)
            after = [used_by(server.pid), size_of(home)]
            work = run([*plain, str(folder / "plain"), str(folder / few)], environment)
            spent[few] = [client, after[0] - before[0], work, after[1] - before[1]]
    finally:
        server.terminate()
        server.wait()
    client, served, work, stored = (
        (many - one) / (files - 1) for one, many in zip(spent["one"], spent["many"], strict=True)
    )
    sys.stdout.write(
        f"a motion file of {frames} frames, in a run of {files}, in processor time:\n"
        f"  client {client * 1e3:.1f} ms, server {served * 1e3:.1f} ms, the work itself "
        f"{work * 1e3:.1f} ms, beyond it {(client + served - work) * 1e3:.1f} ms\n"
        f"  database {stored / 1e3:.1f} kB\n"
    )


def start_server(folder: Path) -> tuple[Path, str, subprocess.Popen[bytes]]:
    """Start a Prefect server; return its folder, the address of its API, and its process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    home = folder / "home"
    process = subprocess.Popen(
        [sys.executable, "-m", "prefect", "server", "start", "--port", str(port)],
        env={**os.environ, "PREFECT_HOME": str(home), "PREFECT_SERVER_ANALYTICS_ENABLED": "false"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    url = f"http://127.0.0.1:{port}/api"
    while process.poll() is None:
        try:
            check_url(url)
            return home, url, process
        except ServerError:
            time.sleep(0.5)
    raise SystemExit("the Prefect server does not start")


def run(command: list[str], environment: dict[str, str]) -> float:
    """Run a program; return the processor time that it took [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def settle(process: int) -> None:
    """Wait until a server has written what it was told."""
    used = -1.0
    while used_by(process) - used > 0.2 * SETTLED_S:  # at rest it takes less than a fifth
        used = used_by(process)
        time.sleep(SETTLED_S)


def used_by(process: int) -> float:
    """Return the processor time of a process and its children so far [s] (Linux)."""
    pids, times = [process], 0.0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        times += (int(fields[11]) + int(fields[12])) / TICKS
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        pids += [int(each) for each in children]
    return times


def size_of(home: Path) -> int:
    """Return how much a server's database holds [bytes]."""
    with closing(sqlite3.connect(home / "prefect.db")) as database:
        pages, free, size = (
            database.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("page_count", "freelist_count", "page_size")
        )
    return (pages - free) * size


if __name__ == "__main__":
    main()
