"""Where an archive lives: a directory or an object store, through one small set of functions.

Every file is written whole or not at all, and `create_file` is the one operation that two
writers can race on: exactly one of them wins, on a disk (hard link) as on an object store
(put if absent). Publication rests on nothing else.
"""

import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import obstore
from obstore.exceptions import AlreadyExistsError, BaseError
from obstore.store import LocalStore, ObjectStore, from_url

from storage.errors import ArchiveError, InputError, PlaceError
from storage.files import NotRegularError, check_regular

_RETRY: Any = {"max_retries": 4, "retry_timeout": timedelta(seconds=30)}
_AT_ONCE = 8
_DELETE_AT_ONCE = 1000  # what one request of S3 takes
_NO_CREDENTIALS = r"169\.254\.169\.254|metadata\.google|credential|instance.metadata"
"""What an object store's client says where it was given no key [pattern]. It then asks the machine
itself for one, at an address that only rented machines have."""
_OF_SYSTEMS = re.compile(r"(^|/)(\..*|Thumbs\.db|desktop\.ini|@eaDir(/.*)?)$", re.IGNORECASE)
"""What file managers and network drives leave in folders [pattern of paths]. No file of ours begins
with a dot but while it is written."""


@dataclass(frozen=True)
class Place:
    """A directory (`folder` is set) or an object store."""

    location: str
    """As the user wrote it: a path, or a URL such as s3://bucket/prefix."""
    store: ObjectStore
    folder: Path | None

    def url(self, path: str) -> str:
        """Return the full path or URL of the file or folder at `path`."""
        return str(self.folder / path) if self.folder else f"{self.location.rstrip('/')}/{path}"


@dataclass(frozen=True)
class StoredFile:
    """A file as a listing shows it."""

    path: str
    size: int
    modified: datetime


def open_place(location: str | os.PathLike[str], *, make: bool = False) -> Place:
    """Return the place at `location`: a directory, or a URL with a scheme such as s3://.

    Credentials and endpoints of object stores come from the environment (AWS_...), as for
    every other program that uses them.

    Raises
    ------
    InputError
        If the URL is of a kind that is not known, or the path is no text.
    PlaceError
        If the directory is to be made and cannot be.
    """
    where = os.fspath(location)
    try:
        where.encode()
    except UnicodeEncodeError as error:
        raise InputError(
            f"the path {where!r} has a name that is not UTF-8; rename it, or give another place"
        ) from error
    if found := re.match(r"^([a-z][a-z0-9+]+):/", where, re.IGNORECASE):
        where = found[1].lower() + where[len(found[1]) :]
        if not where.startswith("://", len(found[1])):
            raise InputError(f"{where!r} should be a directory, or a URL such as s3://bucket/x")
        try:
            return Place(where, from_url(where, retry_config=_RETRY), None)
        except (BaseError, ValueError) as error:
            raise InputError(
                f"cannot use {where!r} as a place for an archive: {_first_line(error)}; "
                "give a directory, or a URL such as s3://bucket/archive"
            ) from error
    folder = Path(where).expanduser().absolute()
    if make:
        with told(f"make the directory {folder}"):
            folder.mkdir(parents=True, exist_ok=True)
    if not folder.is_dir():
        raise InputError(f"there is no directory {where!r}; check the path")
    return Place(where, LocalStore(folder), folder)


def read_file(place: Place, path: str) -> bytes:
    """Return the bytes of the file at `path`; FileNotFoundError where there is none.

    Raises
    ------
    ArchiveError
        If a folder, a pipe or a device is in its place.
    """
    with told(f"read {place.url(path)}"):
        if place.folder:
            return regular_file(place.folder / path).read_bytes()
        return bytes(obstore.get(place.store, path).bytes())


def read_range(place: Place, path: str, start: int, end: int) -> bytes:
    """Return the bytes of a file from `start` to before `end`; raises as `read_file`."""
    with told(f"read {place.url(path)}"):
        if place.folder:
            with regular_file(place.folder / path).open("rb") as file:
                file.seek(start)
                return file.read(end - start)
        return bytes(obstore.get_range(place.store, path, start=start, end=end))


def regular_file(path: Path) -> Path:
    """Return the path of a file of an archive, which reading can not wait on for ever.

    Raises
    ------
    FileNotFoundError
        If there is none.
    ArchiveError
        If a folder, a pipe or a device is in its place.
    """
    try:
        check_regular(path)
    except NotADirectoryError:
        raise FileNotFoundError(f"there is no {path}") from None
    except NotRegularError as error:
        raise _not_regular(error) from error
    if path.is_dir():
        raise ArchiveError(
            f"{path} is no regular file; put the file back from a copy, or remove what is there"
        )
    return path


