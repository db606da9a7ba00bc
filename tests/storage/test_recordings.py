"""Tests of storage.recordings: which file becomes which take."""

import dataclasses

import pytest

from storage import create_archive
from storage.errors import InputError
from storage.publication import publish_record
from storage.recordings import find_recordings, plan_takes, read_metadata, remember_source

from .takes import write_version


@pytest.fixture
def archive(tmp_path):
    return create_archive(tmp_path / "archive")


@pytest.fixture
def inbox(tmp_path):
    folder = tmp_path / "inbox"
    for name in ("day1/walk.bvh", "day2/walk.bvh", "day1/Okuri 48.C3D", "day1/readme.txt"):
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(name)
    return folder


def take_in(archive, recording):
    """Publish a recording as a flow does."""
    record = write_version(archive.place, recording.take)
    source = {"kind": "bvh", "name": "", "path": recording.path, "digest": recording.digest}
    record = dataclasses.replace(record, source=source)
    publish_record(archive.place, record)
    remember_source(archive, record)


def plan(archive, *paths):
    return plan_takes(archive, find_recordings(paths))


def names(plan):
    return [recording.take for recording in plan.recordings]


def test_every_motion_file_below_a_folder_is_found(inbox):
    files, notes = find_recordings([inbox])
    assert [file.relative_to(inbox).as_posix() for file in files] == [
        "day1/Okuri 48.C3D",
        "day1/walk.bvh",
        "day2/walk.bvh",
    ]
    assert notes == []


def test_what_cannot_be_ingested_is_said_all_at_once(inbox, tmp_path):
    (tmp_path / "empty").mkdir()
    paths = [inbox / "none.bvh", inbox / "day1/readme.txt", tmp_path / "empty"]
    with pytest.raises(InputError) as caught:
        find_recordings(paths)
    for words in ("none.bvh is not there", "readme.txt is no motion file", "empty holds no motion"):
        assert words in str(caught.value)


def test_a_capture_is_passed_over_with_a_word(inbox):
    (inbox / "day3/videos").mkdir(parents=True)
    (inbox / "day3/capture.toml").touch()
    (inbox / "day3/videos/a.bvh").touch()
    files, [note] = find_recordings([inbox])
    assert len(files) == 3
    assert "day3 is a capture" in note
    with pytest.raises(InputError, match=r"nothing to ingest: .*day3 is a capture"):
        find_recordings([inbox / "day3"])


def test_files_of_one_name_get_the_name_of_their_folder_too(archive, inbox):
    assert names(plan(archive, inbox)) == ["okuri-48", "walk", "day2-walk"]


def test_the_names_stay_when_everything_is_ingested_again(archive, inbox):
    first = plan(archive, inbox)
    for recording in first.recordings:
        take_in(archive, recording)
    assert plan(archive, inbox).recordings == first.recordings
    assert names(plan(archive, inbox / "day2/walk.bvh")) == ["day2-walk"]


def test_a_changed_file_is_a_new_version_of_its_take(archive, inbox):
    for recording in plan(archive, inbox).recordings:
        take_in(archive, recording)
    (inbox / "day2/walk.bvh").write_text("measured again")
    assert names(plan(archive, inbox / "day2/walk.bvh")) == ["day2-walk"]


def test_the_same_content_is_the_same_take_wherever_it_lies(archive, inbox):
    [recording] = plan(archive, inbox / "day2/walk.bvh").recordings
    take_in(archive, recording)
    (inbox / "day2/walk.bvh").rename(inbox / "moved.bvh")
    assert names(plan(archive, inbox / "moved.bvh")) == [recording.take] == ["walk"]


def test_a_copy_in_the_same_run_is_passed_over_with_a_word(archive, inbox):
    (inbox / "zcopy.bvh").write_text((inbox / "day1/walk.bvh").read_text())
    planned = plan(archive, inbox)
    assert len(planned.recordings) == 3
    assert "zcopy.bvh is the same, byte for byte, as" in planned.notes[0]


def test_a_take_is_never_overwritten_by_another_file(archive, inbox):
    [recording] = plan(archive, inbox / "day1/walk.bvh").recordings
    take_in(archive, recording)
    other = inbox / "other/walk.bvh"
    other.parent.mkdir()
    other.write_text("another dance")
    other.with_suffix(".toml").write_text('[take]\nid = "walk"\n')
    planned = plan(archive, other)
    assert planned.recordings == []
    assert "the name 'walk' is already the take of" in planned.refusals[0].reason
    assert 'by id = "..."' in planned.refusals[0].reason


def test_metadata_beside_a_file_name_and_describe_its_take(archive, inbox):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text(
        '[take]\nid = "Okuri 48 a"\nperformer = "TK"\nrecorded = 2026-03-02\nstature_m = 1.58\n'
    )
    [recording] = plan(archive, file).recordings
    assert recording.take == "okuri-48-a"
    assert recording.metadata == {"performer": "TK", "recorded": "2026-03-02"}
    assert recording.stature_m == 1.58


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[take", "are not TOML"),
        ("title = 'x'", r"have no table \[take\]"),
        ("take = 3", r"have no table \[take\]"),
    ],
)
def test_bad_metadata_are_said(inbox, text, message):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_metadata(file)


@pytest.mark.parametrize("stature", ['"tall"', "17", "-1.6", "nan"])
def test_an_impossible_stature_is_refused(archive, inbox, stature):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text(f"[take]\nstature_m = {stature}\n")
    planned = plan(archive, file)
    assert "should be a number of metres between 0.3 and 3" in planned.refusals[0].reason
