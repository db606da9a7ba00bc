"""How a take gets into an archive: written aside under a name of its own, then published at once.

    takes/<take>/<version>/          the Zarr group of one version, written once
    published/<take>/<number>.json   the record that makes a version the take's; never changed

The take is what its record with the highest number says. A record is created, never replaced,
and creating it is one atomic operation on a disk and on an object store. So a killed run leaves
the old version or the new one; of two runs that publish the same number one wins and the other
is told; and who is reading the old version goes on reading it until `collect_garbage`.
"""

import json
import re
import secrets
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from storage.errors import ArchiveError, ConflictError
from storage.places import (
    Place,
    StoredFile,
    create_file,
    delete_files,
    folders_older,
    list_files,
    list_names,
    read_file,
    remove_empty_folders,
    sync_files,
)
from storage.provenance import digest_bytes, now

RECORD_FORMAT = 1
_REQUESTS_AT_ONCE = 16
_RECORD_NAME = re.compile(r"^(\d{6})\.json$")


@dataclass(frozen=True)
class Record:
    """What is published of a take: enough to list and search it without opening its arrays."""

    take: str
    version: str
    """The folder below takes/<take>/ that holds it."""
    number: int
    """1 for the first version published, then 2, ..."""
    source: dict[str, str]
    """`kind` (capture, c3d, trc, bvh), `name`, `path` and `digest` of what was ingested."""
    metadata: dict[str, Any]
    """Dublin Core names and what the user gave for them."""
    frames: int
    rate_hz: float
    joints_present: list[str]
    """The joints that at least half of the frames have."""
    stages: list[str]
    files: dict[str, dict[str, Any]]
    """`bytes` and `sha256` of every file of the version, by its path in the version."""
    notes: list[str] = field(default_factory=list)
    """What was inferred or left out when the take was made, a sentence each."""
    settings: dict[str, Any] = field(default_factory=dict)
    """The settings that were not the defaults, by name (`pose_fitting.method`)."""
    published: str = field(default_factory=now)
    format: int = RECORD_FORMAT


def new_version(place: Place, take: str) -> str:
    """Return a folder name that no other writer uses, for the next version of `take`."""
    return f"{next_number(place, take):06d}-{secrets.token_hex(4)}"


def version_folder(take: str, version: str) -> str:
    """Return where a version's Zarr group lives in the archive."""
    return f"takes/{take}/{version}"


def next_number(place: Place, take: str) -> int:
    """Return the number that the next published version of `take` gets."""
    return max(_numbers(place, take), default=0) + 1


def describe_files(place: Place, take: str, version: str) -> dict[str, dict[str, Any]]:
    """Return size and SHA-256 of every file of a version, by its path in the version."""
    folder = version_folder(take, version)
    described = {}
    for file in list_files(place, folder):
        content = read_file(place, file.path)
        name = file.path[len(folder) + 1 :]
        described[name] = {"bytes": len(content), "sha256": digest_bytes(content)}
    return described


def discard_version(place: Place, take: str, version: str) -> None:
    """Remove what was written of a version that will not be published, as far as that goes."""
    with suppress(OSError):
        files = list_files(place, version_folder(take, version))
        delete_files(place, [file.path for file in files])


def publish_record(place: Place, record: Record) -> None:
    """Make `record` what its take is, from this instant on.

    Raises
    ------
    ConflictError
        If another run published the same number first; nothing has changed then.
    """
    folder = version_folder(record.take, record.version)
    sync_files(place, [f"{folder}/{name}" for name in record.files])
    content = json.dumps(asdict(record), indent=1, ensure_ascii=False, allow_nan=False).encode()
    if not create_file(place, _record_path(record.take, record.number), content):
        raise ConflictError(
            f"another run published version {record.number} of take {record.take!r} in the "
            "meantime; nothing was lost: run it again to publish on top of it"
        )


def published_takes(place: Place) -> list[str]:
    """Return the names of all takes, sorted."""
    return sorted(_newest_records(place))


def read_record(place: Place, take: str) -> Record | None:
    """Return what `take` is now, or None where nothing was ever published under this name."""
    numbers = _numbers(place, take)
    if not numbers:
        return None
    path = _record_path(take, max(numbers))
    return _parse_record(place, path, read_file(place, path))


