"""Captures into takes: the chain of stages as a Prefect flow."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.states import Failed

from flows import chain
from flows.dashboard import progress_teller, show_digitized
from flows.outcomes import REFUSED, Outcome, outcome_of, refused, tell
from flows.progress import ASSEMBLING, tell_compiled
from flows.runners import spread_blocks
from storage import create_archive, open_archive
from storage.blocks import Block, Written, discard_blocks
from storage.errors import ArchiveError, InputError, PlaceError
from storage.formats.capture.capture import capture_of
from storage.formats.capture.capture_toml import MARK
from storage.formats.settings_toml import SETTINGS_FILE, read_capture_settings
from storage.recordings import Recording, plan_takes
from storage.sources import remember_source, take_of_content
from tasks.cached import run_once
from tasks.engine.compiling import compiling_beside
from tasks.retrieval.gathering import gather_when_many
from tasks.retrieval.indexing import index_take
from tasks.settings import (
    Settings,
    changed_settings,
    merge_tables,
    read_settings,
    settings_of_stages,
)
from tasks.takes.assembling import assemble_take
from tasks.takes.beginning import Blocks, beginning_beside
from tasks.takes.identity import code_of, find_same, why_anew
from tasks.takes.publishing import publish_take

logger = logging.getLogger(__name__)


@flow(name="digitize_take", flow_run_name="digitize {recording.take}", persist_result=False)
def digitize_take(
    archive: str,
    recording: Recording,
    settings: dict[str, Any] | None = None,
    again: bool = False,  # noqa: FBT001, FBT002 - Prefect passes parameters by name
) -> dict[str, Any] | State[Any]:
    """Run `make_take`, whose arguments these are, so that the dashboard shows it.

    What is the fault of the capture or the archive is raised where the result is asked for; the log
    of the run has its sentence, without a traceback.
    """
    try:
        return make_take(archive, recording, settings, again=again)
    except InputError as error:
        return Failed(name=REFUSED, message=str(error), data=error)
    except (ArchiveError, PlaceError) as error:
        return Failed(message=str(error), data=error)


def digitize_here(
    archive: str, path: Path, settings: dict[str, Any] | None = None, *, again: bool = False
) -> Outcome:
    """Digitize one capture as part of the run that calls this; return what became of it.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix; made if it is not there.
    path
        Of the capture.
    settings, again
        As of `make_take`.

    Raises
    ------
    InputError
        If there is no capture at `path`.
    """
    if not path.is_dir():
        raise InputError(f"{path} is no capture; name a folder with {MARK}")
    plan = plan_takes(create_archive(archive), [path])
    if plan.refusals:
        return refused(plan.refusals[0])
    [recording] = plan.recordings

    def take_in() -> tuple[dict[str, Any], bool]:
        draft = make_take(archive, recording, settings, again=again)
        return draft, draft["published"]

    return tell(outcome_of(recording, take_in), 1, 1)


def make_take(
    archive: str,
    recording: Recording,
    settings: dict[str, Any] | None = None,
    *,
    again: bool = False,
) -> dict[str, Any]:
    """Take a capture into the archive at `archive`, stage after stage, block after block.

    A run that was killed is gone on with, on whatever machine: the blocks that it finished are not
    computed again.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix.
    recording
        The capture.
    settings
        Tables as in a file of settings (`{"pose_fitting": {"method": "paper"}}`), which come
        before those of the capture's `digitize.toml`.
    again
        Make the take anew, though the archive has it.

    Returns
    -------
    dict
        The fields of the take's `Record`, and `published`: False where the archive had it.

    Raises
    ------
    InputError
        If the capture cannot be digitized, with all that is wrong.
    """
    chosen, notes = choose_settings(recording, settings or {})
    opened = open_archive(archive)
    changed = changed_settings(chosen)
    reason, record = why_anew(opened, recording, changed)
    if record and not reason and not again:
        if take_of_content(opened.place, recording.digest) is None:
            remember_source(opened.place, record)  # of a run that was killed before
        return {**asdict(record), "published": False}
    if record and record.source["digest"] == recording.digest:
        logger.info("%s is digitized anew: %s", recording.take, reason or "it was asked for")
    made: list[Block] = []
    try:
        draft, blocks = _make_draft(archive, recording, chosen, notes, made)
        publish_take(archive, draft, over=record.number if record else 0)
    except ArchiveError:
        # another run that took in the same has published it, and removed the blocks
        other = None if again else find_same(opened, recording, changed)
        if other is None:
            raise
        discard_blocks(opened.place, made)
        return {**asdict(other), "published": False}
    discard_blocks(opened.place, made)
    gather_when_many(opened.location)
    take = opened.take(recording.take)
    show_digitized(take, blocks)
    return {**asdict(take.record), "published": True}


def _make_draft(
    archive: str, recording: Recording, chosen: Settings, notes: list[str], made: list[Block]
) -> tuple[dict[str, Any], Blocks]:
    """Run all stages; return the draft of the record, and the blocks, which `made` gets at once."""

    def run(function: Callable[..., Written], **parameters: Any) -> Written:
        written = run_once(function, **parameters)
        made.append(written.block)
        return written

    def run_blocks(*stage_and_calls: Any) -> Iterator[Written]:
        for written in spread(*stage_and_calls) if spread else ():
            made.append(written.block)
            yield written

    spread = spread_blocks()
    capture = capture_of(recording.path, recording.digest)
    tell = progress_teller(recording.take, capture.frames)
    named = (archive, recording.path, recording.digest, recording.take)
    tables = settings_of_stages(chosen)
    with beginning_beside(*named, tables) as begin:
        with compiling_beside(tell_compiled):
            blocks, found = chain.digitize(
                archive,
                recording,
                chosen,
                run=run,
                tell=tell,
                run_blocks=run_blocks if spread else None,
                begin=begin,
            )
        tell(ASSEMBLING, 0)
        draft = assemble_take(
            *named,
            blocks,
            settings=tables,
            changed=changed_settings(chosen),
            code=code_of("capture"),
            notes=[*notes, *found],
            begun=begin(blocks).result(),
        )
    if "motion" in draft["stages"]:
        run_once(index_take, archive=archive, take=draft["take"], version=draft["version"])
    tell(ASSEMBLING, capture.frames)
    return draft, blocks


def choose_settings(recording: Recording, given: dict[str, Any]) -> tuple[Settings, list[str]]:
    """Return the settings of a capture, those that were given first, and what both set."""
    own = read_capture_settings(Path(recording.path))
    read_settings(own, f"{recording.path}/{SETTINGS_FILE}")  # its faults are told as its own
    merged, both = merge_tables(own, given)
    notes = [
        f"{name} is set by {SETTINGS_FILE} and, otherwise, by the settings of this run: the "
        "latter were taken."
        for name in both
    ]
    return read_settings(merged, "the settings of this run").that_are_read(), notes