def write_file(place: Place, path: str, content: bytes | memoryview) -> None:
    """Write the file at `path`, whole or not at all, over what was there."""
    with told(f"write {place.url(path)}"):
        obstore.put(place.store, path, content)


def write_files(place: Place, contents: Mapping[str, bytes]) -> None:
    """Write files by their paths, many at a time; each as `write_file` does."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        list(pool.map(lambda path: write_file(place, path, contents[path]), contents))


def create_file(place: Place, path: str, content: bytes) -> bool:
    """Write the file at `path` if nothing is there, and say whether this call wrote it.

    On a disk the content is on the medium before the name appears.
    """
    with told(f"write {place.url(path)}"):
        if place.folder:
            return _link_file(place.folder / path, content)
        try:
            obstore.put(place.store, path, content, mode="create")
        except AlreadyExistsError:
            return False
        return True


def list_files(place: Place, folder: str) -> list[StoredFile]:
    """Return every file below `folder`, at any depth, in the order of the paths."""
    with told(f"list {place.url(folder)}"):
        if place.folder:
            # not obstore's listing: it hides what a killed write left behind
            return sorted(_walk(place.folder, folder), key=lambda file: file.path)
        found = obstore.list(place.store, prefix=folder).collect()
    files = [StoredFile(each["path"], each["size"], each["last_modified"]) for each in found]
    return sorted(files, key=lambda file: file.path)


def list_names(place: Place, folder: str) -> list[str]:
    """Return the names directly in `folder`, of files and of folders, sorted."""
    with told(f"list {place.url(folder)}"):
        if place.folder:
            inside = place.folder / folder
            return sorted(os.listdir(inside)) if inside.is_dir() else []
        found = obstore.list_with_delimiter(place.store, prefix=folder)
    paths = [*found["common_prefixes"], *(each["path"] for each in found["objects"])]
    return sorted(path.rstrip("/").rsplit("/", 1)[-1] for path in paths)


def list_links(place: Place, folder: str) -> list[str]:
    """On a disk, return the links to folders at `folder` and below it, sorted.

    A listing of what is above such a link does not look behind it.
    """
    if not place.folder:
        return []
    if (place.folder / folder).is_symlink():
        return [folder]
    found = [
        path.relative_to(place.folder).as_posix()
        for above, folders, _ in os.walk(place.folder / folder)
        for name in folders
        if (path := Path(above, name)).is_symlink()
    ]
    return sorted(found)


def is_own(place: Place, path: str) -> bool:
    """Say whether no folder above `path` in the archive is a link, so that it may be removed."""
    above = Path(path).parents
    return not place.folder or not any((place.folder / each).is_symlink() for each in above[:-1])


def is_of_system(path: str) -> bool:
    """Say whether a file is one that file managers and network drives leave in folders."""
    return _OF_SYSTEMS.search(path) is not None


def delete_files(place: Place, paths: Sequence[str]) -> None:
    """Remove the files, and on a disk the folders that this leaves empty.

    What is behind a link to a folder may belong to somebody else, and stays.
    """
    with told(f"remove files from {place.location}"):
        if place.folder:
            for path in (each for each in paths if is_own(place, each)):
                (place.folder / path).unlink(missing_ok=True)
                _remove_empty_parents(place.folder, path)
            return
        for first in range(0, len(paths), _DELETE_AT_ONCE):
            obstore.delete(place.store, list(paths[first : first + _DELETE_AT_ONCE]))


def folders_older(place: Place, folder: str, before: datetime) -> list[Path]:
    """On a disk, return the folders below `folder` untouched since `before`, leaves last."""
    if not place.folder or (place.folder / folder).is_symlink():
        return []
    below = [Path(above) for above, _, _ in os.walk(place.folder / folder)]
    return [path for path in below if path.stat().st_mtime < before.timestamp()]


def remove_empty_folders(folders: Sequence[Path]) -> None:
    """Remove those of the folders that hold nothing, from the leaves up."""
    for path in reversed(folders):
        with suppress(OSError):  # not empty, or gone
            path.rmdir()


def sync_files(place: Place, paths: Sequence[str]) -> None:
    """On a disk, wait until the files and the folders that name them are on the medium."""
    if not place.folder:
        return
    files = [place.folder / path for path in paths]
    folders = {
        parent for file in files for parent in file.parents if place.folder in parent.parents
    }
    # the medium takes many at a time
    with told(f"write to {place.location}"), ThreadPoolExecutor(_AT_ONCE) as pool:
        list(pool.map(_sync, (*files, *folders, place.folder)))


def zarr_store(place: Place, folder: str, *, read_only: bool = False) -> Any:
    """Return the folder as a store that Zarr opens.

    Raises
    ------
    ArchiveError
        It is to be read, and holds a pipe, a socket or a device.
    """
    from zarr.storage import ObjectStore as ZarrObjectStore

    if place.folder:
        with told(f"write {place.url(folder)}"):
            if read_only:
                _check_below(place.folder / folder)
            inside = LocalStore(place.folder / folder, mkdir=not read_only)
        return ZarrObjectStore(inside, read_only=read_only)
    inside = from_url(place.url(folder), retry_config=_RETRY)
    return ZarrObjectStore(inside, read_only=read_only)


@contextmanager
def told(action: str) -> Iterator[None]:
    """Turn a fault of the disk or object store into a PlaceError of one sentence.

    A missing file stays FileNotFoundError; a pipe in a file's place is an ArchiveError.
    """
    try:
        yield
    except (FileNotFoundError, PlaceError):
        raise
    except NotRegularError as error:
        raise _not_regular(error) from error
    except (OSError, BaseError) as error:
        raise PlaceError(f"cannot {action}: {_reason(error)}") from error


def _not_regular(error: NotRegularError) -> ArchiveError:
    """Return what is said of a pipe, a socket or a device in a file's place."""
    return ArchiveError(
        f"{error.filename} is no regular file, but {error.kind}; remove it, then see what "
        "`shosa verify` says"
    )


