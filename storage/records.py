"""The records of takes: what is published of each, and whether a record is still what was written.

    published/<take>/<number>.json   the record that makes a version the take's; never changed
    sources/<take>/<version>.json    a copy of it, by which a lost record is known and put back

A record ends with the SHA-256 of its other fields. Records of before that have none.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from typing import Any

from storage.errors import ArchiveError
from storage.places import Place, list_files, list_names, read_file
from storage.provenance import digest_bytes, now
from storage.schema import JOINTS

RECORD_FORMAT = 1
_REQUESTS_AT_ONCE = 16
_RECORD_NAME = re.compile(r"^(\d{6})\.json$")
_SEAL = "sha256"


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
    replaced: dict[str, Any] = field(default_factory=dict)
    """What the recording itself says of the fields of `metadata` that a person has changed since;
    None where it says nothing."""
    published: str = field(default_factory=now)
    format: int = RECORD_FORMAT


def record_path(take: str, number: int) -> str:
    """Return where a record lives in the archive."""
    return f"published/{take}/{number:06d}.json"


def copy_path(take: str, version: str) -> str:
    """Return where the copy of the record of a version lives in the archive."""
    return f"sources/{take}/{version}.json"


def record_numbers(place: Place, take: str) -> list[int]:
    """Return the numbers of the records of a take."""
    names = list_names(place, f"published/{take}")
    return [int(found[1]) for name in names if (found := _RECORD_NAME.match(name))]


def record_number(path: str) -> int | None:
    """Return the number of the record at a path in the archive, or None where it is none."""
    found = _RECORD_NAME.match(path.rsplit("/", 1)[-1])
    return int(found[1]) if found else None


def published_takes(place: Place) -> list[str]:
    """Return the names of the takes that have a record, sorted."""
    return sorted(_newest_records(place))


def read_record(place: Place, take: str) -> Record | None:
    """Return what `take` is now, or None where nothing was ever published under this name.

    Raises
    ------
    ArchiveError
        If its record is damaged, or of a newer shosa.
    """
    numbers = record_numbers(place, take)
    return read_numbered_record(place, take, max(numbers)) if numbers else None


def read_numbered_record(place: Place, take: str, number: int) -> Record:
    """Return the record of a take with this number; raises as `read_record`."""
    path = record_path(take, number)
    try:
        content = read_file(place, path)
    except FileNotFoundError as error:
        raise ArchiveError(
            f"{place.url(path)} was removed while it was read; run it again"
        ) from error
    return _parse_record(place, path, content)


def read_records(place: Place) -> list[Record]:
    """Return what every take is now, in the order of their names; raises as `read_record`."""
    newest = _newest_records(place)

    def read(take: str) -> Record | str:
        try:
            return read_numbered_record(place, take, newest[take])
        except ArchiveError as error:
            return str(error)

    takes = sorted(newest)
    if place.folder:
        found = [read(take) for take in takes]
    else:
        with ThreadPoolExecutor(_REQUESTS_AT_ONCE) as pool:
            found = list(pool.map(read, takes))
    if faults := [each for each in found if isinstance(each, str)]:
        raise ArchiveError("; ".join(faults))
    return [each for each in found if isinstance(each, Record)]


def record_content(record: Record) -> bytes:
    """Return the file of a record."""
    fields = asdict(record)
    sealed = {**fields, _SEAL: _digest_fields(fields)}
    return json.dumps(sealed, indent=1, ensure_ascii=False, allow_nan=False).encode()


def _newest_records(place: Place) -> dict[str, int]:
    """Return the highest number of a record, by take; what else lies about is passed over."""
    if place.folder and (top := place.folder / "published").exists() and not top.is_dir():
        raise ArchiveError(f"{top} is no folder; put the records back from a copy of the archive")
    if place.folder:  # a folder in place of a record counts, so that it is told
        takes = {take: record_numbers(place, take) for take in list_names(place, "published")}
        return {take: max(numbers) for take, numbers in takes.items() if numbers}
    newest: dict[str, int] = {}
    for file in list_files(place, "published"):  # in one request
        parts = file.path.split("/")
        number = record_number(file.path)
        if len(parts) == 3 and number is not None:
            newest[parts[1]] = max(newest.get(parts[1], 0), number)
    return newest


def _parse_record(place: Place, path: str, content: bytes) -> Record:
    """Return the record in `content`, or say what is wrong with it."""
    try:
        fields = json.loads(content)
        number = fields["format"]
        if isinstance(number, int) and number > RECORD_FORMAT:
            raise ArchiveError(
                f"{place.url(path)} was written by a newer shosa (record format "
                f"{number}, this one reads up to {RECORD_FORMAT}); update shosa"
            )
        seal = fields.pop(_SEAL, None)
        if seal is not None and seal != _digest_fields(fields):
            raise ValueError("it is not what was published")
        record = Record(**fields)
        if faults := list(_faults(record, path)):
            raise ValueError("; ".join(faults))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        if isinstance(error, ArchiveError):
            raise
        take = path.split("/")[1]
        raise ArchiveError(
            f"{place.url(path)} is damaged ({_reason(error)}); restore it from a copy, as "
            f"in sources/{take}/, or remove it to fall back to the version before; `shosa verify` "
            "names all faults"
        ) from error
    return record


def _reason(error: Exception) -> str:
    """Return what an error says, in one line."""
    name = type(error).__name__
    said = " ".join(str(error).split()) or name
    return f"it has no {said}" if isinstance(error, KeyError) else said


def _digest_fields(fields: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the fields of a record that hold something, in whatever order.

    So a field that a later shosa adds changes no digest of a record without it.
    """
    held = {name: value for name, value in fields.items() if value not in ({}, [])}
    return digest_bytes(json.dumps(held, sort_keys=True).encode())


