"""Tell a Prefect server what can be run: the pool, the deployments, and what ends dead runs.

    python -m flows.service.deploying deploy|join

Started by `flows.service.serving`, in a process of its own, because importing Prefect and the
stages takes 200 MB that the supervisor need not keep.
"""

import os
import socket
import sys
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import Any

from prefect import Flow, get_client
from prefect.client.schemas.actions import WorkPoolCreate, WorkPoolUpdate
from prefect.client.schemas.filters import (
    FlowRunFilter,
    FlowRunFilterState,
    FlowRunFilterStateType,
)
from prefect.client.schemas.objects import (
    ConcurrencyLimitConfig,
    ConcurrencyLimitStrategy,
    FlowRun,
    StateType,
)
from prefect.client.schemas.responses import SetStateStatus
from prefect.events.actions import ChangeFlowRunState
from prefect.events.schemas.automations import AutomationCore, EventTrigger, Posture
from prefect.events.schemas.events import ResourceSpecification
from prefect.exceptions import ObjectAlreadyExists, ObjectNotFound
from prefect.states import Crashed
from prefect.types.entrypoint import EntrypointType

from flows.outcomes import REFUSED
from flows.service import forms
from flows.service.processes import served_processes
from flows.service.served import ENDED, POOL, Served, read_served, tag_of

_DIED = (
    "The run gives no sign of life: its process was killed, or its machine was switched off. What "
    "it had finished is kept."
)
AUTOMATION = "shosa: runs whose machine died are crashed"
_SILENT_S = 90  # three heartbeats
_MORNING = "0 6 * * *"  # when the day before is summed up, UTC
_PENDING_S = 120.0  # a run that a worker took begins within seconds

_TEMPLATE: dict[str, Any] = {
    "job_configuration": {"command": None, "env": {}, "labels": {}, "name": None},
    "variables": {"type": "object", "properties": {}},
}
"""How a worker starts a run. It has no variables, so no form can change the command."""


def main(action: str) -> None:
    """Do what the supervisor asks for; raises SystemExit with a sentence where it cannot."""
    served = read_served()
    with get_client(sync_client=True) as client:
        if action == "join":
            _check_same(client, served)
            _crash_dead_runs(client)
            return
        _make_pool(client, served)
        _crash_dead_runs(client)
        _make_automation(client, served)
    for each in _deployments(served):
        each.apply()


def _about(served: Served) -> str:
    """Return what the pool says of itself."""
    return f"{served.archive}, with the inboxes {', '.join(served.inboxes) or '(none)'}"


def _check_same(client: Any, served: Served) -> None:
    """Refuse to work for a server that serves something else, or by other paths."""
    try:
        about = client.read_work_pool(POOL).description
    except ObjectNotFound:
        about = "nothing yet"
    if about != _about(served):
        raise SystemExit(
            f"that server serves {about}; this machine has to see the same by the same paths, and "
            f"was told {_about(served)}"
        )


def _make_pool(client: Any, served: Served) -> None:
    """Make the work pool, or make it again as it should be."""
    about = _about(served)
    try:
        pool = client.read_work_pool(POOL)
    except ObjectNotFound:
        pool = None
    if pool is None:
        new = WorkPoolCreate(
            name=POOL, type="process", description=about, base_job_template=_TEMPLATE
        )
        try:
            client.create_work_pool(new)
            return
        except ObjectAlreadyExists:  # another machine was faster
            pool = client.read_work_pool(POOL)
    if pool.description != about and _is_anybody_working(client):
        raise SystemExit(
            f"this Prefect server serves another archive already ({pool.description}); start "
            "`shosa serve` without PREFECT_API_URL and with a --port of its own"
        )
    again = WorkPoolUpdate(description=about, base_job_template=_TEMPLATE, is_paused=False)
    client.update_work_pool(POOL, again)


def _is_anybody_working(client: Any) -> bool:
    """Say whether a worker asked the pool for runs in the last minute or so."""
    return any(
        worker.status == "ONLINE" and not _is_dead(worker.name)
        for worker in client.read_workers_for_work_pool(POOL)
    )


def _is_dead(worker: str) -> bool:
    """Say whether a worker is of a supervisor of this machine that is gone, or of our own."""
    host, _, process = worker.rpartition("-")
    if host != socket.gethostname() or not process.isdigit():
        return False
    if int(process) == os.getppid():  # it has not started its worker, or found it dead
        return True
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return False


