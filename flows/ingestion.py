"""Motion files and captures into the takes of an archive."""

import logging
from collections.abc import Sequence
from contextvars import ContextVar
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from prefect import flow, task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State
from prefect.states import Completed, Failed
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from flows.dashboard import count_teller, show_ingested
from flows.digitization import choose_settings, digitize_take
from flows.server import is_server_fault, tell_server_is_gone
from storage import create_archive, open_archive
from storage.archive import Archive
from storage.errors import ArchiveError, ConflictError, InputError, PlaceError
from storage.recordings import (
    Recording,
    Refusal,
    find_recordings,
    plan_takes,
    remember_source,
    take_of_content,
)
from storage.records import read_record
from tasks.motion.importing import (
    ImportSettings,
    changed_import_settings,
    import_take,
    settings_for,
)
from tasks.retrieval.gathering import gather_when_many
from tasks.retrieval.indexing import find_index, index_take
from tasks.settings import changed_settings, read_settings
from tasks.takes.identity import why_anew
from tasks.takes.publishing import publish_take

logger = logging.getLogger(__name__)


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


_SAID = 5
"""How many recordings a sentence names that were not taken in. Chosen: a paragraph on a page."""
_TOLD: ContextVar[list[Outcome]] = ContextVar("_TOLD")
"""Where outcomes go as they come, so that they are known though the Prefect server goes away."""


def run_ingestion(
    archive: str,
    paths: Sequence[str],
    importing: ImportSettings | None = None,
    settings: dict[str, Any] | None = None,
    *,
    again: bool = False,
    runner: TaskRunner[Any] | None = None,
) -> list[Outcome]:
    """Run the flow `ingest_archive`, and return what became of each recording, good or bad.

    A Prefect server that goes away in the meantime is said, and harms nothing.

    Parameters and errors are those of the flow; `runner` is what its tasks run on, by default
    threads of this process.
    """
    run: Any = ingest_archive  # pyright takes it for the function that it was
    run = run if runner is None else run.with_options(task_runner=runner)
    told: list[Outcome] = []
    token = _TOLD.set(told)
    try:
        state = run(archive, list(paths), importing, settings, again, return_state=True)
        outcomes = state.result(raise_on_failure=False)
    except Exception as error:
        if not told or not is_server_fault(error):
            raise
        tell_server_is_gone()
        return told
    finally:
        _TOLD.reset(token)
    if isinstance(outcomes, Exception):
        raise outcomes
    return outcomes


@flow(
    name="ingest_archive",
    flow_run_name="ingest into {archive}",
    task_runner=ThreadPoolTaskRunner(max_workers=2),  # type: ignore[arg-type]
    persist_result=False,
)
def ingest_archive(
    archive: str,
    paths: list[str],
    importing: ImportSettings | None = None,
    settings: dict[str, Any] | None = None,
    again: bool = False,  # noqa: FBT001, FBT002 - Prefect passes parameters by name
) -> State[list[Outcome]]:
    """Take every motion file and capture among and below `paths` into the archive at `archive`.

    What cannot be used is recorded with its reason, and the others go on. What the archive has is
    left alone, whatever version of the program made it.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix; made if it is not there.
    paths
        Motion files, captures, and folders of them.
    importing
        How motion files are read.
    settings
        How captures are digitized: as of `digitize_take`.
    again
        Take in anew what the archive has.

    Returns
    -------
    prefect.states.State
        With the outcomes; Completed if all is in, else Failed, saying what is not and why.

    Raises
    ------
    InputError
        If a path is not there, or the settings cannot be used: all faults at once.
    """
    importing = importing or ImportSettings()
    read_settings(settings or {}, "the settings of this run")
    found = find_recordings(paths)
    opened = create_archive(archive)
    plan = plan_takes(opened, found)
    for note in plan.notes:
        logger.warning("%s", note)
    total = len(plan.recordings)
    tell_done = count_teller(f"{total} recordings into {archive}", total)
    outcomes = _outcomes_of_run()
    outcomes += [_refused(each) for each in plan.refusals]
    # what the archive has costs no run of a task
    started = [
        (each, _unchanged(opened, each, importing, settings, again=again))
        for each in plan.recordings
    ]
    runs: list[tuple[Recording, Any]] = [
        (each, known or ingest_take.submit(opened.location, each, importing, settings, again))
        for each, known in started
    ]
    for done, (recording, run) in enumerate(runs, start=1):
        result = run if isinstance(run, Outcome) else run.result(raise_on_failure=False)
        outcomes.append(_tell(_outcome(recording, result), done, total))
        tell_done(done)
    gather_when_many(opened.location)
    show_ingested(archive, [asdict(each) for each in outcomes])
    lost = [each for each in outcomes if each.reason]
    if not lost:
        return Completed(message=f"All {len(outcomes)} recordings are in.", data=outcomes)
    return Failed(message=_say_lost(lost, len(outcomes)), data=outcomes)


