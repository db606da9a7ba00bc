"""Tests of a scan: what is dropped becomes takes once, what is bad leaves the way, by a server."""

import math
import os
import shutil
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from storage import create_archive, open_archive, places
from storage.errors import PlaceError
from storage.inbox.listing import open_inbox
from storage.inbox.lock import scanning
from storage.inbox.memory import read_memory
from storage.publication import verify_take
from tests.conftest import HANGING_S
from tests.figures.slow_stores import slow_way

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]

BROKEN = b"PathFileType\t4\n"


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "inbox"
    folder.mkdir()
    return folder


@pytest.fixture
def scan(tmp_path, folder):
    """A function that scans the inbox once; returns the state of the run."""
    from flows.inbox import scan_inbox

    def run(settle_s=0.0, **options):
        return scan_inbox(
            str(tmp_path / "archive"), str(folder), settle_s, return_state=True, **options
        )

    return run


def takes(tmp_path):
    return open_archive(tmp_path / "archive").takes()


def known(tmp_path, folder):
    archive = open_archive(tmp_path / "archive")
    memory = read_memory(archive.place, open_inbox(str(folder), archive.location))
    return {name: seen.state for name, seen in memory.items()}


def test_good_is_taken_in_once_bad_leaves_the_way_and_comes_back_mended(
    scan, tmp_path, folder, write_walk
):
    write_walk(folder / "okuri48.trc")
    write_walk(folder / "踊り" / "line\nbreak.trc", seed=1)
    shutil.copy(folder / "okuri48.trc", folder / "same.trc")
    (folder / "broken.trc").write_bytes(BROKEN)
    os.mkfifo(folder / "pipe.bvh")
    os.close(os.open(os.fsencode(folder) + b"/\xff.bvh", os.O_CREAT))
    state = scan()
    assert (state.type.value, state.name) == ("FAILED", "Refused")
    assert state.message.startswith("3 of 6 recordings were not taken in: ")
    for said in ("broken.trc", "named pipe", "not UTF-8; rename it"):
        assert said in state.message
    assert takes(tmp_path) == ["line-break", "okuri48"]
    held = folder / "quarantine"
    assert (held / "broken.trc" / "broken.trc").read_bytes() == BROKEN
    assert "Why: " in (held / "broken.trc" / "REASON.txt").read_text("utf-8")
    assert len(list(held.iterdir())) == 3
    versions = {
        record.take: record.version for record in open_archive(tmp_path / "archive").records()
    }

    again = scan()
    assert (again.type.value, again.message) == ("COMPLETED", "nothing new")
    os.utime(folder / "okuri48.trc")  # looks new, and is not
    assert scan().message == "1 already in the archive"

    write_walk(held / "broken.trc" / "broken.trc", seed=2)  # mended, and moved back
    os.rename(held / "broken.trc" / "broken.trc", folder / "broken.trc")
    assert scan().message == "1 taken in"
    assert not (held / "broken.trc").exists()
    assert takes(tmp_path) == ["broken", "line-break", "okuri48"]
    records = open_archive(tmp_path / "archive").records()
    assert {r.take: r.version for r in records if r.take != "broken"} == versions


def test_of_two_that_are_the_same_and_bad_both_leave_the_way(scan, folder):
    for name in ("bent.trc", "broken.trc"):
        (folder / name).write_bytes(BROKEN)
    assert scan().name == "Refused"
    assert scan().name == "Refused"
    assert scan().message == "nothing new"
    assert sorted(os.listdir(folder / "quarantine")) == ["bent.trc", "broken.trc"]


def test_what_is_moved_away_in_the_meantime_keeps_no_other_out(
    scan, tmp_path, folder, write_walk, monkeypatch
):
    from flows import ingestion

    write_walk(folder / "okuri48.trc")
    away = write_walk(folder / "okuri49.trc", seed=1)

    def find(paths):
        away.unlink(missing_ok=True)
        return find_recordings(paths)

    find_recordings = ingestion.find_recordings
    monkeypatch.setattr(ingestion, "find_recordings", find)
    state = scan()
    assert state.message == "1 taken in, 1 waiting until nobody writes to them"
    assert takes(tmp_path) == ["okuri48"]
    assert scan().message == "nothing new"
    assert known(tmp_path, folder) == {"okuri48.trc": "in"}


def test_what_still_settles_waits(scan, tmp_path, folder, write_walk):
    path = write_walk(folder / "okuri48.trc")
    assert scan(3600).message == "1 waiting until nobody writes to them"
    with path.open("a") as file:
        file.write("\n")
    assert scan(3600).message == "1 waiting until nobody writes to them"
    assert takes(tmp_path) == []


