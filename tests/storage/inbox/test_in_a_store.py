"""An inbox in an object store: listed, fetched, locked and put out of the way as a folder is."""

import pytest

from storage import create_archive
from storage.inbox.fetching import fetched
from storage.inbox.listing import list_waiting, open_inbox, stamp_of
from storage.inbox.lock import BusyError, scanning
from storage.inbox.memory import (
    look_now,
    read_memory,
)
from storage.inbox.quarantine import move_to_quarantine


@pytest.mark.s3
@pytest.mark.slow
def test_an_inbox_may_be_in_an_object_store(object_store, tmp_path, monkeypatch):
    import obstore

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    archive = create_archive(f"{object_store}/archive")
    inbox = open_inbox(f"{object_store}/inbox", archive.location)
    store = inbox.place.store
    for name in ("sub/a.bvh", "sub/a.toml", "cap/capture.toml", "cap/videos/one.mp4", "b.txt"):
        obstore.put(store, name, b"first")
    known, ready = look_now(archive.place, inbox, 0)
    assert ready == ["cap", "sub/a.bvh"]
    assert {name: stamp_of(inbox, name) for name in ready} == list_waiting(inbox)
    assert read_memory(archive.place, inbox) == known
    for name in ("sub/a.toml", "cap/videos/one.mp4"):
        before = list_waiting(inbox)
        obstore.put(store, name, b"other")
        assert sum(list_waiting(inbox)[each] != before[each] for each in before) == 1
    with fetched(inbox, "cap") as path:
        assert (path / "videos" / "one.mp4").read_bytes() == b"other"
    assert not path.exists()
    with fetched(inbox, "sub/a.bvh") as again, scanning(archive.place, inbox):
        assert (again.read_bytes(), again.with_suffix(".toml").read_bytes()) == (b"first", b"other")
        with pytest.raises(BusyError):
            scanning(archive.place, inbox, dead_s=10).__enter__()
    for name, into in (("cap", "quarantine/cap"), ("sub/a.bvh", "quarantine/a.bvh")):
        assert move_to_quarantine(inbox, name, "bad") == into
    obstore.put(store, "sub/a.bvh", b"second")
    assert move_to_quarantine(inbox, "sub/a.bvh", "bad") == "quarantine/a.bvh-2"
    held = {each["path"] for each in obstore.list(store).collect()}
    assert held == {
        "b.txt", "quarantine/cap/REASON.txt", "quarantine/cap/cap/capture.toml",
        "quarantine/cap/cap/videos/one.mp4", "quarantine/a.bvh/REASON.txt",
        "quarantine/a.bvh/a.bvh", "quarantine/a.bvh/a.toml", "quarantine/a.bvh-2/REASON.txt",
        "quarantine/a.bvh-2/a.bvh",
    }  # fmt: skip
    assert list_waiting(inbox) == {}
