"""Tests of a scan: what is dropped becomes takes once, what is bad leaves the way, by a server."""

import os
import shutil
import threading

import pytest

from storage import create_archive, open_archive
from storage.errors import PlaceError
from storage.inbox.listing import open_inbox
from storage.inbox.lock import scanning
from tests.flows.service.conftest import BROKEN, known, takes

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]


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

    from flows.service import inbox

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
    from flows.service import inbox

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
    from flows.service import inbox

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


def test_two_archives_may_be_fed_from_one_inbox(tmp_path, folder, write_walk):
    from flows.service.inbox import scan_inbox

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
