"""Motion files and captures into the takes of an archive."""

import logging
from dataclasses import asdict, dataclass, field
from typing import Any

from prefect import flow, task
from prefect.cache_policies import NO_CACHE
from prefect.task_runners import ThreadPoolTaskRunner

from flows.dashboard import count_teller, show_ingested
from flows.digitization import digitize_take
from storage import create_archive
from storage.errors import ArchiveError, InputError, PlaceError
from storage.recordings import Recording, Refusal, find_recordings, plan_takes
from tasks.cached import run_once
from tasks.motion.importing import ImportSettings, import_take
from tasks.retrieval.indexing import index_take
from tasks.settings import read_settings
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


@flow(
    name="ingest_archive",
    flow_run_name="ingest into {archive}",
    task_runner=ThreadPoolTaskRunner(max_workers=2),  # type: ignore[arg-type]
)
def ingest_archive(
    archive: str,
    paths: list[str],
    importing: ImportSettings | None = None,
    settings: dict[str, Any] | None = None,
) -> list[Outcome]:
    """Take every motion file and capture among and below `paths` into the archive at `archive`.

    What cannot be used is recorded with its reason, and the others go on.

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
    runs = [
        ingest_take.submit(opened.location, each, importing, settings) for each in plan.recordings
    ]
    outcomes = [_refused(each) for each in plan.refusals]
    for done, run in enumerate(runs, start=1):
        result = run.result(raise_on_failure=False)
        outcomes.append(_tell(_outcome(plan.recordings[done - 1], result), done, total))
        tell_done(done)
    show_ingested(archive, [asdict(each) for each in outcomes])
    return outcomes


@task(task_run_name="ingest {recording.take}", cache_policy=NO_CACHE)
def ingest_take(
    archive: str,
    recording: Recording,
    importing: ImportSettings,
    settings: dict[str, Any] | None,
) -> Outcome:
    """Import one file, index it, and publish both at once; or digitize one capture."""
    try:
        if recording.kind == "capture":
            draft = digitize_take(archive, recording, settings)
            return _finished(recording, draft, published=draft["published"])
        draft = run_once(import_take, archive=archive, recording=recording, settings=importing)
        run_once(index_take, archive=archive, take=draft["take"], version=draft["version"])
        published = publish_take(archive, draft)
    except (InputError, ArchiveError) as error:
        return Outcome(recording.path, "refused", recording.take, reason=str(error))
    except PlaceError as error:
        return Outcome(recording.path, "failed", recording.take, reason=str(error))
    return _finished(recording, draft, published=published)


def _finished(recording: Recording, draft: dict[str, Any], *, published: bool) -> Outcome:
    """Return the outcome of a recording that is in the archive."""
    return Outcome(
        recording.path,
        "ingested" if published else "unchanged",
        draft["take"],
        draft["frames"],
        draft["rate_hz"],
        len(draft["joints_present"]),
        draft["notes"],
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
