"""What every take is now, without reading a record a take.

The labels of the index's segments hold what the records said. A take is known to be still that by
its stamp: on a disk, when something in its folder below published/ was last created or removed,
for a record is never changed; in an object store, number, size and time of its newest record.
Every other record is read, and its seal checked. So a listing is never older than the archive,
and without an index it is only slower.
"""

import os
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from storage.errors import ArchiveError
from storage.index.entries import Entry, entry_of
from storage.index.snapshots import Snapshot, open_snapshot
from storage.places import Place, list_files, told
from storage.records import read_numbered_record, read_record, record_number

_RACY_NS = 100_000_000
_RACY_WHOLE_NS = 2_000_000_000
"""How young a stamp is not trusted [ns], and one of whole seconds: a file system counts in steps,
of 10 ms or, as FAT does, of up to 2 s, and what changes twice in a step has one stamp."""
_REQUESTS_AT_ONCE = 16


@dataclass(frozen=True, eq=False)
class Listing:
    """What every take is at a moment."""

    entries: list[Entry]
    """In the order of the names."""
    faults: dict[str, str]
    """What is wrong with the record of each other take, by its name."""
    stamps: Mapping[str, Any]
    """By which it is known that a take is still what its entry says; None where not."""
    snapshot: Snapshot
    """The index at that moment."""


def list_takes(place: Place, before: Listing | None = None) -> Listing:
    """Return what every take is now.

    Parameters
    ----------
    before
        What was listed before: what is in it and has not changed is not read again.

    Raises
    ------
    ArchiveError
        If the folder of the records is none.
    """
    snapshot = open_snapshot(place)
    stamps, numbers = _stamps(place)
    known = [(label.entries, label.stamps) for label in snapshot.labels]
    if before:
        known.append((before.entries, [before.stamps.get(e.take) for e in before.entries]))
    found: dict[str, Entry | str] = {
        entry.take: entry
        for entries, stamps_then in known
        for entry, stamp in zip(entries, stamps_then, strict=True)
        if stamp is not None and stamps.get(entry.take) == stamp
    }

    def read(take: str) -> Entry | str | None:
        try:
            if (number := numbers.get(take)) is not None:
                record = read_numbered_record(place, take, number)
            else:
                record = read_record(place, take)
        except ArchiveError as error:
            return str(error)
        return entry_of(record) if record else None

    unknown = [take for take in stamps if take not in found]
    if place.folder:
        anew = map(read, unknown)
    else:
        with ThreadPoolExecutor(_REQUESTS_AT_ONCE) as pool:
            anew = list(pool.map(read, unknown))
    found |= {take: each for take, each in zip(unknown, anew, strict=True) if each is not None}
    takes = sorted(found)
    entries = [each for take in takes if isinstance(each := found[take], Entry)]
    faults = {take: each for take in takes if isinstance(each := found[take], str)}
    return Listing(entries, faults, stamps, snapshot)


def _stamps(place: Place) -> tuple[dict[str, Any], dict[str, int]]:
    """Return the stamp of each take, and where one listing tells it the number of its record."""
    if place.folder:
        return _stamps_of_folders(place, time.time_ns()), {}
    numbers: dict[str, int] = {}
    stamps: dict[str, Any] = {}
    for file in list_files(place, "published"):  # a request for a thousand
        parts = file.path.split("/")
        number = record_number(file.path)
        if len(parts) == 3 and number is not None and number > numbers.get(parts[1], -1):
            numbers[parts[1]] = number
            stamps[parts[1]] = f"{number} {file.size} {file.modified.timestamp():.3f}"
    return stamps, numbers


def _stamps_of_folders(place: Place, now_ns: int) -> dict[str, Any]:
    """Return when a name in the folder of each take was last created or removed [ns]."""
    top = place.url("published")
    with told(f"list {top}"):
        if not os.path.isdir(top):
            if os.path.exists(top):
                raise ArchiveError(
                    f"{top} is no folder; put the records back from a copy of the archive"
                )
            return {}
        stamps: dict[str, Any] = {}
        with os.scandir(top) as listed:
            for each in listed:
                with suppress(FileNotFoundError):  # removed just now
                    if each.is_dir():
                        changed_ns = each.stat().st_mtime_ns
                        is_old = changed_ns < now_ns - _racy_ns(changed_ns)
                        stamps[each.name] = changed_ns if is_old else None
        return stamps


def _racy_ns(changed_ns: int) -> int:
    return _RACY_NS if changed_ns % 1_000_000_000 else _RACY_WHOLE_NS
