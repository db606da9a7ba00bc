"""Files of an object store on this machine: what never changes is fetched once and mapped.

Only files whose name no other content ever has are kept so; who reads them checks them.
"""

import hashlib
import os
import secrets
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import obstore

from storage.files import cache_folder
from storage.places import Place, regular_file, told

_PART_BYTES = 8 << 20
"""How much of a file is fetched by one request [bytes]. Chosen: many times what asking costs."""
_PARTS_AT_ONCE = 8
_UNUSED_S = 7 * 86400.0
"""How long a copy that nobody opened is kept [s]. Chosen: a week of work."""


def local_file(place: Place, path: str, size: int) -> Path:
    """Return where the file at `path` can be mapped: itself on a disk, else a copy of it.

    Raises
    ------
    FileNotFoundError
        If there is none.
    """
    if place.folder:
        return regular_file(place.folder / path)
    copy = _folder(place) / Path(path).name
    with told(f"copy {place.url(path)} to {copy}"):
        if copy.is_file() and copy.stat().st_size == size:
            os.utime(copy)  # it is used
            return copy
        copy.parent.mkdir(parents=True, exist_ok=True)
        beside = copy.with_name(f".{secrets.token_hex(4)}.partial")
        try:
            _fetch(place, path, beside)
            beside.replace(copy)
        finally:
            beside.unlink(missing_ok=True)
        _forget_unused(copy.parent)
    return copy


def drop_local_file(place: Place, path: str) -> None:
    """Remove the copy of a file, if there is one, so that it is fetched anew."""
    if not place.folder:
        with suppress(OSError):
            (_folder(place) / Path(path).name).unlink(missing_ok=True)


def _folder(place: Place) -> Path:
    """Return where the copies of files of a place are."""
    key = hashlib.sha256(place.location.rstrip("/").encode()).hexdigest()[:16]
    return cache_folder("index", key)


def _forget_unused(folder: Path) -> None:
    """Remove the copies that nobody used for long."""
    with suppress(OSError):
        for each in folder.iterdir():
            if each.stat().st_mtime < time.time() - _UNUSED_S:
                each.unlink()


def _fetch(place: Place, path: str, into: Path) -> None:
    """Copy a file of an object store to this machine, many parts of it at a time."""
    size = obstore.head(place.store, path)["size"]
    with into.open("wb") as file, ThreadPoolExecutor(_PARTS_AT_ONCE) as pool:

        def fetch(start: int) -> None:
            end = min(start + _PART_BYTES, size)
            part = obstore.get_range(place.store, path, start=start, end=end)
            os.pwrite(file.fileno(), part, start)

        list(pool.map(fetch, range(0, size, _PART_BYTES)))
