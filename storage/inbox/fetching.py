"""Recordings as files on this machine: those of an object store are copied here first."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

import obstore

from storage.errors import InputError
from storage.files import cache_folder
from storage.inbox.listing import Inbox, files_of
from storage.places import told

_PIECE_BYTES = 8 << 20  # what is written at once of a film


@contextmanager
def fetched(inbox: Inbox, name: str) -> Iterator[Path]:
    """Give the path of the recording `name` on this machine; a copy is removed afterwards.

    A copy lies at the same path each time, by which a changed recording is known as the same one.

    Raises
    ------
    InputError
        If it is gone.
    PlaceError
        If the object store or the disk does not do what is asked.
    """
    if inbox.folder is not None:
        yield inbox.folder / name
        return
    folder = cache_folder("inbox", inbox.key)
    files = files_of(inbox, name)
    if not files:
        raise InputError(f"{inbox.place.url(name)} is not there any more")
    path = folder / name
    try:
        for each in files:
            if ".." in PurePosixPath(each).parts:
                raise InputError(f"{inbox.place.url(each)} is no name of a file; rename it")
            _download(inbox, each, folder / each)
        yield path
    finally:
        for each in files:
            (folder / each).unlink(missing_ok=True)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)


def _download(inbox: Inbox, name: str, path: Path) -> None:
    """Copy a file from an object store."""
    with told(f"copy {inbox.place.url(name)} to {path}"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            for piece in obstore.get(inbox.place.store, name).stream(min_chunk_size=_PIECE_BYTES):
                file.write(bytes(piece))
