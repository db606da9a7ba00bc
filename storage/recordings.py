"""What users bring: motion files and captures in folders, what they are called, who danced."""

import hashlib
import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from storage.archive import Archive, take_name
from storage.errors import ArchiveError, InputError, PlaceError
from storage.files import NotRegularError
from storage.formats import MOTION_SUFFIXES
from storage.formats.calibration.parts import as_shown
from storage.formats.capture.capture_toml import MARK, read_capture_toml
from storage.formats.encodings import normalized
from storage.formats.settings_toml import SETTINGS_FILE
from storage.formats.toml_text import NotTomlError, plain_metadata, read_toml
from storage.provenance import digest_file
from storage.records import Record, read_record
from storage.sources import take_of_content

logger = logging.getLogger(__name__)

_METADATA_WANTED = "a TOML file with a table [take]"


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
    broken: bool = False
    """The fault is the archive's, the machine's or the program's, not the file's."""


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
            below = sorted(recordings_below(path))
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


def recordings_below(folder: Path) -> list[Path]:
    """Collect the motion files and the captures below a folder, each folder once.

    Links to folders come last: what lies there already keeps the path that it had.
    """
    found: list[Path] = []
    seen: set[tuple[int, int]] = set()
    waiting = [folder]
    while waiting:
        for place, folders, names in os.walk(waiting.pop(0)):
            above = Path(place)
            if _identity(above) in seen:
                folders.clear()
                continue
            seen.add(_identity(above))
            if MARK in names:
                found.append(above)
                folders.clear()
                continue
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            waiting += [above / name for name in folders if (above / name).is_symlink()]
            found += [
                above / name
                for name in names
                if Path(name).suffix.lower() in MOTION_SUFFIXES and not name.startswith(".")
            ]
    return found


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
        except Exception as error:  # whatever is raised, the others go on
            plan.refusals.append(_refusal(path, error))
            continue
        if not recording.take:
            same = digests[recording.digest]
            plan.notes.append(f"{path} is the same, byte for byte, as {same}")
            continue
        digests[recording.digest] = str(path)
        claimed[recording.take] = str(path)
        plan.recordings.append(recording)
    return plan


def digest_capture(folder: Path) -> str:
    """Return the SHA-256 of the names and contents of all that is in a capture, links followed.

    Without its `digitize.toml`: settings are no content, and each stage is keyed by those it reads.
    """
    digest = hashlib.sha256()
    for line in _content_lines(folder, "", {_identity(folder): "."}):
        digest.update(line.encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def read_metadata(motion_file: Path) -> dict[str, Any]:
    """Return the table [take] of the .toml beside a motion file, or nothing where there is none.

    Raises
    ------
    InputError
        If the file cannot be read as TOML, has no such table, or a number that is not finite.
    """
    path = metadata_beside(motion_file)
    if path is None:
        return {}
    try:
        tables = read_toml(path, _METADATA_WANTED)
    except NotTomlError as error:
        raise InputError(f"the metadata {path} are not TOML: {error.reason}") from error
    table = tables.get("take")
    if not isinstance(table, dict):
        raise InputError(f"the metadata {path} have no table [take]")
    _stature(motion_file, table)
    return plain_metadata(table, f"[take] of {path}")


def metadata_beside(motion_file: Path) -> Path | None:
    """Return the .toml beside a motion file, in whatever way the letters of its name are composed.

    Macs and shares from Macs decompose a name, and not always that of both files.
    """
    path = motion_file.with_suffix(".toml")
    if os.path.lexists(path) or path.name.isascii():
        return path if os.path.lexists(path) else None
    name = normalized(path.name)
    return next((each for each in path.parent.iterdir() if normalized(each.name) == name), None)


def _plan_capture(
    archive: Archive, folder: Path, digests: dict[str, str], claimed: dict[str, str]
) -> Recording:
    """Return the take that a capture becomes, or one without a name where it came before."""
    said = read_capture_toml(folder, [], [])  # what is wrong in it is said by its reader
    digest = digest_capture(folder)
    if digest in digests:
        return Recording(str(folder), digest, "", {}, None, "capture")
    known = take_of_content(archive.place, digest)
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


def _choose_take(
    archive: Archive, file: Path, digest: str, metadata: dict[str, Any], claimed: dict[str, str]
) -> str:
    """Return the name of the take that a file becomes, or refuse it."""
    known = take_of_content(archive.place, digest)
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


def _stature(file: Path, metadata: dict[str, Any]) -> float | None:
    """Return the stature that the metadata give."""
    stature_m = metadata.get("stature_m")
    if stature_m is None:
        return None
    is_number = isinstance(stature_m, int | float) and not isinstance(stature_m, bool)
    if not is_number or not 0.3 < stature_m < 3.0:
        raise InputError(
            f"stature_m = {as_shown(stature_m)} in {file.with_suffix('.toml').name} should be a "
            "number of metres between 0.3 and 3"
        )
    return float(stature_m)


def _refusal(file: Path, error: Exception) -> Refusal:
    """Return an error as one sentence that names the file."""
    if isinstance(error, NotRegularError):
        return Refusal(str(file), f"{error.filename} is no regular file, but {error.kind}")
    if isinstance(error, PlaceError | ArchiveError):
        return Refusal(str(file), f"{file}: {error}", broken=True)
    if isinstance(error, OSError):  # the disk that it is on, or who may read it
        return Refusal(str(file), f"{file} cannot be read: {error.strerror or error}", broken=True)
    if isinstance(error, InputError):
        return Refusal(str(file), f"{file}: {error}")
    logger.debug("%s cannot be planned", file, exc_info=error)
    reason = f"{file}: {type(error).__name__}: {error}; tell the authors of shosa"
    return Refusal(str(file), reason, broken=True)


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


def _content_lines(folder: Path, within: str, seen: dict[tuple[int, int], str]) -> Iterator[str]:
    """Yield a line a file below a folder: its name and the digest of its content.

    A folder that links lead to again is named by where it was seen first, so no loop is entered.
    """
    for path in sorted(folder.iterdir(), key=lambda path: path.name):
        name = f"{within}{path.name}"
        if path.name.startswith(".") or name == SETTINGS_FILE:
            continue
        if path.is_dir():
            first = seen.setdefault(_identity(path), name)
            if first == name:
                yield from _content_lines(path, f"{name}/", seen)
            else:
                yield f"{name}/\0{first}/\n"
        elif path.is_file():
            yield f"{name}\0{digest_file(path)}\n"


def _identity(folder: Path) -> tuple[int, int]:
    """Return what a folder is, whatever links lead to it."""
    status = folder.stat()
    return status.st_dev, status.st_ino
