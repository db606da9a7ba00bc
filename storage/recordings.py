"""What users bring: motion files and captures in folders, what they are called, who danced."""

import hashlib
import json
import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from storage.archive import Archive, take_name
from storage.errors import InputError
from storage.formats import MOTION_SUFFIXES
from storage.formats.capture.capture_toml import MARK, read_capture_toml
from storage.formats.settings_toml import SETTINGS_FILE
from storage.places import write_file
from storage.provenance import digest_file
from storage.publication import read_source
from storage.records import Record, read_record


@dataclass(frozen=True)
class Recording:
    """A motion file or a capture on its way into an archive."""

    path: str
    digest: str
    """SHA-256 of the file, or of all that is in the folder."""
    take: str
    """The take that it becomes."""
    metadata: dict[str, Any]
    """From the .toml beside it, or in the capture: Dublin Core names, as the user wrote them."""
    stature_m: float | None = None
    """Also from there."""
    kind: Literal["motion", "capture"] = "motion"


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


def find_recordings(paths: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Return the motion files and captures among `paths` and below the folders among them.

    Raises
    ------
    InputError
        If a path is not there or is neither, or if nothing is found; all faults at once.
    """
    wanted = f"a motion file ({', '.join(MOTION_SUFFIXES)}) or a capture (a folder with {MARK})"
    found: list[Path] = []
    faults: list[str] = []
    for path in map(Path, paths):
        if fault := _name_fault(path):
            faults.append(fault)
        elif path.is_dir():
            below = sorted(_recordings_below(path))
            found += below
            if not below:
                faults.append(f"{path} holds neither {wanted.replace(' or ', ' nor ')}")
        elif not path.exists():
            faults.append(f"{path} is not there")
        elif path.suffix.lower() not in MOTION_SUFFIXES:
            faults.append(f"{path} is neither {wanted.replace(' or ', ' nor ')}")
        else:
            found.append(path)
    if faults:
        raise InputError("; ".join(faults))
    return list(dict.fromkeys(path.absolute() for path in found))


def plan_takes(archive: Archive, paths: Sequence[Path]) -> Plan:
    """Give each motion file and capture the take that it becomes, without looking inside.

    What the archive has already stays the take it is, whatever it is called now. Otherwise it
    becomes a new version of the take that was made from the same path, or a new take: a capture
    under its id or the name of its folder, a file under its name, or that of its folder and the
    file where that name is taken.
    """
    plan = Plan()
    claimed: dict[str, str] = {}
    digests: dict[str, str] = {}
    for path in paths:
        if fault := _name_fault(path):
            plan.refusals.append(Refusal(_shown(path), fault))
            continue
        try:
            recording = (
                _plan_capture(archive, path, digests, claimed)
                if path.is_dir()
                else _plan_file(archive, path, digests, claimed)
            )
        except UnicodeEncodeError as error:  # of a file in a capture
            fault = _name_fault(Path(error.object.split("\0")[0])) or str(error)
            plan.refusals.append(Refusal(str(path), f"{path}: {fault}"))
            continue
        except (InputError, OSError) as error:
            plan.refusals.append(Refusal(str(path), _sentence(path, error)))
            continue
        if not recording.take:
            same = digests[recording.digest]
            plan.notes.append(f"{path} is the same, byte for byte, as {same}")
            continue
        digests[recording.digest] = str(path)
        claimed[recording.take] = str(path)
        plan.recordings.append(recording)
    return plan


def _plan_capture(
    archive: Archive, folder: Path, digests: dict[str, str], claimed: dict[str, str]
) -> Recording:
    """Return the take that a capture becomes, or one without a name where it came before."""
    said = read_capture_toml(folder, [], [])  # what is wrong in it is said by its reader
    digest = digest_capture(folder)
    if digest in digests:
        return Recording(str(folder), digest, "", {}, None, "capture")
    known = _take_of_content(archive, digest)
    take = known if known and known not in claimed else take_name(said.take)
    record = read_record(archive.place, take)
    if take in claimed or (record and not _made_from(record, folder, digest)):
        holder = claimed.get(take) or (record.source["path"] if record else "another run")
        raise InputError(
            f"the name {take!r} is already the take of {holder}; rename the folder, or give it "
            f'another name by id = "..." under [take] in {MARK}'
        )
    return Recording(str(folder), digest, take, said.metadata, said.stature_m, "capture")


def _plan_file(
    archive: Archive, file: Path, digests: dict[str, str], claimed: dict[str, str]
) -> Recording:
    """Return the take that a motion file becomes, or one without a name where it came before."""
    digest = digest_file(file)
    if digest in digests and file.stat().st_size:
        return Recording(str(file), digest, "", {})
    metadata = read_metadata(file)
    take = _choose_take(archive, file, digest, metadata, claimed)
    stature_m = _stature(file, metadata)
    kept = {key: value for key, value in metadata.items() if key not in ("id", "stature_m")}
    return Recording(str(file), digest, take, kept, stature_m)


def digest_capture(folder: Path) -> str:
    """Return the SHA-256 of the names and contents of all that is in a capture.

    Without its `digitize.toml`: settings are no content, and each stage is keyed by those it reads.
    """
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if (
            name.as_posix() != SETTINGS_FILE
            and path.is_file()
            and not any(part.startswith(".") for part in name.parts)
        ):
            digest.update(f"{name.as_posix()}\0{digest_file(path)}\n".encode())
    return digest.hexdigest()


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


def _name_fault(path: Path) -> str | None:
    """Say what is wrong with a name that is no text; records and other systems hold only texts."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return f"the name {_shown(path)!r} is not UTF-8; rename it"
    return None


def _shown(path: Path) -> str:
    """Return a path with what is no text written as numbers."""
    return str(path).encode(errors="surrogateescape").decode(errors="backslashreplace")


def _recordings_below(folder: Path) -> list[Path]:
    """Collect the motion files and the captures below a folder."""
    found = []
    for above, folders, names in os.walk(folder):
        if MARK in names:
            found.append(Path(above))
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
    take = read_source(archive.place, _source_path(digest))
    record = read_record(archive.place, take) if take else None
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
