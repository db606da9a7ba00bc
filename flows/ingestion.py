"""Motion files and captures into the takes of an archive."""

import functools
import logging
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from prefect import flow, task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State
from prefect.states import Completed, Failed
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from flows.dashboard import count_teller, show_ingested
from flows.digitization import choose_settings, digitize_take, make_take
from flows.outcomes import (
    Outcome,
    broken,
    ended,
    finished,
    outcome_of,
    refused,
    say_lost,
    tell,
)
from flows.server import is_server_fault, tell_server_is_gone
from storage import create_archive, open_archive
from storage.archive import Archive
from storage.errors import ArchiveError, ConflictError, InputError, PlaceError
from storage.recordings import Recording, find_recordings, plan_takes
from storage.records import read_record
from storage.sources import remember_source, take_of_content
from tasks.motion.importing import (
    ImportSettings,
    changed_import_settings,
    import_take,
    settings_for,
)
from tasks.retrieval.gathering import gather_when_many
from tasks.retrieval.indexing import find_index, index_take
from tasks.settings import changed_settings, read_settings
from tasks.takes.identity import find_same
from tasks.takes.publishing import publish_take

logger = logging.getLogger(__name__)


_FILES_A_TASK = 20
"""How many motion files one run of a task takes in. Measured: a run costs client and server some
150 ms, a file of 300 frames 66 ms; with twenty a run, few files are lost with a worker."""
_BYTES_A_TASK = 8_000_000
"""How much one run of a task takes in, where that is more than one file [bytes]: some seconds."""
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
    outcomes += [refused(each) for each in plan.refusals]

    def find(recording: Recording) -> Outcome | None:
        return _unchanged(opened, recording, importing, settings, again=again)

    done = 0
    new: list[Recording] = []
    for recording in plan.recordings:  # what the archive has costs no run of a task
        if (known := find(recording)) is None:
            new.append(recording)
            continue
        done += 1
        outcomes.append(tell(known, done, total))
    parts = split_recordings(new)
    runs: list[Any] = [
        ingest_take.submit(opened.location, part[0], settings, again)
        if part[0].kind == "capture"
        else ingest_files.submit(opened.location, part, importing, again)
        for part in parts
    ]
    for part, run in zip(parts, runs, strict=True):
        for outcome in _outcomes(part, run.result(raise_on_failure=False), find):
            done += 1
            outcomes.append(tell(outcome, done, total))
            if outcome.reason and len(part) > 1:
                lose_take(outcome, return_state=True)
        tell_done(done)
    order = {each.path: number for number, each in enumerate(plan.recordings)}
    outcomes.sort(key=lambda each: order.get(each.path, -1))  # refusals first, as they came
    gather_when_many(opened.location)
    show_ingested(archive, [asdict(each) for each in outcomes])
    lost = [each for each in outcomes if each.reason]
    if not lost:
        return Completed(message=_say_in(outcomes), data=outcomes)
    return Failed(message=say_lost(lost, len(outcomes)), data=outcomes)


def _say_in(outcomes: list[Outcome]) -> str:
    """Say in one sentence that all is taken in."""
    if len(outcomes) == 1:
        return f"{outcomes[0].take} is in."
    return f"All {len(outcomes)} recordings are in."


def split_recordings(recordings: Sequence[Recording]) -> list[list[Recording]]:
    """Return what each run of a task takes in: a capture, or some motion files.

    A run of a task costs three times as much as a small file; a large one is worth its own.
    """
    parts: list[list[Recording]] = []
    files: list[Recording] = []
    size = 0
    for each in recordings:
        if each.kind == "capture":
            parts.append([each])
            continue
        size += _size_of(each.path)
        if not files or len(files) == _FILES_A_TASK or size > _BYTES_A_TASK:
            files, size = [], _size_of(each.path)
            parts.append(files)
        files.append(each)
    return parts


def _size_of(path: str) -> int:
    """Return the size of a file; 0 where it is gone, which is said where it is read."""
    try:
        return Path(path).stat().st_size
    except OSError:
        return 0


def _never_again(*_: Any) -> bool:
    """Say that a run of a task is not tried again."""
    return False


_TASK: dict[str, Any] = {
    "cache_policy": NO_CACHE,
    "persist_result": False,
    # never tried again, and asked whether: else Prefect logs "NoneType: None" below a Failed state
    "retries": 1,
    "retry_condition_fn": _never_again,
}


