"""How much the database of an idle `shosa serve` grows, and what of it stays.

    python -m tests.benchmarks.running.idle [--minutes 12] [--every 15]

`serve` has what its scans leave removed after an hour, once an hour. Here events are removed after
a minute, once a minute, and at the end the runs that found nothing are removed as scans do it; what
is there then is what a day adds to, the rest is there for an hour or two.
"""

import argparse
import json
import sqlite3
import tempfile
import time
from collections import Counter
from contextlib import closing
from pathlib import Path

from flows.service.environment import SOON_OLD
from flows.service.processes import served_processes
from flows.service.served import ENDED
from tests.benchmarks.running.database import remove_scans, sizes_of
from tests.benchmarks.running.share import own_time
from tests.benchmarks.running.soak import say
from tests.benchmarks.running.workers import ask, is_first, is_of, serving

KEPT_S = 60.0
SCAN_S = 15.0
"""So long a scan takes at most, from its schedule to its last event."""
SCANS_A_DAY = 1440
"""With `--every 60`, as it is by default."""


def main() -> None:
    """Serve an empty inbox, look, and print what a scan leaves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=12.0)
    parser.add_argument("--every", type=float, default=15.0)
    options = parser.parse_args()
    settings = {
        "PREFECT_SERVER_SERVICES_DB_VACUUM_LOOP_SECONDS": str(KEPT_S),
        "PREFECT_SERVER_SERVICES_DB_VACUUM_EVENT_RETENTION_OVERRIDES": json.dumps(
            dict.fromkeys([ENDED, *(f"prefect.{each}" for each in SOON_OLD)], KEPT_S)
        ),
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "inbox").mkdir()
        with serving(folder, every_s=options.every, settings=settings) as url:
            watch(folder, url, options.minutes)


def watch(folder: Path, url: str, minutes: float) -> None:
    """Look at the start and at the end, remove what scans remove, and look again."""
    ours = {each.number: each for each in served_processes() if is_of(folder, each)}
    ours = {number: each.said for number, each in ours.items() if is_first(ours, number)}
    home = folder / "home-0"
    schedule(url, "pause")  # else scans of the last minute would count
    REMOVED[0] += remove_scans(url)
    time.sleep(3 * KEPT_S)
    before, used = (look(home, url), {number: own_time(number) for number in ours})
    schedule(url, "resume")
    time.sleep(60 * minutes)
    schedule(url, "pause")
    between = look(home, url)
    for number, said in ours.items():
        kind = "server" if "server start" in said else "worker"
        share = (own_time(number) - used[number]) / (60 * minutes)
        say(f"{kind}: {share:.1%} of a processor")
    REMOVED[0] += remove_scans(url)
    time.sleep(3 * KEPT_S)
    after = look(home, url)
    scans = between[1] - before[1]
    for title, (sizes, _) in (("with the scans of that time", between), ("without", after)):
        grown = Counter(sizes)
        grown.subtract(before[0])
        total = sum(grown.values())
        most = ", ".join(f"{table} {n / scans:.0f}" for table, n in grown.most_common(8) if n > 0)
        say(
            f"{scans} scans, {title}: {total / 1e3:.0f} kB, {total / scans / 1e3:.1f} kB a scan, "
            f"{total / scans * SCANS_A_DAY / 1e6:.1f} MB a day of {SCANS_A_DAY} scans; "
            f"bytes a scan: {most}"
        )
    with closing(sqlite3.connect(home / "prefect.db")) as database:
        left = database.execute("SELECT event, count(*) FROM events GROUP BY 1 ORDER BY 2 DESC")
        say(f"events that are left: {left.fetchall()}")
    say(f"all of the database: {sum(after[0].values()) / 1e6:.1f} MB")


def schedule(url: str, what: str) -> None:
    """Pause the schedule of the scans, or resume it."""
    scans = ask(url, "deployments/name/scan/inbox")["id"]
    ask(url, f"deployments/{scans}/{what}_deployment", {})
    time.sleep(SCAN_S)


def look(home: Path, url: str) -> tuple[Counter[str], int]:
    """Return how large each table is, and how many scans there have been."""
    runs = ask(url, "flow_runs/count", {})
    return sizes_of(home), runs + REMOVED[0]


REMOVED = [0]
"""How many runs this program has removed."""


if __name__ == "__main__":
    main()
