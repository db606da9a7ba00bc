"""One scan of an inbox at a time, and one server of an archive, on whatever machine they start.

    inbox/<key>/<number>     who holds the lock, and a count that goes up while the holder lives
    inbox/served/<number>    the same of who serves the archive

The holder is who made the file with the highest number; files are created, never replaced by
others, so of two that ask at once one gets it. No clock is compared: who finds the lock held
watches whether the count goes up, and takes it over where it does not.
"""

import json
import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from storage.archive import Archive
from storage.errors import ArchiveError
from storage.inbox.listing import Inbox
from storage.places import Place, create_file, delete_files, list_names, read_file, write_file

logger = logging.getLogger(__name__)

BEAT_S = 4.0
"""How often the holder says that it lives [s]. Chosen: 15 small writes a minute."""
DEAD_S = 20.0
"""How long the count of a holder stands still until it counts as dead [s]. Chosen: five beats."""


class BusyError(ArchiveError):
    """Somebody else scans the inbox now."""


@contextmanager
def scanning(
    place: Place, inbox: Inbox, *, beat_s: float = BEAT_S, dead_s: float = DEAD_S
) -> Iterator[Callable[[], bool]]:
    """Hold the lock of an inbox; gives a function that says whether it is still held.

    A lock is lost when this machine stood still for so long that it counted as dead.

    Raises
    ------
    BusyError
        If somebody else holds it and lives.
    PlaceError
        If the archive cannot be written.
    """
    said = f"{inbox.location} is being scanned"
    with _held(place, f"inbox/{inbox.key}", said, beat_s, dead_s) as is_held:
        yield is_held


@contextmanager
def serving(
    archive: Archive, *, beat_s: float = BEAT_S, dead_s: float = DEAD_S
) -> Iterator[Callable[[], bool]]:
    """Hold the lock of an archive that is served; all else as of `scanning`."""
    said = f"{archive.location} is being served"
    with _held(archive.place, "inbox/served", said, beat_s, dead_s) as is_held:
        yield is_held


@contextmanager
def _held(
    place: Place, folder: str, said: str, beat_s: float, dead_s: float
) -> Iterator[Callable[[], bool]]:
    """Hold the lock whose files are in a folder; `said` is what whoever holds it does."""
    number = _take_over(place, folder, said, dead_s)
    lost, done = threading.Event(), threading.Event()

    def beat() -> None:
        for count in range(1, 1 << 62):
            if done.wait(beat_s):
                return
            with suppress(OSError):  # the next beat tries again
                if _highest(place, folder) > number:
                    lost.set()
                    return
                write_file(place, _path(folder, number), _content(count))

    thread = threading.Thread(target=beat, daemon=True, name=f"lock {folder}")
    thread.start()
    try:
        yield lambda: not lost.is_set()
    finally:
        done.set()
        thread.join()
        if not lost.is_set():
            with suppress(OSError):  # then it counts as dead after a while
                write_file(place, _path(folder, number), b"{}")


def _take_over(place: Place, folder: str, said: str, dead_s: float) -> int:
    """Get the lock, and return its number."""
    number = _highest(place, folder)
    before = _read(place, folder, number)
    if before and before != b"{}":
        until = time.monotonic() + dead_s
        while time.monotonic() < until:
            time.sleep(min(0.5, dead_s / 4))
            if _read(place, folder, number) != before or _highest(place, folder) != number:
                raise BusyError(f"{said} by {_holder(before)}")
        logger.warning("%s by %s, which died", said, _holder(before))
    if not create_file(place, _path(folder, number + 1), _content(0)):
        raise BusyError(f"{said} by another process")
    with suppress(OSError):
        old = [name for name in list_names(place, folder) if name.isdigit() and int(name) <= number]
        delete_files(place, [f"{folder}/{name}" for name in old])
    return number + 1


def _highest(place: Place, folder: str) -> int:
    return max((int(name) for name in list_names(place, folder) if name.isdigit()), default=0)


def _read(place: Place, folder: str, number: int) -> bytes:
    try:
        return read_file(place, _path(folder, number))
    except FileNotFoundError:
        return b""


def _path(folder: str, number: int) -> str:
    return f"{folder}/{number:09d}"


def _content(count: int) -> bytes:
    return json.dumps({"host": socket.gethostname(), "pid": os.getpid(), "count": count}).encode()


def _holder(content: bytes) -> str:
    try:
        said = json.loads(content)
        return f"process {int(said['pid'])} on {said['host']}"
    except (ValueError, KeyError, TypeError):
        return "another process"