def _reason(error: Exception) -> str:
    """Name the fault in the operating system's words, or in the object store's first line."""
    number = error.errno if isinstance(error, OSError) else None
    found = re.search(r"\(os error (\d+)\)", str(error))
    if number is None and found:
        number = int(found[1])
    if number is None and re.search(_NO_CREDENTIALS, str(error), re.IGNORECASE):
        return (
            "there are no credentials for the object store; set AWS_ACCESS_KEY_ID and "
            "AWS_SECRET_ACCESS_KEY, or what your store asks for, then run it again"
        )
    if number is None:
        return f"{_first_line(error)}; check that the object store answers, then run it again"
    advice = {
        28: "free some space, then run it again",
        30: "choose a place that can be written to",
        13: "choose a place that you may write to",
        1: "an archive needs a file system with hard links, which FAT and exFAT are not",
        95: "an archive needs a file system with hard links, which FAT and exFAT are not",
    }
    return f"{os.strerror(number)}; {advice.get(number, 'mend this, then run it again')}"


def _first_line(error: Exception) -> str:
    """Leave out the debug print that obstore puts below its message."""
    return str(error).strip().splitlines()[0].rstrip(". ")


def _link_file(path: Path, content: bytes) -> bool:
    """Write beside, wait for the medium, and give it the name unless the name is taken."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, beside = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".partial")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(beside, 0o644)
        os.link(beside, path)
    except FileExistsError:
        return False
    finally:
        os.unlink(beside)
    _sync(path.parent)
    return True


def _walk(root: Path, folder: str) -> Iterator[StoredFile]:
    """Yield the files below root/folder, also while others write there."""
    for above, _, names in os.walk(root / folder):
        for name in names:
            path = Path(above, name)
            try:
                status = path.lstat()
            except FileNotFoundError:
                continue
            modified = datetime.fromtimestamp(status.st_mtime, tz=UTC)
            yield StoredFile(path.relative_to(root).as_posix(), status.st_size, modified)


def _check_below(folder: Path) -> None:
    """Refuse a folder that holds what would hang its reader."""
    for above, _, names in os.walk(folder):
        for name in names:
            with suppress(FileNotFoundError):
                regular_file(Path(above, name))


def _sync(path: Path) -> None:
    """Wait until the file or folder is on the medium."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _remove_empty_parents(root: Path, path: str) -> None:
    """Remove the folders above `path` that hold nothing, up to `root`."""
    for parent in (root / path).parents:
        if parent == root or root not in parent.parents:
            return
        with suppress(OSError):  # not empty
            parent.rmdir()
