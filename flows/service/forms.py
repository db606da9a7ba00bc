"""The flows that a person starts from a form of the dashboard, or a schedule by itself.

What they may touch is not among their parameters: the archive, the inboxes and the folders that a
path may lie in are those of the `shosa serve` whose worker runs them. What the docstrings say
stands in the forms.
"""

import logging
from collections import Counter
from contextlib import ExitStack
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Annotated, Any, Literal

from prefect import State, flow
from prefect.artifacts import create_table_artifact
from prefect.exceptions import FailedRun
from prefect.runtime import flow_run
from prefect.states import Completed, Failed
from pydantic import BaseModel, ConfigDict, Field

from flows.artifacts import shown
from flows.outcomes import REFUSED
from flows.service.forgetting import forget_idle_scans, forget_stages, tell_end
from flows.service.inbox import ingest_here, scan_inbox, state_of
from flows.service.named import check_query, find_named, inbox_of, move_away
from flows.service.served import MOST_PATHS, Served, read_served
from storage import open_archive
from storage.errors import ArchiveError, InputError
from storage.inbox.fetching import fetched
from storage.inbox.listing import stamp_of
from storage.roots import check_within, is_url

logger = logging.getLogger(__name__)

_MOST_MATCHES = 1000
"""How much one form may ask for. Chosen: a page."""
_NAMED = 3  # recordings in the name of a run
_LONGEST = 4096  # the longest path of a system

Part = Literal[
    "whole", "upper", "lower", "arms", "right-arm", "left-arm", "legs", "right-leg", "left-leg",
    "feet", "hands", "head",
]  # fmt: skip
"""The parts that can be searched with: `tasks.retrieval.normalization.PARTS`."""

PathText = Annotated[str, Field(min_length=1, max_length=_LONGEST)]


class Reading(BaseModel):
    """How motion files are read. Leave all of it as it is unless a take comes out wrong."""

    model_config = ConfigDict(extra="forbid")

    scale_m: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        title="Scale",
        description="Metres in one unit of the file. 0: as the file and the body say.",
    )
    up: Literal["as the file says", "x", "y", "z"] = Field(
        default="as the file says", title="Up", description="The file's axis that points up."
    )
    low_pass_hz: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        title="Low-pass",
        description="Smooth the markers: movement above this frequency in Hz is taken for noise. "
        "0: nothing is smoothed.",
    )


@flow(name="scan", flow_run_name="scan the inboxes", persist_result=False)
def scan() -> State[Any]:
    """Look into the inboxes and take in what is new and has settled.

    Runs by itself on its schedule. What is bad is moved to the folder `quarantine` of its inbox,
    with a REASON.txt.
    """
    served = _begin()
    # as itself and not a run inside this one, of which there would be a thousand a day more
    states = [
        scan_inbox.fn(served.archive, inbox, served.settle_s, list(served.roots), apart=True)
        for inbox in served.inboxes
    ]
    said = "; ".join(state.message or "" for state in states)
    shown(forget_idle_scans)
    shown(forget_stages)
    tell_end()
    if bad := [state for state in states if not state.is_completed()]:
        return Failed(name=bad[0].name or "Failed", message=said)
    return Completed(message=said)


def _name_of_ingestion() -> str:
    """Return how an ingestion is called on the dashboard."""
    names = [str(path).rstrip("/").rpartition("/")[2] for path in flow_run.parameters["paths"]]
    return f"ingest {', '.join(names[:_NAMED])}{', ...' if len(names) > _NAMED else ''}"


