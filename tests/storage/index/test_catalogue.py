"""Tests of listings: what is read anew, and that nothing is listed as it was."""

import os
from pathlib import Path

import pytest

from storage import open_archive
from storage.index import catalogue, segments, snapshots
from storage.index.snapshots import open_snapshot
from tasks.retrieval.gathering import gather_segments
from tests.figures.archives.packed_takes import (
    aged,
    fill,
    newest,
)


def counted(monkeypatch):
    """Count the records that a listing reads."""
    read = []
    before = catalogue.read_record
    monkeypatch.setattr(
        catalogue, "read_record", lambda place, take: read.append(take) or before(place, take)
    )
    return read


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
