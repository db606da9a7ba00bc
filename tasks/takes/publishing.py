"""Publish a version that was written: it becomes what its take is."""

import logging
from dataclasses import replace
from typing import Any

from storage import open_archive
from storage.describing import keep_words
from storage.errors import ArchiveError, ConflictError
from storage.places import Place
from storage.provenance import now
from storage.publication import discard_version, publish_record
from storage.records import Record, read_numbered_record, read_record
from storage.sources import remember_source

logger = logging.getLogger(__name__)


def publish_take(archive: str, draft: dict[str, Any], *, over: int) -> None:
    """Make a version what its take is; words that a person has given it meanwhile are kept.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix.
    draft
        The fields of its `Record`.
    over
        The number of the version that it replaces, 0 where there is none yet.

    Raises
    ------
    ConflictError
        If another run published the take in the meantime; what was written is removed then.
    """
    opened = open_archive(archive)
    place, take = opened.place, draft["take"]
    before = read_record(place, take)
    if before is not None and before.number > over and _only_words_since(place, before, over):
        over = before.number
    record = replace(Record(**draft), number=over + 1, published=now())
    if before is not None:
        metadata, replaced = keep_words(before, record.metadata)
        record = replace(record, metadata=metadata, replaced=replaced)
    try:
        publish_record(place, record)
    except ConflictError:
        discard_version(place, take, record.version)
        raise
    remember_source(opened.place, record)
    logger.info("published take %s, version %d", take, record.number)


def _only_words_since(place: Place, now_: Record, number: int) -> bool:
    """Say whether a take has the same data as in its record with this number."""
    try:
        return number > 0 and read_numbered_record(place, now_.take, number).version == now_.version
    except ArchiveError:
        return False
