"""What is bad leaves the way: into a folder of its own in the inbox, with the reason beside it.

<inbox>/quarantine/<name>/<name>       the file or the capture, as it was
<inbox>/quarantine/<name>/<name>.toml  its metadata, where it had some
<inbox>/quarantine/<name>/REASON.txt   what, why, and what to do
"""

import errno
import os
from contextlib import suppress
from pathlib import Path, PurePosixPath

import obstore

from storage.inbox.listing import QUARANTINE, Inbox, files_of
from storage.places import told, write_file
from storage.provenance import now
from storage.recordings import metadata_beside

REASON = "REASON.txt"
_MOST_NAMES = 10_000  # of one name in quarantine; then something is wrong


def move_to_quarantine(inbox: Inbox, name: str, reason: str) -> str | None:
    """Move a recording out of the way, and write down why.

    Nothing is copied on a disk and nothing is overwritten anywhere. What lies behind a link to
    another place is left where it is.

    Parameters
    ----------
    name
        Its path in the inbox.
    reason
        A sentence.

    Returns
    -------
    Where it is now, as a path in the inbox; None where it was left, is gone, or was moved by
    somebody else at the same time.

    Raises
    ------
    PlaceError
        If the inbox cannot be written.
    """
    text = _text(inbox, name, reason)
    if inbox.folder is None:
        return _move_stored(inbox, name, text)
    path = inbox.folder / name
    if not path.parent.resolve().is_relative_to(inbox.folder) or not os.path.lexists(path):
        return None
    with told(f"move {path} to {inbox.folder / QUARANTINE}"):
        beside = metadata_beside(path) if not path.is_dir() else None
        if (inbox.folder / QUARANTINE).is_symlink():
            raise NotADirectoryError(errno.ENOTDIR, "quarantine is a link; make it a folder")
        into = _make_folder(inbox.folder / QUARANTINE, _shown(path.name))
        try:
            (into / REASON).write_text(text, encoding="utf-8")
            os.rename(path, into / path.name)
        except FileNotFoundError:
            _remove_reason(into)
            if os.path.lexists(path):
                raise
            return None  # somebody else was faster, and left a reason, too
        if beside is not None:  # metadata that stay by a kill are there when it comes back
            with suppress(FileNotFoundError):
                os.rename(beside, into / beside.name)
    return into.relative_to(inbox.folder).as_posix()


def forget_reason(inbox: Inbox, name: str) -> None:
    """Remove the reason of a recording that was mended and moved back, where nothing is with it."""
    if inbox.folder is None:
        return
    _remove_reason(inbox.folder / QUARANTINE / _shown(Path(name).name))


def _remove_reason(folder: Path) -> None:
    """Remove a folder of quarantine in which is only a reason."""
    with suppress(OSError):
        if os.listdir(folder) == [REASON]:
            (folder / REASON).unlink()
            folder.rmdir()


def _make_folder(quarantine: Path, name: str) -> Path:
    """Return a folder in quarantine that holds no recording."""
    for number in range(1, _MOST_NAMES):
        folder = quarantine / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:
            if folder.is_dir() and not folder.is_symlink() and os.listdir(folder) == [REASON]:
                return folder  # what was in it has been moved back
    raise FileExistsError(f"{quarantine} holds {_MOST_NAMES} of {name}")


def _text(inbox: Inbox, name: str, reason: str) -> str:
    """Return what stands in REASON.txt."""
    return (
        f"{_shown(name)} was not taken into the archive {_shown(inbox.archive)} ({now()}).\n\n"
        f"Why: {reason}\n\n"
        "What to do: mend it, then move it back to where it was:\n"
        f"    {_shown(inbox.location)}/{_shown(name)}\n"
        "It is tried again there by itself. If it is not wanted, remove this folder.\n"
    )


def _shown(name: str) -> str:
    """Return a name with what is no text, and what would break a line, written as numbers."""
    text = name.encode(errors="surrogateescape").decode(errors="backslashreplace")
    return "".join(each if each.isprintable() else repr(each)[1:-1] for each in text)


def _move_stored(inbox: Inbox, name: str, text: str) -> str | None:
    """Move a recording of an object store: copy, then remove."""
    files = files_of(inbox, name)
    if not files:
        return None
    place = inbox.place
    with told(f"move {place.url(name)} to quarantine"):
        taken = [each["path"] for each in obstore.list(place.store, prefix=QUARANTINE).collect()]
        last = PurePosixPath(name).name
        for number in range(1, _MOST_NAMES):
            into = f"{QUARANTINE}/{last if number == 1 else f'{last}-{number}'}"
            held = [each for each in taken if each.startswith(f"{into}/")]
            if held in ([], [f"{into}/{REASON}"]):
                break
        else:
            raise FileExistsError(f"{place.url(QUARANTINE)} holds {_MOST_NAMES} of {last}")
        write_file(place, f"{into}/{REASON}", text.encode())
        above = PurePosixPath(name).parent
        copies = [f"{into}/{PurePosixPath(each).relative_to(above)}" for each in files]
        try:
            for each, copy in zip(files, copies, strict=True):
                obstore.copy(place.store, each, copy)
        except FileNotFoundError:  # somebody else was faster
            obstore.delete(place.store, [*copies, f"{into}/{REASON}"])
            return None
        obstore.delete(place.store, list(reversed(files)))
    return into
