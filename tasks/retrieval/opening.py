"""Open what a search reads: the segments of the index, and the takes that lie beside them."""

import itertools
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from storage.arrays.search import read_search_array
from storage.errors import ArchiveError, DamagedSegmentError
from storage.index.entries import Entry
from storage.index.segments import Label, OpenSegment
from storage.index.snapshots import Snapshot, open_snapshot
from storage.places import Place
from storage.publication import version_folder
from storage.records import Record, read_record
from storage.schema import JOINTS
from tasks.retrieval.normalization import INDEX_RATE_HZ, ROWS, sample_count
from tasks.retrieval.segments import ALIGNMENT, PackedTake, Segment

logger = logging.getLogger(__name__)

SUMMARIZED = 1
"""What kind of summaries this program makes and reads. It counts up whenever what
`summarize_rows` returns changes its meaning, so that those of another shosa are not read."""
_REQUESTS_AT_ONCE = 16
"""How many search arrays are fetched from an object store at a time. Chosen; it answers slowly, and
many at once."""
_BATCH = 1 << 18
"""How many samples of takes that lie beside the segments are in memory at once [samples]. Chosen:
72 MB."""


@dataclass(frozen=True, eq=False)
class OpenedSegment:
    """A segment as the search reads it, and the files that it is mapped from."""

    segment: Segment
    files: OpenSegment

    def without_damage(self, error: DamagedSegmentError) -> tuple["OpenedSegment", dict[str, str]]:
        """Return the segment without what `error` found damaged, and the takes that this costs."""
        if error.summary is not None:
            return replace(self, segment=replace(self.segment, summaries={})), {}
        held = self.files.label.samples > 0
        lost = self.files.damaged()[held] & self.segment.searched
        if not lost.any():  # what was read is of no take that is searched: none is believed
            lost = self.segment.searched
        names = [name for name, is_lost in zip(self.segment.names, lost, strict=True) if is_lost]
        left = replace(self.segment, searched=self.segment.searched & ~lost)
        return replace(self, segment=left), {
            name: f"take {name!r} cannot be searched: {error}" for name in names
        }


def searched_labels(
    labels: Iterable[Label], wanted: Mapping[str, str]
) -> list[tuple[Label, list[Entry], NDArray[np.bool_]]]:
    """Return the labels of segments with takes that are searched, their takes, and which are.

    Parameters are those of `open_segments`.
    """
    left = dict(wanted)
    found = []
    for label in labels:
        held = label.samples > 0
        entries = [entry for entry, is_held in zip(label.entries, held, strict=True) if is_held]
        searched = [left.get(entry.take) == entry.version for entry in entries]
        for entry in itertools.compress(entries, searched):
            del left[entry.take]  # no take is searched twice, whatever the labels say
        if any(searched):
            found.append((label, entries, np.array(searched, bool)))
    return found


def open_segments(
    place: Place, labels: Iterable[Label], wanted: Mapping[str, str]
) -> tuple[list[OpenedSegment], dict[str, str]]:
    """Return the segments that hold takes that are searched, mapped.

    Parameters
    ----------
    labels
        Of the segments of the index.
    wanted
        The version of each take that is searched, by its name. What else a segment holds is marked
        as a hole; a segment of nothing else is left out.

    Returns
    -------
    segments
        In the order of the index.
    faults
        Why takes are in none of them that the index holds, by name.
    """

    def open_one(
        label: Label, entries: list[Entry], searched: NDArray[np.bool_]
    ) -> OpenedSegment | dict[str, str]:
        held = label.samples > 0
        try:
            files = OpenSegment(place, label)
        except DamagedSegmentError as error:
            logger.warning("%s", error)
            return dict.fromkeys(
                (entry.take for entry in itertools.compress(entries, searched)), str(error)
            )
        segment = Segment(
            rows=files.rows,
            names=[entry.take for entry in entries],
            first=label.first[held],
            samples=label.samples[held],
            frames=np.array([entry.frames for entry in entries], np.int64),
            rate_hz=np.array([entry.rate_hz for entry in entries], np.float64),
            joints_present=_present(entries),
            searched=searched,
            summaries=files.summaries if label.summarized == SUMMARIZED else {},
            check=files.check,
        )
        return OpenedSegment(segment, files)

    found = searched_labels(labels, wanted)
    if place.folder:
        opened = [open_one(*each) for each in found]
    else:
        with ThreadPoolExecutor(_REQUESTS_AT_ONCE) as pool:
            opened = list(pool.map(lambda each: open_one(*each), found))
    faults: dict[str, str] = {}
    for each in opened:
        faults |= each if isinstance(each, dict) else {}
    return [each for each in opened if isinstance(each, OpenedSegment)], faults