@task(
    task_run_name="ingest {recording.take}",
    cache_policy=NO_CACHE,
    persist_result=False,
)
def ingest_take(
    archive: str,
    recording: Recording,
    importing: ImportSettings,
    settings: dict[str, Any] | None,
    again: bool,  # noqa: FBT001 - Prefect passes parameters by name
) -> State[Outcome]:
    """Import one file, index it, and publish both at once; or digitize one capture.

    The state is Failed where the recording is refused, by a fault of its own, or fails, by one of
    the archive's or the machine's.
    """
    try:
        if recording.kind == "capture":
            record, published = _digitize(archive, recording, settings, again=again)
        else:
            record, published = _import(archive, recording, importing, again=again)
    except InputError as error:
        return _ended(Outcome(recording.path, "refused", recording.take, reason=str(error)))
    except (ArchiveError, PlaceError) as error:
        return _ended(Outcome(recording.path, "failed", recording.take, reason=str(error)))
    return _ended(_finished(recording, record, "ingested" if published else "unchanged"))


def _import(
    archive: str, recording: Recording, importing: ImportSettings, *, again: bool
) -> tuple[dict[str, Any], bool]:
    """Take in a motion file; return its record, and False where the archive had it."""
    opened = open_archive(archive)
    before = read_record(opened.place, recording.take)
    draft = import_take(archive, recording, importing)
    index_take(archive, draft["take"], draft["version"])
    try:
        publish_take(archive, draft, over=before.number if before else 0)
    except ConflictError:  # another run may have taken in the same
        changed = changed_import_settings(settings_for(recording, importing))
        reason, record = why_anew(opened, recording, changed)
        if again or reason or not record:
            raise
        return asdict(record), False
    return draft, True


def _digitize(
    archive: str, recording: Recording, settings: dict[str, Any] | None, *, again: bool
) -> tuple[dict[str, Any], bool]:
    """Digitize a capture; return its record, and False where the archive had it.

    As a flow of its own, as long as there is a Prefect server to tell.
    """
    opened = open_archive(archive)
    before = read_record(opened.place, recording.take)
    try:
        draft = digitize_take(archive, recording, settings, again)
        return draft, draft["published"]
    except Exception as error:
        if not is_server_fault(error):
            raise
        tell_server_is_gone()
    record = read_record(opened.place, recording.take)
    if record and record.number > (before.number if before else 0):
        return asdict(record), True
    draft = digitize_take.fn(archive, recording, settings, again)
    return draft, draft["published"]


def _unchanged(
    opened: Archive,
    recording: Recording,
    importing: ImportSettings,
    settings: dict[str, Any] | None,
    *,
    again: bool,
) -> Outcome | None:
    """Return the outcome of what the archive has, None where the recording is to be taken in."""
    if again:
        return None
    try:
        if recording.kind == "capture":
            changed = changed_settings(choose_settings(recording, settings or {})[0])
        else:
            changed = changed_import_settings(settings_for(recording, importing))
        reason, record = why_anew(opened, recording, changed)
    except (InputError, ArchiveError, PlaceError):
        return None  # said where it is taken in
    if reason or not record:
        return None
    if take_of_content(opened, recording.digest) is None:
        remember_source(opened, record)  # of a run that was killed before
    if (
        "motion" in record.stages
        and find_index(opened.location, record.take, record.version) is None
    ):
        index_take(opened.location, record.take, record.version)
    return _finished(recording, asdict(record), "unchanged")


def _outcomes_of_run() -> list[Outcome]:
    """Return the list that `run_ingestion` looks into, or a new one.

    As a function, because a flow that is sent to Dask takes its module's variables with it, and
    this one cannot be sent.
    """
    return _TOLD.get([])


def _ended(outcome: Outcome) -> State[Outcome]:
    """Return the state of the run of a take."""
    if outcome.reason:
        return Failed(message=f"{outcome.status}: {outcome.reason}", data=outcome)
    name = "Completed" if outcome.status == "ingested" else "Unchanged"
    return Completed(name=name, message=f"{outcome.take}: {outcome.status}", data=outcome)


def _say_lost(lost: list[Outcome], total: int) -> str:
    """Say in one sentence what was not taken in."""
    said = "; ".join(
        f"{each.status}: {each.take or Path(each.path).name} ({each.reason})"
        for each in lost[:_SAID]
    )
    more = f"; and {len(lost) - _SAID} more, which the table lists" if len(lost) > _SAID else ""
    return f"{len(lost)} of {total} recordings were not taken in: {said}{more}"


def _finished(recording: Recording, record: dict[str, Any], status: str) -> Outcome:
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


def _refused(refusal: Refusal) -> Outcome:
    """Return the outcome of a file that was refused unopened."""
    logger.error("%s", refusal.reason)
    return Outcome(refusal.path, "failed" if refusal.broken else "refused", reason=refusal.reason)


def _outcome(recording: Recording, result: Outcome | Exception) -> Outcome:
    """Return what a run gave, also where it broke: a bad take fails alone."""
    if isinstance(result, Outcome):
        return result
    reason = f"{recording.path}: {type(result).__name__}: {result}; the run's log has the rest"
    return Outcome(recording.path, "failed", recording.take, reason=reason)


def _tell(outcome: Outcome, done: int, total: int) -> Outcome:
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
