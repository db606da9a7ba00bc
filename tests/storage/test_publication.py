"""Tests of storage.publication on a directory."""

import json
import os
import threading
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from storage import create_archive, open_archive
from storage.arrays.search import open_search_array, verify_search_array
from storage.errors import ArchiveError, ConflictError
from storage.publication import publish_record, version_folder
from storage.records import read_record
from storage.upkeep.garbage import collect_garbage
from storage.upkeep.verification import verify_take
from tests.conftest import cases
from tests.figures.archives.takes import publish, publish_until_killed, write_version

NOW = timedelta(0)


@pytest.fixture
def archive(tmp_path):
    return create_archive(tmp_path / "archive")


def number_in(take):
    """The version number that every value of the take tells."""
    values = np.unique(take.motion["position"].values)
    assert values.size == 1
    return int(values[0])


def test_a_take_is_there_once_published_and_not_before(archive):
    record = write_version(archive.place, "okuri48")
    assert archive.takes() == []
    publish_record(archive.place, record)
    assert archive.takes() == ["okuri48"]
    assert number_in(archive.take("okuri48")) == 1


def test_a_run_killed_before_its_first_record_leaves_no_take(archive):
    folder = Path(archive.place.location, "published/okuri48")
    folder.mkdir(parents=True)
    (folder / ".abc.partial").write_text("{")
    assert archive.takes() == []
    assert archive.records() == []
    collect_garbage(archive.place, older_than=NOW)
    assert list(folder.parent.rglob("*.partial")) == []
    assert publish(archive.place, "okuri48").number == 1


def test_a_new_version_replaces_the_old_one_and_leaves_its_readers_alone(archive):
    publish(archive.place, "okuri48")
    reader = archive.take("okuri48")
    publish(archive.place, "okuri48")
    assert number_in(archive.take("okuri48")) == 2
    assert number_in(reader) == 1


def test_of_two_runs_that_publish_the_same_number_one_wins_and_the_other_is_told(archive):
    first = write_version(archive.place, "okuri48")
    second = write_version(archive.place, "okuri48")
    publish_record(archive.place, second)
    with pytest.raises(ConflictError, match="another run published version 1 of take 'okuri48'"):
        publish_record(archive.place, first)
    assert archive.take("okuri48").record.version == second.version


