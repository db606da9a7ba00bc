"""What is lost of an archive, what stands where a link leads out of it, what others leave in it."""

import json
import os
import re
import shutil
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from storage import create_archive
from storage.arrays.search import open_search_array, search_array_path, verify_search_array
from storage.errors import ArchiveError, InputError
from storage.places import open_place, read_file
from storage.publication import publish_record, version_folder
from storage.recordings import find_recordings, plan_takes
from storage.records import read_record
from storage.upkeep.garbage import (
    collect_garbage,
    kept_from_garbage,
    lost_versions,
    unpublished_versions,
)
from storage.upkeep.verification import damaged_files, verify_records, verify_take
from tests.figures.archives.takes import publish, write_version

NOW = timedelta(0)


@pytest.fixture
def archive(tmp_path):
    """Two takes."""
    archive = create_archive(tmp_path / "archive")
    publish(archive.place, "okuri48")
    publish(archive.place, "okuri49")
    return archive


@pytest.fixture
def root(archive):
    return Path(archive.place.location)


def content(folder):
    """All files below a folder, and what they hold."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("gone", ["published", "published/okuri48"])
def test_takes_whose_records_are_lost_are_kept_and_can_be_put_back(archive, root, gone):
    before = content(root)
    shutil.rmtree(root / gone)
    lost = ["okuri48"] if "/" in gone else ["okuri48", "okuri49"]
    assert [take for take, _ in lost_versions(archive.place)] == lost
    assert collect_garbage(archive.place, older_than=NOW) == []
    faults = verify_records(archive.place)
    assert len(faults) == len(lost)
    assert kept_from_garbage(archive.place) == faults
    for fault in faults:
        found = re.search(r"has no record in published/.*copy (\S+) to (\S+);", fault)
        assert found
        (root / found[2]).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(root / found[1], root / found[2])
    assert verify_records(archive.place) == []
    assert content(root) == before


def test_lost_takes_go_when_that_is_asked_for(archive, root):
    shutil.rmtree(root / "published/okuri48")
    removed = collect_garbage(archive.place, older_than=NOW, lost=True)
    assert {file.path.split("/")[1] for file in removed} == {"okuri48"}
    assert not (root / "takes/okuri48").exists()
    assert verify_take(archive.place, "okuri49") == verify_records(archive.place) == []


def test_an_archive_of_before_copies_loses_nothing_either(archive, root):
    shutil.rmtree(root / "published")
    shutil.rmtree(root / "sources")
    assert collect_garbage(archive.place, older_than=NOW) == []
    [fault, _] = verify_records(archive.place)
    assert "put the folder published/ back from a copy" in fault
    for take in ("okuri48", "okuri49"):
        publish(archive.place, take)
    shutil.rmtree(root / "published/okuri48")
    shutil.rmtree(root / "sources")
    (root / "sources").mkdir()
    (root / "sources" / f"{'d' * 64}.json").write_text('{"take": "okuri48"}')
    collect_garbage(archive.place, older_than=NOW)
    assert len(list((root / "takes/okuri48").iterdir())) == 2


def test_a_version_that_was_never_published_is_named_and_is_garbage(archive):
    record = write_version(archive.place, "okuri48")
    assert unpublished_versions(archive.place) == [("okuri48", record.version)]
    assert verify_records(archive.place) == []
    assert collect_garbage(archive.place, older_than=NOW)
    assert unpublished_versions(archive.place) == []


def test_a_record_whose_version_is_gone_is_named(archive, root):
    shutil.rmtree(root / "takes/okuri48")
    [fault] = verify_take(archive.place, "okuri48")
    assert re.search(r"takes/okuri48/\S+ with its \d+ files is missing; put it back", fault)
    publish(archive.place, "okuri48")
    [fault] = verify_records(archive.place)
    assert re.search(r"published/okuri48/000001.json is the record of .* which is gone", fault)


@pytest.mark.parametrize(
    "link", ["work", "index/x", "takes/x", "published/x", "takes", "index", "published/okuri48"]
)
def test_garbage_behind_a_link_stays_and_is_named(archive, root, tmp_path, link):
    publish(archive.place, "okuri48")  # what it replaced would be garbage
    outside = tmp_path / "outside"
    if (root / link).exists():
        shutil.move(root / link, outside)
    for folder in (outside / "000001-aaaaaaaa", outside / "empty"):
        folder.mkdir(parents=True)
    (outside / "000001-aaaaaaaa" / "zarr.json").write_text("{}")
    (root / link).symlink_to(outside)
    before = content(outside)
    removed = collect_garbage(archive.place, older_than=NOW)
    assert content(outside) == before
    assert (outside / "empty").is_dir()
    assert not [file for file in removed if file.path.startswith(f"{link}/")]
    assert f"{link} is a link: what is behind it was left alone" in kept_from_garbage(archive.place)


def test_what_systems_leave_in_folders_is_passed_over(archive, root):
    version = version_folder("okuri48", archive.take("okuri48").record.version)
    for folder in (
        "published",
        "published/okuri48",
        "takes",
        version,
        f"{version}/motion",
        "sources",
    ):
        for name in (".DS_Store", "Thumbs.db", "._zarr.json"):
            (root / folder / name).write_bytes(b"\0")
    (root / version / "@eaDir").mkdir()
    (root / version / "@eaDir" / "x").write_bytes(b"\0")
    assert archive.takes() == ["okuri48", "okuri49"]
    assert verify_take(archive.place, "okuri48") == verify_records(archive.place) == []
    assert archive.take("okuri48").motion["position"].load().size
    (root / version / "motion" / "c").write_bytes(b"\0")
    assert "motion/c is not in its record" in verify_take(archive.place, "okuri48")[0]


WRONG = {
    "another take's": (lambda r: {**r, "take": "okuri49"}, "it is not what was published"),
    "a value": (lambda r: {**r, "frames": 41}, "it is not what was published"),
    "of before, a value": (lambda r: {**without_seal(r), "frames": "41"}, "frames is '41', wanted"),
    "of before, another's": (lambda r: {**without_seal(r), "take": "x"}, "the record of take 'x'"),
    "a path": (
        lambda r: {**without_seal(r), "version": "../x"},
        "version is '../x', wanted is the",
    ),
    "rate": (lambda r: {**without_seal(r), "rate_hz": float("nan")}, "rate_hz is 'nan', wanted"),
    "files": (lambda r: {**without_seal(r), "files": {"../a": {}}}, "files is .*, wanted is"),
    "no table": (lambda r: [r], "is damaged"),
    "none": (lambda _: None, "is damaged"),
}


def without_seal(fields):
    return {name: value for name, value in fields.items() if name != "sha256"}


@pytest.mark.parametrize("case", WRONG)
def test_a_record_that_is_not_what_was_published_is_refused_and_others_are_read(
    archive, root, case
):
    change, message = WRONG[case]
    path = root / "published/okuri48/000001.json"
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(ArchiveError, match=message):
        read_record(archive.place, "okuri48")
    listing = archive.listing()
    assert [record.take for record in listing.entries] == ["okuri49"]
    assert re.search(message, listing.faults["okuri48"])
    assert re.search(message, verify_take(archive.place, "okuri48")[0])
    assert [f for f in collect_garbage(archive.place, older_than=NOW) if "okuri48" in f.path] == []
    assert "all of take 'okuri48' was kept" in kept_from_garbage(archive.place)[0]


def test_a_record_of_before_is_read_without_its_digest(archive, root):
    path = root / "published/okuri48/000001.json"
    path.write_text(json.dumps(without_seal(json.loads(path.read_text()))))
    assert archive.take("okuri48").record.frames == 40
    assert "differ; keep the right one" in verify_records(archive.place)[0]


@pytest.mark.parametrize("harm", ["changed", "missing", "added", "zeros"])
def test_a_damaged_chunk_is_never_read(archive, harm):
    take = archive.take("okuri48")
    chunk = Path(take.path, "motion/position/c/0/0/0")
    data = bytearray(chunk.read_bytes())
    if harm == "missing":
        chunk.unlink()
    elif harm == "added":  # all of `filled` is False, and so has no chunk
        stray = Path(take.path, "motion/filled/c/0/0")
        stray.parent.mkdir(parents=True)
        stray.write_bytes(b"\1")
        assert not take.motion["filled"].values.any()
        assert damaged_files(archive.place, take.record)
        return
    else:
        data[-3] ^= 4
        chunk.write_bytes(data if harm == "changed" else bytes(len(data)))
    motion = take.motion  # what is whole can be read
    assert motion.sizes["time"] == 40
    with pytest.raises(ArchiveError, match=r"take 'okuri48' is damaged.*c/0/0/0.*shosa verify"):
        _ = motion["position"].values


def test_a_reader_whose_version_was_collected_is_told(archive):
    reader = archive.take("okuri48")
    motion = reader.motion
    publish(archive.place, "okuri48")
    collect_garbage(archive.place, older_than=NOW)
    for read in (lambda: motion["position"].values, lambda: reader.motion):
        with pytest.raises(ArchiveError, match="replaced and collected since it was opened"):
            read()


def test_a_search_array_is_that_of_its_take_whole_or_refused(archive, root):
    mine = read_record(archive.place, "okuri48")
    other = read_record(archive.place, "okuri49")
    assert mine is not None
    assert other is not None
    path, twin = (root / search_array_path(each.take, each.version) for each in (mine, other))
    label = path.with_suffix(".json")
    whole, said = path.read_bytes(), label.read_bytes()

    def refused(message):
        assert verify_search_array(archive.place, "okuri48", mine.version)
        with pytest.raises(ArchiveError, match=f"{message}.*run `shosa index`"):
            open_search_array(archive.place, "okuri48", mine.version)
        path.write_bytes(whole)
        label.write_bytes(said)
        assert open_search_array(archive.place, "okuri48", mine.version).shape == (5, 40)

    for place in (len(whole) - 1, len(whole) - 300):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        refused("has changed")
    path.write_bytes(whole[:-160])
    refused("has 768 bytes where 928 are wanted")
    path.write_bytes(whole.replace(b"(5, 40)", b"(40, 5)"))
    refused("its head is not that of float32 values")
    path.write_bytes(twin.read_bytes())
    label.write_bytes(twin.with_suffix(".json").read_bytes())
    refused("it is that of take 'okuri49'")
    label.write_text('{"sha256": "0"}')
    refused("of an older shosa, or the file beside it is damaged")
    label.write_text(json.dumps({**json.loads(said), "shape": [5, -40]}))
    refused("its shape is said to be")


def test_another_takes_array_of_the_same_shape_is_refused(archive, root):
    publish(archive.place, "okuri49")  # the values are those of another number
    mine, other = (read_record(archive.place, take) for take in ("okuri48", "okuri49"))
    assert mine is not None
    assert other is not None
    path, twin = (root / search_array_path(each.take, each.version) for each in (mine, other))
    shutil.copy(twin, path)
    with pytest.raises(ArchiveError, match="search array of take 'okuri48' has changed"):
        open_search_array(archive.place, "okuri48", mine.version)


def test_a_pipe_or_a_folder_in_place_of_a_file_is_refused_at_once(archive, root):
    for path in ("archive.json", "published/okuri48/000001.json"):
        (root / path).unlink()
        os.mkfifo(root / path)
        with pytest.raises(ArchiveError, match="is no regular file, but a named pipe; remove it"):
            read_file(archive.place, path)
    with pytest.raises(ArchiveError, match="is no regular file"):
        read_file(archive.place, "takes")
    (root / "published/okuri49/000001.json").unlink()
    (root / "published/okuri49/000001.json").mkdir()
    assert archive.takes() == ["okuri48", "okuri49"]
    assert "is no regular file" in verify_take(archive.place, "okuri49")[0]
    shutil.rmtree(root / "published")
    (root / "published").write_text("?")
    with pytest.raises(ArchiveError, match="published is no folder"):
        archive.takes()


def test_a_name_that_is_no_text_is_refused_and_the_others_go_on(archive, tmp_path, write_walk):
    folder = tmp_path / "inbox"
    write_walk(folder / "a.trc")
    os.rename(write_walk(folder / "b.trc"), os.path.join(os.fsencode(folder), b"caf\xe9.trc"))
    plan = plan_takes(archive, find_recordings([folder]))
    assert [recording.take for recording in plan.recordings] == ["a"]
    assert [each.reason for each in plan.refusals] == [
        f"the name {str(folder / 'caf')!r}".replace("caf'", r"caf\\xe9.trc'")
        + " is not UTF-8; rename it"
    ]
    with pytest.raises(InputError, match="is not UTF-8; rename it"):
        find_recordings([os.fsdecode(os.path.join(os.fsencode(folder), b"caf\xe9.trc"))])
    with pytest.raises(InputError, match="not UTF-8; rename it, or give another place"):
        open_place(os.fsdecode(os.fsencode(folder) + b"/\xff"))


def test_urls_are_read_whatever_the_case_of_their_scheme():
    assert open_place("S3://bucket/x").location == "s3://bucket/x"
    with pytest.raises(InputError, match="should be a directory, or a URL such as s3://"):
        open_place("s3:/bucket/x")
    with pytest.raises(InputError, match="cannot use 's3://' as a place"):
        open_place("S3://")


def test_values_of_a_take_are_those_that_were_written(archive):
    record = write_version(archive.place, "okuri48")
    publish_record(archive.place, record)
    np.testing.assert_array_equal(np.unique(archive.take("okuri48").motion["position"]), [2.0])