@flow(name="ingest", flow_run_name=_name_of_ingestion, persist_result=False)
def ingest(
    paths: Annotated[list[PathText], Field(min_length=1, max_length=MOST_PATHS)],
    reading: Reading = Reading(),  # noqa: B008 - never changed, and shown as the form's defaults
    again: bool = False,  # noqa: FBT001, FBT002 - a switch of a form
) -> State[Any]:
    """Take motion files and captures into the archive.

    What is bad in an inbox is moved to its quarantine, unless it was read in a way of its own.

    Args:
        paths: Motion files (C3D, TRC, BVH), captures, and folders of them; full paths, or paths
            in an inbox.
        reading: How motion files are read.
        again: Also make anew what the archive has already.
    """
    served = _begin()
    options: dict[str, Any] = {"again": again, "importing": _import_settings(reading)}
    try:
        with ExitStack() as copies:
            found, faults = find_named(served, paths, copies)
            stamps = {each: stamp_of(*place) for each, place in found.items() if place}
            outcomes, said = ingest_here(served.archive, [*found], **options) if found else ({}, "")
            for path, outcome in outcomes.items():
                place = found.get(Path(path))
                if place and outcome.status == "refused" and reading == Reading():
                    move_away(*place, stamps[Path(path)], outcome.reason)
    except (InputError, ArchiveError, OSError) as error:
        return Failed(message=str(error))
    if found and not outcomes:
        return Failed(message=said)
    counts = Counter(outcome.status for outcome in outcomes.values())
    counts["refused"] += len(faults)
    faults += [o.reason for o in outcomes.values() if o.status in ("refused", "failed")]
    return state_of(counts, faults)


def _name_of_digitization() -> str:
    """Return how a digitization is called on the dashboard: by the folder, without where it is."""
    capture = str(flow_run.parameters["capture"]).rstrip("/")
    return f"digitize {capture.rpartition('/')[2]}"


@flow(name="digitize", flow_run_name=_name_of_digitization, persist_result=False)
def digitize(
    capture: PathText,
    method: Literal["as the capture says", "joint", "paper"] = "as the capture says",
    again: bool = False,  # noqa: FBT001, FBT002 - a switch of a form
) -> State[Any]:
    """Digitize a capture: films into silhouettes, voxels, colors, poses, labels and joints.

    A run that was killed goes on where it was when it is started again.

    Args:
        capture: The folder with capture.toml; a full path, or a path in an inbox.
        method: How poses are fitted. "joint" fits all segments at once; "paper" is the method of
            the digitization paper, slower and for study.
        again: Also make anew what the archive has already.
    """
    served = _begin()
    options: dict[str, Any] = {"again": again}
    if method != "as the capture says":
        options["settings"] = {"pose_fitting": {"method": method}}
    try:
        path = check_within(capture, served.roots)
        if (found := inbox_of(served, path)) is None:
            if is_url(path):
                raise InputError(f"{path!r} lies in no inbox; captures are read from there")
            return _digitize(served, Path(path), options)
        inbox, name = found
        stamp = stamp_of(inbox, name)
        with fetched(inbox, name) as copy:
            state = _digitize(served, copy, options)
        if state.name == REFUSED:
            move_away(inbox, name, stamp, state.message or "")
        return state
    except (InputError, ArchiveError) as error:
        return _refused(error)
    except OSError as error:
        return Failed(message=str(error))


@flow(name="index", flow_run_name="index the archive", persist_result=False)
def index() -> State[Any]:
    """Build the search arrays of all takes anew. Never needed, but after damage."""
    from flows.indexing import index_archive

    index_all: Any = index_archive
    return index_all.fn(_begin().archive)  # as itself and not a run inside this one


@flow(name="search", flow_run_name="search for {query}", persist_result=False)
def search(
    query: PathText,
    part: Part = "whole",
    top: Annotated[int, Field(ge=1, le=_MOST_MATCHES)] = 10,
    threshold: Annotated[float, Field(ge=0, le=100)] = 0.0,
    level: Literal["any", "same", "like"] = "any",
    mirror: bool = False,  # noqa: FBT001, FBT002 - a switch of a form
    path_weight: Annotated[float, Field(ge=0, le=100)] = 0.0,
    takes: Annotated[str, Field(max_length=200)] = "",
) -> State[Any]:
    """Find what moves like a clip, in all takes. The matches are an artifact of the run.

    Args:
        query: TAKE, TAKE:START-END, FILE or FILE:START-END; frames are inclusive.
        part: The joints to compare.
        top: At most so many matches.
        threshold: Only matches whose distance is below this; 0 for no bound.
        level: Only matches as near as the same dancer's same movement, or as another dancer's
            (like); the threshold is then not looked at.
        mirror: Also look for the motion with left and right exchanged.
        path_weight: How much it counts where the dancer goes on the floor; 0 for not at all.
        takes: Search only in takes whose name matches, such as okuri*. Empty for all.
    """
    from flows.searching import search_archive
    from tasks.retrieval.meaning.levels import threshold_of
    from tasks.retrieval.searching import SearchSettings

    served = _begin()
    settings = SearchSettings(part=part, top=top, mirror=mirror, path_weight=path_weight)
    below = (threshold or None) if level == "any" else level
    settings = replace(settings, threshold=threshold_of(below, settings))
    try:
        asked = check_query(served, query)
        answer = search_archive.fn(served.archive, asked, settings, takes or None)
    except ValueError as error:  # of the input, the archive, an unknown name, or a setting
        return _refused(error)
    return Completed(message=f"{len(answer.matches)} matches in {answer.searched_takes} takes")


