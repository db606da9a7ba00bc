"""Publish a version that was written: it becomes what its take is."""

import logging
from dataclasses import replace
from typing import Any

from storage import open_archive
from storage.provenance import now
from storage.publication import (
    Record,
    next_number,
    publish_record,
    read_record,
)
from storage.recordings import remember_source

logger = logging.getLogger(__name__)


def publish_take(archive: str, draft: dict[str, Any]) -> bool:
    """Make a version what its take is; return False where it already was.

    Raises
    ------
    ConflictError
        If another run published the take in the meantime.
    """
    opened = open_archive(archive)
    place, take = opened.place, draft["take"]
    current = read_record(place, take)
    if current and current.version == draft["version"]:
        return False
    number = next_number(place, take)
    record = replace(Record(**draft), number=number, published=now())
    publish_record(place, record)
    remember_source(opened, record)
    logger.info("published take %s, version %d", take, number)
    return True