def fit_in_memory(entries: Sequence[Entry]) -> bool:
    """Say whether takes that are in no segment are read at once, and not some at a time."""
    return sum(sample_count(entry.frames, entry.rate_hz) for entry in entries) < _BATCH


def read_lying_takes(
    place: Place, entries: Sequence[Entry]
) -> Iterator[tuple[Segment | None, dict[str, str]]]:
    """Yield takes that are in no segment, some at a time, as segments in memory.

    With each come the takes that cannot be searched, and why; the last may be None.
    """
    batch: list[PackedTake] = []
    samples = 0
    skipped: dict[str, str] = {}
    for packed, faults in _read_each(place, entries):
        skipped |= faults
        if packed is None:
            continue
        batch.append(packed)
        samples += packed.rows.shape[1]
        if samples >= _BATCH:
            yield side_by_side(batch), skipped
            batch, samples, skipped = [], 0, {}
    yield side_by_side(batch) if batch else None, skipped


def side_by_side(takes: Sequence[PackedTake]) -> Segment:
    """Return takes as a segment in memory, without summaries."""
    counts = [take.rows.shape[1] for take in takes]
    first, total = places(counts)
    rows = np.full((ROWS, total), np.nan, np.float32)
    for take, begin, count in zip(takes, first, counts, strict=True):
        rows[:, begin : begin + count] = take.rows
    return Segment(
        rows=rows,
        names=[take.name for take in takes],
        first=np.array(first, np.int64),
        samples=np.array(counts, np.int64),
        frames=np.array([take.frames for take in takes], np.int64),
        rate_hz=np.array([take.rate_hz for take in takes], np.float64),
        joints_present=np.array([take.joints_present for take in takes], bool),
        searched=np.ones(len(takes), bool),
    )


def read_doubtful(
    place: Place, entries: Iterable[Entry]
) -> tuple[dict[str, NDArray[np.bool_]], dict[str, str]]:
    """Return which frames of takes are doubtful, and why that cannot be told of some.

    Returns
    -------
    doubtful
        (frame,) of the takes that have such frames, by name.
    faults
        Why a take cannot be asked, by name.
    """
    from storage.arrays.groups import open_group  # Zarr, which few searches need

    found: dict[str, NDArray[np.bool_]] = {}
    faults: dict[str, str] = {}
    for entry in entries:
        if "pose" not in entry.stages:
            continue
        try:
            record = read_record(place, entry.take)
            files = record.files if record and record.version == entry.version else None
            folder = version_folder(entry.take, entry.version)
            pose = open_group(place, folder, "pose", files)
            doubtful = np.asarray(pose["doubtful"].values, np.bool_)
        except ArchiveError as error:
            faults[entry.take] = str(error)
            continue
        if doubtful.any():
            found[entry.take] = doubtful
    return found, faults


def leave_out(segment: Segment, doubtful: Mapping[str, NDArray[np.bool_]]) -> None:
    """Make the samples of a segment in memory missing that come of doubtful frames."""
    for name, first, samples, rate_hz in zip(
        segment.names, segment.first, segment.samples, segment.rate_hz, strict=True
    ):
        if name in doubtful:
            at = np.arange(samples) * float(rate_hz) / INDEX_RATE_HZ
            last = len(doubtful[name]) - 1
            between = [np.minimum(side(np.round(at, 6)), last) for side in (np.floor, np.ceil)]
            lost = np.logical_or.reduce([doubtful[name][each.astype(int)] for each in between])
            segment.rows[:, int(first) + np.flatnonzero(lost)] = np.nan


