"""What users bring: which files of a folder are motion files, what they are called, who danced."""

import json
import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from storage.archive import Archive, take_name
from storage.errors import InputError
from storage.formats import MOTION_SUFFIXES
from storage.places import read_file, write_file
from storage.provenance import digest_file
from storage.publication import Record, read_record

_CAPTURE_MARK = "capture.toml"


@dataclass(frozen=True)
class Recording:
    """A motion file on its way into an archive."""

    path: str
    digest: str
    """SHA-256 of the file."""
    take: str
    """The take that it becomes."""
    metadata: dict[str, Any]
    """From the .toml beside it: Dublin Core names, as the user wrote them."""
    stature_m: float | None = None
    """Also from there."""


@dataclass(frozen=True)
class Refusal:
    """A file that was not taken in, and why, in a sentence."""

    path: str
    reason: str


@dataclass
class Plan:
    """Which files become which takes."""

    recordings: list[Recording] = field(default_factory=list)
    refusals: list[Refusal] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """What was passed over without being wrong."""


def find_motion_files(paths: Sequence[str | os.PathLike[str]]) -> tuple[list[Path], list[str]]:
    """Return the motion files among `paths` and below the folders among them, and what to say.

    Raises
    ------
    InputError
        If a path is not there or is no motion file, or if nothing is found; all faults at once.
    """
    files: list[Path] = []
    notes: list[str] = []
    faults: list[str] = []
    for path in map(Path, paths):
        if path.is_dir():
            found = sorted(_motion_files(path, notes))
            files += found
            if not found and not notes:
                faults.append(f"{path} holds no motion file ({', '.join(MOTION_SUFFIXES)})")
        elif not path.exists():
            faults.append(f"{path} is not there")
        elif path.suffix.lower() not in MOTION_SUFFIXES:
            faults.append(f"{path} is no motion file ({', '.join(MOTION_SUFFIXES)})")
        else:
            files.append(path)
    if not files and not faults:
        faults.append(f"nothing to ingest: {'; '.join(notes)}")
    if faults:
        raise InputError("; ".join(faults))
    return list(dict.fromkeys(file.absolute() for file in files)), notes


def plan_takes(archive: Archive, files: Sequence[Path]) -> Plan:
    """Give each file the take that it becomes, without looking inside.

    A file whose content the archive has already stays the take it is, whatever it is called now.
    Otherwise it becomes a new version of the take that was made from the same path, or a new
    take under the name of the file, or of its folder and the file where that name is taken.
    """
    plan = Plan()
    claimed: dict[str, str] = {}
    digests: dict[str, str] = {}
    for file in files:
        try:
            digest = digest_file(file)
            if digest in digests and file.stat().st_size:
                plan.notes.append(f"{file} is the same, byte for byte, as {digests[digest]}")
                continue
            metadata = read_metadata(file)
            take = _choose_take(archive, file, digest, metadata, claimed)
            stature_m = _stature(file, metadata)
        except (InputError, OSError) as error:
            plan.refusals.append(Refusal(str(file), _sentence(file, error)))
            continue
        digests[digest] = str(file)
        claimed[take] = str(file)
        kept = {key: value for key, value in metadata.items() if key not in ("id", "stature_m")}
        plan.recordings.append(Recording(str(file), digest, take, kept, stature_m))
    return plan


def read_metadata(motion_file: Path) -> dict[str, Any]:
    """Return the table [take] of the .toml beside a motion file, or nothing where there is none.

    Raises
    ------
    InputError
        If the file cannot be read as TOML, or has no such table.
    """
    path = motion_file.with_suffix(".toml")
    if not path.is_file():
        return {}
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))["take"]
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"the metadata {path} are not TOML: {error}") from error
    except KeyError:
        raise InputError(f"the metadata {path} have no table [take]") from None
    if not isinstance(table, dict):
        raise InputError(f"the metadata {path} have no table [take]")
    return json.loads(json.dumps(table, default=str))


def remember_source(archive: Archive, record: Record) -> None:
    """Write which take a content became, so that the same content is never taken in twice."""
    content = json.dumps({"take": record.take}).encode()
    write_file(archive.place, _source_path(record.source["digest"]), content)


def _motion_files(folder: Path, notes: list[str]) -> list[Path]:
    """Collect the motion files below a folder; captures are said and passed over."""
    found = []
    for above, folders, names in os.walk(folder):
        if _CAPTURE_MARK in names:
            notes.append(f"{above} is a capture; this version of shosa takes motion files only")
            folders.clear()
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [
            Path(above, name)
            for name in names
            if Path(name).suffix.lower() in MOTION_SUFFIXES and not name.startswith(".")
        ]
    return found


def _choose_take(
    archive: Archive, file: Path, digest: str, metadata: dict[str, Any], claimed: dict[str, str]
) -> str:
    """Return the name of the take that a file becomes, or refuse it."""
    known = _take_of_content(archive, digest)
    if known and known not in claimed:
        return known
    if "id" in metadata:
        wanted = [take_name(str(metadata["id"]))]
    else:
        wanted = [take_name(file.stem), take_name(f"{file.parent.name}-{file.stem}")]
    holders: list[str] = []
    for name in wanted:
        record = read_record(archive.place, name)
        if name not in claimed and (record is None or _made_from(record, file, digest)):
            return name
        holders.append(claimed.get(name) or (record.source["path"] if record else "another run"))
    raise InputError(
        f"the name {wanted[0]!r} is already the take of {holders[0]}; rename the file, or give it "
        f'another name by id = "..." under [take] in {file.with_suffix(".toml").name}'
    )


def _made_from(record: Record, file: Path, digest: str) -> bool:
    """Say whether a take was made from this file, or an earlier state of it."""
    return record.source["digest"] == digest or record.source["path"] == str(file)


def _take_of_content(archive: Archive, digest: str) -> str | None:
    """Return the take that this content became, if the take still says so."""
    try:
        take = json.loads(read_file(archive.place, _source_path(digest)))["take"]
    except (FileNotFoundError, ValueError, KeyError):
        return None
    record = read_record(archive.place, take)
    return take if record and record.source["digest"] == digest else None


def _source_path(digest: str) -> str:
    return f"sources/{digest}.json"


def _stature(file: Path, metadata: dict[str, Any]) -> float | None:
    """Return the stature that the metadata give."""
    stature_m = metadata.get("stature_m")
    if stature_m is None:
        return None
    if not isinstance(stature_m, int | float) or not 0.3 < stature_m < 3.0:
        raise InputError(
            f"stature_m = {stature_m!r} in {file.with_suffix('.toml').name} should be a number of "
            "metres between 0.3 and 3"
        )
    return float(stature_m)


def _sentence(file: Path, error: Exception) -> str:
    """Return an error as one sentence that names the file."""
    if isinstance(error, OSError):
        return f"{file} cannot be read: {error.strerror or error}"
    return f"{file}: {error}"
