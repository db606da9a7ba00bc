"""The page of a day, for a schedule: what came in, what was refused, how large the archive is."""

import logging
import re
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from prefect import flow
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import (
    FlowRunFilter,
    FlowRunFilterStartTime,
    FlowRunFilterState,
    FlowRunFilterStateType,
)
from prefect.client.schemas.objects import StateType

from flows.artifacts import shown
from flows.dashboard import show_day
from flows.outcomes import REFUSED

logger = logging.getLogger(__name__)

_AGAIN = re.compile(r" \(tried again after \d+ s\)")
_MOST_RUNS = 100
"""How many failed runs are asked for. Chosen: a page that a person reads."""


@flow(name="summarize_archive", flow_run_name="the day of {archive}")
def summarize_archive(archive: str, inboxes: Sequence[str] = (), hours: float = 24.0) -> str:
    """Show what happened to an archive in the last hours, and how large it is.

    Args:
        archive: A directory or s3://bucket/prefix.
        inboxes: The folders whose quarantine is looked at.
        hours: How long the day is.
    """
    failed = shown(failed_runs, since=datetime.now(UTC) - timedelta(hours=hours)) or []
    return show_day(archive, inboxes=inboxes, hours=hours, failed=failed)


def failed_runs(since: datetime) -> list[tuple[str, str]]:
    """Return the runs that failed or crashed since then, the newest first, and why.

    Of runs inside runs the outermost is meant. What was refused is told by the quarantine; what
    failed several times for one reason is told once.
    """
    runs = FlowRunFilter(
        state=FlowRunFilterState(
            type=FlowRunFilterStateType(any_=[StateType.FAILED, StateType.CRASHED])
        ),
        start_time=FlowRunFilterStartTime.model_validate({"after_": since}),
    )
    with get_client(sync_client=True) as client:
        found = client.read_flow_runs(flow_run_filter=runs, limit=_MOST_RUNS)
    found.sort(key=lambda run: run.start_time or since, reverse=True)
    return told_once(
        [
            (run.name, run.state.message or "no reason")
            for run in found
            if run.parent_task_run_id is None and run.state and run.state.name != REFUSED
        ]
    )


def told_once(failed: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return runs and why they failed; what is told several times, once, with how often."""
    times = Counter((name, _AGAIN.sub("", reason)) for name, reason in failed)
    return [
        (name, f"{reason} ({count} times)" if count > 1 else reason)
        for (name, reason), count in times.items()
    ]
