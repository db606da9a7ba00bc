"""What `shosa serve` costs beside the digitization of a long film that it runs.

    python -m tests.benchmarks.running.share [CAPTURE] [--film FOLDER]

The film is that of CAPTURE ten times over, 1500 frames by default; with --film it is kept there for
the next time. It is digitized by the stages alone in a process of their own, and by a run that
`serve` starts from its form; kernels are compiled before.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from flows.service.processes import served_processes
from tests.benchmarks.recordings import data_folder
from tests.benchmarks.running.soak import say
from tests.benchmarks.running.workers import ask, is_first, is_of, serving
from tests.benchmarks.voxels.digitization import lengthen

LOOK_S = 0.1
QUIET_S = 20.0
"""After `serve` has started [s]: what it does at rest is measured for as long."""
MEASURES = ("alone", "served")


def main() -> None:
    """Measure both, and print what one has more than the other."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    plain = data_folder() / "captures" / "plain"
    parser.add_argument("capture", nargs="?", type=Path, default=plain)
    parser.add_argument("--film", type=Path, help="where the long film is, or is to be kept")
    parser.add_argument("--only", choices=MEASURES)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        film = options.film or folder / "film"
        if not film.exists():
            lengthen(options.capture, film)
        if options.only != "served":
            say_alone(film, folder / "alone")
        if options.only != "alone":
            say_served(film, folder / "served")


def say_alone(film: Path, archive: Path) -> None:
    """Digitize without Prefect, and print what it took."""
    command = [sys.executable, "-m", "tests.benchmarks.voxels.digitization", "--once"]
    done = subprocess.run(
        [*command, str(film), str(archive)], check=True, capture_output=True, text=True
    )
    found = json.loads(done.stdout)
    seconds = {each: found[f"{each}_ms"]["all"] * found["frames"] / 1e3
               for each in ("clock", "processor")}  # fmt: skip
    say(f"the stages alone: {seconds['clock']:.1f} s, {seconds['processor']:.1f} s of processor "
        f"time, {found['frames']} frames")  # fmt: skip


def say_served(film: Path, folder: Path) -> None:
    """Have it digitized by a run of `serve`, and print what everybody took."""
    (folder / "inbox").mkdir(parents=True)
    with serving(folder, every_s=60.0, roots=[film]) as url:
        ours = {each.number: each for each in served_processes() if is_of(folder, each)}
        ours = {number: each.said for number, each in ours.items() if is_first(ours, number)}
        begun = {number: own_time(number) for number in ours}
        time.sleep(QUIET_S)
        rest = {number: (own_time(number) - begun[number]) / QUIET_S for number in ours}
        begun, since = {number: own_time(number) for number in ours}, time.monotonic()
        form = ask(url, "deployments/name/digitize/digitize")
        parameters = {"parameters": {"capture": str(film)}}
        run = ask(url, f"deployments/{form['id']}/create_flow_run", parameters)
        ended, engine = wait_for(url, run["id"])
        wall = time.monotonic() - since
        time.sleep(QUIET_S / 2)  # events of the end
        for number, said in ours.items():
            kind = "server" if "server start" in said else "worker"
            spent = own_time(number) - begun[number]
            own = spent - rest[number] * (time.monotonic() - since)
            say(f"{kind}: {spent:.1f} s of processor time, {own:.1f} s more than at rest")
    say(f"the run: {ended['state_name']}, {ended['total_run_time']:.1f} s, {wall:.1f} s since it "
        f"was asked for; its process: {engine:.1f} s of processor time")  # fmt: skip


def own_time(number: int) -> float:
    """Return the processor time of a process, without that of the runs that it started [s]."""
    times = psutil.Process(number).cpu_times()
    return times.user + times.system


def wait_for(url: str, run: str) -> tuple[dict[str, Any], float]:
    """Return a run when it has ended, and the processor time of the process that it was [s]."""
    spent, asked, process = 0.0, 0.0, None
    while True:
        if process is None:
            found = (each for each in served_processes() if each.run == run)
            process = next((psutil.Process(each.number) for each in found), None)
        else:
            try:
                times = process.cpu_times()
                spent = max(spent, times.user + times.system)
            except psutil.Error:
                pass
        if time.monotonic() - asked > 1.0:
            asked = time.monotonic()
            ended = ask(url, f"flow_runs/{run}")
            is_gone = process is not None and not process.is_running()
            if ended["state_type"] in ("COMPLETED", "FAILED", "CRASHED") and is_gone:
                return ended, spent
        time.sleep(LOOK_S)


if __name__ == "__main__":
    main()
