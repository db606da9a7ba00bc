"""Tests of what leaves the server: scans that found nothing, and old stages of good runs."""

import time
from types import SimpleNamespace

import pytest

from tests.conftest import HANGING_S

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]


def test_scans_that_found_nothing_are_forgotten_and_the_others_are_not(monkeypatch):
    from prefect import get_client
    from prefect.states import Cancelled, Completed, Failed

    from flows.service import forgetting, forms

    states = [
        Completed(message="nothing new; 3 being taken in, 1 waiting until nobody writes to them"),
        Cancelled(message="Deployment concurrency limit reached."),
        Completed(message="nothing new; 1 taken in"),
        Failed(message="the disk is away"),
    ]
    with get_client(sync_client=True) as client:
        flow = client.create_flow(forms.scan)
        deployment = client.create_deployment(flow, "inbox")
        runs = [client.create_flow_run_from_deployment(deployment, state=state) for state in states]
        other = client.create_flow_run(forms.scan, state=states[0])
        monkeypatch.setattr(forgetting, "deployment", SimpleNamespace(id=str(deployment)))
        forgetting.forget_idle_scans()
        assert len(client.read_flow_runs()) >= 5  # none is an hour old
        monkeypatch.setattr(forgetting, "_IDLE_KEPT_H", -1)
        forgetting.forget_idle_scans()
        left = {run.id for run in client.read_flow_runs(limit=200)}
    assert {runs[2].id, runs[3].id, other.id} <= left
    assert not {runs[0].id, runs[1].id} & left


def test_stages_of_what_went_well_are_forgotten_after_a_day(monkeypatch):
    from prefect import flow as a_flow
    from prefect import get_client, tags, task
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId
    from prefect.states import Failed

    from flows.service import forgetting

    @task
    def stage():
        return None

    @a_flow
    def inner():
        stage()

    @a_flow
    def work(*, is_good):
        stage()
        if is_good:
            inner()
        return None if is_good else Failed(message="bad")

    runs = {}
    for name, tag, is_good in (
        ("good", "shosa-one", True), ("bad", "shosa-one", False), ("other's", "shosa-two", True)
    ):  # fmt: skip
        with tags(tag):
            state = work(is_good=is_good, return_state=True)
            runs[name] = state.state_details.flow_run_id

    def left(client):
        """The tasks of each run, but for those of the runs inside it."""
        ids = {name: FlowRunFilterId(any_=[run]) for name, run in runs.items()}
        return {
            name: sorted(
                each.name.split("-")[0]
                for each in client.read_task_runs(flow_run_filter=FlowRunFilter(id=number))
            )
            for name, number in ids.items()
        }

    everything = {"good": ["inner", "stage"], "bad": ["stage"], "other's": ["inner", "stage"]}
    monkeypatch.setattr(forgetting, "flow_run", SimpleNamespace(tags=["shosa", "shosa-one"]))
    with get_client(sync_client=True) as client:
        until(lambda: left(client) == everything)  # the server hears of tasks by events
        forgetting.forget_stages()
        assert left(client) == everything  # none is a day old
        monkeypatch.setattr(forgetting, "_STAGES_KEPT_H", -1)
        forgetting.forget_stages()
        assert left(client) == {**everything, "good": ["inner"]}
        assert client.read_flow_run(runs["good"]).state.is_completed()


def until(is_so):
    """Wait until something is so."""
    deadline = time.monotonic() + HANGING_S
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.1)