def test_what_grows_while_it_is_read_waits(scan, tmp_path, folder, write_walk, monkeypatch):
    path = write_walk(folder / "okuri48.trc")
    whole = path.read_bytes()
    path.write_bytes(whole[:300])

    from flows import inbox

    ingest_here = inbox.ingest_here

    def grow(*arguments, **options):
        outcome = ingest_here(*arguments, **options)
        path.write_bytes(whole)
        return outcome

    monkeypatch.setattr(inbox, "ingest_here", grow)
    state = scan()
    assert (state.type.value, state.message) == (
        "COMPLETED",
        "1 waiting until nobody writes to them",
    )
    assert path.exists()
    monkeypatch.undo()
    assert scan().message == "1 taken in"
    assert takes(tmp_path) == ["okuri48"]


def test_what_may_not_be_read_is_tried_again_and_never_moved(
    scan, tmp_path, folder, write_walk, monkeypatch
):
    write_walk(folder / "closed.trc")
    write_walk(folder / "open.trc", seed=1)
    from flows import inbox

    def refuse(path):
        if path.name == "closed.trc":
            raise PermissionError(13, "Permission denied", str(path))
        return digest_file(path)

    digest_file = inbox.digest_file
    monkeypatch.setattr(inbox, "digest_file", refuse)
    state = scan()
    assert (state.type.value, state.name) == ("FAILED", "Failed")
    assert "'closed.trc' cannot be read: Permission denied; let the user that runs shosa read" in (
        state.message
    )
    assert takes(tmp_path) == ["open"]
    assert known(tmp_path, folder) == {"closed.trc": "failed", "open.trc": "in"}
    assert (folder / "closed.trc").exists()


def test_what_cannot_be_moved_away_stops_no_other(scan, tmp_path, folder, write_walk, monkeypatch):
    (folder / "broken.trc").write_bytes(BROKEN)
    write_walk(folder / "okuri48.trc")
    from flows import inbox

    def refuse(*_):
        raise PlaceError("cannot move it: Permission denied; choose a place that you may write to")

    with monkeypatch.context() as patch:
        patch.setattr(inbox, "move_to_quarantine", refuse)
        state = scan()
    assert (state.type.value, state.name) == ("FAILED", "Failed")
    assert "choose a place that you may write to) (tried again after 60 s)" in state.message
    assert known(tmp_path, folder) == {"broken.trc": "failed", "okuri48.trc": "in"}


def test_links_that_leave_the_inbox_are_not_read_unless_a_root_says_so(
    scan, tmp_path, folder, write_walk
):
    write_walk(tmp_path / "elsewhere" / "okuri48.trc")
    (folder / "link").symlink_to(tmp_path / "elsewhere")
    (folder / "nothing.bvh").symlink_to(folder / "absent")
    (folder / "ring.bvh").symlink_to(folder / "ring.bvh")
    state = scan()
    assert "'ring.bvh' is, or holds, a link to itself (ring.bvh); remove the link" in state.message
    assert "'link/okuri48.trc' is, or holds, a link that leads out of the inbox" in state.message
    assert "'nothing.bvh' cannot be read: No such file" in state.message
    assert (tmp_path / "elsewhere" / "okuri48.trc").exists()
    assert takes(tmp_path) == []
    os.utime(tmp_path / "elsewhere" / "okuri48.trc")
    assert "1 taken in" in scan(roots=[str(tmp_path / "elsewhere")]).message