def _faults(record: Record, path: str) -> Iterator[str]:
    """Yield what is wrong with the fields of the record at `path`, a sentence each."""
    _, take, name = path.split("/")
    if record.take != take or record.number != int(name.removesuffix(".json")):
        yield f"it is the record of take {record.take!r}, number {record.number}"
    for what, (is_right, wanted) in _FIELDS.items():
        if not is_right(value := getattr(record, what)):
            yield f"{what} is {str(value)[:_SHOWN]!r}, wanted is {wanted}"


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)


def _are_files(value: Any) -> bool:
    """Say whether these are files inside a version, with their sizes and digests."""
    return isinstance(value, dict) and all(
        not name.startswith("/")
        and ".." not in name.split("/")
        and isinstance(said, dict)
        and _is_count(said.get("bytes"))
        and isinstance(said.get("sha256"), str)
        for name, said in value.items()
    )


def _is_source(value: Any) -> bool:
    wanted = ("kind", "name", "path", "digest")
    return isinstance(value, dict) and all(isinstance(value.get(each), str) for each in wanted)


_FIELDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "version": (
        lambda value: isinstance(value, str) and bool(re.fullmatch(r"\w[\w.-]*", value)),
        "the name of a version",
    ),
    "source": (_is_source, "a table with kind, name, path and digest"),
    "metadata": (lambda value: isinstance(value, dict), "a table"),
    "frames": (lambda value: _is_count(value) and value > 0, "a whole number from 1 up"),
    "rate_hz": (
        lambda value: isinstance(value, int | float) and 0 < value < math.inf,
        "a number above 0",
    ),
    "joints_present": (lambda value: _are_texts(value) and {*value} <= {*JOINTS}, "joints"),
    "stages": (_are_texts, "a list of texts"),
    "files": (_are_files, "the bytes and sha256 of each file"),
    "notes": (_are_texts, "a list of texts"),
    "settings": (lambda value: isinstance(value, dict), "a table"),
    "replaced": (lambda value: isinstance(value, dict), "a table"),
    "published": (lambda value: isinstance(value, str), "a date"),
}
"""What each field of a record has to be: how that is found out, and how it is said."""
_SHOWN = 40
"""How much of a wrong value is shown [characters]. Chosen: a line."""