def read_records(place: Place) -> list[Record]:
    """Return what every take is now, in the order of their names."""
    newest = _newest_records(place)
    paths = [newest[take] for take in sorted(newest)]
    if place.folder:
        return [_parse_record(place, path, read_file(place, path)) for path in paths]
    with ThreadPoolExecutor(_REQUESTS_AT_ONCE) as pool:
        contents = pool.map(lambda path: read_file(place, path), paths)
        return [_parse_record(place, *each) for each in zip(paths, contents, strict=True)]


def collect_garbage(place: Place, *, older_than: timedelta) -> list[StoredFile]:
    """Remove what no record refers to, and return it.

    A file younger than `older_than` stays: somebody may still be writing or reading it. A
    version counts as old when everything in it, and the record that replaced it, is.
    """
    limit = datetime.now(UTC) - older_than
    doomed: list[StoredFile] = []
    records = {take: _numbers(place, take) for take in list_names(place, "published")}
    for take, numbers in records.items():
        doomed += _replaced_records(place, take, max(numbers, default=0), limit)
    kept = {(take, v) for take in records for v in _recent_versions(place, take, doomed)}
    for top in ("takes", "index", "work"):
        groups: dict[tuple[str, str], list[StoredFile]] = {}
        for file in list_files(place, top):
            groups.setdefault(_owner(file.path), []).append(file)
        for owner, files in groups.items():
            if owner not in kept and all(file.modified < limit for file in files):
                doomed += files
    old = [path for top in ("takes", "index", "work") for path in folders_older(place, top, limit)]
    delete_files(place, [file.path for file in doomed])
    remove_empty_folders(old)
    return doomed


def verify_take(place: Place, take: str) -> list[str]:
    """Recompute the digest of every file of a take, and return each fault as a sentence."""
    try:
        record = read_record(place, take)
    except ArchiveError as error:
        return [str(error)]
    if record is None:
        return [f"take {take!r} has no published record"]
    return [f"take {take!r}: {fault}" for fault in damaged_files(place, record)]


def damaged_files(place: Place, record: Record) -> list[str]:
    """Return how the files of a version differ from its record, a sentence each."""
    folder = version_folder(record.take, record.version)
    found = describe_files(place, record.take, record.version)
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


def _newest_records(place: Place) -> dict[str, str]:
    """Return the path of the record with the highest number, by take."""
    newest: dict[str, str] = {}
    for file in list_files(place, "published"):
        _, take, name = file.path.split("/")
        if _RECORD_NAME.match(name):
            newest[take] = max(newest.get(take, ""), file.path)
    return newest


def _record_path(take: str, number: int) -> str:
    return f"published/{take}/{number:06d}.json"


def _numbers(place: Place, take: str) -> list[int]:
    """Return the numbers of the records of a take."""
    names = list_names(place, f"published/{take}")
    return [int(found[1]) for name in names if (found := _RECORD_NAME.match(name))]


def _parse_record(place: Place, path: str, content: bytes) -> Record:
    """Return the record in `content`, or say what is wrong with it."""
    try:
        fields = json.loads(content)
        if fields["format"] > RECORD_FORMAT:
            raise ArchiveError(
                f"{place.url(path)} was written by a newer shosa (record format "
                f"{fields['format']}, this one reads up to {RECORD_FORMAT}); update shosa"
            )
        return Record(**fields)
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, ArchiveError):
            raise
        raise ArchiveError(
            f"{place.url(path)} is damaged ({error}); restore it from a copy, or remove it to "
            "fall back to the version before"
        ) from error


def _replaced_records(place: Place, take: str, newest: int, limit: datetime) -> list[StoredFile]:
    """Return the records that a newer one replaced before `limit`, and stray parts of writes."""
    files = {file.path: file for file in list_files(place, f"published/{take}")}
    doomed = []
    for path, file in files.items():
        found = _RECORD_NAME.match(path.rsplit("/", 1)[-1])
        successor = files.get(_record_path(take, int(found[1]) + 1)) if found else file
        if found and int(found[1]) >= newest:
            continue
        if successor and successor.modified < limit:
            doomed.append(file)
    return doomed


def _recent_versions(place: Place, take: str, doomed: Sequence[StoredFile]) -> list[str]:
    """Return the versions of the records of `take` that stay."""
    gone = {file.path for file in doomed}
    paths = [_record_path(take, number) for number in _numbers(place, take)]
    records = [_parse_record(place, p, read_file(place, p)) for p in paths if p not in gone]
    return [record.version for record in records]


def _owner(path: str) -> tuple[str, str]:
    """Return the take and version that a file of takes/ or index/ belongs to."""
    parts = path.split("/")
    return (parts[1], parts[2].split(".")[0]) if len(parts) > 2 else ("", path)
