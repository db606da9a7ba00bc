"""Whether what is published is still there, byte for byte: each fault is a sentence."""

import json

from storage.errors import ArchiveError
from storage.places import Place, list_names, read_file
from storage.publication import describe_files, version_folder
from storage.records import (
    Record,
    copy_path,
    read_numbered_record,
    read_record,
    record_numbers,
    record_path,
)
from storage.sources import list_sources
from storage.upkeep.garbage import tell_lost


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
    faults = list(tell_lost(place))
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
    for path, name in list_sources(place).items():
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


def _differs_from_copy(place: Place, path: str, record: Record) -> bool:
    """Say whether there is a copy of the record, and it says something else."""
    try:
        copy = read_file(place, copy_path(record.take, record.version))
        return json.loads(copy) != json.loads(read_file(place, path))
    except FileNotFoundError:  # an archive of before has no copies
        return False
    except (ValueError, RecursionError):
        return True
