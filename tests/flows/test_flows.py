"""Tests of the flows on a real Prefect server: cache, bad takes, re-runs, artifacts."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from flows.command.main import main
from storage import open_archive
from storage.arrays.search import (
    lying_search_arrays,
    open_search_array,
    search_array_path,
)
from storage.upkeep.verification import verify_take

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]


@pytest.fixture
def inbox(tmp_path, write_walk):
    folder = tmp_path / "inbox"
    for number, name in enumerate(("okuri48", "okuri49", "lonely")):
        write_walk(folder / f"{name}.trc", seed=number, frames=70 + number)
    return folder


@pytest.fixture
def ingest(tmp_path, inbox):
    """A function that ingests the inbox and returns status by take."""
    from flows.ingestion import run_ingestion

    def run(**settings):
        from tasks.motion.importing import ImportSettings

        outcomes = run_ingestion(
            str(tmp_path / "archive"), [str(inbox)], ImportSettings(**settings)
        )
        return {outcome.take: outcome.status for outcome in outcomes}

    return run


def version_of(archive, take):
    return open_archive(archive).take(take).record.version


def test_an_inbox_becomes_takes_that_can_be_searched(ingest, tmp_path):
    assert ingest() == dict.fromkeys(("okuri48", "okuri49", "lonely"), "ingested")
    archive = open_archive(tmp_path / "archive")
    assert archive.takes() == ["lonely", "okuri48", "okuri49"]
    for record in archive.records():
        assert verify_take(archive.place, record.take) == []
        rows = open_search_array(archive.place, record.take, record.version)
        assert rows.shape == (69, record.frames)
    assert archive.take("okuri49").motion.attrs["provenance"]["stage"] == "importing"


def test_what_did_not_change_is_not_computed_again(ingest, tmp_path, inbox, write_walk):
    ingest()
    before = version_of(tmp_path / "archive", "okuri48")
    assert set(ingest().values()) == {"unchanged"}
    assert version_of(tmp_path / "archive", "okuri48") == before
    write_walk(inbox / "okuri48.trc", seed=99)
    again = ingest()
    assert again == {"okuri48": "ingested", "okuri49": "unchanged", "lonely": "unchanged"}
    assert open_archive(tmp_path / "archive").take("okuri48").record.number == 2


def test_another_setting_is_another_computation(ingest):
    ingest()
    assert set(ingest(low_pass_hz=6.0).values()) == {"ingested"}
    assert set(ingest(low_pass_hz=6.0).values()) == {"unchanged"}


@pytest.mark.parametrize("fault", ["array", "index"])
def test_a_hit_is_believed_only_if_what_it_wrote_is_intact(ingest, tmp_path, fault):
    ingest()
    archive = open_archive(tmp_path / "archive")
    take = archive.take("lonely")
    if fault == "array":
        chunk = Path(take.path, "motion/position/c/0/0/0")
        chunk.write_bytes(chunk.read_bytes()[:-1])
    else:
        path = search_array_path("lonely", take.record.version)
        Path(archive.place.location, path).unlink()
    ingest()
    archive = open_archive(tmp_path / "archive")
    assert verify_take(archive.place, "lonely") == []
    take = archive.take("lonely")
    assert open_search_array(archive.place, "lonely", take.record.version).shape == (69, 72)


def test_a_bad_take_fails_alone_and_says_why(ingest, inbox):
    (inbox / "broken.bvh").write_text("HIERARCHY\nROOT hip\n{")
    (inbox / "empty.c3d").write_bytes(b"")
    statuses = ingest()
    assert statuses.pop("broken") == statuses.pop("empty") == "refused"
    assert set(statuses.values()) == {"ingested"}


def test_an_archive_that_was_removed_is_made_again(ingest, tmp_path):
    ingest()
    shutil.rmtree(tmp_path / "archive")
    assert set(ingest().values()) == {"ingested"}
    assert len(open_archive(tmp_path / "archive").takes()) == 3


def test_indexing_makes_every_search_array_anew_in_segments(ingest, tmp_path):
    from flows.indexing import run_indexing
    from tasks.retrieval.opening import read_packed_takes

    ingest()
    archive = open_archive(tmp_path / "archive")
    arrays = {}
    for record in archive.records():
        path = Path(archive.place.location, search_array_path(record.take, record.version))
        arrays[record.take] = np.load(path)
        path.unlink()
    assert run_indexing(str(tmp_path / "archive")) == []
    packed, faults = read_packed_takes(archive.place, archive.records())
    assert (len(packed), faults) == (3, {})
    for take in packed:
        np.testing.assert_array_equal(take.rows, arrays[take.name])
    assert set(ingest().values()) == {"unchanged"}
    assert lying_search_arrays(archive.place) == {}  # nothing was indexed again


def test_a_search_as_a_flow_answers_as_the_search_does(ingest, tmp_path):
    from flows.searching import search_archive
    from tasks.retrieval.answering import answer_query
    from tasks.retrieval.searching import SearchSettings

    ingest()
    asked = (str(tmp_path / "archive"), "okuri48:10-40", SearchSettings(part="arms", top=3))
    direct, flow = answer_query(*asked), search_archive(*asked)
    assert direct.matches == flow.matches
    assert direct.matches[0].take == "okuri48"
    assert direct.matches[0].distance == 0.0


@pytest.mark.long
def test_a_run_killed_in_the_middle_is_finished_by_the_next(ingest, tmp_path, inbox, write_walk):
    """The program is killed at moments spread over its run; only the server lives on."""
    from prefect.settings import PREFECT_API_URL

    for number in range(12):
        write_walk(inbox / f"walk{number}.trc", seed=100 + number, frames=1000)
    program = [sys.executable, "-m", "flows.command.main", "ingest", str(tmp_path / "archive")]
    environment = {**os.environ, "PREFECT_API_URL": str(PREFECT_API_URL.value())}
    seen = set()
    for seconds in (0.0, 0.2, 0.4, 0.8, 1.6):
        process = subprocess.Popen(
            [*program, str(inbox)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=environment,
        )
        for line in process.stderr:
            if line.startswith(b"[1/"):  # the flow runs; before that it starts up
                break
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        archive = open_archive(tmp_path / "archive")
        takes = set(archive.takes())
        assert takes
        assert seen <= takes
        seen = takes
        for take in takes:
            assert verify_take(archive.place, take) == []
    ingest()
    archive = open_archive(tmp_path / "archive")
    assert len(archive.takes()) == 15
    assert all(verify_take(archive.place, take) == [] for take in archive.takes())


@pytest.mark.s3
def test_an_archive_in_an_object_store_is_ingested_and_searched(object_store, inbox, capsys):
    assert main(["ingest", object_store, str(inbox)]) == 0
    assert main(["verify", object_store]) == 0
    capsys.readouterr()
    assert main(["search", object_store, "okuri48:10-40", "--top", "1", "--json"]) == 0
    [match] = json.loads(capsys.readouterr().out)["matches"]
    assert (match["take"], match["start"], match["end"]) == ("okuri48", 10, 40)
    assert main(["search", object_store, "okuri48:10-40", "--top", "1", "--json", "--flow"]) == 0
    assert json.loads(capsys.readouterr().out)["matches"] == [match]
    assert main(["index", object_store]) == 0


def test_the_command_says_which_file_was_refused_and_why(tmp_path, inbox, capsys):
    (inbox / "broken.trc").write_text("nothing of the kind")
    assert main(["ingest", str(tmp_path / "archive"), str(inbox)]) == 3
    out, err = capsys.readouterr()
    assert re.search(r"refused +broken", out)
    assert re.search(r"\[\d/4\] refused: .*broken.trc", err)
    assert "Traceback" not in err
    assert main(["takes", str(tmp_path / "archive"), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["takes"]) == 3


@pytest.mark.long
@pytest.mark.no_cover  # it digitizes 150 frames, and reaches what the others do
def test_the_demo_finds_everything_that_it_promises(tmp_path, capsys):
    assert main(["demo", str(tmp_path / "demo")]) == 0
    out = capsys.readouterr().out
    assert out.count("danced at") == 7
    for promised, found in re.findall(r"danced at (\d+) other places, (\d+) of them", out):
        assert promised == found
    pictures = sorted((tmp_path / "demo" / "pictures").glob("*.png"))
    assert len(pictures) == 10
    assert all(picture.stat().st_size > 5000 for picture in pictures)


@pytest.mark.data
def test_all_shared_recordings_are_ingested_or_refused_with_a_sentence(tmp_path, shared_data):
    from flows.ingestion import run_ingestion

    folders = [str(shared_data / name) for name in ("mocap", "c3d", "trc")]
    outcomes = {each.take: each for each in run_ingestion(str(tmp_path / "archive"), folders)}
    ingested = {take for take, each in outcomes.items() if each.status == "ingested"}
    assert len(outcomes) == 24
    assert len(ingested) == 17
    assert {"ballet_reduced", "t_pose", "pig_motion-flatfoot-full"} <= ingested
    for take in outcomes.keys() - ingested:
        assert outcomes[take].status == "refused"
        assert re.search("no marker set|is empty", outcomes[take].reason)
