"""Captures that are digitized again from a page: by the command line, in programs of their own.

The viewer knows no flow. It is given a function that starts one, watches the program, and tells
how far it is. A program goes on when the viewer ends, and a run that was ended goes on later.
"""

import itertools
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

Starter = Callable[[str, Path], subprocess.Popen[bytes]]
"""Starts digitizing a capture, what it says going into a file; returns the program."""
_SHOWN = 300
"""How much of the last line that a program said is shown [characters]."""


class Digitizations:
    """What was started from the pages, by take: one at a time each."""

    def __init__(self, start: Starter, folder: Path) -> None:
        """Take what starts a program, and a folder for what they say."""
        self._start, self._folder = start, folder
        self._lock = threading.Lock()
        self._numbers = itertools.count()
        self._running: dict[str, tuple[subprocess.Popen[bytes], Path]] = {}

    def start(self, take: str, capture: Path) -> None:
        """Digitize the capture of a take again, unless that is under way."""
        with self._lock:
            if take in self._running and self._running[take][0].poll() is None:
                return
            said = self._folder / f"digitizing-{next(self._numbers)}.txt"
            said.write_bytes(b"")
            self._running[take] = self._start(str(capture), said), said

    def state(self, take: str) -> dict[str, Any]:
        """Return whether a digitization of a take runs, its exit code, and its last line."""
        with self._lock:
            held = self._running.get(take)
        if held is None:
            return {"running": False, "code": None, "said": ""}
        program, said = held
        code = program.poll()
        lines = [line for line in said.read_text("utf-8", "replace").splitlines() if line.strip()]
        return {
            "running": code is None,
            "code": code,
            "said": lines[-1].strip()[:_SHOWN] if lines else "",
        }
