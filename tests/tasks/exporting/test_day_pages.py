"""The page of a day counts what the archive and the quarantine hold, bad news first."""

import dataclasses
import os
from datetime import UTC, datetime, timedelta

import pytest

from storage import create_archive
from storage.errors import InputError
from storage.records import record_content, record_path
from tasks.exporting.day_pages import day_line, read_quarantine, summarize_day
from tests.figures.archives.takes import publish

AT = datetime(2026, 3, 2, 18, 0, tzinfo=UTC)


@pytest.fixture
def archive(tmp_path):
    """Three takes of 40 frames at 30 Hz: two of the last day, one of last week."""
    archive = create_archive(tmp_path / "archive")
    for take, hours, title in (("a", 1, "Okuri"), ("b|c", 23, "<b>x|y"), ("old", 170, "Old")):
        record = publish(archive.place, take)
        path = archive.place.folder / record_path(take, record.number)
        published = (AT - timedelta(hours=hours)).isoformat().replace("+00:00", "Z")
        changed = dataclasses.replace(record, published=published, metadata={"title": title})
        path.write_bytes(record_content(changed))
    return archive


@pytest.fixture
def inbox(tmp_path):
    folder = tmp_path / "inbox"
    for name, hours in (("broken.bvh", 2), ("日本|語.c3d", 100)):
        reason = folder / "quarantine" / name / "REASON.txt"
        reason.parent.mkdir(parents=True)
        reason.write_text(f"{name} was refused.\n\nWhy: <i>it</i> | is cut short")
        second = (AT - timedelta(hours=hours)).timestamp()
        os.utime(reason, (second, second))
    return folder


def test_the_day_is_counted_and_the_rest_is_not(archive, inbox):
    failed = [("digitize kimono", "the disk is full")]
    page = summarize_day(archive.location, inboxes=[str(inbox)], failed=failed, at=AT)
    assert "**In the last 24 hours: 1 failed, 1 refused, 2 taken in.** (18:00 UTC)" in page
    heads = ("## Failed", "## Refused", "## Taken in", "## The archive")
    assert [page.index(head) for head in heads] == sorted(page.index(head) for head in heads)
    assert "- **digitize kimono**: the disk is full" in page
    assert "- **broken.bvh, new, since 2026-03-02 16:00**: &lt;i&gt;it&lt;/i&gt; \\| is cut" in page
    assert "- **日本\\|語.c3d, since 2026-02-26 14:00**" in page  # it still waits for somebody
    taken = page[page.index("## Taken in") : page.index("## The archive")]
    assert taken.index("| a |") < taken.index("| b\\|c |")  # the newest first
    assert "old" not in taken
    assert "| takes | 3, of them 0 from captures; 3 are searched |" in page
    assert "| frames | 120 |" in page
    assert f"| hours | {120 / 30 / 3600:.2f} |" in page
    assert day_line(archive.location, page).startswith("archive: in the last 24 hours: 1 failed")


def test_what_was_written_elsewhere_is_letters(archive, inbox):
    page = summarize_day(archive.location, inboxes=[str(inbox)], at=AT)
    assert "<b>" not in page
    assert "<i>" not in page
    assert "&lt;b&gt;x\\|y" in page


def test_a_quiet_day_says_so(archive):
    later = AT + timedelta(days=30)
    page = summarize_day(archive.location, inboxes=["/nowhere"], at=later)
    assert "nothing taken in.**" in page
    assert "## Refused" not in page


def test_a_damaged_take_is_told(archive):
    (archive.place.folder / record_path("a", 1)).write_text("{")
    page = summarize_day(archive.location, at=AT)
    assert "1 damaged, 1 taken in" in page
    assert "## Damaged\n\n- **a**: " in page


def test_links_in_a_quarantine_are_not_followed(inbox, tmp_path):
    """Who may write to an inbox could have the server read any file into a page."""
    secret = tmp_path / "secret.txt"
    secret.write_text("a password")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "REASON.txt").write_text("a password")
    quarantine = inbox / "quarantine"
    (quarantine / "link").mkdir()
    (quarantine / "link" / "REASON.txt").symlink_to(secret)
    (quarantine / "folder").symlink_to(tmp_path / "elsewhere")
    (quarantine / "pipe").mkdir()
    os.mkfifo(quarantine / "pipe" / "REASON.txt")
    (quarantine / "empty").mkdir()
    (quarantine / "stray.txt").write_text("no folder")
    assert [each.name for each in read_quarantine(str(inbox))] == ["broken.bvh", "日本|語.c3d"]
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "quarantine").symlink_to(quarantine)
    assert read_quarantine(str(tmp_path / "other")) == []


@pytest.mark.parametrize("inbox", ["/nowhere", "s3://bucket/inbox"])
def test_an_inbox_that_cannot_be_looked_into_refuses_nothing(inbox):
    assert read_quarantine(inbox) == []


def test_a_long_reason_is_cut(archive, inbox):
    reason = inbox / "quarantine" / "broken.bvh" / "REASON.txt"
    reason.write_text("word " * 10_000)
    page = summarize_day(archive.location, inboxes=[str(inbox)], at=datetime.now(UTC))
    assert len(page) < 3000
    assert " ..." in page


def test_an_archive_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="is not an archive"):
        summarize_day(str(tmp_path))
