"""What waits in an inbox: its recordings, and a stamp of each by which a change is seen.

<inbox>/.../<name>.(c3d|trc|bvh)     with <name>.toml beside it, or without
<inbox>/.../<capture>/capture.toml   and all that is in this folder
<inbox>/quarantine/                  what was bad; not looked into
"""

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import obstore

from storage.errors import InputError, PlaceError
from storage.formats import MOTION_SUFFIXES
from storage.formats.capture.capture_toml import MARK
from storage.places import Place, open_place, told
from storage.recordings import metadata_beside, recordings_below
from storage.roots import is_url

QUARANTINE = "quarantine"
_STAMP_DIGITS = 24  # of a SHA-256 in hexadecimal; enough that no two states of a file share one


@dataclass(frozen=True)
class Inbox:
    """A folder, or a prefix in an object store, into which recordings are dropped."""

    location: str
    """A full path with links followed, or a URL."""
    place: Place
    archive: str
    """What its recordings go into; another one may be fed from the same folder."""

    @property
    def folder(self) -> Path | None:
        """The folder, where it is one on a disk."""
        return self.place.folder

    @property
    def key(self) -> str:
        """What the archive calls it."""
        return hashlib.sha256(self.location.encode()).hexdigest()[:16]


def open_inbox(location: str, archive: str) -> Inbox:
    """Return the inbox at `location`.

    Parameters
    ----------
    location
        A folder, or a URL such as s3://bucket/inbox.
    archive
        Where the archive is, into which its recordings go.

    Raises
    ------
    InputError
        If it is not there, may not be read, is a capture, or if inbox and archive lie in each
        other.
    """
    if is_url(location):
        place = open_place(location.rstrip("/"))
        inbox = Inbox(place.location, place, archive)
    else:
        folder = Path(location).expanduser().resolve()
        if not folder.is_dir():
            raise InputError(
                f"the inbox {location!r} is {'no folder' if folder.exists() else 'not there'}; "
                "make the folder, or mount the disk that it is on"
            )
        try:
            names = os.listdir(folder)
        except OSError as error:
            raise InputError(
                f"the inbox {location!r} cannot be read: {error.strerror}; let the user that runs "
                "shosa read and write it"
            ) from error
        if MARK in names:
            raise InputError(
                f"the inbox {location!r} is a capture itself (it holds {MARK}); name the folder "
                "that captures are dropped into"
            )
        inbox = Inbox(str(folder), open_place(folder), archive)
    _check_apart(inbox, archive)
    return inbox


def list_waiting(inbox: Inbox) -> dict[str, str]:
    """Return the stamp of every recording in an inbox, by its path there, in their order.

    Sub-folders are looked into, also behind links, each once; what is hidden or in quarantine is
    not.

    Raises
    ------
    InputError
        If the folder is gone.
    PlaceError
        If the object store does not answer.
    """
    folder = inbox.folder
    if folder is None:
        return _list_stored(inbox.place)
    if not folder.is_dir():
        raise InputError(
            f"the inbox {str(folder)!r} is not there any more; put the folder back, or mount the "
            "disk that it is on"
        )
    with told(f"list the inbox {folder}"):
        os.listdir(folder)  # a walk passes over what may not be read
        found = recordings_below(folder)
    names = sorted(path.relative_to(folder).as_posix() for path in found)
    return {name: stamp_of(inbox, name) for name in names if not _is_apart(name)}


def stamp_of(inbox: Inbox, name: str) -> str:
    """Return what changes when the recording `name`, or what belongs to it, does.

    It is made of names, sizes, times of change and numbers of the files, and nothing is opened:
    the clock of the machine that wrote them need not be right.
    """
    if inbox.folder is None:
        lines = [_object_line(each) for each in _objects_of(inbox.place, name)]
        return _stamp(iter(sorted(lines))) if lines else ""
    path = inbox.folder / name
    return _stamp(_lines(path) if path.is_dir() else _file_lines(path))


def files_of(inbox: Inbox, name: str) -> list[str]:
    """Return the paths in an object store of all that belongs to the recording `name`."""
    return [each["path"] for each in _objects_of(inbox.place, name)]


