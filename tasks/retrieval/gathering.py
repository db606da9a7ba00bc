"""Gather the search arrays of takes in segments of the index, and merge segments as they gather.

Arrays that lie by themselves become a segment once they are many. It takes up every segment that is
at most twice as large as what has come together so far, the smallest first, and segments of which
most was replaced or deleted. So a sample is copied a few times at most, whatever the size of the
archive, and at most a few segments are small.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import timedelta
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.arrays.search import (
    lying_search_arrays,
    read_search_array,
    remove_search_arrays,
)
from storage.errors import ArchiveError, PlaceError
from storage.index.catalogue import Listing
from storage.index.entries import Entry
from storage.index.segments import Label, OpenSegment, new_rows, rewrite_label, write_segment
from storage.index.snapshots import (
    collect_segments,
    left_lying,
    publish_snapshot,
)
from storage.places import Place, delete_files
from tasks.retrieval.normalization import ROWS, sample_count
from tasks.retrieval.opening import SUMMARIZED, places, room
from tasks.retrieval.pruned.summaries import summarize_rows

logger = logging.getLogger(__name__)

SEGMENT = 1 << 20
"""How many samples a segment has at most [samples], unless it holds one longer take. Chosen: a
quarter of a gigabyte, which a merge holds in memory."""
_MANY = 256
"""How many takes are gathered at once [takes]. A merge lists the archive, which takes a second for
100,000 takes."""
_LARGE_BYTES = 64 << 20
"""How much of takes is gathered at once, however few they are [bytes]."""
_STALE = 64
"""How many entries of a label are out of date before it is written anew [entries]. Each costs a
listing the reading of a record."""
_SUPERSEDED_FOR = timedelta(hours=1)
"""How long the files of a snapshot stay when there is a newer one. Chosen: longer than a search."""
_STRAYED_FOR = timedelta(days=1)
"""How long a file stays that belongs to no snapshot. Chosen: longer than a merge."""


@dataclass(frozen=True)
class _Piece:
    """A take on its way into a segment."""

    entry: Entry
    samples: int
    label: int | None
    """In which of the labels it is; None where it lies by itself."""
    at: int = 0
    """At which place there."""


@dataclass
class _Merge:
    """What a merge has to do, and what it did."""

    place: Place
    listing: Listing
    labels: Sequence[Label]
    faults: list[str] = field(default_factory=list)
    written: list[tuple[Label, str]] = field(default_factory=list)
    """New segments, each with the SHA-256 of its label."""
    written_labels: list[str] = field(default_factory=list)
    """The paths of new labels of old segments."""
    taken_up: list[tuple[str, str]] = field(default_factory=list)
    opened: dict[int, OpenSegment] = field(default_factory=dict)

    @cached_property
    def current(self) -> dict[str, Entry]:
        """What each take is now."""
        return {entry.take: entry for entry in self.listing.entries}


def gather_when_many(location: str) -> None:
    """Gather the search arrays of an archive where many lie by themselves; a fault is only told."""
    try:
        place = open_archive(location).place
        lying = lying_search_arrays(place)
        takes, size = left_lying(place)
        if len(lying) - takes >= _MANY or sum(lying.values()) - size >= _LARGE_BYTES:
            for fault in gather_segments(location):
                logger.warning("%s", fault)
    except (ArchiveError, PlaceError) as error:
        logger.warning("the index of %s was not merged: %s", location, error)


def gather_segments(location: str, *, anew: bool = False) -> list[str]:
    """Put all search arrays that lie by themselves into segments, and merge small segments.

    It may be killed at any moment: the index stays as it was. Where another merge is faster, that
    of this call is dropped.

    Parameters
    ----------
    location
        A directory or s3://bucket/prefix.
    anew
        Take nothing over from the segments of before.

    Returns
    -------
    list of str
        What could not be taken over, a sentence each.

    Raises
    ------
    PlaceError
        If the disk or object store does not do what is asked: full, away.
    """
    archive = open_archive(location)
    lying = lying_search_arrays(archive.place)
    listing = archive.listing()
    snapshot = listing.snapshot
    merge = _Merge(archive.place, listing, () if anew else snapshot.labels)
    kept, pieces = _plan(merge, {*lying})
    try:
        for group in _groups(pieces):
            _write_group(merge, group)
        stay = [
            _refreshed(merge, merge.labels[number], snapshot.digests[number]) for number in kept
        ]
    except BaseException:
        with suppress(PlaceError):
            _discard(merge)
        raise
    is_new = merge.written or merge.written_labels or len(stay) < len(snapshot.labels)
    taken_up = {*merge.taken_up} & {*lying}
    if not is_new and not taken_up and not snapshot.faults:
        return merge.faults
    left = [size for version, size in lying.items() if version not in taken_up]
    is_first = publish_snapshot(  # where it fails, it may be there all the same: nothing is removed
        archive.place,
        snapshot.newest + 1,
        [*stay, *merge.written],
        left=(len(left), sum(left)),
    )
    if not is_first:
        logger.info("another merge of the index of %s was faster", location)
        _discard(merge)
        return []
    remove_search_arrays(archive.place, taken_up)
    collect_segments(archive.place, _SUPERSEDED_FOR, _STRAYED_FOR)
    takes = sum(len(label.entries) for label, _ in merge.written)
    logger.info("gathered %d takes in %d segments", takes, len(merge.written))
    return merge.faults


def _plan(merge: _Merge, lying: set[tuple[str, str]]) -> tuple[list[int], list[_Piece]]:
    """Return which segments stay as they are, and the takes that new ones are made of."""
    held: set[str] = set()
    damaged: set[int] = set()
    pieces: list[list[_Piece]] = []
    for number in range(len(merge.labels)):
        pieces.append([])
        for piece in _live(merge, number):
            version = piece.entry.take, piece.entry.version
            if version[0] in held:
                continue
            if version in lying:  # of a merge that was killed, or made again
                if not _is_whole(merge, piece):
                    damaged.add(number)
                    continue
                merge.taken_up.append(version)
            held.add(version[0])
            pieces[-1].append(piece)
    beside = []
    for entry in merge.listing.entries:
        if entry.take not in held:
            if "motion" not in entry.stages:
                beside.append(_Piece(entry, 0, None))
            elif (entry.take, entry.version) in lying:
                beside.append(_Piece(entry, sample_count(entry.frames, entry.rate_hz), None))
    live = [sum(room(each.samples) for each in found) for found in pieces]
    whole = [label.rows.shape[1] for label in merge.labels]
    gathered = sum(room(each.samples) for each in beside)
    merged = _choose_merged(live, whole, gathered, damaged)
    kept = [number for number in range(len(merge.labels)) if number not in merged]
    return kept, [each for number in sorted(merged) for each in pieces[number]] + beside


def _live(merge: _Merge, number: int) -> Iterator[_Piece]:
    """Yield what a segment holds that still is of a take."""
    label = merge.labels[number]
    for at, (entry, samples) in enumerate(zip(label.entries, label.samples.tolist(), strict=True)):
        now = merge.current.get(entry.take)
        if entry.take in merge.listing.faults:
            now = entry  # its record may be put back
        if now is not None and now.version == entry.version:
            yield _Piece(now, samples, number, at)


def _choose_merged(
    live: Sequence[int], whole: Sequence[int], gathered: int, damaged: set[int]
) -> set[int]:
    """Return which segments are merged with samples that are gathered anyway.

    Parameters
    ----------
    live, whole
        How many samples of each segment are still of a take, and how many it has.
    gathered
        How many there are beside them.
    damaged
        The segments that are merged in any case.
    """
    merged = damaged | {number for number, count in enumerate(live) if count < whole[number] / 2}
    gathered += sum(live[number] for number in merged)
    for number in sorted(range(len(live)), key=lambda number: live[number]):
        if number not in merged and live[number] <= min(2 * gathered, SEGMENT // 2):
            merged.add(number)
            gathered += live[number]
    return merged


def _groups(pieces: Sequence[_Piece]) -> list[list[_Piece]]:
    """Return the takes of each new segment."""
    groups: list[list[_Piece]] = []
    total = SEGMENT
    for each in pieces:
        if not groups or (total + room(each.samples) > SEGMENT and total):
            groups.append([])
            total = 0
        groups[-1].append(each)
        total += room(each.samples)
    return groups


def _write_group(merge: _Merge, group: Sequence[_Piece]) -> None:
    """Write a segment of takes; what is damaged is left out and told."""
    first, total = places(each.samples for each in group)
    content = new_rows(ROWS, total)
    done: list[tuple[_Piece, int]] = []
    for each, begin in zip(group, first, strict=True):
        try:
            if each.samples:
                content[1][:, begin : begin + each.samples] = _rows_of(merge, each)
        except ArchiveError as error:
            merge.faults.append(f"take {each.entry.take!r} was not taken into a segment: {error}")
            continue
        done.append((each, begin))
    if done:
        merge.written.append(
            write_segment(
                merge.place,
                [each.entry for each, _ in done],
                [merge.listing.stamps.get(each.entry.take) for each, _ in done],
                [(begin, each.samples) for each, begin in done],
                content,
                summarize_rows(content[1]) if total else {},
                summarized=SUMMARIZED,
            )
        )
        merge.taken_up += [(each.entry.take, each.entry.version) for each, _ in done]


def _rows_of(merge: _Merge, piece: _Piece) -> NDArray[np.float32]:
    """Return the rows of a take from where it is; an ArchiveError if they have changed."""
    if piece.label is None:
        rows = read_search_array(merge.place, piece.entry.take, piece.entry.version)
        if rows.shape != (ROWS, piece.samples):
            raise ArchiveError(f"its search array has shape {rows.shape}; run `shosa index`")
        return rows
    if piece.label not in merge.opened:
        merge.opened[piece.label] = OpenSegment(merge.place, merge.labels[piece.label])
    files = merge.opened[piece.label]
    first = int(files.label.first[piece.at])
    files.check(first, first + piece.samples)
    return files.rows[:, first : first + piece.samples]


def _is_whole(merge: _Merge, piece: _Piece) -> bool:
    try:
        _rows_of(merge, piece)
    except ArchiveError:
        return False
    return True


def _refreshed(merge: _Merge, label: Label, sha256: str) -> tuple[Label, str]:
    """Return a label that stays, or a new one where many of its entries are out of date."""
    stamps = merge.listing.stamps
    entries: list[Entry] = []
    new: list[Any] = []
    for entry, stamp in zip(label.entries, label.stamps, strict=True):
        now = merge.current.get(entry.take)
        is_held = now is not None and now.version == entry.version
        entries.append(now if now is not None and is_held else entry)
        new.append(stamps.get(entry.take) if is_held else stamp)
    stale = sum(old != now for old, now in zip(label.stamps, new, strict=True))
    if stale < _STALE:
        return label, sha256
    found = rewrite_label(merge.place, label, entries, new)
    merge.written_labels.append(found[0].path)
    return found


def _discard(merge: _Merge) -> None:
    """Remove what was written of a merge that did not become the index."""
    paths = [path for label, _ in merge.written for path in label.files]
    delete_files(merge.place, [*paths, *merge.written_labels])
