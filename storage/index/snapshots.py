"""Which segments are the index at a moment: a manifest a snapshot, created and never replaced.

    index/all.segments/<number>.json   the labels of its segments, with their digests

The newest manifest that is whole is the index. Of two merges that create the same number one wins;
the files of the other belong to no snapshot, and are garbage. So a merge that is killed leaves the
snapshot of before, and who reads that goes on reading it until its files are collected.
"""

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any

from storage.arrays.search import ADVICE, PACKING
from storage.errors import ArchiveError, DamagedSegmentError
from storage.index.segments import FOLDER, FORMAT, Label, read_label, verify_segment
from storage.places import (
    Place,
    StoredFile,
    create_file,
    delete_files,
    is_own,
    list_files,
    list_names,
    read_file,
    sync_files,
)
from storage.provenance import digest_bytes

_MANIFEST = re.compile(r"^(\d{8})\.json$")
_SEAL = "sha256"
_TRIES = 3
"""How often a snapshot is looked for that is collected just then [times]."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The segments of the index, as they were at a moment."""

    number: int
    """Of its manifest; 0 where there is none."""
    labels: tuple[Label, ...]
    digests: tuple[str, ...]
    """The SHA-256 of each label."""
    faults: tuple[str, ...]
    """What of the index cannot be read, a sentence each."""
    newest: int
    """The highest number that a manifest has, whether it can be read or not."""

    @cached_property
    def places(self) -> dict[tuple[str, str], tuple[int, int]]:
        """By take and version: in which label it is, and at which place there."""
        return {
            (entry.take, entry.version): (number, place)
            for number, label in enumerate(self.labels)
            for place, entry in enumerate(label.entries)
        }


_held: dict[str, tuple[str, Snapshot]] = {}
"""The snapshot that was read last, by the place it is in: the digest of its manifest, and it."""


def open_snapshot(place: Place) -> Snapshot:
    """Return the newest snapshot that can be read, without opening what its segments hold.

    What is damaged, or of another shosa, is not used and is named.

    Raises
    ------
    PlaceError
        If the disk or object store does not do what is asked.
    """
    found = _open_newest(place)
    for _ in range(_TRIES):
        if not found.faults or max(_numbers(place), default=0) == found.newest:
            break
        found = _open_newest(place)  # what was looked for was collected meanwhile
    return found


def left_lying(place: Place) -> tuple[int, int]:
    """Return how many search arrays of takes the last merge left by themselves, and their bytes."""
    for number in sorted(_numbers(place), reverse=True):
        with suppress(ArchiveError, FileNotFoundError):
            takes, size = _read_manifest(place, number)[1]["left"]
            return takes, size
    return 0, 0


def publish_snapshot(
    place: Place, number: int, labels: Sequence[tuple[Label, str]], *, left: tuple[int, int]
) -> bool:
    """Make these segments the index from this instant on, and say whether they are.

    False where another merge created the same number first; nothing has changed then.

    Parameters
    ----------
    labels
        Each with its SHA-256.
    left
        How many search arrays of takes lie by themselves, and their bytes: for `left_lying`.
    """
    sync_files(place, [path for label, _ in labels for path in label.files])
    said: dict[str, Any] = {
        "format": FORMAT,
        "packing": PACKING,
        "number": number,
        "segments": [
            {
                "label": label.path,
                "sha256": sha256,
                "files": label.files[1:],
                "takes": len(label.entries),
                "samples": label.rows.shape[1],
            }
            for label, sha256 in labels
        ],
        "left": left,
    }
    said[_SEAL] = _seal(said)
    content = json.dumps(said, indent=1).encode()
    # an object store may have written it though its answer was lost, and be asked again
    return create_file(place, _path(number), content) or (
        read_file(place, _path(number)) == content
    )


def verify_snapshot(place: Place) -> tuple[list[str], set[tuple[str, str]]]:
    """Recompute all checksums of the index.

    Returns
    -------
    faults
        A sentence each.
    held
        The take and version of all that the index holds.
    """
    snapshot = open_snapshot(place)
    faults = list(snapshot.faults)
    for label in snapshot.labels:
        faults += verify_segment(place, label)
    return faults, {*snapshot.places}


