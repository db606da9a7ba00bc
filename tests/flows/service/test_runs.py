"""Tests of the runs that a scan starts: they are followed, and what they left is begun again."""

import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from storage import create_archive, open_archive
from tests.flows.service.conftest import BROKEN, known, takes

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]


def put_capture(folder):
    folder.mkdir()
    (folder / "capture.toml").write_text("[take]\n")


def test_a_capture_is_digitized_by_one_run_of_its_own_that_is_followed(
    scan, tmp_path, folder, monkeypatch
):
    from prefect import get_client
    from prefect.states import Cancelled, Completed, Crashed, Failed, Running

    from flows.service import inbox, runs

    started = []

    def start(_, *, idempotency_key, parameters, **__):
        with get_client(sync_client=True) as client:
            run = client.create_flow_run(inbox.scan_inbox, state=Running())
        started.append((run.id, idempotency_key, parameters))
        return run

    def end(state):
        with get_client(sync_client=True) as client:
            client.set_flow_run_state(started[-1][0], state, force=True)

    monkeypatch.setattr(runs, "run_deployment", start)
    monkeypatch.setattr("storage.inbox.memory.FIRST_PAUSE_S", 0.0)
    put_capture(folder / "cap")
    assert scan(apart=True).message == "1 being taken in"
    assert scan(apart=True).message == "nothing new"  # it is still running
    end(Crashed())
    scan(apart=True)
    assert known(tmp_path, folder) == {"cap": "failed"}
    scan(apart=True)
    assert known(tmp_path, folder) == {"cap": "started"}
    assert len({key for _, key, _ in started}) == len(started) == 2
    assert {str(parameters) for *_, parameters in started} == {
        str({"capture": str(folder / "cap")})
    }
    for state, so in (
        (Completed(), "in"),
        (Failed(name="Refused"), "refused"),
        (Cancelled(), "refused"),
    ):
        (folder / "cap" / "more").write_text(so + state.name)
        scan(apart=True)
        assert known(tmp_path, folder) == {"cap": "started"}
        end(state)
        scan(apart=True)
        assert known(tmp_path, folder) == {"cap": so}


def test_a_capture_that_is_moved_back_as_it_was_is_tried_again(scan, tmp_path, folder, monkeypatch):
    from prefect import get_client
    from prefect.states import Failed

    from flows.service import inbox, runs

    keys = []

    def start(_, *, idempotency_key, **__):
        keys.append(idempotency_key)
        with get_client(sync_client=True) as client:
            return client.create_flow_run(inbox.scan_inbox, state=Failed(name="Refused"))

    monkeypatch.setattr(runs, "run_deployment", start)
    put_capture(folder / "cap")
    for _ in range(2):
        scan(apart=True)
        assert known(tmp_path, folder)["cap"] == "started"
        os.rename(folder / "cap", tmp_path / "cap")  # the run has moved it to quarantine
        scan(apart=True)
        assert known(tmp_path, folder) == {}
        os.rename(tmp_path / "cap", folder / "cap")
    assert len({*keys}) == 2


