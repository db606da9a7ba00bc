"""When a recording is ready: two looks saw the same, or what failed waited long enough."""

import os

import pytest

from storage.errors import InputError
from storage.inbox.memory import (
    FIRST_PAUSE_S,
    LONGEST_PAUSE_S,
    Seen,
    look,
    look_now,
    pause_after,
    read_memory,
)
from storage.inbox.quarantine import move_to_quarantine
from tests.storage.inbox.conftest import put


def test_a_recording_is_ready_when_two_looks_saw_the_same():
    known, ready = look({}, {"a": "1"}, now_s=100, settle_s=30)
    assert (known, ready) == ({"a": Seen("1", "waiting", 100)}, [])
    assert look(known, {"a": "1"}, now_s=129, settle_s=30)[1] == []
    assert look(known, {"a": "1"}, now_s=130, settle_s=30)[1] == ["a"]
    grown, ready = look(known, {"a": "2"}, now_s=130, settle_s=30)
    assert (grown["a"].since_s, ready) == (130, [])
    assert look({}, {"a": "1"}, now_s=100, settle_s=0)[1] == ["a"]


def test_a_clock_set_back_begins_the_wait_anew():
    known, _ = look({}, {"a": "1"}, now_s=1000, settle_s=30)
    known, ready = look(known, {"a": "1"}, now_s=10, settle_s=30)
    assert (known["a"].since_s, ready) == (10, [])
    assert look(known, {"a": "1"}, now_s=40, settle_s=30)[1] == ["a"]


@pytest.mark.parametrize("state", ["in", "refused", "started"])
def test_what_was_dealt_with_is_not_taken_again_unless_it_changes(state):
    known = {"a": Seen("1", state, 100)}
    assert look(known, {"a": "1"}, now_s=1e6, settle_s=30) == (known, [])
    assert look(known, {"a": "2"}, now_s=1e6, settle_s=30)[0]["a"].state == "waiting"
    assert look({**known, "b": Seen("1", "in", 0)}, {"a": "1"}, now_s=1e6, settle_s=30)[0] == known


def test_what_failed_is_tried_again_later_and_later():
    assert [pause_after(n) for n in (1, 2, 3)] == [FIRST_PAUSE_S * n for n in (1, 2, 4)]
    assert pause_after(1000) == LONGEST_PAUSE_S
    known = {"a": Seen("1", "failed", 100, tries=2)}
    assert look(known, {"a": "1"}, now_s=100 + pause_after(2) - 1, settle_s=0)[1] == []
    assert look(known, {"a": "1"}, now_s=100 + pause_after(2), settle_s=0)[1] == ["a"]


@pytest.mark.parametrize("content", [b"", b"[]", b'{"recordings": {"a": 1}}', b"{" * 9999])
def test_a_damaged_memory_is_no_memory(inbox, archive, content):
    put(inbox, "a.bvh")
    look_now(archive.place, inbox, 0)
    [path] = (archive.place.folder / "inbox").glob("*.json")
    path.write_bytes(content)
    assert read_memory(archive.place, inbox) == {}
    assert look_now(archive.place, inbox, 0)[1] == ["a.bvh"]


def test_names_that_are_no_text_are_remembered(inbox, archive):
    os.close(os.open(os.fsencode(inbox.folder) + b"/\xff.bvh", os.O_CREAT))
    _, ready = look_now(archive.place, inbox, 0)
    assert [os.fsencode(name) for name in ready] == [b"\xff.bvh"]
    assert list(read_memory(archive.place, inbox)) == ready
    into = move_to_quarantine(inbox, ready[0], "bad")
    assert os.listdir(os.fsencode(inbox.folder / into)).count(b"\xff.bvh") == 1


def test_an_inbox_that_disappears_is_told_and_remembered(inbox, archive):
    put(inbox, "a.bvh")
    known, _ = look_now(archive.place, inbox, 0)
    (inbox.folder / "a.bvh").unlink()  # the folder where the disk was mounted is empty
    assert look_now(archive.place, inbox, 0) == (known, [])
    inbox.folder.rmdir()
    with pytest.raises(InputError, match="not there any more; put the folder back"):
        look_now(archive.place, inbox, 0)
    assert read_memory(archive.place, inbox) == known