def places(counts: Iterable[int]) -> tuple[list[int], int]:
    """Return where takes of so many samples begin in a segment, and how many samples that has."""
    first, total = [], 0
    for count in counts:
        first.append(total)
        total += room(count)
    return first, total


def room(samples: int) -> int:
    """Return how many samples of a segment a take takes up, the missing ones after it included."""
    return -(-(samples + 1) // ALIGNMENT) * ALIGNMENT if samples else 0


def read_packed_takes(
    place: Place, records: Sequence[Record | Entry]
) -> tuple[list[PackedTake], dict[str, str]]:
    """Return the packed arrays of some takes, and which could not be opened.

    Returns
    -------
    packed
        In the order of `records`; each is known to be that of its take, and whole.
    skipped
        Why, by the name of the take: it has no motion, or its search array is missing or damaged.
    """
    snapshot = open_snapshot(place)
    packed: list[PackedTake] = []
    skipped: dict[str, str] = {}
    for record in records:
        try:
            packed.append(_take_of_segment(place, snapshot, record) or _read_lying(place, record))
        except ArchiveError as error:
            skipped[record.take] = str(error)
    return packed, skipped


def _take_of_segment(place: Place, snapshot: Snapshot, record: Record | Entry) -> PackedTake | None:
    """Return a take that a segment holds, mapped and checked."""
    at = snapshot.places.get((record.take, record.version))
    if at is None or not (label := snapshot.labels[at[0]]).samples[at[1]]:
        return None
    files = OpenSegment(place, label)
    first = int(label.first[at[1]])
    last = first + int(label.samples[at[1]])
    files.check(first, last)
    return PackedTake(
        record.take, files.rows[:, first:last], record.rate_hz, record.frames, _present([record])[0]
    )


def _read_each(
    place: Place, entries: Sequence[Entry]
) -> Iterator[tuple[PackedTake | None, dict[str, str]]]:
    """Yield each take that lies by itself, or why it cannot be searched."""
    now: list[Snapshot] = []

    def read(entry: Entry) -> tuple[PackedTake | None, dict[str, str]]:
        try:
            return _read_lying(place, entry), {}
        except ArchiveError as error:
            if not now:
                now.append(open_snapshot(place))  # a merge may have taken it up meanwhile
            found = None
            with suppress(ArchiveError):
                found = _take_of_segment(place, now[0], entry)
            return (found, {}) if found else (None, {entry.take: str(error)})

    if place.folder:
        yield from map(read, entries)
        return
    with ThreadPoolExecutor(_REQUESTS_AT_ONCE) as pool:
        for at in range(0, len(entries), _REQUESTS_AT_ONCE):
            yield from pool.map(read, entries[at : at + _REQUESTS_AT_ONCE])


def _read_lying(place: Place, record: Record | Entry) -> PackedTake:
    """Return a take that lies by itself; an ArchiveError says why it cannot be searched."""
    if "motion" not in record.stages:
        raise ArchiveError(f"take {record.take!r} has no motion, only voxels")
    rows = read_search_array(place, record.take, record.version)
    if rows.shape != (ROWS, sample_count(record.frames, record.rate_hz)):
        raise ArchiveError(
            f"the search array of take {record.take!r} has shape {rows.shape}, which is not that "
            "of its motion; run `shosa index` on the archive"
        )
    return PackedTake(record.take, rows, record.rate_hz, record.frames, _present([record])[0])


def _present(records: Sequence[Record | Entry]) -> NDArray[np.bool_]:
    """Return which joints takes have, (take, 21)."""
    held: dict[tuple[str, ...], list[bool]] = {}
    rows = []
    for record in records:
        joints = tuple(record.joints_present)
        if joints not in held:
            held[joints] = [joint in joints for joint in JOINTS]
        rows.append(held[joints])
    return np.array(rows, bool)