def collect_segments(
    place: Place, superseded_for: timedelta, strayed_for: timedelta
) -> list[StoredFile]:
    """Remove files of the index that no snapshot refers to, and return them.

    Nothing is removed while the newest manifest cannot be read: its files are not known.

    Parameters
    ----------
    superseded_for
        For how long a newer snapshot has been there at least, where one of before refers to a file.
    strayed_for
        How old a file is at least that no snapshot refers to: a merge may be writing it.
    """
    files = {file.path: file for file in list_files(place, FOLDER)}
    numbers = sorted(number for path in files if (number := _number(path)) is not None)
    now = datetime.now(UTC)
    kept: set[str] = set()
    known: set[str] = set()
    for number, successor in zip(numbers, [*numbers[1:], None], strict=False):
        path = _path(number)
        is_kept = successor is None or now - files[_path(successor)].modified <= superseded_for
        try:
            said = _read_manifest(place, number)[1]
            used = {path}.union(*({each["label"], *each["files"]} for each in said["segments"]))
        except (ArchiveError, FileNotFoundError):
            if is_kept:
                return []
            used = {path}
        known |= used
        kept |= used if is_kept else set()
    doomed = [
        file
        for path, file in files.items()
        if path not in kept and (path in known or now - file.modified > strayed_for)
        if is_own(place, path)
    ]
    delete_files(place, [file.path for file in doomed])
    return doomed


def _open_newest(place: Place) -> Snapshot:
    """Return the newest snapshot whose manifest is whole."""
    numbers = sorted(_numbers(place), reverse=True)
    newest = max(numbers, default=0)
    faults: list[str] = []
    for number in numbers:
        try:
            digest, said = _read_manifest(place, number)
        except ArchiveError as error:
            faults.append(str(error))
            continue
        except FileNotFoundError:
            continue
        held = _held.get(place.url(FOLDER))
        if held and held[0] == digest and not faults:
            return held[1]
        labels: list[tuple[Label, str]] = []
        known = {label.path: label for label in held[1].labels} if held else {}
        for each in said["segments"]:
            try:
                path, sha256 = each["label"], each["sha256"]
                labels.append((known.get(path) or read_label(place, path, sha256), sha256))
            except DamagedSegmentError as error:
                faults.append(f"the index is damaged: {error}")
        found = Snapshot(
            number,
            tuple(label for label, _ in labels),
            tuple(sha256 for _, sha256 in labels),
            tuple(faults),
            newest,
        )
        if not faults:
            _held[place.url(FOLDER)] = digest, found
        return found
    return Snapshot(0, (), (), tuple(faults), newest)


def _read_manifest(place: Place, number: int) -> tuple[str, dict[str, Any]]:
    """Return the digest of a manifest and what it says; an ArchiveError if it cannot be used."""
    path = _path(number)
    try:
        content = read_file(place, path)
        said = json.loads(content)
        seal = said.pop(_SEAL)
        if seal != _seal(said):
            raise ValueError("it is not what was written")
        form = said["format"], said["packing"]
        if form == (FORMAT, PACKING) and said["number"] != number:
            raise ValueError(f"it is that of number {said['number']}")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ArchiveError(
            f"the index is damaged: {place.url(path)} cannot be read "
            f"({' '.join(str(error).split()) or type(error).__name__}); {ADVICE}"
        ) from error
    if form > (FORMAT, PACKING):
        raise ArchiveError(
            f"{place.url(path)} is the index of a newer shosa and is not used; update shosa, or "
            f"{ADVICE}"
        )
    if form < (FORMAT, PACKING):
        raise ArchiveError(
            f"{place.url(path)} is the index of an older shosa and is not used; {ADVICE}"
        )
    return digest_bytes(content), said


def _seal(said: dict[str, Any]) -> str:
    return digest_bytes(json.dumps(said, sort_keys=True).encode())


def _numbers(place: Place) -> list[int]:
    """Return the numbers of all manifests."""
    names = list_names(place, FOLDER)
    return [number for name in names if (number := _number(name)) is not None]


def _number(path: str) -> int | None:
    found = _MANIFEST.match(path.rsplit("/", 1)[-1])
    return int(found[1]) if found else None


def _path(number: int) -> str:
    return f"{FOLDER}/{number:08d}.json"
