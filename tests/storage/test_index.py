"""Tests of the index in segments: gathered, merged, listed, harmed, against a dict of arrays."""

import itertools
import json
import os
import resource
import shutil
import threading
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as drawn
from hypothesis import strategies as st

from storage import create_archive, open_archive
from storage.arrays.search import lying_search_arrays
from storage.errors import DamagedSegmentError, PlaceError
from storage.index import catalogue, segments, snapshots
from storage.index.segments import FOLDER
from storage.index.snapshots import open_snapshot, verify_snapshot
from storage.publication import collect_garbage, kept_from_garbage, publish_record
from tasks.retrieval import answering, gathering, opening
from tasks.retrieval.gathering import gather_segments, gather_when_many
from tasks.retrieval.searching import Found, Match, SearchSettings
from tests.conftest import cases
from tests.figures.packed_takes import PlainTakes, read_all, record_of

NOW = timedelta(0)
MANIFEST = "[0-9]" * 8 + ".json"


@pytest.fixture(autouse=True)
def forget():
    """Let nothing that was read before hide what lies on the disk."""
    snapshots._held.clear()


@pytest.fixture
def takes(tmp_path):
    return PlainTakes(create_archive(tmp_path / "archive").place)


@pytest.fixture
def small(monkeypatch):
    """Segments of a few takes, so that there are many."""
    monkeypatch.setattr(gathering, "SEGMENT", 256)
    monkeypatch.setattr(gathering, "_STALE", 2)


@pytest.fixture
def summarized(monkeypatch):
    """A summary is made and kept: the mean of each row over 16 samples."""

    def summarize(rows):
        return {"mean": np.nan_to_num(rows).reshape(len(rows), -1, 16).mean(axis=2)}

    monkeypatch.setattr(gathering, "summarize", summarize)
    monkeypatch.setattr(gathering, "SUMMARIZED", 1)
    monkeypatch.setattr(opening, "SUMMARIZED", 1)


def lying(takes):
    return {take for take, _ in lying_search_arrays(takes.place)}


def files(takes, pattern="*"):
    return sorted(takes.place.folder.glob(f"{FOLDER}/{pattern}"))


def newest(takes):
    """The newest manifest."""
    return files(takes, MANIFEST)[-1]


def label(takes):
    """The label of the first segment of the newest snapshot."""
    return takes.place.folder / json.loads(newest(takes).read_text())["segments"][0]["label"]


def fill(takes, count=7):
    for number in range(count):
        takes.publish(f"take{number}", 32 + 17 * number)  # some whole numbers of blocks


@pytest.mark.usefixtures("small")
def test_takes_that_lie_by_themselves_are_searched_and_gathered(takes):
    fill(takes)
    takes.check()
    assert gather_segments(takes.location) == []
    assert lying(takes) == set()
    assert len(open_snapshot(takes.place).labels) == 4
    takes.check()
    takes.publish("late", 40)
    takes.check()
    assert verify_snapshot(takes.place)[0] == []
    aged(takes)
    assert gather_segments(takes.location) == []
    takes.check()
    manifests = len(files(takes, MANIFEST))
    assert gather_segments(takes.location) == []  # nothing is left to do
    assert len(files(takes, MANIFEST)) == manifests


STEPS = st.lists(
    st.tuples(st.sampled_from(("publish", "remove", "gather", "anew")), st.integers(0, 5)),
    max_size=14,
)


@pytest.mark.drawn
@pytest.mark.slow
@drawn(max_examples=cases(15))
@given(steps=STEPS)
def test_whatever_is_published_removed_and_gathered_the_index_holds_what_there_is(
    steps, tmp_path_factory
):
    takes = PlainTakes(create_archive(tmp_path_factory.mktemp("drawn") / "archive").place)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gathering, "SEGMENT", 160)
        patch.setattr(gathering, "_STALE", 2)
        for number, (step, which) in enumerate(steps):
            take = f"take{which}"
            if step == "publish":
                takes.publish(take, 17 + 16 * ((number + which) % 5))
            elif step == "remove" and take in takes.rows:
                takes.remove(take)
            elif step == "gather":
                assert gather_segments(takes.location) == []
            elif step == "anew":
                takes.write_again()
                assert gather_segments(takes.location, anew=True) == []
            takes.check()
            listing = open_archive(takes.location).listing()
            assert {entry.take: entry.version for entry in listing.entries} == takes.versions
        assert verify_snapshot(takes.place)[0] == []
        collect_garbage(takes.place, older_than=NOW)
        takes.check()


