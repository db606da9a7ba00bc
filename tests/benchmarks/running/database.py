"""What a take that `shosa serve` digitized leaves in the database of its server, table by table.

    python -m tests.benchmarks.running.database [--frames 60] [CAPTURE ...]

The first capture makes the tables, the others are measured: when they are in, and as they are after
a day, when the stages of what went well are removed. Most of what is in `events` is removed after
an hour, all else after thirty days.
"""

import argparse
import shutil
import sqlite3
import sys
import tempfile
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

from flows.service.processes import served_processes
from flows.service.served import tag_of
from storage import open_archive
from tests.benchmarks.recordings import data_folder
from tests.benchmarks.running.overhead import settle
from tests.benchmarks.running.soak import say
from tests.benchmarks.running.workers import (
    CAPTURES,
    FRAMES,
    ask,
    is_of,
    serving,
    shorten,
    wait,
)

PASSING = ("events", "event_resources")
"""Tables whose lines `serve` has removed after an hour, most of them."""
LOGS_S = 10.0
"""The server removes the logs of what was removed a moment later [s]."""


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures", nargs="*", type=Path, metavar="CAPTURE")
    parser.add_argument("--frames", type=int, default=FRAMES, help="of each; 0 for all")
    options = parser.parse_args()
    given = options.captures or [data_folder() / "captures" / name for name in CAPTURES]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        waiting = folder / "inbox" / ".captures"
        for path in given:
            if options.frames:
                shorten(path, waiting / path.name, options.frames)
            else:
                shutil.copytree(path, waiting / path.name)
        with serving(folder) as url:
            measure(folder, url, sorted(waiting.iterdir()))


def measure(folder: Path, url: str, captures: list[Path]) -> None:
    """Have captures digitized, one after another, and print what all but the first left."""
    archive, home = folder / "archive", folder / "home-0"
    found = (each for each in served_processes() if is_of(folder, each))
    server = next(each.number for each in found if "server start" in each.said)
    before: Counter[str] = Counter()
    for number, capture in enumerate(captures):
        capture.rename(folder / "inbox" / capture.name)
        name = f"digitize {capture.name}"
        wait(lambda name=name: has_ended(url, name), f"{name} does not end")
        settle(server)
        remove_scans(url)
        before = before if number else sizes_of(home)
    takes = len(open_archive(archive).takes()) - 1
    whole = sizes_of(home)
    remove_stages(url, str(archive))
    for title, left in (("at once", whole), ("after a day", sizes_of(home))):
        left.subtract(before)
        kept = {table: size for table, size in left.most_common() if size > 0}
        total = sum(left.values())
        lasting = total - sum(left[table] for table in PASSING)
        tables = ", ".join(f"{table} {size / takes / 1e3:.1f}" for table, size in kept.items())
        say(f"a take, {title}: {total / takes / 1e3:.1f} kB, {lasting / takes / 1e3:.1f} kB "
            f"without events: {tables}")  # fmt: skip


def has_ended(url: str, name: str) -> bool:
    """Say whether a run with this name is over."""
    wanted = {"flow_runs": {"name": {"any_": [name]}, "state": {"type": {"any_": ["COMPLETED"]}}}}
    return bool(ask(url, "flow_runs/filter", wanted))


def remove_scans(url: str) -> int:
    """Remove all ended scans that found nothing, as a scan does after an hour; return how many."""
    from prefect.settings import PREFECT_API_URL, temporary_settings

    from flows.service import forgetting

    scans = ask(url, "deployments/name/scan/inbox")["id"]
    before = ask(url, "flow_runs/count", {})
    with (
        temporary_settings({PREFECT_API_URL: url}),
        mock.patch.object(forgetting, "deployment", SimpleNamespace(id=scans)),
        mock.patch.object(forgetting, "_IDLE_KEPT_H", 0),
        mock.patch.object(forgetting, "_IDLE_FORGOTTEN", sys.maxsize),
    ):
        forgetting.forget_idle_scans()
    return before - ask(url, "flow_runs/count", {})


def remove_stages(url: str, archive: str) -> None:
    """Remove the stages of what went well, as scans do after a day."""
    from prefect.settings import PREFECT_API_URL, temporary_settings

    from flows.service import forgetting

    with (
        temporary_settings({PREFECT_API_URL: url}),
        mock.patch.object(forgetting, "flow_run", SimpleNamespace(tags=[tag_of(archive)])),
        mock.patch.object(forgetting, "_STAGES_KEPT_H", 0),
        mock.patch.object(forgetting, "_STAGES_FORGOTTEN", 200),
    ):
        forgetting.forget_stages()
    time.sleep(LOGS_S)


def sizes_of(home: Path) -> Counter[str]:
    """Return how much each table of a server's database holds, its indexes with it [bytes]."""
    said = (
        "SELECT m.tbl_name, sum(s.pgsize - s.unused) FROM dbstat AS s "
        "JOIN sqlite_master AS m ON m.name = s.name GROUP BY 1"
    )
    with closing(sqlite3.connect(home / "prefect.db")) as database:
        return Counter(dict(database.execute(said).fetchall()))


if __name__ == "__main__":
    main()
