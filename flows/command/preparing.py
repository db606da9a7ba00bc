"""What is done before Prefect is imported: how it is set, and what goes on while it starts."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager


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
def compiling_early(*, wanted: bool) -> Iterator[None]:
    """Let kernels be compiled, once after an installation, while Prefect and its server start.

    They keep one processor busy for a quarter of a minute, in which another one would be idle.
    """
    if not wanted:
        yield
        return
    from flows.progress import tell_compiled
    from tasks.engine.compiling import compiling_beside

    with compiling_beside(tell_compiled):
        yield


@contextmanager
def loading_early(*, wanted: bool) -> Iterator[None]:
    """Let compiled kernels be loaded while this process waits for Prefect's server.

    To be called when all of ours is imported: two threads that import wait for each other.
    """
    if not wanted:
        yield
        return
    from tasks.engine.compiling import loading_beside

    with loading_beside():
        yield
