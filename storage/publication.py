"""How a take gets into an archive: written aside under a name of its own, then published at once.

    takes/<take>/<version>/          the Zarr group of one version, written once
    published/<take>/<number>.json   the record that makes a version the take's; never changed
    sources/<take>/<version>.json    a copy of it, by which a lost record is known and put back

The take is what its record with the highest number says. A record is created, never replaced,
and creating it is one atomic operation on a disk and on an object store. So a killed run leaves
the old version or the new one; of two runs that publish the same number one wins and the other
is told; and who is reading the old version goes on reading it until `collect_garbage`.
"""

import json
import re
import secrets
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import Any

from storage.errors import ArchiveError, ConflictError, PlaceError
from storage.index.segments import FOLDER as SEGMENTS
from storage.index.snapshots import collect_segments, open_snapshot
from storage.places import (
    Place,
    StoredFile,
    create_file,
    delete_files,
    folders_older,
    is_own,
    list_files,
    list_links,
    list_names,
    read_file,
    remove_empty_folders,
    sync_files,
    write_file,
)
from storage.provenance import digest_bytes
from storage.records import (
    Record,
    copy_path,
    read_numbered_record,
    read_record,
    record_content,
    record_number,
    record_numbers,
    record_path,
)

_OF_SYSTEMS = re.compile(r"(^|/)(\..*|Thumbs\.db|desktop\.ini|@eaDir(/.*)?)$", re.IGNORECASE)
"""What file managers and network drives leave in folders [pattern of paths]. No file of ours begins
with a dot but while it is written."""
_TOPS = ("takes", "index", "work")
"""The folders in which there may be garbage [names]."""


def new_version(place: Place, take: str) -> str:
    """Return a folder name that no other writer uses, for the next version of `take`."""
    return f"{next_number(place, take):06d}-{secrets.token_hex(4)}"


def version_folder(take: str, version: str) -> str:
    """Return where a version's Zarr group lives in the archive."""
    return f"takes/{take}/{version}"


def next_number(place: Place, take: str) -> int:
    """Return the number that the next published version of `take` gets."""
    return max(record_numbers(place, take), default=0) + 1


def describe_files(place: Place, take: str, version: str) -> dict[str, dict[str, Any]]:
    """Return size and SHA-256 of every file of a version, by its path in the version."""
    folder = version_folder(take, version)
    described = {}
    for file in list_files(place, folder):
        name = file.path[len(folder) + 1 :]
        if _OF_SYSTEMS.search(name):
            continue
        try:
            content = read_file(place, file.path)
        except FileNotFoundError:  # a link to nothing
            continue
        except ArchiveError:
            described[name] = {"bytes": 0, "sha256": "no regular file"}
            continue
        described[name] = {"bytes": len(content), "sha256": digest_bytes(content)}
    return described


def discard_version(place: Place, take: str, version: str) -> None:
    """Remove what was written of a version that will not be published, as far as that goes."""
    with suppress(OSError):
        files = [file.path for file in list_files(place, version_folder(take, version))]
        index = [file.path for file in list_files(place, f"index/{take}")]
        files += [path for path in index if path.startswith(f"index/{take}/{version}.")]
        delete_files(place, files)


def publish_record(place: Place, record: Record) -> None:
    """Make `record` what its take is, from this instant on.

    Raises
    ------
    ConflictError
        If another run published the same number first; nothing has changed then.
    """
    folder = version_folder(record.take, record.version)
    sync_files(place, [f"{folder}/{name}" for name in record.files])
    content = record_content(record)
    if not create_file(place, record_path(record.take, record.number), content):
        raise ConflictError(
            f"another run published version {record.number} of take {record.take!r} in the "
            "meantime; nothing was lost: run it again to publish on top of it"
        )
    with suppress(PlaceError):  # it is published, and does without a copy
        write_file(place, copy_path(record.take, record.version), content)


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
    return said if lost else said + list(_tell_lost(place))


def lost_versions(place: Place) -> list[tuple[str, str]]:
    """Return the take and the version of what was published and has no record any more, sorted.

    A version that a later one has replaced is not lost. Where no take has a record, all are taken
    for lost.
    """
    sources = _by_owner(place, "sources")
    remembered = _remembered_takes(place)
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


def verify_take(place: Place, take: str) -> list[str]:
    """Recompute the digest of every file of a take, and return each fault as a sentence."""
    try:
        record = read_record(place, take)
    except ArchiveError as error:
        return [str(error)]
    if record is None:
        return [f"take {take!r} has no published record"]
    return [f"take {take!r}: {fault}" for fault in damaged_files(place, record)]


def verify_records(place: Place) -> list[str]:
    """Return versions without a record, records without a version, and what else is wrong.

    The newest record of a take and the files of its version are the matter of `verify_take`.
    """
    faults = list(_tell_lost(place))
    for take in list_names(place, "published"):
        numbers = sorted(record_numbers(place, take))
        for number in numbers:
            path = record_path(take, number)
            try:
                record = read_numbered_record(place, take, number)
            except ArchiveError as error:
                faults += [str(error)] if number < numbers[-1] else []
                continue
            gone = not list_names(place, version_folder(take, record.version))
            if gone and number < numbers[-1]:
                faults.append(f"{path} is the record of version {record.version}, which is gone")
            elif _differs_from_copy(place, path, record):
                faults.append(
                    f"{path} and its copy {copy_path(take, record.version)} differ; keep the right "
                    "one in both places"
                )
    for path, name in _sources(place).items():
        if name is None:
            faults.append(f"{path} is damaged; remove it: it is made anew")
    return faults


def damaged_files(place: Place, record: Record) -> list[str]:
    """Return how the files of a version differ from its record, a sentence each."""
    folder = version_folder(record.take, record.version)
    found = describe_files(place, record.take, record.version)
    if record.files and not found:
        return [
            f"{folder} with its {len(record.files)} files is missing; put it back from a copy, or "
            "ingest the recording again"
        ]
    faults = [f"{folder}/{name} is missing" for name in record.files if name not in found]
    faults += [
        f"{folder}/{name} is not in its record" for name in found if name not in record.files
    ]
    for name in record.files.keys() & found.keys():
        if found[name] != record.files[name]:
            faults.append(
                f"{folder}/{name} has changed: {found[name]['bytes']} bytes where "
                f"{record.files[name]['bytes']} were published, or another digest"
            )
    return sorted(faults)


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


def _tell_lost(place: Place) -> Iterator[str]:
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


def _sources(place: Place) -> dict[str, str | None]:
    """Return which take each content became, by the path of its file; None where it is damaged."""
    found: dict[str, str | None] = {}
    for file in list_files(place, "sources"):
        if file.path.count("/") == 1 and not _OF_SYSTEMS.search(file.path):
            found[file.path] = read_source(place, file.path)
    return found


def read_source(place: Place, path: str) -> str | None:
    """Return the take that the file of a content in sources/ names, or None where it names none."""
    try:
        take = json.loads(read_file(place, path))["take"]
    except (FileNotFoundError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return take if isinstance(take, str) and re.fullmatch(r"[\w-]+", take) else None


def _remembered_takes(place: Place) -> set[str]:
    """Return the takes that recordings became."""
    return {take for take in _sources(place).values() if take}


def _differs_from_copy(place: Place, path: str, record: Record) -> bool:
    """Say whether there is a copy of the record, and it says something else."""
    try:
        copy = read_file(place, copy_path(record.take, record.version))
        return json.loads(copy) != json.loads(read_file(place, path))
    except FileNotFoundError:  # an archive of before has no copies
        return False
    except (ValueError, RecursionError):
        return True
