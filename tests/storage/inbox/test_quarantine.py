"""What is bad leaves the way, with a reason; nothing is lost, overwritten or taken elsewhere."""

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest

from storage.errors import PlaceError
from storage.inbox.listing import list_waiting, open_inbox
from storage.inbox.quarantine import forget_reason, move_to_quarantine
from tests.storage.inbox.conftest import put, put_capture


def test_what_is_bad_is_moved_with_its_metadata_and_a_reason(inbox):
    path = put(inbox, "sub/a.bvh", b"bad")
    put(inbox, "sub/a.toml", b"[take]")
    number = path.stat().st_ino
    assert move_to_quarantine(inbox, "sub/a.bvh", "It has no hips.") == "quarantine/a.bvh"
    folder = inbox.folder / "quarantine" / "a.bvh"
    assert sorted(os.listdir(folder)) == ["REASON.txt", "a.bvh", "a.toml"]
    assert (folder / "a.bvh").stat().st_ino == number  # renamed, not copied
    text = (folder / "REASON.txt").read_text("utf-8")
    assert "sub/a.bvh was not taken into the archive" in text
    assert "Why: It has no hips.\n" in text
    assert f"move it back to where it was:\n    {inbox.folder}/sub/a.bvh\n" in text
    assert list_waiting(inbox) == {}


def test_nothing_in_quarantine_is_overwritten(inbox):
    for content in (b"1", b"2"):
        put(inbox, "a.bvh", content)
        move_to_quarantine(inbox, "a.bvh", "bad")
    put_capture(inbox, "a.bvh")
    assert move_to_quarantine(inbox, "a.bvh", "bad") == "quarantine/a.bvh-3"
    held = inbox.folder / "quarantine"
    assert (held / "a.bvh" / "a.bvh").read_bytes() == b"1"
    assert (held / "a.bvh-2" / "a.bvh").read_bytes() == b"2"
    assert (held / "a.bvh-3" / "a.bvh" / "capture.toml").exists()


def test_a_reason_goes_when_its_recording_was_moved_back_and_is_good(inbox):
    path = put(inbox, "a.bvh")
    folder = inbox.folder / move_to_quarantine(inbox, "a.bvh", "bad")
    forget_reason(inbox, "a.bvh")
    assert (folder / "a.bvh").exists()
    os.rename(folder / "a.bvh", path)
    forget_reason(inbox, "a.bvh")
    assert not folder.exists()
    assert path.exists()


def test_of_several_who_move_it_at_once_one_does_and_leaves_one_reason(inbox):
    for number in range(20):
        put(inbox, f"a{number}.bvh")
        with ThreadPoolExecutor(4) as several:
            moved = [several.submit(move_to_quarantine, inbox, f"a{number}.bvh", "bad")
                     for _ in range(4)]  # fmt: skip
        [folder] = {each.result() for each in moved} - {None}
        assert sorted(os.listdir(inbox.folder / folder)) == ["REASON.txt", f"a{number}.bvh"]
    assert len(os.listdir(inbox.folder / "quarantine")) == 20
    assert f"the archive {inbox.archive} (" in (inbox.folder / folder / "REASON.txt").read_text()


def test_a_line_break_in_a_name_breaks_no_line_of_the_reason(inbox):
    put(inbox, "a\nWhy: all is well.bvh")
    folder = inbox.folder / move_to_quarantine(inbox, "a\nWhy: all is well.bvh", "bad")
    lines = (folder / "REASON.txt").read_text("utf-8").splitlines()
    assert [line for line in lines if line.startswith("Why")] == ["Why: bad"]


def test_what_lies_behind_a_link_is_never_moved(inbox, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "a.bvh").write_bytes(b"mine")
    (inbox.folder / "link").symlink_to(elsewhere)
    assert move_to_quarantine(inbox, "link/a.bvh", "bad") is None
    assert (elsewhere / "a.bvh").read_bytes() == b"mine"
    assert move_to_quarantine(inbox, "gone.bvh", "bad") is None
    put(inbox, "b.bvh")
    (inbox.folder / "quarantine").symlink_to(elsewhere)
    with pytest.raises(PlaceError):
        move_to_quarantine(inbox, "b.bvh", "bad")
    assert os.listdir(elsewhere) == ["a.bvh"]


def test_an_inbox_that_cannot_be_written_keeps_what_is_bad(inbox, monkeypatch):
    path = put(inbox, "a.bvh")

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.mkdir", refuse)
    with pytest.raises(PlaceError, match=r"cannot move .*a.bvh to .*quarantine: Permission denied"):
        move_to_quarantine(inbox, "a.bvh", "bad")
    assert path.exists()


def test_a_full_disk_keeps_what_is_bad(small_disk, archive):
    inbox = open_inbox(str(small_disk), archive.location)
    path = put(inbox, "a.bvh")
    with (small_disk / "fill").open("wb", buffering=0) as fill, suppress(OSError):
        while fill.write(b"\0" * 4096):
            pass
    with pytest.raises(PlaceError, match="No space left on device; free some space"):
        move_to_quarantine(inbox, "a.bvh", "bad" * 2000)
    assert path.exists()
