"""Tests of an index that is harmed in every way, of another archive or of another shosa."""

import json
import os
import shutil
from datetime import timedelta

import numpy as np
import pytest

from storage import create_archive, open_archive
from storage.errors import DamagedSegmentError
from storage.index import segments, snapshots
from storage.index.segments import FOLDER
from storage.index.snapshots import open_snapshot, verify_snapshot
from storage.upkeep.garbage import collect_garbage, kept_from_garbage
from tasks.retrieval import archive_search, opening
from tasks.retrieval.gathering import gather_segments
from tasks.retrieval.searching import Found, Match, SearchSettings
from tests.figures.archives.packed_takes import (
    PlainTakes,
    files,
    fill,
    label,
    newest,
    read_all,
)

NOW = timedelta(0)


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
    [opened], _ = opening.open_segments(takes.place, listing.snapshot.labels, takes.versions)
    rows = np.nan_to_num(opened.segment.rows)
    np.testing.assert_array_equal(
        opened.segment.summaries["mean"], rows.reshape(69, -1, 16).mean(axis=2)
    )
    harm(files(takes, "*.mean.npy")[0])
    [opened], _ = opening.open_segments(takes.place, listing.snapshot.labels, takes.versions)
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

    def search(_query, found, _settings, **_):
        names = []
        for segment in found:
            tried.append([*segment.summaries.values()])
            for at in np.flatnonzero(segment.searched):
                segment.check(segment.first[at], segment.first[at] + segment.samples[at])
                names.append(segment.names[at])
        return [Found([Match(name, 0, 9, 0.5) for name in names], {})]

    monkeypatch.setattr(archive_search, "search_gradually", search)
    archive = open_archive(takes.location)

    def answer():
        listing = archive.listing()
        found = archive_search.search_archive(
            archive.place, listing, listing.entries, None, SearchSettings(top=9)
        )
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


@pytest.mark.usefixtures("summarized")
def test_summaries_of_another_kind_are_not_read(takes, monkeypatch):
    fill(takes, 3)
    gather_segments(takes.location)
    monkeypatch.setattr(opening, "SUMMARIZED", 2)
    snapshot = open_snapshot(takes.place)
    [opened], _ = opening.open_segments(takes.place, snapshot.labels, takes.versions)
    assert dict(opened.segment.summaries) == {}


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
