"""Tests of what the server is told: what an older version told it is replaced, runs and all."""

import os
import subprocess
import sys
from importlib import import_module

import pytest

from storage import create_archive
from tests.conftest import ROOT

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]

OLDER = """
from flows.service import deploying
from flows.service.served import read_served
for each in deploying._deployments(read_served()):
    each.entrypoint = each.entrypoint.replace("flows.service.", "flows.of_before.")
    each.apply()
"""
"""Tells the server of the forms as a version does whose modules are called otherwise."""
ASKED = {"ingest": {"paths": ["a.trc"]}, "digitize": {"capture": "a"}, "search": {"query": "a"}}
"""What has to be filled in, by the form."""


def test_a_run_that_waits_since_an_older_version_is_one_of_this_version(tmp_path):
    from prefect import get_client
    from prefect.settings import PREFECT_API_URL

    from flows.service import forms
    from flows.service.served import VARIABLE, Served, write_served

    served = Served(create_archive(tmp_path / "archive").location)
    environment = {
        **os.environ, "PREFECT_API_URL": PREFECT_API_URL.value(), "PYTHONPATH": str(ROOT),
        VARIABLE: write_served(served),
    }  # fmt: skip

    def tell(*how):
        subprocess.run([sys.executable, *how], env=environment, check=True)

    def entrypoint_of(run):
        """A run finds its program by its deployment, when it begins."""
        return client.read_deployment(client.read_flow_run(run.id).deployment_id).entrypoint

    tell("-m", "flows.service.deploying", "deploy")
    tell("-c", OLDER)
    with get_client(sync_client=True) as client:
        runs = {}
        for each in client.read_deployments():
            name = (each.entrypoint or "").removeprefix("flows.of_before.forms.")
            if name != each.entrypoint:
                asked = ASKED.get(name)
                runs[name] = client.create_flow_run_from_deployment(each.id, parameters=asked)
        assert len(runs) == 8
        assert all(run.state.is_scheduled() for run in runs.values())
        tell("-m", "flows.service.deploying", "deploy")
        for name, run in runs.items():
            module, _, flow = entrypoint_of(run).rpartition(".")
            assert getattr(import_module(module), flow) is getattr(forms, name)
            assert client.read_flow_run(run.id).state.is_scheduled()
            client.delete_deployment(run.deployment_id)