@pytest.mark.usefixtures("small")
def test_segments_are_merged_so_that_few_are_small(takes):
    for number in range(24):
        takes.publish(f"take{number:02}", 20)
        gather_segments(takes.location)
    labels = open_snapshot(takes.place).labels
    assert sum(len(each.entries) for each in labels) == 24
    assert sum(each.rows.shape[1] <= 128 for each in labels) <= 3
    takes.check()


@pytest.mark.usefixtures("small")
def test_a_segment_of_holes_is_compacted(takes):
    fill(takes, 4)
    gather_segments(takes.location)
    before = sum(each.rows.shape[1] for each in open_snapshot(takes.place).labels)
    for number in range(3):
        takes.remove(f"take{number}")
    takes.check()
    gather_segments(takes.location)
    after = open_snapshot(takes.place).labels
    assert sum(each.rows.shape[1] for each in after) < before / 2
    takes.check()


def test_few_takes_are_not_gathered_at_the_end_of_a_run_and_many_are(takes, monkeypatch):
    monkeypatch.setattr(gathering, "_MANY", 3)
    fill(takes, 2)
    gather_when_many(takes.location)
    assert len(lying(takes)) == 2
    fill(takes, 4)
    gather_when_many(takes.location)
    assert lying(takes) == {"take0", "take1"}  # of versions that were replaced
    takes.publish("late", 30)
    gather_when_many(takes.location)
    assert "late" in lying(takes)
    takes.check()


def test_a_take_without_motion_is_listed_from_the_index_and_not_searched(takes):
    record = record_of("voxels", "000001-abcdefab", 1, 50)
    fields = {**record.__dict__, "stages": ["voxels"], "joints_present": []}
    publish_record(takes.place, type(record)(**fields))
    fill(takes, 2)
    gather_segments(takes.location)
    _, skipped = read_all(takes.location)
    assert skipped == {"voxels": "take 'voxels' has no motion, only voxels"}
    assert [entry.take for entry in open_snapshot(takes.place).labels[0].entries] == [
        "take0", "take1", "voxels",
    ]  # fmt: skip


class KilledError(BaseException):
    """As when the process is killed: nothing is done any more."""


WRITES = (
    (segments, "write_file"),
    (snapshots, "sync_files"),
    (snapshots, "create_file"),
    (snapshots, "delete_files"),
    (gathering, "remove_search_arrays"),
    (gathering, "delete_files"),
)


def kill_at(patch, number, *, done):
    """Let the process be killed at its write of this number, before it or when it is done."""
    count = itertools.count()
    dead = []
    for module, name in WRITES:
        write = getattr(module, name)

        def wrapped(*values, write=write, **options):
            here = next(count)
            if dead or (here == number and not done):
                dead.append(here)
                raise KilledError
            result = write(*values, **options)
            if here == number:
                dead.append(here)
                raise KilledError
            return result

        patch.setattr(module, name, wrapped)


@pytest.mark.usefixtures("small")
def test_a_merge_that_is_killed_at_any_write_leaves_a_whole_index(takes):
    fill(takes, 4)
    gather_segments(takes.location)
    kills = 0
    for number, done in itertools.product(range(9), (False, True)):
        takes.publish(f"take{number % 3}", 33 + number)
        takes.publish(f"new{number % 2}", 50 + number)
        with pytest.MonkeyPatch.context() as patch:
            kill_at(patch, number, done=done)
            try:
                gather_segments(takes.location)
            except KilledError:
                kills += 1
        snapshots._held.clear()
        takes.check()
        assert verify_snapshot(takes.place)[0] == []
    assert kills >= 10
    gather_segments(takes.location)
    collect_garbage(takes.place, older_than=NOW)
    takes.check()
    named = {path for each in open_snapshot(takes.place).labels for path in each.files}
    on_disk = {path.relative_to(takes.place.folder).as_posix() for path in files(takes)}
    assert on_disk == named | {newest(takes).relative_to(takes.place.folder).as_posix()}
    assert lying(takes) == set()


