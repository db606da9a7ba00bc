"""What waits in an inbox, under which names, and whether it changed."""

import os
import shutil

import pytest

from storage.errors import InputError
from storage.inbox.listing import list_waiting, open_inbox, stamp_of
from tests.storage.inbox.conftest import put, put_capture

NAMES = ["おくり/四十八.trc", "a b.bvh", "line\nbreak.c3d", "sub/deeper/x.TRC"]


def test_recordings_of_sub_folders_are_listed_under_names_in_any_script(inbox):
    for name in NAMES:
        put(inbox, name)
    put_capture(inbox, "captures/踊り")
    put(inbox, "notes.txt")
    assert list(list_waiting(inbox)) == sorted([*NAMES, "captures/踊り"])


def test_what_is_hidden_or_in_quarantine_is_left_alone(inbox):
    for name in (".part.bvh", ".trash/a.bvh", "quarantine/a.bvh/a.bvh", "sub/.b/c.trc"):
        put(inbox, name)
    put(inbox, "sub/quarantine/kept.bvh")
    assert list(list_waiting(inbox)) == ["sub/quarantine/kept.bvh"]


@pytest.mark.parametrize(
    "change",
    [
        lambda path: path.write_bytes(b"longer"),
        lambda path: path.with_suffix(".toml").write_bytes(b"[take]"),
        lambda path: os.utime(path, ns=(0, 0)),
        lambda path: (shutil.copy(path, f"{path}~"), os.replace(f"{path}~", path)),
    ],
    ids=["longer", "metadata", "touched", "replaced"],
)
def test_every_change_of_a_motion_file_changes_its_stamp(inbox, change):
    path = put(inbox, "a.bvh")
    before = stamp_of(inbox, "a.bvh")
    assert stamp_of(inbox, "a.bvh") == before
    change(path)
    assert stamp_of(inbox, "a.bvh") != before


def test_content_with_its_time_kept_is_another_stamp(inbox):
    path = put(inbox, "a.bvh", b"12")
    before, times = stamp_of(inbox, "a.bvh"), path.stat()
    path.write_bytes(b"21")
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert stamp_of(inbox, "a.bvh") != before


@pytest.mark.parametrize("name", ["videos/two.mp4", "videos/.two.mp4.part", "digitize.toml"])
def test_a_capture_changes_with_all_that_is_in_it(inbox, name):
    put_capture(inbox)
    before = stamp_of(inbox, "cap")
    put(inbox, f"cap/{name}")
    assert stamp_of(inbox, "cap") != before


def test_loops_of_links_end_and_links_to_nothing_are_listed(inbox):
    capture = put_capture(inbox)
    (capture / "videos" / "loop").symlink_to(capture)
    (inbox.folder / "loop").symlink_to(inbox.folder)
    (inbox.folder / "itself.bvh").symlink_to(inbox.folder / "itself.bvh")
    os.mkfifo(inbox.folder / "pipe.bvh")
    assert list(list_waiting(inbox)) == ["cap", "itself.bvh", "pipe.bvh"]


def test_an_inbox_that_cannot_be_one_is_refused_with_what_to_do(tmp_path, archive):
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "capture").mkdir()
    (tmp_path / "capture" / "capture.toml").write_bytes(b"")
    (tmp_path / "link").symlink_to(archive.location)
    inside = tmp_path / "archive" / "takes"
    inside.mkdir()
    for folder, said in (
        (tmp_path / "absent", "not there; make the folder"),
        (tmp_path / "file", "no folder"),
        (tmp_path / "capture", "is a capture itself"),
        (tmp_path / "archive", "is the archive itself"),
        (tmp_path / "link", "is the archive itself"),
        (inside, "lies in the archive"),
        (tmp_path, "holds the archive"),
    ):
        with pytest.raises(InputError, match=said):
            open_inbox(str(folder), archive.location)


def test_an_inbox_that_may_not_be_read_is_refused(inbox, archive, monkeypatch):
    def refuse(_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.listdir", refuse)
    with pytest.raises(InputError, match=r"cannot be read: Permission denied; let the user"):
        open_inbox(inbox.location, archive.location)
