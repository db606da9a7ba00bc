"""Keep the ratios of `make bench` beside those of the last release, so that a slower program shows.

`history.jsonl` has a line for each benchmark of a run: the commit and its release, the date, the
processor, and ratios within that run. Seconds of other machines would say nothing here.
"""

import json
import platform
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

HISTORY = Path(__file__).with_name("history.jsonl")


def keep_ratios(benchmark: str, ratios: Mapping[str, float], history: Path = HISTORY) -> None:
    """Print ratios beside the last release's, or the first ones before there is one; add a line.

    Parameters
    ----------
    benchmark
        Which one was run.
    ratios
        By what was compared; larger is faster, or the name says what is counted.
    history
        The file that the line goes to.
    """
    before = last_release(benchmark, history)
    then = before["ratios"] if before else {}
    said = f"  of {before['release'] or before['commit']}, {before['processor']}" if before else ""
    sys.stdout.write(f"\n{benchmark:64} {'ratio':>8} {'before':>8}{said}\n")
    for name, ratio in ratios.items():
        sys.stdout.write(f"{name:64} {ratio:8.2f} {then.get(name, float('nan')):8.2f}\n")
    line = {
        "benchmark": benchmark,
        "commit": _git("describe", "--always", "--dirty", "--exclude=*") or "unknown",
        "release": _git("describe", "--exact-match", "--match=v*"),
        "date": datetime.now(UTC).date().isoformat(),
        "processor": _processor(),
        "ratios": {name: round(ratio, 3) for name, ratio in ratios.items()},
    }
    with history.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n")


def last_release(benchmark: str, history: Path = HISTORY) -> dict[str, Any] | None:
    """Return the last line of a release, before there is one the first line, None where none is."""
    text = history.read_text("utf-8") if history.exists() else ""
    lines = [json.loads(line) for line in text.splitlines()]
    own = [line for line in lines if line["benchmark"] == benchmark]
    released = [line for line in own if line["release"]]
    return released[-1] if released else own[0] if own else None


def _git(*arguments: str) -> str | None:
    """Return what git says of this repository; None where it says nothing."""
    command = ["git", "-C", str(HISTORY.parent), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip() or None


def _processor() -> str:
    """Return what the processor is called."""
    path = Path("/proc/cpuinfo")
    for line in path.read_text().splitlines() if path.exists() else ():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
