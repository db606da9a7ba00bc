"""Tests of what the server is told: what an older version told it is replaced, runs and all."""

import pytest

from storage import create_archive

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]


def test_a_run_that_waits_since_an_older_version_is_one_of_this_version(tmp_path, monkeypatch):
    from prefect import get_client
    from prefect.client.schemas.objects import StateType
    from prefect.exceptions import ScriptError
    from prefect.flow_engine import load_flow

    from flows.service import deploying, forms
    from flows.service.served import VARIABLE, Served, write_served

    served = Served(create_archive(tmp_path / "archive").location)
    monkeypatch.setenv(VARIABLE, write_served(served))
    deploying.main("deploy")
    older = deploying._deployments(served)
    for each in older:
        each.entrypoint = each.entrypoint.replace("flows.service.", "flows.")
    numbers = [each.apply() for each in older]
    with get_client(sync_client=True) as client:
        runs = [client.create_flow_run_from_deployment(number) for number in numbers]
        assert {run.state.type for run in runs} == {StateType.SCHEDULED}
        with pytest.raises((ImportError, ScriptError)):
            load_flow(client.read_flow_run(runs[0].id))
        deploying.main("deploy")
        names = [each.flow_name for each in older]
        for name, run in zip(names, runs, strict=True):
            assert load_flow(client.read_flow_run(run.id)) is getattr(forms, name)
