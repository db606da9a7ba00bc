"""Captures into takes: the chain of stages as a Prefect flow."""

import hashlib
import logging
from dataclasses import asdict
from pathlib import Path
from typing import Any

from prefect import flow

from flows import chain
from flows.dashboard import progress_teller, show_digitized
from flows.progress import ASSEMBLING
from flows.runners import spread_blocks
from storage import open_archive
from storage.blocks import discard_blocks
from storage.formats.capture.capture import capture_of
from storage.formats.settings_toml import SETTINGS_FILE, read_capture_settings
from storage.publication import read_record
from storage.recordings import Recording
from tasks.cached import run_once
from tasks.engine.fingerprints import fingerprint
from tasks.retrieval.indexing import index_take
from tasks.settings import (
    Settings,
    changed_settings,
    merge_tables,
    read_settings,
    settings_of_stages,
)
from tasks.takes.assembling import assemble_take, is_digitized
from tasks.takes.publishing import publish_take

logger = logging.getLogger(__name__)


@flow(name="digitize_take", flow_run_name="digitize {recording.take}", persist_result=False)
def digitize_take(
    archive: str, recording: Recording, settings: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Take a capture into the archive at `archive`, stage after stage, block after block.

    A run that was killed is gone on with: the blocks that it finished are not computed again.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix.
    recording
        The capture.
    settings
        Tables as in a file of settings (`{"pose_fitting": {"method": "paper"}}`), which come
        before those of the capture's `digitize.toml`.

    Returns
    -------
    dict
        The fields of the take's `Record`, and `published`: False where the archive had it.

    Raises
    ------
    InputError
        If the capture cannot be digitized, with all that is wrong.
    """
    chosen, notes = _choose_settings(recording, settings or {})
    identity = _identity(recording, chosen)
    opened = open_archive(archive)
    if is_digitized(opened, recording.take, identity):
        return {**asdict(opened.take(recording.take).record), "published": False}
    _say_why_again(read_record(opened.place, recording.take), recording)
    capture = capture_of(recording.path, recording.digest)
    tell = progress_teller(recording.take, capture.frames)
    blocks, found = chain.digitize(
        archive, recording, chosen, run=run_once, tell=tell, run_blocks=spread_blocks()
    )
    tell(ASSEMBLING, 0)
    draft = assemble_take(
        archive,
        recording.path,
        recording.digest,
        recording.take,
        blocks,
        settings=settings_of_stages(chosen),
        changed=changed_settings(chosen),
        identity=identity,
        notes=[*notes, *found],
    )
    if "motion" in draft["stages"]:
        run_once(index_take, archive=archive, take=draft["take"], version=draft["version"])
    tell(ASSEMBLING, capture.frames)
    publish_take(archive, draft)
    discard_blocks(opened.place, recording.take, recording.digest)
    record = read_record(opened.place, recording.take)
    assert record is not None  # it was published just now
    show_digitized(opened.take(recording.take), blocks)
    return {**asdict(record), "published": True}


def _choose_settings(recording: Recording, given: dict[str, Any]) -> tuple[Settings, list[str]]:
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


def _identity(recording: Recording, settings: Settings) -> str:
    """Name what makes a take what it is: the capture, the settings and the code."""
    parts = [
        fingerprint(chain.digitize, {"settings": settings}),
        fingerprint(assemble_take, {}),
        recording.digest,
    ]
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def _say_why_again(record: Any, recording: Recording) -> None:
    """Say why a capture that the archive has is computed anew."""
    if record and record.source.get("digest") == recording.digest:
        logger.info(
            "%s: digitized anew: version %d is of other settings or of another version of the "
            "program, or was damaged",
            recording.take,
            record.number,
        )
