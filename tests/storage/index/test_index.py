"""Tests of the index in segments: gathered, merged, killed, against a dict of arrays."""

import itertools
import os
import resource
import threading
from datetime import timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as drawn
from hypothesis import strategies as st

from storage import create_archive, open_archive
from storage.errors import PlaceError
from storage.index import segments, snapshots
from storage.index.snapshots import open_snapshot, verify_snapshot
from storage.publication import publish_record
from storage.upkeep.garbage import collect_garbage
from tasks.retrieval import gathering, opening
from tasks.retrieval.gathering import gather_segments, gather_when_many
from tasks.retrieval.pruned.summaries import SUMMARIES
from tests.conftest import cases
from tests.figures.archives.packed_takes import (
    MANIFEST,
    PlainTakes,
    aged,
    files,
    fill,
    lying,
    newest,
    read_all,
    record_of,
)

NOW = timedelta(0)


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
    assert len(files(takes)) == 3 + len(SUMMARIES)  # manifest, label, rows


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


@pytest.mark.usefixtures("small")
def test_what_is_not_asked_for_is_a_hole_and_a_segment_of_holes_is_not_opened(takes):
    fill(takes)
    gather_segments(takes.location)
    wanted = {"take1": takes.versions["take1"], "take2": "another version"}
    [opened], faults = opening.open_segments(takes.place, open_snapshot(takes.place).labels, wanted)
    assert faults == {}
    searched = itertools.compress(opened.segment.names, opened.segment.searched)
    assert list(searched) == ["take1"]


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
