"""What nobody looks at any more leaves the server: scans that found nothing, and old stages."""

import re
import time
from datetime import UTC, datetime, timedelta
from typing import Any

from prefect import State, get_client
from prefect.client.schemas.filters import (
    FlowRunFilter,
    FlowRunFilterDeploymentId,
    FlowRunFilterEndTime,
    FlowRunFilterState,
    FlowRunFilterStateType,
    FlowRunFilterTags,
    TaskRunFilter,
    TaskRunFilterSubFlowRuns,
)
from prefect.client.schemas.objects import StateType
from prefect.client.schemas.sorting import FlowRunSort
from prefect.events import emit_event
from prefect.runtime import deployment, flow_run

from flows.service.inbox import KNOWN, NOTHING_NEW, STARTED, WAITING
from flows.service.served import ENDED, POOL

_APART_S = 3.0
"""Between a beat and the end [s]. What comes together the server takes in any order, and then tries
to crash a run that is over: with 1 s, on a busy machine, two of three."""
_IDLE_KEPT_H = 1  # how long scans that found nothing are shown; 1440 a day would hide the others
_IDLE_FORGOTTEN = 10  # at most so many in one scan: it should be over soon
_IDLE = re.compile(rf"{NOTHING_NEW}|\d+ ({WAITING}|{STARTED}|{KNOWN})")
"""What is said by a scan that nobody has to know of: what it started has runs of its own."""
_STAGES_KEPT_H = 24
"""How long the stages of what went well are shown: they are most of what a take leaves in the
database, 4 kB each, and the page of the take says how long each took."""
_STAGES_FORGOTTEN = 20  # at most so many in one scan


def forget_idle_scans() -> None:
    """Remove scans from the dashboard that found nothing, or never began, after an hour."""
    if not deployment.id:
        return
    before = datetime.now(UTC) - timedelta(hours=_IDLE_KEPT_H)
    scans = FlowRunFilter(
        deployment_id=FlowRunFilterDeploymentId.model_validate({"any_": [deployment.id]}),
        end_time=FlowRunFilterEndTime.model_validate({"before_": before}),
    )
    with get_client(sync_client=True) as client:
        ended = client.read_flow_runs(flow_run_filter=scans, sort=FlowRunSort.END_TIME_DESC)
        idle = [run for run in ended if run.state and is_idle(run.state)]
        for run in idle[-_IDLE_FORGOTTEN:]:
            client.delete_flow_run(run.id)


def forget_stages() -> None:
    """Remove the runs of tasks inside runs that went well, after a day.

    The run itself stays, with its log and its page; of one that did not go well, all of it does.
    """
    before = datetime.now(UTC) - timedelta(hours=_STAGES_KEPT_H)
    good = FlowRunFilterStateType(any_=[StateType.COMPLETED])
    runs = FlowRunFilter(
        tags=FlowRunFilterTags.model_validate({"all_": [*_own_tags()]}),
        state=FlowRunFilterState.model_validate({"type": good}),
        end_time=FlowRunFilterEndTime.model_validate({"before_": before}),
    )
    # what stands for a run inside a run is left, or that one would be listed beside the others
    stages = TaskRunFilter.model_validate({"subflow_runs": TaskRunFilterSubFlowRuns(exists_=False)})
    with get_client(sync_client=True) as client:
        for stage in client.read_task_runs(
            flow_run_filter=runs, task_run_filter=stages, limit=_STAGES_FORGOTTEN
        ):
            client.delete_task_run(stage.id)


def _own_tags() -> list[str]:
    """Return the tags of this run, by which those of this archive are told."""
    return [each for each in flow_run.tags if each.startswith(f"{POOL}-")]


def is_idle(state: State[Any]) -> bool:
    """Say whether a scan with this state took nothing in itself, or was not even begun."""
    if state.is_cancelled():
        return True
    said = re.split("[;,] ", state.message or "")
    return state.is_completed() and all(_IDLE.fullmatch(each) for each in said)


def tell_end() -> None:
    """Tell the server that no more beats come.

    Of a run on a schedule it considers the end itself only minutes later, as it waits for an event
    of its scheduling, which there is none of: each scan would look like one whose heart stopped.
    """
    if flow_run.id:
        time.sleep(_APART_S)
        emit_event(ENDED, resource={"prefect.resource.id": f"prefect.flow-run.{flow_run.id}"})
