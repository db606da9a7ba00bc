"""What became of each recording of a run: in words, and as the state of a run."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from prefect import get_run_logger
from prefect.client.schemas.objects import State
from prefect.states import Completed, Failed

from storage.errors import ArchiveError, InputError, PlaceError
from storage.recordings import Recording, Refusal

logger = logging.getLogger(__name__)

REFUSED = "Refused"
"""How a failed run is called on the dashboard when the recording is at fault."""
_SAID = 5
"""How many recordings a sentence names that were not taken in. Chosen: a paragraph on a page."""


@dataclass(frozen=True)
class Outcome:
    """What became of one motion file or capture."""

    path: str
    status: str
    """"ingested", "unchanged", "refused" (the file's fault) or "failed" (the run's)."""
    take: str | None = None
    frames: int = 0
    rate_hz: float = 0.0
    joints: int = 0
    notes: list[str] = field(default_factory=list)
    reason: str = ""


def finished(recording: Recording, record: dict[str, Any], status: str) -> Outcome:
    """Return the outcome of a recording that is in the archive."""
    return Outcome(
        recording.path,
        status,
        record["take"],
        record["frames"],
        record["rate_hz"],
        len(record["joints_present"]),
        record["notes"],
    )


def outcome_of(recording: Recording, take_in: Callable[[], tuple[dict[str, Any], bool]]) -> Outcome:
    """Return what becomes of a recording that is taken in, also where that breaks.

    Parameters
    ----------
    recording
        What is taken in.
    take_in
        Takes it in; returns its record, and False where the archive had it.
    """
    try:
        record, published = take_in()
    except InputError as error:
        return Outcome(recording.path, "refused", recording.take, reason=str(error))
    except (ArchiveError, PlaceError) as error:
        return Outcome(recording.path, "failed", recording.take, reason=str(error))
    except Exception as error:
        get_run_logger().exception("%s broke", recording.path)  # on the dashboard only
        return broken(recording, error)
    return finished(recording, record, "ingested" if published else "unchanged")


def refused(refusal: Refusal) -> Outcome:
    """Return the outcome of a file that was refused unopened."""
    logger.error("%s", refusal.reason)
    return Outcome(refusal.path, "failed" if refusal.broken else "refused", reason=refusal.reason)


def broken(recording: Recording, error: Exception) -> Outcome:
    """Return the outcome of a recording on which the program broke: it fails alone."""
    reason = f"{recording.path}: {type(error).__name__}: {error}; the run's log has the rest"
    return Outcome(recording.path, "failed", recording.take, reason=reason)


def ended(outcome: Outcome, data: Any = None) -> State[Any]:
    """Return the state of the run of a take, with its outcome or what is given."""
    data = data or outcome
    if outcome.reason:
        return Failed(message=f"{outcome.status}: {outcome.reason}", data=data)
    name = "Completed" if outcome.status == "ingested" else "Unchanged"
    return Completed(name=name, message=f"{outcome.take}: {outcome.status}", data=data)


def say_lost(lost: list[Outcome], total: int) -> str:
    """Say in one sentence what was not taken in."""
    said = "; ".join(
        f"{each.status}: {each.take or Path(each.path).name} ({each.reason})"
        for each in lost[:_SAID]
    )
    if total == 1:
        return said
    more = f"; and {len(lost) - _SAID} more, which the table lists" if len(lost) > _SAID else ""
    return f"{len(lost)} of {total} recordings were not taken in: {said}{more}"


def tell(outcome: Outcome, done: int, total: int) -> Outcome:
    """Say what became of a file."""
    if outcome.reason:
        logger.error("[%d/%d] %s: %s", done, total, outcome.status, outcome.reason)
        return outcome
    logger.info(
        "[%d/%d] %s: %s, %d frames at %g Hz, %d joints",
        *(done, total, outcome.take, outcome.status),
        *(outcome.frames, outcome.rate_hz, outcome.joints),
    )
    for note in outcome.notes if outcome.status == "ingested" else ():
        logger.info("    %s", note)
    return outcome