def test_of_two_merges_at_once_one_wins_and_the_other_leaves_nothing(takes, monkeypatch):
    fill(takes)
    publish = gathering.publish_snapshot
    others = []

    def publish_late(*values, **options):
        if not others:
            others.append(True)
            assert gather_segments(takes.location) == []
        return publish(*values, **options)

    monkeypatch.setattr(gathering, "publish_snapshot", publish_late)
    assert gather_segments(takes.location) == []
    takes.check()
    assert [path.name for path in files(takes, MANIFEST)][-1] == "00000001.json"
    assert len(files(takes)) == 3


def test_a_manifest_is_created_when_all_that_it_names_is_on_the_medium(takes, monkeypatch):
    fill(takes, 3)
    done = []
    sync, create = snapshots.sync_files, snapshots.create_file
    monkeypatch.setattr(
        snapshots, "sync_files", lambda place, paths: done.append({*paths}) or sync(place, paths)
    )
    monkeypatch.setattr(
        snapshots, "create_file", lambda *values: done.append("created") or create(*values)
    )
    gather_segments(takes.location)
    [about] = open_snapshot(takes.place).labels
    assert done == [{*about.files}, "created"]


def test_an_index_whose_creation_was_answered_twice_is_ours(takes, monkeypatch):
    """An object store that wrote the manifest, lost its answer, and was asked again."""
    fill(takes, 2)
    create = snapshots.create_file
    monkeypatch.setattr(snapshots, "create_file", lambda *values: create(*values) and False)
    gather_segments(takes.location)
    takes.check()
    assert lying(takes) == set()


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_takes_published_and_gathered_by_many_at_once_are_all_there(takes):
    def work(which):
        for number in range(5):
            takes.publish(f"take{which}-{number}", 20 + number)
            gather_segments(takes.location)

    threads = [threading.Thread(target=work, args=(which,)) for which in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    takes.check()
    gather_segments(takes.location)
    takes.check()
    assert lying(takes) == set()


def test_an_archive_that_grows_and_is_merged_during_a_search_answers_as_it_was(takes):
    fill(takes, 3)
    gather_segments(takes.location)
    takes.publish("late", 44)
    before = dict(takes.rows)
    listing = open_archive(takes.location).listing()
    takes.publish("take1", 60)
    takes.publish("later", 60)
    gather_segments(takes.location)
    found, skipped = read_all(takes.location, listing)
    assert skipped == {}
    assert sorted(found) == sorted(before)
    for take, rows in found.items():
        np.testing.assert_array_equal(rows, before[take])


def test_many_takes_that_lie_by_themselves_keep_no_file_open(takes):
    for number in range(60):
        takes.publish(f"take{number}", 20)
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    in_use = len(os.listdir("/proc/self/fd"))
    resource.setrlimit(resource.RLIMIT_NOFILE, (in_use + 20, before[1]))
    try:
        takes.check()
        gather_segments(takes.location)
        takes.check()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def blank(path):
    path.write_bytes(bytes(path.stat().st_size))


def remove(path):
    path.unlink()


def folder(path):
    path.unlink()
    path.mkdir()


def pipe(path):
    path.unlink()
    os.mkfifo(path)


HARMS = (flip, cut, blank, remove, folder, pipe)


@pytest.mark.parametrize("harm", HARMS, ids=lambda harm: harm.__name__)
@pytest.mark.parametrize("part", ["manifest", "label", "rows"])
def test_nothing_is_read_from_a_harmed_index_and_it_is_made_anew(takes, part, harm):
    fill(takes, 3)
    gather_segments(takes.location)
    takes.publish("late", 44)
    path = {"manifest": newest, "label": label, "rows": lambda t: files(t, "*.rows.npy")[0]}[part]
    harm(path(takes))
    found, skipped = read_all(takes.location)
    assert "late" in found
    assert {*found} | {*skipped} == {*takes.rows}
    for take, rows in found.items():
        np.testing.assert_array_equal(rows, takes.rows[take])
    assert all("run `shosa index`" in why for why in skipped.values())
    listing = open_archive(takes.location).listing()
    assert {entry.take: entry.version for entry in listing.entries} == takes.versions
    assert listing.faults == {}
    if (part, harm) != ("manifest", remove):  # then there is no index
        assert "run `shosa index`" in verify_snapshot(takes.place)[0][0]
    takes.write_again()
    assert gather_segments(takes.location, anew=True) == []
    takes.check()
    assert verify_snapshot(takes.place)[0] == []
    collect_garbage(takes.place, older_than=NOW)
    takes.check()


@pytest.mark.parametrize("form", [(0, 1), (2, 1), (1, 0), (1, 2)], ids=str)
def test_an_index_of_another_shosa_is_named_and_not_used(takes, form):
    fill(takes, 2)
    gather_segments(takes.location)
    said = json.loads(newest(takes).read_text())
    del said["sha256"]
    said |= {"format": form[0], "packing": form[1]}
    newest(takes).write_text(json.dumps({**said, "sha256": snapshots._seal(said)}))
    [fault] = open_snapshot(takes.place).faults
    assert f"the index of a{' newer' if sum(form) > 2 else 'n older'} shosa" in fault
    assert "run `shosa index`" in fault
    takes.check(without=takes.rows)
    # a newer shosa may be using it
    assert collect_garbage(takes.place, older_than=NOW) == []
    assert fault in kept_from_garbage(takes.place)
    takes.write_again()
    gather_segments(takes.location, anew=True)
    takes.check()


def test_an_index_of_another_archive_is_not_believed(takes, tmp_path):
    other = PlainTakes(create_archive(tmp_path / "other").place)
    for each in (takes, other):
        fill(each, 3)
        gather_segments(each.location)
    shutil.rmtree(takes.place.folder / FOLDER)
    shutil.copytree(other.place.folder / FOLDER, takes.place.folder / FOLDER)
    takes.check(without=takes.rows)
    listing = open_archive(takes.location).listing()
    assert {entry.take: entry.version for entry in listing.entries} == takes.versions
    takes.write_again()
    gather_segments(takes.location)
    takes.check()


def test_rows_of_another_segment_are_not_believed(takes, tmp_path):
    other = PlainTakes(create_archive(tmp_path / "other").place)
    for each in (takes, other):
        fill(each, 3)
        gather_segments(each.location)
    mine, theirs = (files(each, "*.rows.npy")[0] for each in (takes, other))
    shutil.copy(theirs, mine)
    takes.check(without=takes.rows)


def test_where_the_newest_manifest_is_harmed_the_one_before_is_used(takes):
    fill(takes, 3)
    gather_segments(takes.location)
    takes.publish("late", 44)
    gather_segments(takes.location)
    flip(newest(takes))
    found, skipped = read_all(takes.location)
    assert sorted(found) == ["take0", "take1", "take2"]
    assert [*skipped] == ["late"]
    assert collect_garbage(takes.place, older_than=NOW) == []


def test_a_harmed_block_costs_its_takes_and_no_others(takes, monkeypatch):
    monkeypatch.setattr(segments, "BLOCK", 64)
    fill(takes, 5)
    gather_segments(takes.location)
    path = files(takes, "*.rows.npy")[0]
    [about] = open_snapshot(takes.place).labels
    place = len(about.rows.head) + 4 * (3 * about.rows.shape[1] + int(about.first[2]) + 20)
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)
    _, skipped = read_all(takes.location)
    assert {"take2"} <= {*skipped} <= {"take1", "take2", "take3"}
    takes.check(without=skipped)
    [fault] = verify_snapshot(takes.place)[0]
    assert f"in {len(skipped)} of its 5 takes" in fault
    # what is damaged is not taken over into a merge, and what is made again is taken up
    takes.write_again()
    assert gather_segments(takes.location) == []
    takes.check()
    assert verify_snapshot(takes.place)[0] == []


