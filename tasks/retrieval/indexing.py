"""Make the arrays that a search reads, take by take.

A take is normalized, resampled to the index rate and packed once, when it is published
(retrieval paper, 3.3; the paper's section 5 asks for index data). The cost of one take does
not depend on the size of the archive.
"""

import logging

from storage import open_archive
from storage.arrays.groups import open_group
from storage.arrays.search import (
    search_array_digest,
    search_digest,
    verify_search_array,
    write_search_array,
)
from storage.index.snapshots import open_snapshot
from storage.publication import version_folder
from storage.records import read_record
from tasks.motion.stature import DEFAULT_STATURE_M
from tasks.retrieval.normalization import pack_motion
from tasks.retrieval.opening import read_packed_takes

logger = logging.getLogger(__name__)


def index_take(archive: str, take: str, version: str) -> str:
    """Write the packed array of one version of a take; return its SHA-256."""
    place = open_archive(archive).place
    record = read_record(place, take)
    files = record.files if record and record.version == version else None  # not published yet
    motion = open_group(place, version_folder(take, version), "motion", files)
    stature_m = motion.attrs["stature_m"]
    rows = pack_motion(
        motion["position"].values,
        float(motion.attrs["rate_hz"]),
        DEFAULT_STATURE_M if stature_m is None else float(stature_m),
    )
    digest = write_search_array(place, take, version, rows)
    logger.info("indexed take %s: %d samples", take, rows.shape[1])
    return digest


def find_index(archive: str, take: str, version: str) -> str | None:
    """Return the SHA-256 of what `index_take` wrote of a version, None where it is not whole."""
    place = open_archive(archive).place
    if (take, version) in open_snapshot(place).places:
        record = read_record(place, take)
        if record is not None and record.version == version:
            packed, _ = read_packed_takes(place, [record])
            return search_digest(packed[0].rows) if packed else None
    whole = not verify_search_array(place, take, version)
    return search_array_digest(place, take, version) if whole else None
