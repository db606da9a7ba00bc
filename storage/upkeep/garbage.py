"""What nothing refers to any more, and is removed: what killed runs and replaced versions left.

What was published and has lost its record is told, and kept unless somebody wants it gone.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta

from storage.errors import ArchiveError
from storage.index.segments import FOLDER as SEGMENTS
from storage.index.snapshots import collect_segments, open_snapshot
from storage.places import (
    Place,
    StoredFile,
    delete_files,
    folders_older,
    is_own,
    list_files,
    list_links,
    list_names,
    remove_empty_folders,
)
from storage.publication import version_folder
from storage.records import (
    Record,
    copy_path,
    read_numbered_record,
    record_number,
    record_numbers,
    record_path,
)
from storage.sources import list_sources

_TOPS = ("takes", "index", "work")
"""The folders in which there may be garbage [names]."""


def collect_garbage(place: Place, *, older_than: timedelta, lost: bool = False) -> list[StoredFile]:
    """Remove what no record refers to, and return it.

    A file younger than `older_than` stays: somebody may still be writing or reading it. A
    version counts as old when everything in it, and the record that replaced it, is. What is
    behind a link to a folder stays, and so does every version of a take whose record is damaged.

    Parameters
    ----------
    lost
        Whether versions that were published, and whose record is gone, are removed too.
    """
    limit = datetime.now(UTC) - older_than
    doomed: list[StoredFile] = []
    kept: set[tuple[str, str]] = set() if lost else set(lost_versions(place))
    unknown = set()
    for take in list_names(place, "published"):
        try:
            records = _records_of(place, take)
        except ArchiveError:
            unknown.add(take)
            continue
        replaced = _replaced_records(place, take, max(records, default=0), limit)
        doomed += replaced
        gone = {record_number(file.path) for file in replaced}
        kept |= {(take, each.version) for number, each in records.items() if number not in gone}
    for top in (*_TOPS, "sources"):
        for owner, files in _by_owner(place, top).items():
            known = owner in kept or owner[0] in unknown
            if not known and all(file.modified < limit for file in files):
                doomed += files
    doomed = [file for file in doomed if is_own(place, file.path)]
    doomed += collect_segments(place, superseded_for=older_than, strayed_for=older_than)
    old = [path for top in _TOPS for path in folders_older(place, top, limit)]
    delete_files(place, [file.path for file in doomed])
    remove_empty_folders(old)
    return doomed


def kept_from_garbage(place: Place, *, lost: bool = False) -> list[str]:
    """Return what `collect_garbage` leaves alone and somebody should look at, a sentence each."""
    said = [
        f"{link} is a link: what is behind it was left alone"
        for top in ("published", *_TOPS, "sources")
        for link in list_links(place, top)
    ]
    for take in list_names(place, "published"):
        try:
            _records_of(place, take)
        except ArchiveError as error:
            said.append(f"all of take {take!r} was kept: {error}")
    said += open_snapshot(place).faults
    return said if lost else said + list(tell_lost(place))


def lost_versions(place: Place) -> list[tuple[str, str]]:
    """Return the take and the version of what was published and has no record any more, sorted.

    A version that a later one has replaced is not lost. Where no take has a record, all are taken
    for lost.
    """
    sources = _by_owner(place, "sources")
    remembered = {take for take in list_sources(place).values() if take}
    newest = {
        take: max(numbers)
        for take in list_names(place, "published")
        if (numbers := record_numbers(place, take))
    }
    return sorted(
        (take, version)
        for take, version in _by_owner(place, "takes")
        if _number_in(version) > newest.get(take, 0)
        and (
            not newest or (take, version) in sources or (take in remembered and take not in newest)
        )
    )


def unpublished_versions(place: Place) -> list[tuple[str, str]]:
    """Return the take and the version of what has no record and never had one, sorted."""
    lost = set(lost_versions(place))
    found = []
    for take, version in _by_owner(place, "takes"):
        if version and (take, version) not in lost:
            with suppress(ArchiveError):
                if version not in {each.version for each in _records_of(place, take).values()}:
                    found.append((take, version))
    return sorted(found)


def tell_lost(place: Place) -> Iterator[str]:
    """Yield which versions have lost their record, a sentence each."""
    sources = _by_owner(place, "sources")
    for take, version in lost_versions(place):
        copy = copy_path(take, version)
        advice = (
            f"copy {copy} to {record_path(take, _number_in(version))}"
            if (take, version) in sources
            else "put the folder published/ back from a copy of the archive"
        )
        yield (
            f"{version_folder(take, version)} has no record in published/, so nobody sees it; "
            f"{advice}; `shosa gc --lost` removes it"
        )


def _records_of(place: Place, take: str) -> dict[int, Record]:
    """Return all records of a take, by number."""
    return {n: read_numbered_record(place, take, n) for n in record_numbers(place, take)}


def _replaced_records(place: Place, take: str, newest: int, limit: datetime) -> list[StoredFile]:
    """Return the records that a newer one replaced before `limit`, and stray parts of writes."""
    files = {file.path: file for file in list_files(place, f"published/{take}")}
    doomed = []
    for path, file in files.items():
        number = record_number(path)
        if number is not None and number >= newest:
            continue
        successor = files.get(record_path(take, number + 1)) if number is not None else file
        if successor and successor.modified < limit:
            doomed.append(file)
    return doomed


def _by_owner(place: Place, top: str) -> Mapping[tuple[str, str], list[StoredFile]]:
    """Return the files of takes/, index/, work/ or sources/, by the take and version they are of.

    A file of no version is one of its own; in sources/ it is left out, and so are segments of the
    index and all behind links.
    """
    groups: dict[tuple[str, str], list[StoredFile]] = {}
    for file in list_files(place, top):
        if not is_own(place, file.path) or file.path.startswith(f"{SEGMENTS}/"):
            continue
        parts = file.path.split("/")
        if len(parts) > 2:
            groups.setdefault((parts[1], parts[2].split(".")[0]), []).append(file)
        elif top != "sources":
            groups[file.path, ""] = [file]
    return groups


def _number_in(version: str) -> int:
    """Return the number that a version was to be published with; 0 for what is no version."""
    found = re.match(r"(\d{6})-", version)
    return int(found[1]) if found else 0
