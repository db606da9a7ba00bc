"""Tests of storage.archive, storage.places and storage.provenance on a directory."""

import json
import os
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

import storage
from storage.archive import take_name
from storage.errors import ArchiveError, InputError, PlaceError, UnknownNameError
from storage.places import create_file, open_place, write_file
from storage.provenance import digest_bytes, digest_file, recorded
from storage.schema import JOINTS, SPACE
from tests.figures.archives.takes import publish


@pytest.fixture
def archive(tmp_path):
    archive = storage.create_archive(tmp_path / "archive")
    publish(archive.place, "okuri48")
    publish(archive.place, "okuri49")
    return archive


def test_an_archive_is_made_once_and_opened_after(tmp_path):
    made = storage.create_archive(tmp_path / "a" / "b")
    mark = (tmp_path / "a" / "b" / "archive.json").read_text()
    assert json.loads(mark)["version"] == 1
    again = storage.create_archive(tmp_path / "a" / "b")
    assert again.takes() == made.takes() == storage.open_archive(tmp_path / "a" / "b").takes() == []
    assert (tmp_path / "a" / "b" / "archive.json").read_text() == mark


def test_a_take_opens_with_xarray_alone(archive):
    take = archive.take("okuri48")
    motion = xarray.open_zarr(take.path, group="motion", consolidated=False)
    assert motion["position"].dims == ("time", "joint", "space")
    assert motion["position"].shape == (40, 21, 3)
    assert motion["position"].dtype == np.float32
    assert motion["filled"].dtype == bool
    assert motion.attrs["joints"] == list(JOINTS) == motion["joint"].values.tolist()
    assert motion["space"].values.tolist() == list(SPACE)
    np.testing.assert_allclose(motion["time"].values[:2], [0.0, 1 / 30])
    assert motion.attrs["provenance"]["stage"] == "test"
    xarray.testing.assert_equal(motion.load(), take.motion.load())


def test_the_consolidated_metadata_that_no_specification_has_are_not_there(archive):
    mark = json.loads(Path(archive.take("okuri48").path, "motion", "zarr.json").read_text())
    assert "consolidated_metadata" not in mark


def test_an_unknown_take_is_answered_with_the_nearest_names(archive):
    with pytest.raises(UnknownNameError, match="has no take 'okuri'; did you mean okuri4"):
        archive.take("okuri")
    with pytest.raises(UnknownNameError, match=r"has no take 'zzz'$"):
        archive.take("zzz")


def test_a_folder_of_other_things_is_not_made_an_archive(tmp_path):
    (tmp_path / "holiday.jpg").touch()
    message = re.escape("not an archive and not empty (it holds holiday.jpg)")
    with pytest.raises(InputError, match=message):
        storage.create_archive(tmp_path)
    with pytest.raises(InputError, match=r"is not an archive: it has no archive.json"):
        storage.open_archive(tmp_path)
    assert os.listdir(tmp_path) == ["holiday.jpg"]


def test_what_is_not_there_is_not_opened(tmp_path):
    with pytest.raises(InputError, match="there is no directory"):
        storage.open_archive(tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_an_archive_of_a_newer_format_is_left_alone(archive):
    mark = Path(archive.place.location, "archive.json")
    mark.write_text(json.dumps({"format": "shosa-archive", "version": 2}))
    with pytest.raises(ArchiveError, match="has format 2 and this shosa reads up to 1; update"):
        storage.open_archive(archive.place.location)
    with pytest.raises(ArchiveError, match="update shosa"):
        storage.create_archive(archive.place.location)
    mark.write_text("{")
    with pytest.raises(ArchiveError, match=r"archive.json is damaged"):
        storage.open_archive(archive.place.location)


def test_a_take_without_motion_says_so(archive):
    take = archive.take("okuri48")
    take.record.stages.clear()
    with pytest.raises(ArchiveError, match="'okuri48' has no motion"):
        _ = take.motion


@pytest.mark.parametrize(
    ("text", "name"),
    [("Okuri 48", "okuri-48"), ("indian_06", "indian_06"), ("a/b:c", "a-b-c"), ("所作", "所作")],
)
def test_the_name_of_a_take_goes_into_paths_and_clips(text, name):
    assert take_name(text) == name


def test_a_name_of_no_letters_is_refused():
    with pytest.raises(InputError, match="makes no name for a take"):
        take_name("...")


def test_a_file_is_created_once(tmp_path):
    place = open_place(tmp_path)
    assert create_file(place, "a/b.json", b"1")
    assert not create_file(place, "a/b.json", b"2")
    assert (tmp_path / "a/b.json").read_bytes() == b"1"
    assert os.listdir(tmp_path / "a") == ["b.json"]


def test_a_full_disk_is_said_and_leaves_what_was_published(small_disk):
    archive = storage.create_archive(small_disk / "archive")
    publish(archive.place, "okuri48", frames=3)
    with pytest.raises(PlaceError, match="No space left on device; free some space"):
        write_file(archive.place, "index/x.npy", bytes(1_000_000))

    def publish_for_ever():
        while True:
            publish(archive.place, "okuri49", frames=5)

    with pytest.raises(PlaceError, match="No space left on device; free some space"):
        publish_for_ever()
    assert "okuri48" in storage.open_archive(archive.place.location).takes()
    for name in archive.takes():
        assert archive.take(name).motion["position"].load().size


def test_a_read_only_disk_is_said_and_can_be_read(small_disk):
    archive = storage.create_archive(small_disk / "archive")
    publish(archive.place, "okuri48", frames=3)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    assert (
        storage.open_archive(archive.place.location).take("okuri48").motion["position"].load().size
    )
    for write in (write_file, create_file):
        with pytest.raises(PlaceError, match="Read-only file system; choose a place"):
            write(archive.place, "sources/x.json", b"{}")
    with pytest.raises(PlaceError, match="Read-only file system"):
        publish(archive.place, "okuri49")
    with pytest.raises(PlaceError, match="cannot make the directory"):
        storage.create_archive(small_disk / "other")


def test_provenance_says_stage_settings_inputs_and_how_long(monkeypatch):
    clock = SimpleNamespace(monotonic=iter([100.0, 107.25]).__next__)
    monkeypatch.setattr("storage.provenance.time", clock)
    with recorded("carving", settings={"voxel_m": 0.01}, inputs={"a": "d"}) as provenance:
        pass
    attributes = json.loads(json.dumps(provenance.attributes()))
    assert attributes["stage"] == "carving"
    assert attributes["settings"] == {"voxel_m": 0.01}
    assert attributes["inputs"] == {"a": "d"}
    assert attributes["seconds"] == 7.25
    assert attributes["shosa"]


def test_the_digest_of_a_file_is_that_of_its_bytes(tmp_path):
    (tmp_path / "a").write_bytes(bytes(range(256)) * 9000)
    assert digest_file(tmp_path / "a") == digest_bytes((tmp_path / "a").read_bytes())
    assert digest_bytes(b"") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