@task(task_run_name="ingest {recording.take}", **_TASK)
def ingest_take(
    archive: str,
    recording: Recording,
    settings: dict[str, Any] | None,
    again: bool,  # noqa: FBT001 - Prefect passes parameters by name
) -> State[Outcome]:
    """Digitize one capture.

    The state is Failed where the recording is refused, by a fault of its own, or fails, by one of
    the archive's, the machine's or the program's.
    """
    take_in = functools.partial(_digitize, archive, recording, settings, again=again)
    return ended(outcome_of(recording, take_in))


def _name_of_files(parameters: dict[str, Any]) -> str:
    """Return how the run of a task is called that takes in motion files."""
    first, *more = (each.take for each in parameters["recordings"])
    return f"ingest {first}{f' and {len(more)} more' if more else ''}"


@task(task_run_name=cast(Any, _name_of_files), **_TASK)  # its type wants the method of a class
def ingest_files(
    archive: str,
    recordings: list[Recording],
    importing: ImportSettings,
    again: bool,  # noqa: FBT001 - Prefect passes parameters by name
) -> State[list[Outcome]]:
    """Import each of some motion files, index it, and publish both at once.

    One that is bad fails alone. The state is Failed where one was not taken in.
    """
    outcomes = []
    for each in recordings:
        take_in = functools.partial(_import, archive, each, importing, again=again)
        outcomes.append(outcome_of(each, take_in))
    lost = [each for each in outcomes if each.reason]
    if len(outcomes) == 1:
        return ended(outcomes[0], data=outcomes)
    if lost:
        return Failed(message=say_lost(lost, len(outcomes)), data=outcomes)
    takes = ", ".join(str(each.take) for each in outcomes)
    return Completed(message=f"All {len(outcomes)} are in: {takes}", data=outcomes)


@task(task_run_name="ingest {outcome.take}", **_TASK)
def lose_take(outcome: Outcome) -> State[Outcome]:
    """Show a take that was not taken in beside others, as a run of its own, with its reason."""
    return ended(outcome)


def _import(
    archive: str, recording: Recording, importing: ImportSettings, *, again: bool
) -> tuple[dict[str, Any], bool]:
    """Take in a motion file; return its record, and False where the archive had it."""
    opened = open_archive(archive)
    changed = changed_import_settings(settings_for(recording, importing))
    before = read_record(opened.place, recording.take)
    if before and not again and (same := find_same(opened, recording, changed)):
        return asdict(same), False  # this run, on a worker that died
    draft = import_take(archive, recording, importing)
    index_take(archive, draft["take"], draft["version"])
    try:
        publish_take(archive, draft, over=before.number if before else 0)
    except ConflictError:  # another run may have taken in the same
        same = None if again else find_same(opened, recording, changed)
        if same is None:
            raise
        return asdict(same), False
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
        draft: Any = digitize_take(archive, recording, settings, again)  # a failed state raises
        return draft, draft["published"]
    except Exception as error:
        if not is_server_fault(error):
            raise
        tell_server_is_gone()
    record = read_record(opened.place, recording.take)
    if record and record.number > (before.number if before else 0):
        return asdict(record), True
    draft = make_take(archive, recording, settings, again=again)
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
        record = find_same(opened, recording, changed)
    except (InputError, ArchiveError, PlaceError):
        return None  # said where it is taken in
    if record is None:
        return None
    if take_of_content(opened.place, recording.digest) is None:
        remember_source(opened.place, record)  # of a run that was killed before
    if (
        "motion" in record.stages
        and find_index(opened.location, record.take, record.version) is None
    ):
        index_take(opened.location, record.take, record.version)
    return finished(recording, asdict(record), "unchanged")


def _outcomes_of_run() -> list[Outcome]:
    """Return the list that `run_ingestion` looks into, or a new one.

    As a function, because a flow that is sent to Dask takes its module's variables with it, and
    this one cannot be sent.
    """
    return _TOLD.get([])


def _outcomes(
    part: list[Recording],
    result: list[Outcome] | Outcome | Exception,
    find: Callable[[Recording], Outcome | None],
) -> list[Outcome]:
    """Return what became of the recordings of a task's run, also where its process died."""
    if isinstance(result, Exception):
        return [find(each) or broken(each, result) for each in part]
    return result if isinstance(result, list) else [result]