def test_many_writers_at_once_lose_nothing(archive):
    told = []

    def write_three():
        done = 0
        while done < 3:
            try:
                told.append(publish(archive.place, "okuri48").number)
            except ConflictError:
                continue
            done += 1

    threads = [threading.Thread(target=write_three) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(told) == list(range(1, 13))
    assert archive.take("okuri48").record.number == 12
    assert verify_take(archive.place, "okuri48") == []


def test_garbage_is_what_no_record_refers_to(archive):
    old = publish(archive.place, "okuri48")
    new = publish(archive.place, "okuri48")
    stray = write_version(archive.place, "okuri49")
    publish(archive.place, "lonely")
    removed = {file.path for file in collect_garbage(archive.place, older_than=NOW)}
    root = Path(archive.place.location)
    assert not (root / version_folder("okuri48", old.version)).exists()
    assert not (root / "takes" / "okuri49").exists()
    assert "published/okuri48/000001.json" in removed
    assert f"index/okuri49/{stray.version}.1.npy" in removed
    assert number_in(archive.take("okuri48")) == 2
    assert verify_take(archive.place, "okuri48") == verify_take(archive.place, "lonely") == []
    assert open_search_array(archive.place, "okuri48", new.version).shape == (5, 40)
    assert collect_garbage(archive.place, older_than=NOW) == []


def test_garbage_that_somebody_may_still_use_stays(archive):
    publish(archive.place, "okuri48")
    reader = archive.take("okuri48")
    publish(archive.place, "okuri48")
    writer = write_version(archive.place, "okuri49")
    assert collect_garbage(archive.place, older_than=timedelta(hours=1)) == []
    assert number_in(reader) == 1
    publish_record(archive.place, writer)
    assert verify_take(archive.place, "okuri49") == []


def test_a_record_is_garbage_only_when_its_successor_is_old(archive):
    publish(archive.place, "okuri48")
    first = Path(archive.place.location, "published/okuri48/000001.json")
    os.utime(first, (0, 0))
    publish(archive.place, "okuri48")
    assert collect_garbage(archive.place, older_than=timedelta(hours=1)) == []


@pytest.mark.parametrize("fault", ["changed", "missing", "added"])
def test_verify_names_the_file_that_is_not_as_published(archive, fault):
    record = publish(archive.place, "okuri48")
    folder = Path(archive.place.location, version_folder("okuri48", record.version))
    chunk = folder / "motion/position/c/0/0/0"
    if fault == "changed":
        content = bytearray(chunk.read_bytes())
        content[len(content) // 2] ^= 1
        chunk.write_bytes(content)
        expected = "position/c/0/0/0 has changed"
    elif fault == "missing":
        chunk.unlink()
        expected = "position/c/0/0/0 is missing"
    else:
        (folder / "motion/stray").write_text("?")
        expected = "motion/stray is not in its record"
    faults = verify_take(archive.place, "okuri48")
    assert len(faults) == 1
    assert expected in faults[0]


def test_verify_sees_a_changed_and_a_missing_search_array(archive):
    record = publish(archive.place, "okuri48")
    assert verify_search_array(archive.place, "okuri48", record.version) == []
    path = Path(archive.place.location, f"index/okuri48/{record.version}.1.npy")
    path.write_bytes(path.read_bytes()[:-1] + b"!")
    [fault] = verify_search_array(archive.place, "okuri48", record.version)
    assert "has changed; run `shosa index`" in fault
    path.unlink()
    [fault] = verify_search_array(archive.place, "okuri48", record.version)
    assert "has no search array; run `shosa index`" in fault


def test_a_damaged_search_array_is_refused(archive):
    record = publish(archive.place, "okuri48")
    path = Path(archive.place.location, f"index/okuri48/{record.version}.1.npy")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ArchiveError, match="search array of take 'okuri48' is damaged"):
        open_search_array(archive.place, "okuri48", record.version)
    path.unlink()
    with pytest.raises(ArchiveError, match="has no search array; run `shosa index`"):
        open_search_array(archive.place, "okuri48", record.version)


def test_a_search_array_is_mapped_and_not_read(archive):
    record = publish(archive.place, "okuri48")
    assert isinstance(open_search_array(archive.place, "okuri48", record.version), np.memmap)


def test_a_record_of_a_newer_shosa_and_a_damaged_one_are_said(archive):
    publish(archive.place, "okuri48")
    path = Path(archive.place.location, "published/okuri48/000001.json")
    fields = json.loads(path.read_text())
    path.write_text(json.dumps({**fields, "format": 99}))
    with pytest.raises(ArchiveError, match=r"newer shosa.*update shosa"):
        read_record(archive.place, "okuri48")
    path.write_text("{")
    with pytest.raises(ArchiveError, match=r"000001.json is damaged"):
        archive.records()
    assert "is damaged" in verify_take(archive.place, "okuri48")[0]


@pytest.mark.slow
@pytest.mark.drawn
@pytest.mark.long
def test_killed_at_any_moment_a_run_leaves_the_old_version_or_the_new_one(tmp_path):
    """Kills at random moments; every published number is kept, every take is whole."""
    rng = np.random.default_rng(20030601)
    location = str(tmp_path / "archive")
    published, seen, unpublished, patience_s = 0, set(), 0, 0.25
    kills = cases(10)
    for _ in range(kills):
        told = publish_until_killed(location, "okuri48", rng.uniform(0.0, patience_s))
        # so that on any machine two in three publish
        patience_s *= 0.95 if told else 1.1 if published else 2.0
        published = told or published
        if not published:
            continue
        archive = open_archive(location)
        take = archive.take("okuri48")
        assert take.record.number in (published, published + 1)  # killed before it could tell
        published = take.record.number
        assert number_in(take) == published
        assert verify_take(archive.place, "okuri48") == []
        versions = {path.name for path in Path(location, "takes/okuri48").iterdir()}
        unpublished += len(versions - seen) > 1
        seen |= versions
    assert published > kills / 3
    assert unpublished > kills / 30  # some kills came in the middle of a write
    collect_garbage(archive.place, older_than=NOW)
    assert len(list(Path(location, "takes/okuri48").iterdir())) == 1
    assert not list(Path(location).rglob("*.partial"))
    assert number_in(archive.take("okuri48")) == published
