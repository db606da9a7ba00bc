"""Calls to the Prefect server for what a dashboard shows: none of them can harm a run.

A server that went away or refuses is told of once a run, in a sentence, and is asked again a minute
later only. Nothing of the stages is imported: a scan of an inbox, every minute, pays for none.
"""

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from prefect.context import FlowRunContext

from flows.server import is_server_fault, tell_server_is_gone

logger = logging.getLogger(__name__)

_SILENT_S = 60.0
"""How long a server that failed is left alone [s]: some failures take seconds to be noticed."""

_AWAY: dict[str, float] = {}
"""When each run's server failed last [s, of `time.monotonic()`]."""
_AWAY_LOCK = threading.Lock()
_RUNS_REMEMBERED = 1000
"""A worker process may live for months."""


def shown(show: Callable[..., Any], **arguments: Any) -> Any:
    """Return what a call to the server returns, or None where it fails: the run goes on.

    Parameters
    ----------
    show
        Of `prefect.artifacts`.
    arguments
        Its arguments.
    """
    context = FlowRunContext.get()
    run = str(context.flow_run.id) if context and context.flow_run else ""
    if time.monotonic() - _AWAY.get(run, -_SILENT_S) < _SILENT_S:
        return None
    try:
        return show(**arguments)
    except Exception as error:  # whatever ails the server, the work is worth more
        with _AWAY_LOCK:
            is_new = run not in _AWAY
            while len(_AWAY) >= _RUNS_REMEMBERED:
                _AWAY.pop(next(iter(_AWAY)))
            _AWAY[run] = time.monotonic()
        if is_server_fault(error):
            tell_server_is_gone()
        elif is_new:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            logger.warning(
                "the Prefect server does not take what is to be shown on the dashboard (%s); the "
                "run goes on without",
                reason,
            )
        return None