def test_many_files_are_taken_in_by_runs_that_any_worker_may_take(
    scan, tmp_path, folder, write_walk, monkeypatch
):
    from prefect import get_client
    from prefect.states import Crashed

    from flows.service import inbox, runs
    from flows.service.forms import ingest
    from flows.service.served import VARIABLE, Served, write_served

    archive = create_archive(tmp_path / "archive").location
    monkeypatch.setenv(VARIABLE, write_served(Served(archive, [str(folder)], [str(folder)])))
    monkeypatch.setattr(inbox, "MOST_PATHS", 2)
    monkeypatch.setattr(runs, "MOST_PATHS", 2)
    monkeypatch.setattr("storage.inbox.memory.FIRST_PAUSE_S", 0.0)
    waiting, died = [], []

    def start(deployment, *, parameters, **__):
        assert deployment == "ingest/ingest"
        waiting.append(parameters)
        with get_client(sync_client=True) as client:
            if len(waiting) == 3 and not died:  # a worker takes this one, and dies
                died.append(parameters)
                waiting.pop()
                return client.create_flow_run(inbox.scan_inbox, state=Crashed())
            state = ingest(**parameters, return_state=True)  # on another worker
            return SimpleNamespace(id=state.state_details.flow_run_id)

    monkeypatch.setattr(runs, "run_deployment", start)
    for number in range(3):
        write_walk(folder / f"walk{number}.trc", seed=number)
    shutil.copy(write_walk(folder / "a.trc", seed=3), folder / "b.trc")
    (folder / "broken.trc").write_bytes(BROKEN)
    assert scan(apart=True).message == "6 being taken in"
    assert [sorted(Path(path).name for path in each["paths"]) for each in (*waiting, *died)] == [
        ["a.trc", "b.trc"], ["broken.trc", "walk0.trc"], ["walk1.trc", "walk2.trc"],
    ]  # fmt: skip
    assert takes(tmp_path) == ["a", "walk0"]
    assert (folder / "quarantine" / "broken.trc" / "REASON.txt").exists()
    for _ in range(3):  # the dead run is noted, what it had is begun again, and that noted
        scan(apart=True)
    assert takes(tmp_path) == ["a", "walk0", "walk1", "walk2"]
    assert set(known(tmp_path, folder).values()) == {"in"}
    assert {record.number for record in open_archive(archive).records()} == {1}


@pytest.mark.parametrize("many", [101, 250, 970])
def test_files_are_split_into_runs_of_one_size_with_their_like(many):
    from flows.service.runs import split_files

    same_names = {f"{n % 7}/walk{n // 2}.trc": str(n) for n in range(many)}
    same_contents = {f"walk{n:04}.trc": str(n % (many - 3)) for n in range(many)}
    for digests, like in (
        (same_names, lambda name: Path(name).stem),
        (same_contents, same_contents.get),
        (dict.fromkeys(same_contents, ""), lambda name: name),
    ):
        batches = split_files(digests)
        assert sorted(name for batch in batches for name in batch) == sorted(digests)
        assert len(batches) == -(-many // 100)
        sizes = [len(batch) for batch in batches]
        assert max(sizes) <= 100
        assert max(sizes) - min(sizes) < 20
        found = [{like(name) for name in batch} for batch in batches]
        assert len(set().union(*found)) == sum(map(len, found))
    alike = split_files(dict.fromkeys(same_contents, "one"))  # what finds no room waits
    assert [len(batch) for batch in alike] == [100]


def test_the_run_that_finds_a_capture_bad_moves_it_away(tmp_path, folder, monkeypatch):
    from flows.service.forms import digitize
    from flows.service.served import VARIABLE, Served, write_served

    archive = create_archive(tmp_path / "archive").location
    served = Served(archive, inboxes=[str(folder)], roots=[str(folder), str(tmp_path / "root")])
    monkeypatch.setenv(VARIABLE, write_served(served))
    (tmp_path / "root").mkdir()
    for above in (folder, tmp_path / "root"):
        put_capture(above / "cap")
        state = digitize(str(above / "cap"), return_state=True)
        assert (state.type.value, state.name) == ("FAILED", "Refused")
        assert "cannot be used as a capture" in state.message
        assert "Traceback" not in logged(state)
    assert (tmp_path / "root" / "cap").exists()  # no inbox of ours
    held = folder / "quarantine" / "cap"
    assert sorted(os.listdir(held)) == ["REASON.txt", "cap"]
    assert "Why: " in (held / "REASON.txt").read_text("utf-8")


def logged(state):
    """What stands in the log of the run of a state, and of the runs inside it."""
    from prefect import get_client
    from prefect.client.schemas.filters import LogFilter, LogFilterTimestamp
    from prefect.logging.handlers import APILogWorker

    APILogWorker.drain_all()
    with get_client(sync_client=True) as client:
        since = client.read_flow_run(state.state_details.flow_run_id).start_time
        lines = client.read_logs(LogFilter(timestamp=LogFilterTimestamp(after_=since)))
    assert any("cannot be used as a capture" in line.message for line in lines)
    return "\n".join(line.message for line in lines)
