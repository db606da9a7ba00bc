"""Tests of an inbox in an object store: as a folder, and through a way that is slow or stalls."""

import math

import pytest

from storage import open_archive, places
from storage.upkeep.verification import verify_take
from tests.figures.slow_stores import slow_way
from tests.flows.service.conftest import BROKEN

pytestmark = [
    pytest.mark.s3,
    pytest.mark.flow,
    pytest.mark.slow,
    pytest.mark.usefixtures("prefect_server"),
]


def test_an_inbox_in_an_object_store_is_scanned_like_a_folder(
    object_store, tmp_path, write_walk, monkeypatch
):
    import obstore
    from obstore.store import from_url

    from flows.service.inbox import scan_inbox

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


def test_a_slow_store_is_waited_for_and_one_that_stalls_is_said_and_tried_again(
    object_store, object_store_server, tmp_path, write_walk, monkeypatch
):
    import obstore
    from obstore.store import from_url

    from flows.service.inbox import scan_inbox

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