def _check_apart(inbox: Inbox, archive: str) -> None:
    """Refuse an inbox and an archive of which one lies in the other."""
    ours, theirs = inbox.location, archive.rstrip("/")
    if not is_url(archive):
        theirs = str(Path(archive).expanduser().resolve())
    said = None
    if ours == theirs:
        said = "is the archive itself"
    elif f"{ours}/".startswith(f"{theirs}/"):
        said = f"lies in the archive {archive!r}"
    elif f"{theirs}/".startswith(f"{ours}/"):
        said = f"holds the archive {archive!r}"
    if said:
        raise InputError(f"the inbox {inbox.location!r} {said}; name a folder apart from it")


def _is_apart(name: str) -> bool:
    """Say whether a path in an inbox is in quarantine, or in a hidden folder."""
    parts = name.split("/")
    return parts[0] == QUARANTINE or any(part.startswith(".") for part in parts)


def _file_lines(path: Path) -> Iterator[str]:
    """Yield a line for a motion file, and one for its metadata."""
    yield _line(path, path.name)
    try:
        beside = metadata_beside(path)
    except OSError:
        return
    if beside is not None:
        yield _line(beside, beside.name)


def _lines(folder: Path) -> Iterator[str]:
    """Yield a line for each file and folder of a capture, links followed, none twice.

    What is hidden counts: programs that copy write there first.
    """
    seen: set[str] = set()
    for above, below, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(above)
        if real in seen:
            below.clear()
            continue
        seen.add(real)
        below.sort()
        for name in sorted([*below, *names]):
            path = Path(above, name)
            yield _line(path, path.relative_to(folder).as_posix())


def _line(path: Path, name: str) -> str:
    """Return what a file or folder is at this moment, and the link to it where it is one."""
    said = [name]
    for look in (os.stat, os.lstat) if path.is_symlink() else (os.stat,):
        try:
            status = look(path)
        except OSError as error:
            said.append(type(error).__name__)
            continue
        size = 0 if path.is_dir() else status.st_size
        said += [
            str(each) for each in (size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)
        ]
    return "\0".join(said)


def _stamp(lines: Iterator[str]) -> str:
    text = "\n".join(lines)
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:_STAMP_DIGITS]


def _list_stored(place: Place) -> dict[str, str]:
    """Return the stamps of the recordings in an object store."""
    objects = _objects(place)
    captures = sorted(
        each["path"].rpartition("/")[0]
        for each in objects
        if each["path"].endswith(f"/{MARK}") and not _is_apart(each["path"])
    )
    outer: list[str] = []
    for name in captures:
        if not any(name.startswith(f"{each}/") for each in outer):
            outer.append(name)
    lines: dict[str, list[str]] = {name: [] for name in outer}
    for each in objects:
        path = PurePosixPath(each["path"])
        capture = next((str(up) for up in path.parents if str(up) in lines), None)
        if capture is not None:
            lines[capture].append(_object_line(each))
        elif path.suffix.lower() in MOTION_SUFFIXES and not _is_apart(str(path)):
            lines[str(path)] = [_object_line(each)]
    described: dict[str, list[str]] = {}
    for name in lines.keys() - set(outer):
        described.setdefault(str(PurePosixPath(name).with_suffix(".toml")), []).append(name)
    for each in objects:
        for name in described.get(each["path"], ()):
            lines[name].append(_object_line(each))
    return {name: _stamp(iter(sorted(said))) for name, said in sorted(lines.items())}


def _objects(place: Place) -> list[Any]:
    with told(f"list the inbox {place.location}"):
        try:
            return sorted(obstore.list(place.store).collect(), key=lambda each: each["path"])
        except FileNotFoundError as error:
            raise PlaceError(f"the inbox {place.location} is not there: {error}") from error


def _objects_of(place: Place, name: str) -> list[Any]:
    """Return the objects of one recording: all below a capture, or a file and its metadata.

    Nothing else is listed: of a store that takes a second to answer, all is asked for once a scan.
    """
    with told(f"list {place.url(name)}"):
        path = PurePosixPath(name)
        if path.suffix.lower() in MOTION_SUFFIXES:
            found, beside = [], str(path.with_suffix(".toml"))
            bare = name.removesuffix(path.suffix)
            above = name.rpartition("/")[0] or None
            for some in obstore.list(place.store, above, offset=f"{bare}."):
                found += [each for each in some if each["path"] in (name, beside)]
                if some[-1]["path"] >= f"{bare}/":  # they come in order, and all others are behind
                    break
            if any(each["path"] == name for each in found):
                return found
        return sorted(obstore.list(place.store, name).collect(), key=lambda each: each["path"])


def _object_line(each: Any) -> str:
    return f"{each['path']}\0{each['size']}\0{each['e_tag']}\0{each['last_modified']}"
