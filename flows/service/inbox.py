"""What is dropped into an inbox becomes takes; what is bad leaves the way; the rest waits."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from prefect import State, flow, tags
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from flows.outcomes import REFUSED
from flows.service.runs import DIGITIZE, INGEST, end_of_run, run_names, split_files, start_run
from flows.service.served import MOST_PATHS, POOL
from storage import Archive, create_archive
from storage.errors import ArchiveError, InputError
from storage.files import NotRegularError
from storage.formats import MOTION_SUFFIXES
from storage.inbox.fetching import fetched
from storage.inbox.listing import Inbox, open_inbox, stamp_of
from storage.inbox.lock import BusyError, scanning
from storage.inbox.memory import Seen, look_now, pause_after, write_memory
from storage.inbox.quarantine import forget_reason, move_to_quarantine
from storage.provenance import digest_file
from storage.recordings import digest_capture
from storage.roots import leads_to_itself, links_out
from storage.sources import take_of_content

logger = logging.getLogger(__name__)

NOTHING_NEW = "nothing new"
"""What a scan says that found nothing."""
WAITING = "waiting until nobody writes to them"
STARTED = "being taken in"
KNOWN = "already in the archive"
"""What a scan says of recordings that it need not take in itself."""
_SHOWN = 3
"""How many faults a sentence names."""


@dataclass
class Scan:
    """What a scan found and did."""

    archive: Archive
    inbox: Inbox
    roots: Sequence[str]
    known: dict[str, Seen]
    counts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    def remember(self) -> None:
        """Write down what is known."""
        write_memory(self.archive.place, self.inbox, self.known)

    def note(self, name: str, status: str, reason: str = "", run: str = "") -> None:
        """Note what became of a recording, and move it out of the way where it is bad.

        What was changed in the meantime was perhaps read half: it waits until it has settled.
        """
        seen = self.known[name]
        good = status in ("ingested", "unchanged", "started")
        if not good and (stamp := stamp_of(self.inbox, name)) != seen.stamp:
            logger.info("%r changed while it was read and waits", name)
            self.known[name] = Seen(stamp, "waiting", time.time())
            self.counts["waiting"] += 1
            return
        if status == "started":
            self.known[name] = replace(seen, state="started", since_s=time.time(), run=run)
        elif good:
            self.known[name] = Seen(seen.stamp, "in", time.time())
            forget_reason(self.inbox, name)
        elif status == "refused":
            self.known[name] = Seen(seen.stamp, "refused", time.time())
            try:
                moved = move_to_quarantine(self.inbox, name, reason)
            except OSError as error:  # the inbox cannot be written, now
                status, reason = "failed", f"{reason} ({error})"
            else:
                if moved:
                    del self.known[name]  # so that it is new when it is moved back
                    logger.warning("%r was moved to %s", name, moved)
        if status == "failed":
            tries = seen.tries + 1
            self.known[name] = Seen(seen.stamp, "failed", time.time(), tries)
            reason = f"{reason} (tried again after {pause_after(tries):.0f} s)"
        self.counts[status] += 1
        if not good:
            self.faults.append(reason)


@flow(name="scan_inbox", flow_run_name="scan {inbox}", persist_result=False)
def scan_inbox(
    archive: str,
    inbox: str,
    settle_s: float = 60.0,
    roots: list[str] | None = None,
    *,
    apart: bool = False,
) -> State[Any]:
    """Take what is new in an inbox and has settled into the archive; nothing is taken in twice.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix; made if it is not there.
    inbox
        A folder, or s3://bucket/prefix.
    settle_s
        How long a recording has to be unchanged before it is read.
    roots
        What links in the inbox may lead to; by default only the inbox itself.
    apart
        Whether a capture is digitized by a run of its own, and a hundred motion files and more are
        taken in by some, which workers have to take, so that the scan does not wait for them.

    Returns
    -------
    State
        Completed where all is well, also where somebody else scans the inbox at the moment. Failed
        with a sentence where something was refused or could not be taken in.
    """
    try:
        opened = create_archive(archive)
        box = open_inbox(inbox, opened.location)
        with scanning(opened.place, box) as is_held:
            known, ready = look_now(opened.place, box, settle_s)
            scan = Scan(opened, box, [box.location, *(roots or ())], known)
            ready += _follow(scan)
            _take_in(scan, ready, is_held, apart=apart)
            scan.remember()
    except BusyError as error:
        return Completed(message=str(error))
    except (InputError, ArchiveError, OSError) as error:
        logger.error("%s", error)
        return Failed(message=str(error))
    return state_of(scan.counts, scan.faults, waiting=_waiting(scan))


def state_of(counts: Counter[str], faults: Sequence[str], *, waiting: int = 0) -> State[Any]:
    """Return how a run ends that met these numbers of recordings, with one sentence."""
    total = sum(counts.values())
    for fault in faults:
        logger.error("%s", fault)
    if faults:
        more = f"; and {len(faults) - _SHOWN} more" if len(faults) > _SHOWN else ""
        said = f"{len(faults)} of {total} recordings were not taken in: "
        message = (said if total > 1 else "") + "; ".join(faults[:_SHOWN]) + more
        name = "Failed" if counts["failed"] else REFUSED
        return Failed(name=name, message=message)
    words = {
        "ingested": "taken in",
        "unchanged": KNOWN,
        "started": STARTED,
    }
    said = [f"{counts[status]} {word}" for status, word in words.items() if counts[status]]
    said += [f"{waiting} {WAITING}"] if waiting else []
    return Completed(message=", ".join(said) or NOTHING_NEW)


def ingest_here(
    archive: str, paths: Sequence[Path], settings: dict[str, Any] | None = None, **options: Any
) -> tuple[dict[str, Any], str]:
    """Take recordings in; return their outcomes by path, and what went wrong with the run.

    One that is gone when the run begins, as somebody moved it, does not keep the others out.
    """
    from flows.ingestion import ingest_archive  # numba and the stages: not for a look

    run: Any = ingest_archive
    ours = [each for each in flow_run.tags if each.startswith(POOL)]
    while True:
        with tags(*ours):  # a run inside a run does not inherit them
            state = run(
                archive, [str(p) for p in paths], settings=settings, return_state=True, **options
            )
        outcomes = state.result(raise_on_failure=False)
        if isinstance(outcomes, list):
            return {outcome.path: outcome for outcome in outcomes}, state.message or ""
        there = [path for path in paths if path.exists()]
        if len(there) in (0, len(paths)):
            return {}, str(outcomes or state.message)
        paths = there


def _take_in(scan: Scan, names: Sequence[str], is_held: Callable[[], bool], *, apart: bool) -> None:
    """Take recordings in: the motion files of a batch in one run, each capture in its own."""
    files: list[str] = []
    for name in names:
        if fault := _fault_of(scan, name):
            scan.note(name, *fault)
        elif not _is_capture(scan, name):
            files.append(name)
        elif is_held():
            _take_capture(scan, name, apart=apart)
            scan.remember()
    if apart and len(files) > MOST_PATHS:
        return _hand_over(scan, files, is_held)
    for first in range(0, len(files), MOST_PATHS):
        if is_held():
            _take_files(scan, files[first : first + MOST_PATHS])
            scan.remember()
    return None


def _is_capture(scan: Scan, name: str) -> bool:
    """Say whether a recording is a capture, and no motion file."""
    if scan.inbox.folder is None:
        return Path(name).suffix.lower() not in MOTION_SUFFIXES
    return (scan.inbox.folder / name).is_dir()


def _take_files(scan: Scan, names: Sequence[str]) -> None:
    """Take motion files in that the archive does not have; one that is bad stops no other."""
    with ExitStack() as copies:
        paths: dict[str, Path] = {}
        for name in names:
            try:
                path = copies.enter_context(fetched(scan.inbox, name))
                if _is_in(scan.archive, digest_file(path)):
                    scan.note(name, "unchanged")
                else:
                    paths[name] = path
            except (InputError, ArchiveError, OSError) as error:
                scan.note(name, *_told(name, error))
        if not paths:
            return
        outcomes, fault = ingest_here(scan.archive.location, list(paths.values()))
        for name, path in paths.items():
            _note_outcome(scan, name, path, outcomes, fault)


def _hand_over(scan: Scan, names: Sequence[str], is_held: Callable[[], bool]) -> None:
    """Start the runs that take in many motion files; the archive is asked for each before."""
    digests: dict[str, str] = {}
    for name in names:
        try:
            digests[name] = digest_file(scan.inbox.folder / name) if scan.inbox.folder else ""
            if digests[name] and _is_in(scan.archive, digests[name]):
                scan.note(name, "unchanged")
                del digests[name]
        except (InputError, ArchiveError, OSError) as error:
            scan.note(name, *_told(name, error))
            digests.pop(name, None)
    for batch in split_files(digests):
        if is_held():
            _start(scan, INGEST, batch, {"paths": [scan.inbox.place.url(name) for name in batch]})
            scan.remember()


def _take_capture(scan: Scan, name: str, *, apart: bool) -> None:
    """Digitize a capture that the archive does not have, or start the run that does."""
    try:
        if scan.inbox.folder is not None:
            digest = digest_capture(scan.inbox.folder / name)
            if _is_in(scan.archive, digest):
                return scan.note(name, "unchanged")
        if apart:
            return _start(scan, DIGITIZE, [name], {"capture": scan.inbox.place.url(name)})
        with fetched(scan.inbox, name) as path:
            outcomes, fault = ingest_here(scan.archive.location, [path])
            return _note_outcome(scan, name, path, outcomes, fault)
    except (InputError, ArchiveError, OSError) as error:
        return scan.note(name, *_told(name, error))


def _start(scan: Scan, deployment: str, names: Sequence[str], parameters: dict[str, Any]) -> None:
    """Start the run that takes recordings in."""
    run = start_run(deployment, parameters, {name: scan.known[name] for name in names})
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    logger.info("taken in by the run %s: %r%s", run, names[0], more)
    for name in names:
        scan.note(name, "started", run=run)


def _follow(scan: Scan) -> list[str]:
    """Note what became of the runs that were started; return what no run takes in any more."""
    lost: list[str] = []
    for run, names in run_names(scan.known).items():
        state = end_of_run(run)
        if state is None:
            lost += names
        elif state.is_final():
            for name in names:
                _note_end(scan, name, state)
    return lost


def _note_end(scan: Scan, name: str, state: State[Any]) -> None:
    """Note what became of a recording whose run ended so."""
    seen = scan.known[name]
    if state.is_completed():
        scan.known[name] = Seen(seen.stamp, "in", time.time())
        forget_reason(scan.inbox, name)
    elif state.name == REFUSED and stamp_of(scan.inbox, name) != seen.stamp:
        del scan.known[name]  # it was moved away, and is new when it is moved back
    elif state.is_cancelled() or (state.name == REFUSED and _is_capture(scan, name)):
        scan.known[name] = Seen(seen.stamp, "refused", time.time())  # by a person; or not movable
    else:  # of many files only one may have been bad: the others are found in the archive
        scan.known[name] = Seen(seen.stamp, "failed", time.time(), seen.tries + 1)


def _note_outcome(scan: Scan, name: str, path: Path, outcomes: dict[str, Any], fault: str) -> None:
    """Note what a run made of a recording."""
    if outcome := outcomes.get(str(path)):
        scan.note(name, outcome.status, outcome.reason)
    elif outcomes and path.exists():  # the run passed it over: it is the same as another
        if _is_in(scan.archive, digest_file(path)):
            scan.note(name, "unchanged")  # else that one was bad, and this is met by the next scan
    else:
        scan.note(name, "failed", f"{name}: {fault or 'the run said nothing of it'}")


def _fault_of(scan: Scan, name: str) -> tuple[str, str] | None:
    """Return the status and the reason of a recording that is not to be opened."""
    try:
        name.encode()
    except UnicodeEncodeError:
        shown = name.encode(errors="surrogateescape").decode(errors="backslashreplace")
        return "refused", f"the name {shown!r} is not UTF-8; rename it"
    if scan.inbox.folder is None:
        return None
    path = scan.inbox.folder / name
    if (out := next(links_out(path, scan.roots), None)) and leads_to_itself(out):
        return "refused", f"{name!r} is, or holds, a link to itself ({out.name}); remove the link"
    if out:
        return "refused", (
            f"{name!r} is, or holds, a link that leads out of the inbox ({out.name}); put the file "
            "in place of the link, or start `shosa serve` with --root"
        )
    return None


def _told(name: str, error: Exception) -> tuple[str, str]:
    """Return the status and the reason of a recording that cannot be read."""
    if isinstance(error, NotRegularError):
        return "refused", f"{name!r} is no regular file, but {error.kind}; put a file in its place"
    if isinstance(error, UnicodeEncodeError):
        return "refused", f"{name!r} holds a name that is not UTF-8; rename it"
    said = error.strerror if isinstance(error, OSError) and error.strerror else error
    advice = "; let the user that runs shosa read it" if isinstance(error, PermissionError) else ""
    return "failed", f"{name!r} cannot be read: {said}{advice}"


def _is_in(archive: Archive, digest: str) -> bool:
    """Say whether a take of the archive was made from this content."""
    return take_of_content(archive.place, digest) is not None


def _waiting(scan: Scan) -> int:
    return sum(seen.state == "waiting" for seen in scan.known.values())
