"""Tests of what the archive remembers: when a recording is taken in anew, and when it is not."""

import os
import shutil
import subprocess
import sys
from collections import Counter

import pytest

from storage import open_archive
from storage.places import list_files
from storage.sources import take_of_content
from storage.upkeep.verification import verify_take
from tasks.engine import fingerprints
from tasks.motion.importing import ImportSettings
from tasks.takes.identity import is_of_other_code
from tests.conftest import HANGING_S

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]


@pytest.fixture
def file(tmp_path, write_walk):
    return write_walk(tmp_path / "inbox" / "okuri48.trc")


@pytest.fixture
def ingest(tmp_path, file):
    """A function that ingests the file, or others, and returns what became of each."""
    from flows.ingestion import run_ingestion

    def run(*paths, again=False, **settings):
        return run_ingestion(
            str(tmp_path / "archive"),
            [str(path) for path in paths or [file]],
            ImportSettings(**settings),
            again=again,
        )

    return run


@pytest.fixture
def archive(tmp_path, ingest):
    [outcome] = ingest()
    assert outcome.status == "ingested", outcome.reason
    return open_archive(tmp_path / "archive")


def number_of(archive):
    return archive.take("okuri48").record.number


def other_code(monkeypatch, module="tasks.motion.gaps"):
    """Let a module that others stand on be another, as after an edit."""
    known = dict(fingerprints.source_files("tasks.motion.importing"))
    assert module in known
    monkeypatch.setattr(fingerprints, "_source_digest", lambda name: f"edited {name}")


def test_an_unchanged_recording_is_unchanged_wherever_it_lies_and_whenever_it_was_touched(
    ingest, archive, file, tmp_path
):
    os.utime(file)
    assert [each.status for each in ingest()] == ["unchanged"]
    elsewhere = tmp_path / "elsewhere" / "another name.trc"
    elsewhere.parent.mkdir()
    shutil.copy(file, elsewhere)
    [outcome] = ingest(elsewhere)
    assert (outcome.status, outcome.take) == ("unchanged", "okuri48")
    assert archive.takes() == ["okuri48"]
    assert number_of(archive) == 1


def test_changed_content_is_taken_in_though_the_file_keeps_its_time(
    ingest, archive, file, write_walk
):
    before = file.stat()
    write_walk(file, seed=9)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert [each.status for each in ingest()] == ["ingested"]
    assert number_of(archive) == 2


def test_other_metadata_are_taken_in(ingest, archive, file):
    file.with_suffix(".toml").write_text('[take]\ntitle = "Okuri"\n')
    assert [each.status for each in ingest()] == ["ingested"]
    assert archive.take("okuri48").record.metadata == {"title": "Okuri"}
    assert [each.status for each in ingest()] == ["unchanged"]
    file.with_suffix(".toml").write_text('[take]\ntitle = "Okuri"\nstature_m = 1.7\n')
    assert [each.status for each in ingest()] == ["ingested"]
    assert archive.take("okuri48").record.settings == {"importing.stature_m": 1.7}


def test_other_settings_take_in_anew_and_are_in_the_record(ingest, archive):
    joints = {"RFin": ("RWrist",)}
    assert [each.status for each in ingest(mapping=tuple(joints.items()))] == ["ingested"]
    assert [each.status for each in ingest(mapping=tuple(joints.items()))] == ["unchanged"]
    settings = archive.take("okuri48").record.settings
    assert settings == {"importing.mapping": {"RFin": ["RWrist"]}}
    assert [each.status for each in ingest()] == ["ingested"]
    assert number_of(archive) == 3


def test_other_code_takes_in_anew_only_when_it_is_asked_to(ingest, archive, monkeypatch):
    assert not is_of_other_code(archive.take("okuri48").record)
    other_code(monkeypatch)
    assert is_of_other_code(archive.take("okuri48").record)
    assert [each.status for each in ingest()] == ["unchanged"]
    assert number_of(archive) == 1
    assert [each.status for each in ingest(again=True)] == ["ingested"]
    assert number_of(archive) == 2
    assert not is_of_other_code(archive.take("okuri48").record)