@pytest.mark.parametrize("harm", HARMS, ids=lambda harm: harm.__name__)
@pytest.mark.usefixtures("summarized")
def test_a_harmed_summary_is_refused_and_the_rows_are_searched_without(takes, harm):
    fill(takes, 3)
    gather_segments(takes.location)
    archive = open_archive(takes.location)
    listing = archive.listing()
    [opened], _ = opening.open_segments(takes.place, listing.snapshot, takes.versions)
    rows = np.nan_to_num(opened.segment.rows)
    np.testing.assert_array_equal(
        opened.segment.summaries["mean"], rows.reshape(69, -1, 16).mean(axis=2)
    )
    harm(files(takes, "*.mean.npy")[0])
    [opened], _ = opening.open_segments(takes.place, listing.snapshot, takes.versions)
    with pytest.raises(DamagedSegmentError, match="run `shosa index`") as raised:
        opened.segment.summaries["mean"]
    left, lost = opened.without_damage(raised.value)
    assert (lost, dict(left.segment.summaries)) == ({}, {})
    takes.check()
    assert len(verify_snapshot(takes.place)[0]) == 1


@pytest.mark.usefixtures("summarized")
def test_a_search_goes_on_without_what_it_finds_to_be_damaged(takes, monkeypatch):
    monkeypatch.setattr(segments, "BLOCK", 64)
    fill(takes, 5)
    gather_segments(takes.location)
    tried = []

    def search(_query, found, _settings):
        names = []
        for segment in found:
            tried.append([*segment.summaries.values()])
            for at in np.flatnonzero(segment.searched):
                segment.check(segment.first[at], segment.first[at] + segment.samples[at])
                names.append(segment.names[at])
        return Found([Match(name, 0, 9, 0.5) for name in names], {})

    monkeypatch.setattr(answering, "search_segments", search)
    archive = open_archive(takes.location)

    def answer():
        listing = archive.listing()
        found = answering._search(archive, listing, listing.entries, None, SearchSettings(top=9))
        return {match.take for match in found.matches}, found.skipped

    assert answer() == ({*takes.rows}, {})
    assert len(tried[-1]) == 1
    flip(files(takes, "*.mean.npy")[0])
    assert answer() == ({*takes.rows}, {})
    assert tried[-1] == []
    flip(files(takes, "*.rows.npy")[0])
    there, skipped = answer()
    assert 0 < len(skipped) < 4
    assert there == {*takes.rows} - {*skipped}
    assert "run `shosa index`" in next(iter(skipped.values()))