def test_two_scans_at_once_take_everything_in_once(scan, tmp_path, folder, write_walk):
    for number in range(3):
        write_walk(folder / f"walk{number}.trc", seed=number)
    states = []
    threads = [threading.Thread(target=lambda: states.append(scan())) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    said = {state.message for state in states} - {"3 taken in"}
    assert len(said) == 1
    assert said == {"nothing new"} or "is being scanned by" in said.pop()
    records = open_archive(tmp_path / "archive").records()
    assert [(record.take, record.number) for record in records] == [
        (f"walk{n}", 1) for n in range(3)
    ]


def test_a_scan_beside_another_ends_well_and_does_nothing(scan, tmp_path, folder, write_walk):
    write_walk(folder / "okuri48.trc")
    archive = create_archive(tmp_path / "archive")
    with scanning(archive.place, open_inbox(str(folder), archive.location), beat_s=0.05):
        state = scan()
    assert state.type.value == "COMPLETED"
    assert "is being scanned by process" in state.message
    assert takes(tmp_path) == []


def test_an_inbox_or_archive_that_is_away_fails_the_run_with_a_sentence(
    scan, tmp_path, folder, write_walk, monkeypatch
):
    write_walk(folder / "okuri48.trc")
    folder.rename(tmp_path / "away")
    state = scan()
    assert state.type.value == "FAILED"
    assert "is not there; make the folder, or mount the disk" in state.message
    (tmp_path / "away").rename(folder)

    def refuse(*_):
        raise PlaceError(
            "cannot write x: Read-only file system; choose a place that can be written"
        )

    with monkeypatch.context() as patch:
        patch.setattr("storage.inbox.lock.create_file", refuse)
        state = scan()
    assert state.type.value == "FAILED"
    assert "Read-only file system; choose a place" in state.message
    assert scan().message == "1 taken in"


def put_capture(folder):
    folder.mkdir()
    (folder / "capture.toml").write_text("[take]\n")


def test_a_capture_is_digitized_by_one_run_of_its_own_that_is_followed(
    scan, tmp_path, folder, monkeypatch
):
    from prefect import get_client
    from prefect.states import Cancelled, Completed, Crashed, Failed, Running

    from flows import apart, inbox

    started = []

    def start(_, *, idempotency_key, parameters, **__):
        with get_client(sync_client=True) as client:
            run = client.create_flow_run(inbox.scan_inbox, state=Running())
        started.append((run.id, idempotency_key, parameters))
        return run

    def end(state):
        with get_client(sync_client=True) as client:
            client.set_flow_run_state(started[-1][0], state, force=True)

    monkeypatch.setattr(apart, "run_deployment", start)
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

    from flows import apart, inbox

    keys = []

    def start(_, *, idempotency_key, **__):
        keys.append(idempotency_key)
        with get_client(sync_client=True) as client:
            return client.create_flow_run(inbox.scan_inbox, state=Failed(name="Refused"))

    monkeypatch.setattr(apart, "run_deployment", start)
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

    from flows import apart, inbox
    from flows.forms import ingest
    from flows.served import VARIABLE, Served, write_served

    archive = create_archive(tmp_path / "archive").location
    monkeypatch.setenv(VARIABLE, write_served(Served(archive, [str(folder)], [str(folder)])))
    monkeypatch.setattr(inbox, "MOST_PATHS", 2)
    monkeypatch.setattr(apart, "MOST_PATHS", 2)
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

    monkeypatch.setattr(apart, "run_deployment", start)
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
    from flows.apart import split_files

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


def test_two_archives_may_be_fed_from_one_inbox(tmp_path, folder, write_walk):
    from flows.inbox import scan_inbox

    (folder / "broken.trc").write_bytes(BROKEN)
    (folder / "bent.trc").write_bytes(BROKEN + b"\n")
    write_walk(folder / "okuri48.trc")
    archives = [str(tmp_path / "one"), str(tmp_path / "two")]
    states = []

    def scan(archive):
        states.append(scan_inbox(archive, str(folder), 0.0, return_state=True))

    for archive in archives:  # so that both have seen it settle
        create_archive(archive)
    threads = [threading.Thread(target=scan, args=(archive,)) for archive in archives]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for archive in archives:
        scan(archive)  # what one moved from under the other is gone
        assert open_archive(archive).takes() == ["okuri48"]
    for state in states:  # none of them failed for what the other moved
        assert state.name in ("Refused", "Completed"), state.message
    assert (folder / "okuri48.trc").exists()
    held = folder / "quarantine"
    assert sorted(os.listdir(held)) == ["bent.trc", "broken.trc"]
    for name in ("bent.trc", "broken.trc"):
        assert sorted(os.listdir(held / name)) == ["REASON.txt", name]
        reason = (held / name / "REASON.txt").read_text("utf-8")
        assert any(f"was not taken into the archive {each} (" in reason for each in archives)


def test_the_run_that_finds_a_capture_bad_moves_it_away(tmp_path, folder, monkeypatch):
    from flows.forms import digitize
    from flows.served import VARIABLE, Served, write_served

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


def test_scans_that_found_nothing_are_forgotten_and_the_others_are_not(monkeypatch):
    from prefect import get_client
    from prefect.states import Cancelled, Completed, Failed

    from flows import forms, idle

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
        monkeypatch.setattr(idle, "deployment", SimpleNamespace(id=str(deployment)))
        idle.forget_idle_scans()
        assert len(client.read_flow_runs()) >= 5  # none is an hour old
        monkeypatch.setattr(idle, "_IDLE_KEPT_H", -1)
        idle.forget_idle_scans()
        left = {run.id for run in client.read_flow_runs(limit=200)}
    assert {runs[2].id, runs[3].id, other.id} <= left
    assert not {runs[0].id, runs[1].id} & left


def test_stages_of_what_went_well_are_forgotten_after_a_day(monkeypatch):
    from prefect import flow as a_flow
    from prefect import get_client, tags, task
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId
    from prefect.states import Failed

    from flows import idle

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
    monkeypatch.setattr(idle, "flow_run", SimpleNamespace(tags=["shosa", "shosa-one"]))
    with get_client(sync_client=True) as client:
        until(lambda: left(client) == everything)  # the server hears of tasks by events
        idle.forget_stages()
        assert left(client) == everything  # none is a day old
        monkeypatch.setattr(idle, "_STAGES_KEPT_H", -1)
        idle.forget_stages()
        assert left(client) == {**everything, "good": ["inner"]}
        assert client.read_flow_run(runs["good"]).state.is_completed()


def until(is_so):
    """Wait until something is so."""
    deadline = time.monotonic() + HANGING_S
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.1)


