"""A process that the supervisor keeps alive: started again when it dies, ended with all it runs."""

import ctypes
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

logger = logging.getLogger(__name__)

_STOP_S = 30.0  # what a worker gets to end its runs, then they are killed
_STEADY_S = 60.0  # a child that ran for so long did not die of its start
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 60.0  # before a child that died is started again


class Child:
    """A process by its command, to be started, watched and ended."""

    def __init__(self, name: str, command: list[str]) -> None:
        self.name, self.command = name, command
        self.process: subprocess.Popen[bytes] | None = None
        self.started = self.due = 0.0
        self.pause_s = _FIRST_PAUSE_S
        self.log: Path | None = None

    def start(self, environment: Mapping[str, str]) -> None:
        """Start the process with an environment; what it says goes into a log in PREFECT_HOME."""
        # a session of its own: Ctrl-C in a terminal is for the supervisor, which ends the rest
        self.log = Path(environment["PREFECT_HOME"]) / f"{self.name}.log"
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                self.command,
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
        self.started = time.monotonic()

    def is_dead(self) -> bool:
        """Say whether it does not run: it ended, or was not started."""
        return self.process is None or self.process.poll() is not None

    def code(self) -> int | None:
        """Return the code with which it ended; None before that."""
        return self.process.returncode if self.process else None

    def keep(self, environment: Mapping[str, str]) -> bool:
        """Start it if it is dead; the more often it dies, the later. Say whether it had died."""
        now = time.monotonic()
        if not self.is_dead():
            return False
        died = self.process is not None
        if self.process is not None:
            steady = now - self.started > _STEADY_S
            self.pause_s = _FIRST_PAUSE_S if steady else self.pause_s
            logger.warning(
                "the %s ended (%s); it is started again in %.0f s: %s",
                *(self.name, self.code(), self.pause_s, self.last_words()),
            )
            self.process, self.due = None, now + self.pause_s
            self.pause_s = min(2 * self.pause_s, _LONGEST_PAUSE_S)
        if now >= self.due:
            self.start(environment)
        return died

    def kill(self) -> None:
        """End the process, but not what it runs; it is started anew at the next look."""
        if self.process is not None and not self.is_dead():
            self.process.kill()
            self.process.wait()
        self.process, self.due = None, 0.0

    def stop(self) -> None:
        """End the process and all that it runs."""
        if self.process is None:
            return
        group = self.process.pid
        if self.process.poll() is None:
            self.process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(_STOP_S)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)  # what it left behind
        self.process.wait()

    def last_words(self) -> str:
        """Return the last line that says something of its log, and where the log is."""
        if self.log is None:
            return "it was not started"
        lines = self.log.read_bytes()[-20_000:].decode(errors="replace").splitlines()
        said = [line.strip() for line in lines if any(each.isalpha() for each in line)]
        return f"{said[-1] if said else 'it said nothing'} (all of it is in {self.log})"


def _die_with_parent() -> None:
    """In a child before it begins: end when the supervisor is killed (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # 1: PR_SET_PDEATHSIG
