"""Tests of storage.recordings: which file becomes which take."""

import dataclasses
import shutil
import unicodedata
from pathlib import Path

import pytest

from storage import create_archive
from storage.errors import InputError
from storage.publication import publish_record
from storage.recordings import digest_capture, find_recordings, plan_takes, read_metadata
from storage.sources import remember_source
from tests.figures.archives.takes import write_version

VOLUME = "[volume]\ncenter_m = [0, 1, 0]\nsize_m = [2, 2, 2]\nvoxel_m = 0.01\n"


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
    remember_source(archive.place, record)


def plan(archive, *paths):
    return plan_takes(archive, find_recordings(paths))


def names(plan):
    return [recording.take for recording in plan.recordings]


@pytest.fixture
def capture(inbox):
    """A capture, as far as planning looks: nothing of its films is opened."""
    return write_capture(inbox / "day3" / "Kimono 7")


def write_capture(folder, take="", film="film"):
    (folder / "videos").mkdir(parents=True)
    (folder / "capture.toml").write_text(f"[take]\n{take}\n{VOLUME}")
    (folder / "videos/a.mp4").write_text(film)
    (folder / "videos/a.bvh").write_text("no take of its own")
    return folder


def test_every_motion_file_and_capture_below_a_folder_is_found(inbox, capture):
    hidden = inbox / ".cache"
    hidden.mkdir()
    (hidden / "walk.bvh").touch()
    (inbox / "._walk.bvh").touch()
    assert [path.relative_to(inbox).as_posix() for path in find_recordings([inbox])] == [
        "day1/Okuri 48.C3D",
        "day1/walk.bvh",
        "day2/walk.bvh",
        "day3/Kimono 7",
    ]
    assert find_recordings([capture, inbox / "day3", capture]) == [capture]


def test_what_cannot_be_ingested_is_said_all_at_once(inbox, tmp_path):
    (tmp_path / "empty").mkdir()
    paths = [inbox / "none.bvh", inbox / "day1/readme.txt", tmp_path / "empty"]
    with pytest.raises(InputError) as caught:
        find_recordings(paths)
    for words in (
        "none.bvh is not there",
        "readme.txt is neither a motion file (.c3d, .trc, .bvh) nor a capture",
        "empty holds neither a motion file (.c3d, .trc, .bvh) nor a capture",
    ):
        assert words in str(caught.value)


def test_a_capture_is_called_by_its_id_or_by_its_folder(archive, inbox, capture):
    write_capture(inbox / "day4", 'id = "Okuri 49"\nperformer = "TK"\nstature_m = 1.58', "other")
    by_folder, by_id = plan(archive, capture, inbox / "day4").recordings
    assert (by_folder.take, by_folder.kind, by_folder.path) == ("kimono-7", "capture", str(capture))
    assert by_id.take == "okuri-49"
    assert by_id.metadata == {"performer": "TK"}
    assert by_id.stature_m == 1.58


def test_a_copy_of_a_capture_is_passed_over_with_a_word(archive, inbox, capture):
    shutil.copytree(capture, inbox / "day4")
    planned = plan(archive, inbox)
    assert names(planned).count("kimono-7") == 1
    [note] = planned.notes
    assert note == f"{inbox / 'day4'} is the same, byte for byte, as {capture}"


def test_two_captures_of_one_name_are_not_one_take(archive, inbox, capture):
    other = write_capture(inbox / "day4" / "kimono_7", 'id = "Kimono 7"', "another dance")
    planned = plan(archive, capture, other)
    assert names(planned) == ["kimono-7"]
    [refusal] = planned.refusals
    assert refusal.path == str(other)
    assert f"the name 'kimono-7' is already the take of {capture}" in refusal.reason
    assert 'by id = "..." under [take] in capture.toml' in refusal.reason


def test_a_capture_never_replaces_the_take_of_a_file(archive, inbox, capture):
    (inbox / "kimono 7.bvh").write_text("measured by markers")
    [of_file] = plan(archive, inbox / "kimono 7.bvh").recordings
    take_in(archive, of_file)
    [refusal] = plan(archive, capture).refusals
    assert f"is already the take of {of_file.path}" in refusal.reason


def test_a_capture_stays_its_take_when_changed_or_moved(archive, inbox, capture):
    [before] = plan(archive, capture).recordings
    take_in(archive, before)
    assert plan(archive, capture).recordings == [before]
    capture.rename(inbox / "moved")
    [moved] = plan(archive, inbox / "moved").recordings
    assert (moved.take, moved.digest) == ("kimono-7", before.digest)
    (inbox / "moved").rename(capture)
    (capture / "videos/a.mp4").write_text("filmed again")
    [changed] = plan(archive, capture).recordings
    assert changed.take == "kimono-7"
    assert changed.digest != before.digest


def test_the_digest_of_a_capture_is_that_of_names_and_contents(capture):
    before = digest_capture(capture)
    (capture / ".thumbnails").mkdir()
    (capture / ".thumbnails/a.png").write_text("made by a file manager")
    assert digest_capture(capture) == before
    (capture / "videos/a.mp4").rename(capture / "videos/b.mp4")
    assert digest_capture(capture) != before
    (capture / "videos/b.mp4").rename(capture / "videos/a.mp4")
    assert digest_capture(capture) == before
    (capture / "videos/a.mp4").write_text("film 2")
    assert digest_capture(capture) != before


@pytest.mark.parametrize(
    ("text", "message"),
    [("[take", "TOML"), ("[take]\nid = '..'", "makes no name")],
)
def test_a_capture_whose_toml_cannot_be_used_is_refused_alone(
    archive, inbox, capture, text, message
):
    (capture / "capture.toml").write_text(text)
    planned = plan(archive, inbox)
    assert len(planned.recordings) == 3
    [refusal] = planned.refusals
    assert refusal.path == str(capture)
    assert message in refusal.reason
    assert str(capture) in refusal.reason


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