@pytest.mark.s3
def test_an_inbox_in_an_object_store_is_scanned_like_a_folder(
    object_store, tmp_path, write_walk, monkeypatch
):
    import obstore
    from obstore.store import from_url

    from flows.inbox import scan_inbox

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    store = from_url(f"{object_store}/inbox")
    walk = write_walk(tmp_path / "okuri48.trc").read_bytes()
    obstore.put(store, "sub/okuri48.trc", walk)
    obstore.put(store, "sub/okuri48.toml", b'[take]\ntitle = "Okuri 48"\n')
    obstore.put(store, "broken.trc", BROKEN)

    def scan():
        where = f"{object_store}/archive", f"{object_store}/inbox"
        return scan_inbox(*where, 0.0, return_state=True).message

    assert scan().startswith("1 of 2 recordings were not taken in: ")
    [record] = open_archive(f"{object_store}/archive").records()
    assert (record.take, record.metadata["title"]) == ("okuri48", "Okuri 48")
    held = {each["path"] for each in obstore.list(store).collect()}
    assert held == {
        "sub/okuri48.trc", "sub/okuri48.toml", "quarantine/broken.trc/broken.trc",
        "quarantine/broken.trc/REASON.txt",
    }  # fmt: skip
    assert scan() == "nothing new"
    obstore.put(store, "sub/okuri48.trc", walk)  # looks new, and is not
    assert scan() == "1 already in the archive"
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]


@pytest.mark.s3
def test_a_slow_store_is_waited_for_and_one_that_stalls_is_said_and_tried_again(
    object_store, object_store_server, tmp_path, write_walk, monkeypatch
):
    import obstore
    from obstore.store import from_url

    from flows.inbox import scan_inbox

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("storage.inbox.memory.FIRST_PAUSE_S", 0.0)
    store = from_url(f"{object_store}/inbox")
    where = f"{object_store}/archive", f"{object_store}/inbox"

    def put(number):
        walk = write_walk(tmp_path / "walk.trc", seed=number).read_bytes()
        obstore.put(store, f"walk{number}.trc", walk)

    def scan():
        return scan_inbox(*where, 0.0, return_state=True)

    with slow_way(object_store_server[0]) as way:
        monkeypatch.setenv("AWS_ENDPOINT_URL", way.url)
        way.late_s = 0.05
        put(0)
        assert scan().message == "1 taken in"
        assert way.asked < 100  # at a second each, these are what one file takes
        way.late_s = 0.0
        monkeypatch.setenv("AWS_TIMEOUT", "0.3s")  # a stall of it stands for one of a minute
        monkeypatch.setitem(places._RETRY, "max_retries", 1)
        for number, answers in enumerate((8, 35), start=1):
            put(number)
            way.answers = answers
            state = scan()
            assert state.type.value == "FAILED"
            assert "check that the object store answers, then run it again" in state.message
            way.answers = math.inf
            monkeypatch.setattr("storage.inbox.lock.DEAD_S", 0.5)  # who held it could not let go
            scan()
            assert scan().message == "nothing new"
    monkeypatch.setenv("AWS_ENDPOINT_URL", object_store_server[0])
    archive = open_archive(where[0])
    assert [(each.take, each.number) for each in archive.records()] == [
        (f"walk{number}", 1) for number in range(3)
    ]
    assert [fault for take in archive.takes() for fault in verify_take(archive.place, take)] == []
