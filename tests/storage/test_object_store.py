"""Tests of an archive in an object store: a real S3 server process on loopback."""

import time
from datetime import timedelta

import numpy as np
import pytest

from storage import create_archive, open_archive
from storage.arrays.search import open_search_array, verify_search_array
from storage.errors import ConflictError, InputError, PlaceError
from storage.index.segments import FOLDER
from storage.index.snapshots import verify_snapshot
from storage.places import list_files, write_file
from storage.publication import publish_record
from storage.upkeep.garbage import collect_garbage
from storage.upkeep.verification import verify_take
from tasks.retrieval.gathering import gather_segments
from tests.conftest import cases
from tests.figures.archives.packed_takes import PlainTakes, read_all
from tests.figures.archives.takes import publish, publish_until_killed, write_version

pytestmark = pytest.mark.s3


def test_an_archive_in_an_object_store_does_what_one_on_a_disk_does(object_store):
    place = create_archive(object_store).place
    publish(place, "okuri48")
    reader = open_archive(object_store).take("okuri48")
    old = write_version(place, "okuri48")
    new = publish(place, "okuri48", frames=57)
    with pytest.raises(ConflictError, match="version 2 of take 'okuri48'"):
        publish_record(place, old)
    archive = open_archive(object_store)
    assert archive.takes() == ["okuri48"]
    assert [record.frames for record in archive.records()] == [57]
    take = archive.take("okuri48")
    assert take.path == f"{object_store}/takes/okuri48/{new.version}"
    np.testing.assert_array_equal(np.unique(take.motion["position"]), [2.0])
    np.testing.assert_array_equal(np.unique(reader.motion["position"]), [1.0])
    assert open_search_array(place, "okuri48", new.version).shape == (5, 57)
    assert verify_take(place, "okuri48") == []
    assert verify_search_array(place, "okuri48", new.version) == []
    removed = {file.path.split("/")[2].split(".")[0] for file in _collect(place)}
    assert removed == {"000001", old.version, reader.record.version}
    assert verify_take(place, "okuri48") == []


def test_a_url_of_no_known_kind_is_refused():
    with pytest.raises(InputError, match="cannot use 'ftp://host/x' as a place for an archive"):
        open_archive("ftp://host/x")


def test_an_empty_bucket_is_no_archive(object_store):
    with pytest.raises(InputError, match="is not an archive"):
        open_archive(object_store)


@pytest.mark.drawn
@pytest.mark.long
def test_a_run_killed_at_any_moment_leaves_the_old_version_or_the_new_one(object_store):
    rng = np.random.default_rng(20030602)
    published, patience_s = 0, 0.5
    kills = cases(8)
    for _ in range(kills):
        told = publish_until_killed(object_store, "okuri48", rng.uniform(0.0, patience_s))
        # so that on any machine two in three publish
        patience_s *= 0.95 if told else 1.1 if published else 2.0
        published = told or published
        if published:
            archive = open_archive(object_store)
            take = archive.take("okuri48")
            assert take.record.number in (published, published + 1)
            published = take.record.number
            np.testing.assert_array_equal(np.unique(take.motion["position"]), [published])
            assert verify_take(archive.place, "okuri48") == []
    assert published > kills / 4


def test_an_index_in_an_object_store_is_copied_once_and_checked(
    object_store, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    takes = PlainTakes(create_archive(object_store).place)
    for number in range(3):
        takes.publish(f"take{number}", 40 + number)
    takes.check()
    assert gather_segments(object_store) == []
    takes.check()
    [copy] = tmp_path.rglob("*.npy")
    before = copy.stat().st_ino
    takes.publish("take1", 77)
    takes.check()
    assert copy.stat().st_ino == before
    content = bytearray(copy.read_bytes())
    content[-5000] ^= 1
    copy.write_bytes(content)
    found, skipped = read_all(object_store)
    assert "run `shosa index`" in skipped["take0"]
    assert "take1" in found
    takes.check()  # it was copied again
    assert verify_snapshot(takes.place)[0] == []
    path = next(file.path for file in list_files(takes.place, FOLDER) if ".rows." in file.path)
    write_file(takes.place, path, bytes(content))
    assert "has changed" in verify_snapshot(takes.place)[0][0]
    time.sleep(1.1)  # the server keeps whole seconds
    for number in range(3):
        takes.publish(f"take{number}", 50 + number)
    assert gather_segments(object_store) == []
    takes.check()
    assert path in {file.path for file in _collect(takes.place)}
    takes.check()


def test_an_object_store_that_goes_away_is_said(object_store, object_store_server):
    """Last in this file: it stops the server."""
    place = create_archive(object_store).place
    publish(place, "okuri48")
    draft = write_version(place, "okuri48")
    _, process = object_store_server
    process.kill()
    process.wait()
    with pytest.raises(PlaceError, match="check that the object store answers"):
        publish_record(place, draft)
    with pytest.raises(PlaceError, match=r"cannot read s3://.*/archive.json"):
        open_archive(object_store)


def _collect(place):
    time.sleep(1.1)  # the server keeps whole seconds
    return collect_garbage(place, older_than=timedelta(0))
