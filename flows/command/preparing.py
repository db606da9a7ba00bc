"""What is done before Prefect is imported: how it is set, and what goes on while it starts."""

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


def prepare_prefect() -> None:
    """Make Prefect ready for a run in this process, or say why it cannot be."""
    hush_prefect()
    os.environ.setdefault("PREFECT_LOGGING_INTERNAL_LEVEL", "CRITICAL")
    # a server that went away is asked twice again, for some seconds, not for a minute each time
    os.environ.setdefault("PREFECT_CLIENT_MAX_RETRIES", "2")
    logging.raiseExceptions = False  # what a log cannot be told is not told on the terminal
    from flows.server import check_server

    check_server()


def hush_prefect() -> None:
    """Keep Prefect's own log off the terminal; the dashboard has it."""
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
    os.environ.setdefault("PREFECT_SERVER_LOGGING_LEVEL", "CRITICAL")


@contextmanager
def compiling_early(recordings: Sequence[Path]) -> Iterator[None]:
    """Let kernels be compiled, once after an installation, while Prefect and its server start.

    They keep one processor busy for a quarter of a minute, in which another one would be idle.
    Nothing happens where none of the recordings is a capture.
    """
    if not any(each.is_dir() for each in recordings):
        yield
        return
    from flows.progress import tell_compiled
    from tasks.engine.compiling import compiling_beside

    with compiling_beside(tell_compiled):
        yield
