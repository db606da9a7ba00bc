"""Publish a version that was written: it becomes what its take is."""

import logging
from dataclasses import replace
from typing import Any

from storage import open_archive
from storage.errors import ConflictError
from storage.provenance import now
from storage.publication import Record, discard_version, publish_record
from storage.recordings import remember_source

logger = logging.getLogger(__name__)


def publish_take(archive: str, draft: dict[str, Any], *, over: int) -> None:
    """Make a version what its take is.

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
    record = replace(Record(**draft), number=over + 1, published=now())
    try:
        publish_record(place, record)
    except ConflictError:
        discard_version(place, take, record.version)
        raise
    remember_source(opened, record)
    logger.info("published take %s, version %d", take, record.number)
