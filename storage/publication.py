"""How a take gets into an archive: written aside under a name of its own, then published at once.

    takes/<take>/<version>/          the Zarr group of one version, written once
    published/<take>/<number>.json   the record that makes a version the take's; never changed
    sources/<take>/<version>.json    a copy of it, by which a lost record is known and put back

The take is what its record with the highest number says. A record is created, never replaced,
and creating it is one atomic operation on a disk and on an object store. So a killed run leaves
the old version or the new one; of two runs that publish the same number one wins and the other
is told; and who is reading the old version goes on reading it until `collect_garbage`.
"""

import secrets
from contextlib import suppress
from typing import Any

from storage.errors import ArchiveError, ConflictError, PlaceError
from storage.places import (
    Place,
    create_file,
    delete_files,
    is_of_system,
    list_files,
    read_file,
    sync_files,
    write_file,
)
from storage.provenance import digest_bytes
from storage.records import Record, copy_path, record_content, record_numbers, record_path


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
        if is_of_system(name):
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
