"""What a form names: recordings in the inboxes and the roots that are served, and nothing else."""

import logging
from contextlib import ExitStack
from pathlib import Path

from flows.service.served import Served
from storage.errors import ArchiveError, InputError, UnknownNameError
from storage.formats import MOTION_SUFFIXES
from storage.inbox.fetching import fetched
from storage.inbox.listing import Inbox, open_inbox, stamp_of
from storage.inbox.quarantine import move_to_quarantine
from storage.recordings import find_recordings
from storage.roots import check_within, is_url

logger = logging.getLogger(__name__)


def find_named(
    served: Served, paths: list[str], copies: ExitStack
) -> tuple[dict[Path, tuple[Inbox, str] | None], list[str]]:
    """Return the recordings that a form names, where they lie in an inbox, and what is not there.

    What is in an object store is copied here, until `copies` is closed.
    """
    found: dict[Path, tuple[Inbox, str] | None] = {}
    faults = []
    for given in paths:
        try:
            path = check_within(given, served.roots)
            place = inbox_of(served, path)
            if is_url(path):
                if place is None:
                    raise InputError(f"{path!r} lies in no inbox; files are read from there")
                found[copies.enter_context(fetched(*place))] = place
                continue
            for each in find_recordings([path]):
                found.setdefault(each, inbox_of(served, str(each)))
        except (InputError, ArchiveError, OSError) as error:
            faults.append(str(error))
    return found, faults


def check_query(served: Served, query: str) -> str:
    """Return a query whose file, if it is one, lies in a root."""
    from tasks.retrieval.answering import parse_query

    name, clip = parse_query(query)
    frames = "" if clip is None else query[len(name) :]
    if Path(name).suffix.lower() in MOTION_SUFFIXES:
        return check_within(name, served.roots) + frames
    if "/" in name or "\\" in name or name.startswith("."):
        raise UnknownNameError(f"{name!r} is neither the name of a take nor a motion file")
    return query


def inbox_of(served: Served, path: str) -> tuple[Inbox, str] | None:
    """Return the inbox that a path lies in, and the path there."""
    for location in served.inboxes:
        inbox = open_inbox(location, served.archive)
        above = f"{inbox.location.rstrip('/')}/"
        for each in (path,) if is_url(path) else (path, str(Path(path).resolve())):
            if each.startswith(above):
                return inbox, each.removeprefix(above)
    return None


def move_away(inbox: Inbox, name: str, stamp: str, reason: str) -> None:
    """Move what is bad to quarantine, unless it was written to meanwhile, and so read half."""
    try:
        if stamp_of(inbox, name) == stamp:
            move_to_quarantine(inbox, name, reason)
    except OSError as error:
        logger.error("%r is bad and stays, for it cannot be moved: %s", name, error)
