"""Words that a person gives a take afterwards: kept apart from the data and from the recording."""

from dataclasses import asdict
from datetime import timedelta

import pytest

from storage import create_archive
from storage.describing import describe_take, keep_words, own_metadata
from storage.errors import ConflictError, InputError
from storage.recordings import Recording
from storage.upkeep.garbage import collect_garbage
from storage.upkeep.verification import verify_take
from tasks.takes.identity import why_anew
from tasks.takes.publishing import publish_take
from tests.figures.archives.takes import publish, write_version


@pytest.fixture
def archive(tmp_path):
    return create_archive(tmp_path / "archive")


def test_words_are_a_new_record_of_the_same_data(archive):
    before = publish(archive.place, "okuri")
    after = describe_take(archive, "okuri", {"title": " Okuri \n48 ", "performer": ""}, over=1)
    assert archive.take("okuri").record == after
    assert after.metadata == {"title": "Okuri 48"}
    assert own_metadata(after) == {"performer": "TK"}
    assert (after.number, after.version, after.files) == (2, before.version, before.files)
    assert verify_take(archive.place, "okuri") == []
    collect_garbage(archive.place, older_than=timedelta(0))
    assert archive.take("okuri").record.metadata == {"title": "Okuri 48"}
    assert archive.take("okuri").motion["position"].shape[0] == before.frames


def test_words_as_they_are_publish_nothing(archive):
    publish(archive.place, "okuri")
    assert describe_take(archive, "okuri", {"performer": "TK"}, over=1).number == 1
    assert describe_take(archive, "okuri", {"title": "A"}, over=1).number == 2
    back = describe_take(archive, "okuri", {"title": ""}, over=2)
    assert (back.metadata, back.replaced) == ({"performer": "TK"}, {})


def test_of_two_people_the_second_is_told(archive):
    publish(archive.place, "okuri")
    describe_take(archive, "okuri", {"title": "A"}, over=1)
    with pytest.raises(ConflictError, match="somebody else has changed take 'okuri'"):
        describe_take(archive, "okuri", {"title": "B"}, over=1)
    assert archive.take("okuri").record.metadata["title"] == "A"


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("", "a", "cannot be called"),
        ("stature_m", "1.6", "cannot be called 'stature_m'"),
        ("a\x00b", "c", "cannot be called"),
        ("title", "a" * 5000, "title is 5000 characters"),
        ("title", "a\x1b[31m", "that can be read"),
    ],
)
def test_what_is_no_words_is_refused(archive, name, text, told):
    publish(archive.place, "okuri")
    with pytest.raises(InputError, match=told):
        describe_take(archive, "okuri", {name: text}, over=1)
    assert archive.take("okuri").record.number == 1


def test_a_recording_that_is_met_again_is_no_other_because_of_the_words(archive):
    publish(archive.place, "okuri")
    describe_take(archive, "okuri", {"performer": "Tanaka", "place": "Kyoto"}, over=1)
    said = Recording("/a.bvh", "d" * 64, "okuri", {"performer": "TK"})
    assert why_anew(archive, said, {})[0] is None
    other = Recording("/a.bvh", "d" * 64, "okuri", {"performer": "YS"})
    assert why_anew(archive, other, {})[0] == "its metadata differs from what the archive has"


def test_words_stay_until_the_recording_says_something_else(archive):
    publish(archive.place, "okuri")
    words = {"performer": "Tanaka", "place": "Kyoto"}
    before = describe_take(archive, "okuri", words, over=1)
    assert keep_words(before, {"performer": "TK"}) == (words, before.replaced)
    kept, replaced = keep_words(before, {"performer": "YS", "date": "2026"})
    assert kept == {"performer": "YS", "date": "2026", "place": "Kyoto"}
    assert replaced == {"place": None}


def test_words_given_while_a_recording_is_taken_in_again_are_kept(archive):
    publish(archive.place, "okuri")
    draft = asdict(write_version(archive.place, "okuri"))
    describe_take(archive, "okuri", {"title": "A"}, over=1)
    publish_take(archive.location, draft, over=1)
    after = archive.take("okuri").record
    assert (after.number, after.version) == (3, draft["version"])
    assert after.metadata == {"performer": "TK", "title": "A"}
    with pytest.raises(ConflictError):  # other data since
        publish_take(archive.location, asdict(write_version(archive.place, "okuri")), over=1)
