"""The page of a day, for a schedule: what came in, what was refused, how large the archive is."""

import logging
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

logger = logging.getLogger(__name__)

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
    """Return the runs that failed or crashed since then, the newest first, and why."""
    runs = FlowRunFilter(
        state=FlowRunFilterState(
            type=FlowRunFilterStateType(any_=[StateType.FAILED, StateType.CRASHED])
        ),
        start_time=FlowRunFilterStartTime.model_validate({"after_": since}),
    )
    with get_client(sync_client=True) as client:
        found = client.read_flow_runs(flow_run_filter=runs, limit=_MOST_RUNS)
    found.sort(key=lambda run: run.start_time or since, reverse=True)
    return [(run.name, (run.state.message if run.state else "") or "no reason") for run in found]