def _crash_dead_runs(client: Any) -> None:
    """Crash the runs of this machine's workers that died: some of them have no heart to stop.

    While a worker of another machine works, only what waits for too long to begin is crashed; the
    automation looks after the rest.
    """
    shared, here = _is_anybody_working(client), {each.run for each in served_processes()}
    states = [StateType.RUNNING, StateType.PENDING, StateType.CANCELLING]
    wanted = FlowRunFilter(
        state=FlowRunFilterState(type=FlowRunFilterStateType(any_=states))  # type: ignore[call-arg]
    )
    runs: list[FlowRun] = client.read_flow_runs(flow_run_filter=wanted)
    dead = {run.id for run in runs if run.work_pool_name == POOL and str(run.id) not in here}
    if shared:
        long_ago = datetime.now(UTC) - timedelta(seconds=_PENDING_S)
        dead &= {
            run.id
            for run in runs
            if run.state and run.state.is_pending() and run.state.timestamp < long_ago
        }
    above = {run.id: _parent_of(client, run) for run in runs}
    while more := {run for run, parent in above.items() if parent in dead} - dead:
        dead |= more
    for run in dead:
        with suppress(ObjectNotFound):
            # not forced at first: so it also gives back what it held
            said = client.set_flow_run_state(run, Crashed(message=_DIED))
            if said.status != SetStateStatus.ACCEPT:
                client.set_flow_run_state(run, Crashed(message=_DIED), force=True)


def _parent_of(client: Any, run: FlowRun) -> Any:
    """Return the run that a run was started by, if it was by one."""
    if run.parent_task_run_id is None:
        return None
    with suppress(ObjectNotFound):
        return client.read_task_run(run.parent_task_run_id).flow_run_id
    return None


def _make_automation(client: Any, served: Served) -> None:
    """Have the server crash runs of this archive whose heart stopped; others are not touched."""
    beat = "prefect.flow-run.heartbeat"
    ends = ("Completed", "Failed", REFUSED, "Cancelled", "Crashed")  # by the names of states
    ended = [*(f"prefect.flow-run.{end}" for end in ends), ENDED]
    related = ResourceSpecification(
        {
            "prefect.resource.id": f"prefect.tag.{tag_of(served.archive)}",
            "prefect.resource.role": "tag",
        }
    )
    wanted = AutomationCore(
        name=AUTOMATION,
        description="Without it they would count as running for ever.",
        trigger=EventTrigger(
            after={beat},
            expect={beat, *ended},
            match={"prefect.resource.id": "prefect.flow-run.*"},  # type: ignore[arg-type]
            match_related=related,
            for_each={"prefect.resource.id"},
            posture=Posture.Proactive,
            threshold=1,
            within=timedelta(seconds=_SILENT_S),
        ),
        actions=[
            ChangeFlowRunState(name=None, state=StateType.CRASHED, message=_DIED, force=False)
        ],
    )
    known = client.read_automations_by_name(AUTOMATION)
    if not known:
        client.create_automation(wanted)
        return
    there: Any = known[0].trigger
    same = [
        (getattr(each, "match_related", None), getattr(each, "expect", None))
        for each in (there, wanted.trigger)
    ]
    if same[0] != same[1]:  # of before, or elsewhere
        client.update_automation(known[0].id, wanted)


def _deployments(served: Served) -> list[Any]:
    """Return what can be run, and when the inboxes are scanned."""
    when: dict[str, Any] = {}
    if served.inboxes:
        when = {"cron": served.cron} if served.cron else {"interval": served.every_s}
    never_beside_itself = ConcurrencyLimitConfig(
        limit=1, collision_strategy=ConcurrencyLimitStrategy.CANCEL_NEW
    )
    deployments: list[tuple[Flow[..., Any], str, dict[str, Any]]] = [
        (forms.scan, "inbox", {**when, "concurrency_limit": never_beside_itself}),
        (forms.ingest, "ingest", {}),
        (forms.digitize, "digitize", {}),
        (forms.index, "index", {}),
        (forms.search, "search", {}),
        (forms.verify, "verify", {}),
        (forms.gc, "gc", {}),
        (forms.summarize, "summary", {"cron": _MORNING}),
    ]
    return [
        each.to_deployment(
            name,
            work_pool_name=POOL,
            entrypoint_type=EntrypointType.MODULE_PATH,
            tags=["shosa", tag_of(served.archive)],
            **options,
        )
        for each, name, options in deployments
    ]


if __name__ == "__main__":
    main(sys.argv[1])
