"""Open what a search reads: the packed arrays of the takes of an archive."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from storage.arrays.search import open_search_array
from storage.errors import ArchiveError
from storage.places import Place
from storage.publication import Record
from storage.schema import JOINTS
from tasks.retrieval.normalization import ROWS, sample_count
from tasks.retrieval.segments import PackedTake

_REQUESTS_AT_ONCE = 16
"""How many search arrays are fetched from an object store at a time. Chosen; it answers slowly, and
many at once."""


def read_packed_takes(
    place: Place, records: Sequence[Record]
) -> tuple[list[PackedTake], dict[str, str]]:
    """Return the packed arrays of takes, mapped on a disk, and which could not be opened.

    Returns
    -------
    packed
        In the order of `records`; each is known to be that of its take, and whole.
    skipped
        Why, by the name of the take: it has no motion, or its search array is missing or damaged.
    """
    if place.folder:
        found = [_open_packed(place, record) for record in records]
    else:
        with ThreadPoolExecutor(_REQUESTS_AT_ONCE) as pool:
            found = list(pool.map(lambda record: _open_packed(place, record), records))
    packed = [each for each in found if isinstance(each, PackedTake)]
    named = zip(records, found, strict=True)
    return packed, {record.take: each for record, each in named if isinstance(each, str)}


def _open_packed(place: Place, record: Record) -> PackedTake | str:
    """Return the packed array of a take, or why it cannot be searched."""
    if "motion" not in record.stages:
        return f"take {record.take!r} has no motion, only voxels"
    try:
        rows = open_search_array(place, record.take, record.version)
    except ArchiveError as error:
        return str(error)
    if rows.shape != (ROWS, sample_count(record.frames, record.rate_hz)):
        return (
            f"the search array of take {record.take!r} has shape {rows.shape}, which is not that "
            "of its motion; run `shosa index` on the archive"
        )
    present = np.array([joint in record.joints_present for joint in JOINTS])
    return PackedTake(record.take, rows, record.rate_hz, record.frames, present)
