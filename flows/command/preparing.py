"""What is set before Prefect is imported: what it says, and how long it asks a server."""

import logging
import os


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
