"""Open files, whoever wrote them: only regular ones, as a pipe or a device may never end."""

import errno
import os
import stat
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


def _refuse_others(path: str | os.PathLike[str], mode: int) -> None:
    for is_it, kind in _KINDS:
        if is_it(mode):
            raise NotRegularError(path, kind)