@pytest.mark.usefixtures("small")
def test_what_is_not_asked_for_is_a_hole_and_a_segment_of_holes_is_not_opened(takes):
    fill(takes)
    gather_segments(takes.location)
    wanted = {"take1": takes.versions["take1"], "take2": "another version"}
    [opened], faults = opening.open_segments(takes.place, open_snapshot(takes.place), wanted)
    assert faults == {}
    searched = itertools.compress(opened.segment.names, opened.segment.searched)
    assert list(searched) == ["take1"]


def test_opening_and_listing_cost_two_files_whatever_the_takes(takes, monkeypatch):
    fill(takes, 12)
    aged(takes)
    gather_segments(takes.location)
    read = []
    for module in (snapshots, segments):
        before = module.read_file
        monkeypatch.setattr(
            module, "read_file", lambda place, path, do=before: read.append(path) or do(place, path)
        )
    records = counted(monkeypatch)
    snapshots._held.clear()
    assert len(open_archive(takes.location).listing().entries) == 12
    assert (len(read), records) == (2, [])


@pytest.mark.usefixtures("summarized")
def test_summaries_of_another_kind_are_not_read(takes, monkeypatch):
    fill(takes, 3)
    gather_segments(takes.location)
    monkeypatch.setattr(opening, "SUMMARIZED", 2)
    snapshot = open_snapshot(takes.place)
    [opened], _ = opening.open_segments(takes.place, snapshot, takes.versions)
    assert dict(opened.segment.summaries) == {}


def test_a_full_disk_leaves_the_index_as_it_was(small_disk):
    takes = PlainTakes(create_archive(small_disk / "archive").place)
    takes.publish("first", 60)
    gather_segments(takes.location)
    takes.publish("second", 420)
    with pytest.raises(PlaceError, match="free some space"):
        gather_segments(takes.location)
    takes.check()
    gather_when_many(takes.location)
    assert len(files(takes, "*.rows.npy")) == 1