def test_metadata_may_begin_with_a_byte_order_mark(archive, inbox):
    file = inbox / "day1/walk.bvh"
    text = '[take]\ntitle = "春の海"\nstature_m = 1.55\n'
    file.with_suffix(".toml").write_text(text, encoding="utf-8-sig")
    [recording] = plan(archive, file).recordings
    assert (recording.metadata, recording.stature_m) == ({"title": "春の海"}, 1.55)


def test_metadata_that_are_not_utf_8_are_refused_naming_their_encoding(inbox):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text('[take]\ntitle = "春の海"\n', encoding="cp932")
    with pytest.raises(InputError, match=r"not in UTF-8 but looks like cp932 .*save it as UTF-8"):
        read_metadata(file)


@pytest.mark.parametrize("forms", [("NFC", "NFD"), ("NFD", "NFC")])
def test_metadata_are_found_by_a_name_composed_in_another_way(inbox, forms):
    motion, beside = (unicodedata.normalize(form, "ガメラ") for form in forms)
    (inbox / f"{beside}.toml").write_text('[take]\nperformer = "TK"\n')
    assert read_metadata(inbox / f"{motion}.bvh") == {"performer": "TK"}


@pytest.mark.parametrize("stature", ['"tall"', "17", "-1.6", "nan", "true"])
def test_an_impossible_stature_is_refused(archive, inbox, stature):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text(f"[take]\nstature_m = {stature}\n")
    planned = plan(archive, file)
    assert "should be a number of metres between 0.3 and 3" in planned.refusals[0].reason


@pytest.mark.parametrize("value", ["nan", "inf", "1e999", "[1.0, -inf]"])
def test_metadata_that_no_json_can_hold_are_refused_by_name(archive, inbox, value):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text(f"[take]\ntitle = 'x'\nheight = {value}\n")
    [refusal] = plan(archive, file).refusals
    assert "'height' in [take] of" in refusal.reason
    assert "is not a finite number" in refusal.reason


def test_metadata_with_a_byte_order_mark_are_read(archive, inbox):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text("[take]\r\ntitle = '春の海'\r\n", encoding="utf-8-sig")
    [recording] = plan(archive, file).recordings
    assert recording.metadata == {"title": "春の海"}


@pytest.mark.data
@pytest.mark.parametrize("name", ["deep", "bigint", "nan"])
def test_one_hostile_file_does_not_end_the_batch(shared_data, archive, inbox, name):
    hostile = shared_data / "reports" / "hostile" / f"metadata-{name}.toml"
    shutil.copy(hostile, inbox / "day1/walk.toml")
    found = find_recordings([inbox])
    planned = plan_takes(archive, found)
    assert len(planned.recordings) + len(planned.notes) == len(found) - 1
    [refusal] = planned.refusals
    assert "walk.toml" in refusal.reason
    assert not refusal.broken


@pytest.mark.parametrize("error", [RecursionError, MemoryError, KeyError, TypeError])
def test_whatever_is_raised_the_others_go_on(archive, inbox, monkeypatch, error):
    def fail(file):
        if file.name == "walk.bvh":
            raise error("a fault of ours")
        return read_metadata(file)

    monkeypatch.setattr("storage.recordings.read_metadata", fail)
    found = find_recordings([inbox])
    planned = plan_takes(archive, found)
    assert len(planned.recordings) > 0
    assert all(refusal.broken for refusal in planned.refusals)
    assert all(error.__name__ in refusal.reason for refusal in planned.refusals)
    assert {Path(refusal.path).name for refusal in planned.refusals} == {"walk.bvh"}


def test_true_is_no_stature(archive, inbox):
    file = inbox / "day1/walk.bvh"
    file.with_suffix(".toml").write_text("[take]\nstature_m = true\n")
    assert "stature_m = True" in plan(archive, file).refusals[0].reason


def test_captures_whose_films_lie_behind_links_are_two(archive, capture, tmp_path):
    films = [shutil.copytree(capture / "videos", tmp_path / f"films{n}") for n in (1, 2)]
    next(path for path in films[1].iterdir() if path.is_file()).write_bytes(b"another moment")
    both = tmp_path / "both"
    for name, target in zip("ab", films, strict=True):
        linked = shutil.copytree(capture, both / name, ignore=lambda *_: ["videos"])
        (linked / "videos").symlink_to(target)
    planned = plan_takes(archive, find_recordings([both]))
    assert len(planned.recordings) + len(planned.refusals) == 2  # not "the same, byte for byte"
    assert planned.notes == []
    before = digest_capture(both / "a")
    next(path for path in films[0].iterdir() if path.is_file()).write_bytes(b"filmed anew")
    assert digest_capture(both / "a") != before


def test_links_that_lead_in_a_circle_are_walked_once(capture, tmp_path):
    plain = digest_capture(capture)
    (capture / "videos" / "again").symlink_to(capture, target_is_directory=True)
    (capture / "self").symlink_to(capture / "self")
    looped = digest_capture(capture)
    assert looped != plain
    assert digest_capture(capture) == looped
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "far.bvh").write_text("a motion far away")
    (elsewhere / "back").symlink_to(tmp_path)
    folder = tmp_path / "start"
    folder.mkdir()
    (folder / "link").symlink_to(elsewhere)
    (folder / "twice").symlink_to(elsewhere)
    found = [path for path in find_recordings([folder]) if path.name == "far.bvh"]
    assert found == [folder / "link" / "far.bvh"]
