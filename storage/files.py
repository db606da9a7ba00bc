"""Files on this machine: only regular ones are opened, and what is written is whole or not there.

Whoever wrote them: a pipe or a device may never end.
"""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

_KINDS = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class NotRegularError(OSError):
    """A path leads to a pipe, a socket or a device, which is not opened."""

    def __init__(self, path: str | os.PathLike[str], kind: str) -> None:
        super().__init__(errno.EINVAL, f"it is no regular file, but {kind}", os.fspath(path))
        self.kind = kind


def check_regular(path: str | os.PathLike[str]) -> None:
    """Refuse what is there and is neither a regular file nor a folder, links followed.

    Raises
    ------
    NotRegularError
        It is a pipe, a socket or a device.
    OSError
        It is not there, or may not be looked at.
    """
    _refuse_others(path, os.stat(path).st_mode)


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading, links followed.

    Raises
    ------
    NotRegularError
        It is a pipe, a socket or a device: none of them is opened.
    OSError
        It is not there, is a folder, or may not be read.
    """
    check_regular(path)  # before it is opened: opening a device does something
    # what took its place since then must not hang either
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        mode = os.fstat(handle).st_mode
        _refuse_others(path, mode)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def write_beside(path: Path, content: bytes) -> None:
    """Write a file beside its place and rename it, so that no half of it is ever seen there.

    Raises
    ------
    OSError
        The disk is full or cannot be written; nothing is left behind.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def cache_folder(kind: str, key: str) -> Path:
    """Return where copies of what lies in an object store are kept, as the user wants it.

    Parameters
    ----------
    kind
        What they are copies of: "inbox" or "index".
    key
        What tells them from those of another place.
    """
    # absolute, but with links: a link in the home would be another's path
    above = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").absolute()
    return above / "shosa" / kind / key


def _refuse_others(path: str | os.PathLike[str], mode: int) -> None:
    for is_it, kind in _KINDS:
        if is_it(mode):
            raise NotRegularError(path, kind)