@flow(name="verify", flow_run_name="verify the archive", persist_result=False)
def verify() -> State[Any]:
    """Compare all that is in the archive with what was published, byte for byte."""
    from tasks.checks.upkeep import verify_archive

    takes, faults, notes = verify_archive(_begin().archive)
    for note in notes:
        logger.info("%s", note)
    return _of_faults(faults, f"{takes} takes verified, no faults")


@flow(name="gc", flow_run_name="remove garbage", persist_result=False)
def gc(older_than_hours: Annotated[float, Field(ge=1, le=24 * 366)] = 24.0) -> State[Any]:
    """Remove from the archive what nothing refers to: what killed runs and old versions left.

    Args:
        older_than_hours: Leave alone what is younger, as somebody may still write or read it.
    """
    from storage.upkeep.garbage import collect_garbage, kept_from_garbage

    place = open_archive(_begin().archive).place
    removed = collect_garbage(place, older_than=timedelta(hours=older_than_hours))
    for note in kept_from_garbage(place):
        logger.info("%s", note)
    size_mb = sum(file.size for file in removed) / 1e6
    return Completed(message=f"removed {len(removed)} files, {size_mb:.1f} MB")


@flow(name="summarize", flow_run_name="what the day brought", persist_result=False)
def summarize(hours: Annotated[float, Field(gt=0, le=24 * 366)] = 24.0) -> State[Any]:
    """Show what was taken in, what was refused and why, and how large the archive is.

    Runs by itself each morning. The page is an artifact of the run.

    Args:
        hours: How far back to look.
    """
    from flows.service.summarizing import summarize_archive

    served = _begin()
    summarize_archive.fn(served.archive, served.inboxes, hours)
    return Completed(message=f"the last {hours:g} hours are among the artifacts")


def _begin() -> Served:
    """Return what is served, and let our modules speak in the log of the run."""
    for name in ("flows", "tasks", "storage"):
        logging.getLogger(name).setLevel(logging.INFO)
    for name in ("prefect.flow_runs", "prefect.task_runs", "prefect.engine"):
        logging.getLogger(name).addFilter(_says_more)
    return read_served()


def _says_more(record: logging.LogRecord) -> bool:
    """Say whether a line of the log is more than the end of a run, which its state shows.

    That is the traceback of one that failed, whose sentence stands there already, and each stage
    that went well, which says so itself.
    """
    if record.exc_info and isinstance(record.exc_info[1], FailedRun):
        return False
    return record.name != "prefect.task_runs" or record.levelno > logging.INFO


def _digitize(served: Served, path: Path, options: dict[str, Any]) -> State[Any]:
    """Digitize one capture, and say what became of it."""
    from flows.digitization import digitize_here  # numba and the stages: not for a scan

    outcome = digitize_here(served.archive, path, **options)
    faults = [outcome.reason] if outcome.reason else []
    return state_of(Counter([outcome.status]), faults)


def _import_settings(reading: Reading) -> Any:
    from tasks.motion.importing import ImportSettings

    up = None if reading.up == "as the file says" else reading.up
    return ImportSettings(
        scale=reading.scale_m or None, up=up, low_pass_hz=reading.low_pass_hz or None
    )


def _refused(error: Exception) -> State[Any]:
    """Return how a run ends that was asked for what cannot be."""
    logger.error("%s", error)
    return Failed(name=REFUSED, message=str(error))


def _of_faults(faults: list[str], good: str) -> State[Any]:
    """Return how a run ends that looked for faults."""
    if not faults:
        return Completed(message=good)
    shown(create_table_artifact, key="faults", table=[{"fault": fault} for fault in faults])
    for fault in faults:
        logger.error("%s", fault)
    return Failed(message=f"{len(faults)} faults: {faults[0]}")
