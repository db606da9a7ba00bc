"""The processes of this machine that shosa started, told by their environment."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

import psutil

from flows.service.served import VARIABLE

_RUN = "PREFECT__FLOW_RUN_ID"
"""The variable by which a worker tells a process which run it is."""


@dataclass(frozen=True)
class Process:
    """A process whose environment this user may read."""

    number: int
    said: str
    """What it runs."""
    environment: Mapping[str, str]

    @property
    def run(self) -> str | None:
        """The run of a flow that it is, if it is one."""
        return self.environment.get(_RUN)


def served_processes(home: str | None = None) -> Iterator[Process]:
    """Yield the living processes that a `shosa serve` started, on whatever system.

    Parameters
    ----------
    home
        Only those whose PREFECT_HOME this is.
    """
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            environment = process.environ()
            is_of_home = home is None or environment.get("PREFECT_HOME") == home
            said = " ".join(process.cmdline())
            if VARIABLE in environment and is_of_home and said:
                yield Process(process.pid, said, environment)
