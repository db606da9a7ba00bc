"""Search all takes of an archive: those in the index's segments, and those that lie beside them.

Segments are searched in threads of this process, or each by a worker of a cluster. A worker is
given the distance within which the best matches are that were found until then, and so leaves out
what cannot be one of them. The answer is the same to the last bit.
"""

import itertools
import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, replace

from storage import open_archive
from storage.errors import ArchiveError, DamagedSegmentError, InputError
from storage.index.catalogue import Listing
from storage.index.entries import Entry
from storage.index.segments import read_label
from storage.places import Place
from tasks.retrieval.opening import (
    OpenedSegment,
    fit_in_memory,
    leave_out,
    open_segments,
    read_doubtful,
    read_lying_takes,
    searched_labels,
)
from tasks.retrieval.searching import Found, Match, Query, SearchSettings, best_matches
from tasks.retrieval.segment_search import search_gradually
from tasks.retrieval.segments import Segment

logger = logging.getLogger(__name__)

Tell = Callable[[list[Match], int], None]
"""What is told while a search goes on: matches, and how many of them are certain."""


@dataclass(frozen=True)
class Cluster:
    """Workers, on this or other machines, that see the archive by the same address."""

    workers: Executor
    at_once: int
    """How many segments they search at a time, each in one thread."""


def search_archive(
    place: Place,
    listing: Listing,
    searched: Sequence[Entry],
    query: Query,
    settings: SearchSettings,
    *,
    tell: Tell | None = None,
    cluster: Cluster | None = None,
) -> Found:
    """Return the matches of a query in takes.

    Parameters
    ----------
    place, listing
        The archive, and what it holds.
    searched
        The takes to be searched, of those that are listed.
    tell
        Called with the best matches until then, and how many of them, the nearest, are certain to
        stay, as often as more is known. What it raises ends the search.
    cluster
        What searches the segments of the index, in place of threads of this process.

    Raises
    ------
    ValueError
        If a setting has no meaning, or the query lacks a value that would be compared.
    ArchiveError
        If a worker does not see the archive.
    """
    doubtful, unread = {}, {}
    if settings.skip_doubtful:
        doubtful, unread = read_doubtful(place, searched)
    searched = [entry for entry in searched if entry.take not in unread]
    wanted = {
        entry.take: entry.version
        for entry in searched
        if "motion" in entry.stages and entry.take not in doubtful
    }
    found: list[Found] = []
    if cluster is None:
        opened, faults = open_segments(place, listing.snapshot.labels, wanted)
        held = {
            name
            for each in opened
            for name, is_searched in zip(each.segment.names, each.segment.searched, strict=True)
            if is_searched
        }
    else:
        opened, faults = [], {}
        snapshot = listing.snapshot
        paths = (label.path for label in snapshot.labels)
        sha256 = dict(zip(paths, snapshot.digests, strict=True))
        parts = [
            (
                (label.path, sha256[label.path]),
                {entry.take: entry.version for entry in itertools.compress(entries, asked)},
            )
            for label, entries, asked in searched_labels(snapshot.labels, wanted)
        ]
        for some, lost in _spread(place, parts, query, settings, cluster):
            found.append(some)
            faults |= lost
            if tell is not None:  # what is left may hold nearer ones
                tell(_best(found, settings.top), 0)
        held = {name for _, names in parts for name in names} - faults.keys()
    lying = [entry for entry in searched if entry.take not in held]
    at_once = fit_in_memory(lying)

    def tell_all(some: Found) -> None:
        assert tell is not None
        matches = _best([*found, some], settings.top)
        certain = some.certain_below if at_once else 0.0
        tell(matches, sum(match.distance < certain for match in matches))

    # not all in memory at once, where there are many
    for segment, skipped in read_lying_takes(place, lying):
        skipped = {take: faults.get(take, why) for take, why in skipped.items()}
        if segment:
            leave_out(segment, doubtful)
        found.append(_search_whole(query, opened, segment, settings, skipped, tell and tell_all))
        opened = []
    return Found(
        _best(found, settings.top),
        {take: why for each in found for take, why in each.skipped.items()} | unread,
        frozenset().union(*(each.too_short for each in found)),
    )


def search_label(
    location: str,
    label: tuple[str, str],
    wanted: Mapping[str, str],
    query: Query,
    settings: SearchSettings,
) -> tuple[Found, dict[str, str]]:
    """Return the matches in one segment: what a worker of a cluster does.

    Parameters
    ----------
    location
        Where the archive is.
    label
        The path and the SHA-256 of the segment's label.
    wanted
        The version of each take in it that is searched, by its name.

    Returns
    -------
    found
        As of `search_archive`.
    faults
        Why takes could not be read from it, by name.

    Raises
    ------
    ArchiveError
        If there is no archive here.
    """
    try:
        place = open_archive(location).place
    except InputError as error:
        raise ArchiveError(f"a worker does not see the archive: {error}") from error
    try:
        read = read_label(place, *label)
    except DamagedSegmentError as error:
        return Found([], {}), dict.fromkeys(wanted, str(error))
    opened, faults = open_segments(place, [read], wanted)
    return _search_whole(query, opened, None, settings, {}, threads=1), faults


def _spread(
    place: Place,
    parts: Sequence[tuple[tuple[str, str], Mapping[str, str]]],
    query: Query,
    settings: SearchSettings,
    cluster: Cluster,
) -> Iterator[tuple[Found, dict[str, str]]]:
    """Yield what workers find in each segment, and what could not be read of it.

    `parts` are label and takes of each, as of `search_label`.
    """
    location = str(place.folder.resolve()) if place.folder else place.location
    waiting = iter(parts)
    found: list[Found] = []
    running: set[Future[tuple[Found, dict[str, str]]]] = set()
    try:
        while True:
            within = replace(settings, threshold=_within(found, settings))
            # no more than work at a time: what begins later is given a smaller distance
            while len(running) < cluster.at_once and (asked := next(waiting, None)):
                running.add(cluster.workers.submit(search_label, location, *asked, query, within))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for each in done:
                found.append(each.result()[0])
                yield each.result()
    finally:
        for each in running:
            each.cancel()


def _within(found: Sequence[Found], settings: SearchSettings) -> float | None:
    """Return the distance below which everything lies that may still be one of the best."""
    best = _best(found, settings.top)
    if len(best) < settings.top:
        return settings.threshold
    farthest = math.nextafter(best[-1].distance, math.inf)  # as near as it may come before it
    return farthest if settings.threshold is None else min(farthest, settings.threshold)


def _best(found: Sequence[Found], top: int) -> list[Match]:
    """Return the best matches of several answers."""
    return best_matches((match for each in found for match in each.matches), top)


def _search_whole(
    query: Query,
    opened: list[OpenedSegment],
    lying: Segment | None,
    settings: SearchSettings,
    skipped: dict[str, str],
    tell: Callable[[Found], None] | None = None,
    *,
    threads: int | None = None,
) -> Found:
    """Return the matches in segments; of what turns out to be damaged nothing is answered."""
    while True:
        segments = [each.segment for each in opened] + ([] if lying is None else [lying])
        found = Found([], {})
        try:
            for found in search_gradually(query, segments, settings, threads=threads):
                if tell is not None:
                    tell(found)
        except DamagedSegmentError as error:
            logger.warning("%s", error)
            at = [each.files.label.path for each in opened].index(error.label)
            opened = [*opened]
            opened[at], lost = opened[at].without_damage(error)
            skipped = skipped | lost
            continue
        return Found(found.matches, skipped | found.skipped, found.too_short)