@pytest.mark.parametrize("fault", ["changed", "gone"])
def test_damaged_data_are_made_again(ingest, archive, fault):
    record = archive.take("okuri48").record
    chunk = archive.place.folder / archive.take("okuri48").folder / sorted(record.files)[0]
    if fault == "gone":
        chunk.unlink()
    else:
        chunk.write_bytes(chunk.read_bytes() + b" ")
    assert verify_take(archive.place, "okuri48")
    assert [each.status for each in ingest()] == ["ingested"]
    assert verify_take(archive.place, "okuri48") == []


def test_a_recording_whose_run_was_killed_after_publishing_is_remembered(ingest, archive):
    digest = archive.take("okuri48").record.source["digest"]
    (archive.place.folder / f"sources/{digest}.json").unlink()
    assert take_of_content(archive.place, digest) is None
    assert [each.status for each in ingest()] == ["unchanged"]
    assert take_of_content(archive.place, digest) == "okuri48"


def test_other_machines_find_it_unchanged(archive, file, tmp_path):
    """Two machines that know nothing of each other, in turn, over the same archive."""
    from prefect.settings import PREFECT_API_URL

    for home in ("a", "b"):
        environment = {
            **os.environ,
            "PREFECT_API_URL": str(PREFECT_API_URL.value()),
            "PREFECT_HOME": str(tmp_path / home),
        }
        program = [sys.executable, "-m", "flows.command.main", "ingest"]
        done = subprocess.run(
            [*program, archive.location, str(file)],
            env=environment, capture_output=True, text=True, timeout=HANGING_S,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines()[1].startswith("unchanged")
    assert number_of(archive) == 1


def test_of_two_runs_on_one_recording_the_slower_finds_it_unchanged(ingest, monkeypatch, tmp_path):
    """And nothing of what it wrote is left over."""
    from flows import ingestion

    inner, importing = [], ingestion.import_take

    def slow(*arguments):
        draft = importing(*arguments)
        if not inner:
            inner.append(None)
            inner[:] = ingest()
        return draft

    monkeypatch.setattr(ingestion, "import_take", slow)
    [outer] = ingest()
    assert [inner[0].status, outer.status] == ["ingested", "unchanged"], outer.reason
    archive = open_archive(tmp_path / "archive")
    assert number_of(archive) == 1
    version = archive.take("okuri48").record.version
    left = [file.path for top in ("takes", "index") for file in list_files(archive.place, top)]
    assert left
    assert all(version in path for path in left)


def test_of_two_runs_with_other_settings_the_slower_fails_and_says_so(ingest, monkeypatch):
    from flows import ingestion

    inner, importing = [], ingestion.import_take

    def slow(*arguments):
        draft = importing(*arguments)
        if not inner:
            inner.append(None)
            inner[:] = ingest(low_pass_hz=6.0)
        return draft

    monkeypatch.setattr(ingestion, "import_take", slow)
    [outer] = ingest()
    assert outer.status == "failed"
    assert "another run published version 1 of take 'okuri48'" in outer.reason


def test_only_a_recordings_own_faults_are_refusals(ingest, archive, file, write_walk, tmp_path):
    """A fault of the archive or the machine is a failure: nothing is wrong with the file."""
    record = archive.place.folder / "published/okuri48/000001.json"
    record.write_text("{")
    broken = tmp_path / "inbox" / "broken.bvh"
    broken.write_text("HIERARCHY\n")
    [*outcomes] = ingest(file, broken, write_walk(tmp_path / "inbox" / "good.trc", seed=3))
    assert Counter(each.status for each in outcomes) == Counter(
        {"failed": 1, "refused": 1, "ingested": 1}
    )
    [failed] = [each for each in outcomes if each.status == "failed"]
    assert "000001.json is damaged" in failed.reason


def test_a_run_that_lost_something_is_failed_and_says_what(file, tmp_path):
    """For the flow, for the files that went in together, and for the take; green has all in."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import (
        FlowRunFilter,
        FlowRunFilterId,
        LogFilter,
        LogFilterFlowRunId,
    )
    from prefect.logging.handlers import APILogWorker

    from flows.ingestion import ingest_archive

    broken = tmp_path / "inbox" / "broken.bvh"
    broken.write_text("HIERARCHY\n")
    paths = [str(broken), str(file)]
    state = ingest_archive(str(tmp_path / "archive"), paths, return_state=True)
    assert state.is_failed()
    assert state.message.startswith("1 of 2 recordings were not taken in: refused: broken (")
    run = state.state_details.flow_run_id
    APILogWorker.drain_all()
    with get_client(sync_client=True) as client:
        of_run = FlowRunFilter(id=FlowRunFilterId(any_=[run]))
        mine = {each.name: each for each in client.read_task_runs(flow_run_filter=of_run)}
        lines = client.read_logs(LogFilter(flow_run_id=LogFilterFlowRunId(any_=[run])))
    logs = [each.message for each in lines]
    assert set(mine) == {"ingest broken and 1 more", "ingest broken"}
    assert all(each.state.is_failed() for each in mine.values())
    assert mine["ingest broken and 1 more"].state.message == state.message
    assert mine["ingest broken"].state.message.startswith("refused: ")
    assert any(each.startswith("[2/2] okuri48: ingested") for each in logs)
    assert [each for each in logs if "NoneType" in each or "Traceback" in each] == []
    state = ingest_archive(str(tmp_path / "archive"), [str(file)], return_state=True)
    assert state.is_completed()
    assert state.message == "okuri48 is in."


def test_a_fault_of_the_program_on_one_file_stops_no_other(
    ingest, monkeypatch, write_walk, tmp_path
):
    from flows import ingestion

    importing = ingestion.import_take

    def break_on_one(archive, recording, *arguments):
        if recording.take == "okuri48":
            raise ZeroDivisionError("by zero")
        return importing(archive, recording, *arguments)

    monkeypatch.setattr(ingestion, "import_take", break_on_one)
    other = write_walk(tmp_path / "inbox" / "other.trc", seed=3)
    broken, good = ingest(tmp_path / "inbox" / "okuri48.trc", other)
    assert (broken.status, good.status) == ("failed", "ingested")
    assert "ZeroDivisionError: by zero; the run's log has the rest" in broken.reason


def test_files_of_a_worker_that_died_are_not_taken_in_again(ingest, monkeypatch, tmp_path):
    """A task that runs once more, elsewhere, finds what it had taken in before."""
    from flows import ingestion

    monkeypatch.setattr(ingestion, "_unchanged", lambda *_, **__: None)
    assert [each.status for _ in range(2) for each in ingest()] == ["ingested", "unchanged"]
    assert number_of(open_archive(tmp_path / "archive")) == 1


def test_small_files_share_a_run_and_large_ones_and_captures_have_their_own(tmp_path):
    from flows.ingestion import split_recordings
    from storage.recordings import Recording

    def recording(name, size=10, kind="motion"):
        (tmp_path / name).write_bytes(b"")
        os.truncate(tmp_path / name, size)
        return Recording(str(tmp_path / name), "", name, {}, kind=kind)

    files = [recording(f"small{n}") for n in range(45)]
    large = [recording(f"large{n}", 9_000_000) for n in range(2)]
    capture = recording("capture", kind="capture")
    gone = Recording(str(tmp_path / "gone"), "", "gone", {})
    parts = split_recordings([*files[:30], capture, *files[30:], *large, gone])
    assert sorted(len(part) for part in parts) == [1, 1, 1, 1, 5, 20, 20]
    assert [capture] in parts
    assert [large[0]] in parts
    assert [each for part in parts for each in part if each != capture] == [*files, *large, gone]
    assert split_recordings([]) == []
