"""The page of a day: what an archive took in, what was refused and why, and how large it is now."""

import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from storage import open_archive
from storage.index.entries import Entry
from tasks.exporting.markdown import escaped, table

QUARANTINE = "quarantine"
"""The folder of an inbox that holds what was refused, each in a folder of its own."""
REASON = "REASON.txt"
"""The file in such a folder that says what, why, and what to do."""

_UNLINKED = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
"""A link is not followed, and nothing is waited for."""
_MOST_ROWS = 100
"""How many takes and refusals are listed. Chosen: a page that a person reads."""
_WHY = re.compile(r"^Why: (.+?)(?:\n\n|\Z)", re.DOTALL | re.MULTILINE)
"""What a person has to know of such a file; the rest of it is the same for all."""
_MOST_BYTES = 4000
"""How much of a reason is read [bytes]. Chosen: a long paragraph."""
_MOST_SHOWN = 400
"""How much of a reason is shown [characters]. Chosen: a few lines of a table."""


@dataclass(frozen=True)
class Refused:
    """A recording in quarantine."""

    name: str
    reason: str
    since: datetime


def summarize_day(
    archive: str,
    *,
    inboxes: Sequence[str] = (),
    hours: float = 24.0,
    failed: Sequence[tuple[str, str]] = (),
    at: datetime | None = None,
) -> str:
    """Return the page of the last day as markdown: what failed or was refused first.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix.
    inboxes
        The folders whose quarantine is looked at.
    hours
        How long the day is.
    failed
        Runs that failed in that time: how they are called, and why.
    at
        When the day ends; by default now.

    Raises
    ------
    InputError, ArchiveError
        If there is no archive, or a newer shosa made it.
    """
    opened = open_archive(archive)
    listing = opened.listing()
    records, damaged = listing.entries, listing.faults
    end = at or datetime.now(UTC)
    since = end - timedelta(hours=hours)
    new = [each for each in records if since < _time(each.published) <= end]
    new.sort(key=lambda record: record.published, reverse=True)
    found = [each for inbox in inboxes for each in read_quarantine(inbox)]
    refused = sorted(found, key=lambda each: each.since, reverse=True)
    fresh = sum(since < each.since for each in refused)
    counts = [
        f"{len(failed)} failed" if failed else "",
        f"{fresh} refused" if fresh else "",
        f"{len(damaged)} damaged" if damaged else "",
        f"{len(new)} taken in" if new else "nothing taken in",
    ]
    said = ", ".join(filter(None, counts))
    lines = [
        f"# {escaped(_last_name(archive))}, {end:%Y-%m-%d}",
        f"**In the last {hours:g} hours: {said}.** ({end:%H:%M} UTC)",
    ]
    if failed:
        lines += ["## Failed", _listed((escaped(run), _short(why)) for run, why in failed)]
    if refused:
        lines += ["## Refused, in quarantine", _refusals(refused, since)]
    if damaged:
        faults = list(damaged.items())[:_MOST_ROWS]
        lines += ["## Damaged", _listed((escaped(take), _short(fault)) for take, fault in faults)]
    if new:
        lines += ["## Taken in", _taken_in(new)]
    return "\n\n".join(
        [*lines, "## The archive", table(("all of it", ""), [*_size(opened.location, records)])]
    )


def day_line(archive: str, page: str) -> str:
    """Return what a list of pages says of the page of a day."""
    counts = page.split("**")[1].rstrip(".")
    return f"{_last_name(archive)}: {counts[0].lower()}{counts[1:]}"


def read_quarantine(inbox: str) -> list[Refused]:
    """Return what is in the quarantine of an inbox, as far as it can be read.

    Links are not followed: who may write to an inbox shall not have other files read.
    """
    if "://" in inbox:
        return []
    folder = Path(inbox) / QUARANTINE
    try:
        if folder.is_symlink():
            return []
        names = sorted(
            each.name for each in os.scandir(folder) if each.is_dir(follow_symlinks=False)
        )
    except OSError:
        return []
    return [found for name in sorted(names) if (found := _read_refused(folder / name))]


def _read_refused(folder: Path) -> Refused | None:
    """Return what a folder in quarantine says; None where it says nothing."""
    try:
        handle = os.open(
            folder / REASON, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        )
    except OSError:
        return None
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            return None
        text = file.read(_MOST_BYTES).decode(errors="replace")
    why = _WHY.search(text)
    since = datetime.fromtimestamp(status.st_mtime, UTC)
    return Refused(folder.name, why[1] if why else text, since)


def _refusals(refused: Sequence[Refused], since: datetime) -> str:
    """Return what is in quarantine, the newest first."""
    said = (
        (
            f"{escaped(each.name)}, {'new, ' if each.since > since else ''}"
            f"since {each.since:%Y-%m-%d %H:%M}",
            _short(each.reason),
        )
        for each in refused[:_MOST_ROWS]
    )
    return _listed(said) + _and_more(len(refused))


def _listed(said: Iterable[tuple[str, str]]) -> str:
    """Return names and sentences; in a table the dashboard would cut these off."""
    return "\n".join(f"- **{name}**: {sentence}" for name, sentence in said)


def _taken_in(records: Sequence[Entry]) -> str:
    """Return what was taken in, the newest first."""
    rows = [
        (
            escaped(each.take),
            "new" if each.number == 1 else f"version {each.number}",
            escaped(each.source["kind"]),
            f"{each.frames / each.rate_hz:.1f} s",
            "" if "motion" in each.stages else "no pose, not searched",
            escaped(each.metadata.get("performer", "")),
            escaped(each.metadata.get("title", "")),
        )
        for each in records[:_MOST_ROWS]
    ]
    heads = ("take", "", "from", "length", "look at", "performer", "title")
    return table(heads, rows) + _and_more(len(records))


def _and_more(count: int) -> str:
    return f"\n\nand {count - _MOST_ROWS} more." if count > _MOST_ROWS else ""


def _size(location: str, records: Sequence[Entry]) -> Iterator[tuple[str, str]]:
    """Yield how large the archive is."""
    captures = sum(each.source["kind"] == "capture" for each in records)
    searched = sum("motion" in each.stages for each in records)
    bytes_kept = sum(each.bytes for each in records)
    yield (
        "takes",
        f"{len(records):,}, of them {captures:,} from captures; {searched:,} are searched",
    )
    yield "frames", f"{sum(each.frames for each in records):,}"
    yield "hours", f"{sum(each.frames / each.rate_hz for each in records) / 3600:.2f}"
    yield "on disk", f"{bytes_kept / 1e9:.2f} GB, without the search arrays"
    yield "in", escaped(location)


def _time(published: str) -> datetime:
    """Return when a record was published; long ago where it does not say."""
    try:
        found = datetime.fromisoformat(published)
    except ValueError:
        return datetime.min.replace(tzinfo=UTC)
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _short(text: str) -> str:
    """Return the beginning of a text as a cell."""
    line = " ".join(text.split())
    return escaped(line if len(line) <= _MOST_SHOWN else f"{line[:_MOST_SHOWN]} ...")


def _last_name(archive: str) -> str:
    return archive.rstrip("/").rsplit("/", 1)[-1]