def test_garbage_is_what_no_snapshot_refers_to(takes):
    fill(takes, 3)
    gather_segments(takes.location)
    before = files(takes)
    takes.publish("late", 60)
    gather_segments(takes.location)
    stray = files(takes)[0].with_name("abcdefab.rows.npy")
    stray.write_bytes(b"?")
    assert collect_garbage(takes.place, older_than=timedelta(hours=1)) == []
    takes.check()
    removed = {
        takes.place.folder / file.path for file in collect_garbage(takes.place, older_than=NOW)
    }
    assert removed == {*before, stray} - {*files(takes)}
    assert stray in removed
    assert before[0] in removed
    takes.check()


def counted(monkeypatch):
    """Count the records that a listing reads."""
    read = []
    before = catalogue.read_record
    monkeypatch.setattr(
        catalogue, "read_record", lambda place, take: read.append(take) or before(place, take)
    )
    return read


def aged(takes):
    """Let the folders of records be as old as those of an archive are that nobody writes to."""
    for path in takes.place.folder.glob("published/*"):
        os.utime(path, ns=(10**18, 10**18 + len(path.name)))


def test_a_listing_reads_only_the_records_that_changed(takes, monkeypatch):
    fill(takes, 5)
    aged(takes)
    gather_segments(takes.location)
    read = counted(monkeypatch)
    archive = open_archive(takes.location)
    listed = archive.listing()
    assert read == []
    assert [entry.take for entry in listed.entries] == archive.takes()
    for entry, record in zip(listed.entries, archive.records(), strict=True):
        assert all(getattr(record, name) == getattr(entry, name) for name in entry._fields[:-1])
        assert entry.bytes == sum(file["bytes"] for file in record.files.values())
    takes.publish("take3", 44, metadata={"title": "new"})
    takes.publish("late", 44)
    takes.remove("take1")
    again = archive.listing(listed)
    assert sorted(read) == ["late", "take3"]
    assert {entry.take: entry.version for entry in again.entries} == takes.versions
    assert next(e.metadata for e in again.entries if e.take == "take3") == {"title": "new"}


def test_what_changes_twice_within_a_step_of_the_clock_is_seen(takes):
    """A file system that counts in whole seconds gives both changes one time."""
    takes.publish("take", 40)
    folder = takes.place.folder / "published/take"
    second = int(os.stat(folder).st_mtime) * 10**9
    os.utime(folder, ns=(second, second))
    gather_segments(takes.location)
    before = open_archive(takes.location).listing()
    takes.publish("take", 50)
    os.utime(folder, ns=(second, second))
    assert open_archive(takes.location).listing(before).entries[0].frames == 50
    takes.check()


def test_a_damaged_record_is_told_and_not_hidden_by_the_catalogue(takes):
    fill(takes, 3)
    aged(takes)
    gather_segments(takes.location)
    path = takes.place.folder / "published/take1/000001.json"
    path.unlink()
    path.write_text("{")
    listing = open_archive(takes.location).listing()
    assert [entry.take for entry in listing.entries] == ["take0", "take2"]
    assert "is damaged" in listing.faults["take1"]


def test_a_take_whose_record_is_damaged_during_a_merge_keeps_its_rows(takes):
    fill(takes, 3)
    gather_segments(takes.location)
    path = takes.place.folder / "published/take1/000001.json"
    whole = path.read_bytes()
    path.write_bytes(b"{")
    takes.publish("late", 600)
    gather_segments(takes.location)
    assert len(open_snapshot(takes.place).labels) == 1
    path.write_bytes(whole)
    takes.check()


def test_a_manifest_under_another_number_is_not_believed(takes):
    fill(takes, 3)
    gather_segments(takes.location)
    shutil.copy(newest(takes), newest(takes).with_name("00000007.json"))
    [fault] = open_snapshot(takes.place).faults
    assert "it is that of number 1" in fault
    takes.check()
    takes.publish("late", 44)
    gather_segments(takes.location)
    assert open_snapshot(takes.place).faults == ()
    takes.check()


@pytest.mark.usefixtures("small")
def test_entries_out_of_date_are_written_anew(takes, monkeypatch):
    fill(takes, 5)
    gather_segments(takes.location)
    aged(takes)
    assert gather_segments(takes.location) == []
    read = counted(monkeypatch)
    takes.check()
    assert len(read) < 5
    assert Path(newest(takes)).name == "00000002.json"
