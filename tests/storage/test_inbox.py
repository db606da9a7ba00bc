"""Tests of inboxes: what is listed, when it has settled, who scans, what is put in quarantine."""

import os
import shutil
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest

from storage import create_archive
from storage.errors import InputError, PlaceError
from storage.inbox.fetching import fetched
from storage.inbox.listing import list_waiting, open_inbox, stamp_of
from storage.inbox.lock import BusyError, scanning, serving
from storage.inbox.memory import (
    FIRST_PAUSE_S,
    LONGEST_PAUSE_S,
    Seen,
    look,
    look_now,
    pause_after,
    read_memory,
)
from storage.inbox.quarantine import forget_reason, move_to_quarantine
from storage.roots import check_within, links_out

NAMES = ["おくり/四十八.trc", "a b.bvh", "line\nbreak.c3d", "sub/deeper/x.TRC"]


@pytest.fixture
def archive(tmp_path):
    return create_archive(tmp_path / "archive")


@pytest.fixture
def inbox(tmp_path, archive):
    folder = tmp_path / "inbox"
    folder.mkdir()
    return open_inbox(str(folder), archive.location)


def put(inbox, name, content=b"x"):
    path = inbox.folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def put_capture(inbox, name="cap"):
    put(inbox, f"{name}/capture.toml")
    put(inbox, f"{name}/videos/one.mp4")
    return inbox.folder / name


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


def test_an_inbox_that_disappears_is_told_and_remembered(inbox, archive):
    put(inbox, "a.bvh")
    known, _ = look_now(archive.place, inbox, 0)
    (inbox.folder / "a.bvh").unlink()  # the folder where the disk was mounted is empty
    assert look_now(archive.place, inbox, 0) == (known, [])
    inbox.folder.rmdir()
    with pytest.raises(InputError, match="not there any more; put the folder back"):
        look_now(archive.place, inbox, 0)
    assert read_memory(archive.place, inbox) == known


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


def test_one_scan_at_a_time(inbox, archive):
    with scanning(archive.place, inbox, beat_s=0.02) as is_held:
        with pytest.raises(BusyError, match="is being scanned by process"):
            scanning(archive.place, inbox, dead_s=60).__enter__()
        assert is_held()
    with scanning(archive.place, inbox, dead_s=60):  # at once: it was let go
        pass
    assert len(list((archive.place.folder / "inbox" / inbox.key).iterdir())) == 1


def test_one_server_of_an_archive_at_a_time_and_it_stops_no_scan(inbox, archive):
    with serving(archive, beat_s=0.02) as is_held, scanning(archive.place, inbox):
        said = f"{archive.location} is being served by process {os.getpid()} on "
        with pytest.raises(BusyError, match=said):
            serving(archive, dead_s=60).__enter__()
        assert is_held()
    with serving(archive, dead_s=60):  # at once: it was let go
        pass


def test_the_lock_of_a_dead_scan_is_taken_over_by_one_and_the_dead_one_knows(inbox, archive):
    with scanning(archive.place, inbox, beat_s=3600) as dead_holds:
        got = []

        def ask():
            try:
                with scanning(archive.place, inbox, beat_s=3600, dead_s=0.3) as is_held:
                    got.append(is_held())
                    time.sleep(1)
            except BusyError:
                got.append(False)

        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(got) == [False, False, False, True]
        assert dead_holds()  # it has not looked
    with scanning(archive.place, inbox, beat_s=0.02) as is_held:
        (archive.place.folder / "inbox" / inbox.key / "000000099").write_bytes(b"other")
        deadline = time.monotonic() + 60
        while is_held():
            assert time.monotonic() < deadline
            time.sleep(0.01)


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


def test_paths_of_forms_stay_in_the_roots(tmp_path):
    root, secret = tmp_path / "root", tmp_path / "secret"
    for folder in (root / "sub", secret):
        folder.mkdir(parents=True)
        (folder / "a.bvh").write_bytes(b"x")
    (root / "link.bvh").symlink_to(secret / "a.bvh")
    (root / "loop").symlink_to(root / "loop")
    roots = [str(root)]
    assert check_within("sub/a.bvh", roots) == str(root / "sub" / "a.bvh")
    assert check_within(str(root / "sub" / ".." / "sub"), roots) == str(root / "sub")
    for path in (
        str(secret / "a.bvh"), "../secret/a.bvh", str(root / ".." / "secret"), "link.bvh", "loop",
        "/etc/passwd", "/etc/absent", str(tmp_path / "root2"), "s3://bucket/x",
    ):  # fmt: skip
        with pytest.raises(InputError, match=r"does not lie in .*nothing else is read"):
            check_within(path, roots)
    for path, said in (("", "is no path"), ("a\0b", "is no path"), ("sub/b.bvh", "not there")):
        with pytest.raises(InputError, match=said):
            check_within(path, roots)
    with pytest.raises(InputError, match=r"link.bvh is a link that leads out"):
        check_within(str(root), roots)
    assert check_within(str(root / "link.bvh"), [*roots, str(secret)])
    assert list(links_out(root / "sub", roots)) == []


def test_urls_of_forms_stay_in_the_roots():
    roots = ["s3://bucket/inbox"]
    assert check_within("S3://bucket/inbox/./a", roots) == "s3://bucket/inbox/a"
    for url in ("s3://bucket/inbox/../other", "s3://bucket/inbox2/a", "file:///etc/passwd"):
        with pytest.raises(InputError, match="does not lie in"):
            check_within(url, roots)


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
