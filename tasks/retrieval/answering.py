"""From what a user asks to an answer: find the query, open the index, search.

No Prefect here: the command line calls this directly, and the flow `search_archive` calls it too.
Notebooks call `find_matches`.
"""

import logging
import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from storage import Archive, open_archive
from storage.errors import ArchiveError, InputError, UnknownNameError
from storage.formats import MOTION_SUFFIXES
from storage.index.catalogue import Listing
from storage.index.entries import Entry
from storage.schema import parse_frames
from tasks.motion.stature import DEFAULT_STATURE_M
from tasks.retrieval.archive_search import Cluster, Tell, search_archive
from tasks.retrieval.meaning.chance import Chance, choose_pieces, cut_piece, measure_pieces
from tasks.retrieval.meaning.levels import level_of, level_thresholds, threshold_of
from tasks.retrieval.normalization import sample_count
from tasks.retrieval.opening import read_packed_takes
from tasks.retrieval.searching import Match, Query, SearchSettings, clip_motion, clip_take

if TYPE_CHECKING:
    import pandas

    from tasks.motion.importing import ImportSettings

logger = logging.getLogger(__name__)

_COLUMNS = {
    "rank": int,
    "take": object,
    "start": int,
    "end": int,
    "distance": float,
    "mirrored": bool,
    "level": object,
    "chance": float,
    "performer": object,
    "title": object,
}
"""The columns of a table of matches, those of a `Match` among them in its order."""

_SHOWN = 80
"""How much of a query that cannot be understood is shown [characters]. Chosen: a line."""


@dataclass(frozen=True)
class Answer:
    """What was found, and in what."""

    query: dict[str, Any]
    settings: SearchSettings
    matches: list[Match]
    records: dict[str, Entry] = field(repr=False)
    """What is known of the takes that were searched, by name."""
    skipped: dict[str, str]
    """Takes that could not be compared, and why."""
    searched_takes: int
    searched_frames: int
    seconds: float
    chance: Chance = field(default_factory=Chance, repr=False)
    """How near the clips of these takes are to the query by chance."""

    def meaning(self, match: Match) -> dict[str, Any]:
        """Return what the distance of a match means, as JSON: its `level` and `chance`, or None."""
        chance = self.chance.of(match.distance)
        return {
            "level": level_of(match.distance, self.settings),
            "chance": None if chance is None else float(f"{chance:.3g}"),
        }

    def as_json(self) -> dict[str, Any]:
        """Return the answer as `search --json` prints it (docs/contract.md, section 6)."""
        matches = [
            {"rank": rank, **asdict(match), **self.meaning(match)}
            for rank, match in enumerate(self.matches, start=1)
        ]
        return {
            "query": self.query,
            "settings": _settings_as_json(self.settings),
            "matches": matches,
            "levels": level_thresholds(self.settings),
            "clips": {"searched": self.chance.clips, "sampled": len(self.chance.distance)},
            "searched": {"takes": self.searched_takes, "frames": self.searched_frames},
            "skipped": [{"take": take, "reason": why} for take, why in self.skipped.items()],
            "seconds": round(self.seconds, 3),
        }


def answer_query(
    location: str,
    text: str,
    settings: SearchSettings,
    takes: str | None = None,
    imported: "ImportSettings | None" = None,
    tell: Tell | None = None,
    cluster: Cluster | None = None,
) -> Answer:
    """Search the archive at `location` for what moves like the query in `text`.

    Parameters
    ----------
    text
        TAKE[:START-END] or FILE[:START-END], frames 0-based and inclusive.
    takes
        Search only in takes whose names fit this pattern (`*`, `?`, `[...]`).
    imported
        How a query file is to be read.
    tell, cluster
        As of `search_archive`.

    Raises
    ------
    InputError
        If there is no archive, the query file cannot be used, or no take can be compared. That all
        takes are too short is no error: nothing is found then.
    UnknownNameError
        If the query take is not there, or no take fits the pattern.
    ArchiveError
        If a worker of the cluster does not see the archive.
    ValueError
        If the clip or a setting is impossible.
    """
    begin = time.perf_counter()
    archive = open_archive(location)
    listing = archive.listing()
    for fault in listing.snapshot.faults:
        logger.warning("%s", fault)
    query, asked = find_query(archive, listing, text, imported)

    def is_searched(take: str) -> bool:
        return takes is None or fnmatchcase(take, takes)

    searched = [entry for entry in listing.entries if is_searched(entry.take)]
    skipped = {take: why for take, why in listing.faults.items() if is_searched(take)}
    if not searched and not skipped:
        raise UnknownNameError(_no_take(archive, listing.entries, takes))
    found = search_archive(
        archive.place, listing, searched, query, settings, tell=tell, cluster=cluster
    )
    skipped |= found.skipped
    if not found.too_short and not {record.take for record in searched} - skipped.keys():
        reasons = "; ".join(f"{take}: {why}" for take, why in list(skipped.items())[:3])
        raise InputError(f"none of the {len(skipped)} takes can be compared ({reasons})")
    compared = [record for record in searched if record.take not in skipped]
    return Answer(
        query=asked,
        settings=settings,
        matches=found.matches,
        records={record.take: record for record in compared},
        skipped=skipped,
        searched_takes=len(compared),
        searched_frames=sum(record.frames for record in compared),
        chance=_measure_chance(archive, compared, query, settings),
        seconds=time.perf_counter() - begin,
    )


def find_matches(
    archive: Archive | str | os.PathLike[str],
    query: str,
    *,
    part: str = "whole",
    weights: Mapping[str, float] | None = None,
    top: int = 10,
    threshold: float | str | None = None,
    mirror: bool = False,
    path_weight: float = 0.0,
    skip_doubtful: bool = False,
    steps: str = "slope",
    takes: str | None = None,
) -> "pandas.DataFrame":
    """Return what moves like a query as a table, as `shosa search` prints it.

    Parameters
    ----------
    archive
        An open archive, or where it is: a directory or a URL.
    query
        TAKE[:START-END] or FILE[:START-END], frames 0-based and inclusive.
    weights
        Joint to weight, in place of the part's: 1 for its joints, 0 for the others.
    threshold
        Only matches nearer than this: statures, or the name of a level, "same" or "like".
    part, top, mirror, path_weight, skip_doubtful, steps
        As in `SearchSettings`.
    takes
        Search only in takes whose names fit this pattern (`*`, `?`, `[...]`).

    Returns
    -------
    pandas.DataFrame
        A row a match, the nearest first: `rank`, `take`, `start`, `end` (frames of the take,
        inclusive), `distance` (statures), `mirrored`, `level` ("same", "like" or None), `chance`
        (the share of the archive's clips that are so near by chance; NaN where the archive is too
        small to tell), `performer` and `title` (None where the metadata have none).
        `attrs["skipped"]` says by take what could not be compared, and why; `attrs["query"]` and
        `attrs["settings"]` what was asked.

    Raises
    ------
    InputError, UnknownNameError, ValueError
        As `answer_query`.
    """
    import pandas  # only for a table: 0.4 s that the command line need not pay

    location = archive.location if isinstance(archive, Archive) else os.fspath(archive)
    settings = SearchSettings(
        part=part,
        weights=tuple((weights or {}).items()),
        steps=steps,
        mirror=mirror,
        path_weight=path_weight,
        skip_doubtful=skip_doubtful,
        top=top,
    )
    settings = replace(settings, threshold=threshold_of(threshold, settings))
    answer = answer_query(location, query, settings, takes)
    rows = []
    for rank, match in enumerate(answer.matches, start=1):
        about = answer.records[match.take].metadata
        meaning = answer.meaning(match).values()
        named = about.get("performer"), about.get("title")
        rows.append((rank, *astuple(match), *meaning, *named))
    columns = zip(*rows, strict=True) if rows else [()] * len(_COLUMNS)
    table = pandas.DataFrame(
        {
            name: pandas.Series(
                values, dtype=kind
            )  # each with its kind: pandas guesses None as NaN
            for (name, kind), values in zip(_COLUMNS.items(), columns, strict=True)
        }
    )
    asked = {"query": query, "settings": _settings_as_json(settings)}  # a file may hold them
    table.attrs |= {"skipped": answer.skipped, **asked}
    return table


def _settings_as_json(settings: SearchSettings) -> dict[str, Any]:
    """Return what a search compares as JSON can hold it."""
    return {**asdict(settings), "weights": dict(settings.weights)}


def parse_query(text: str) -> tuple[str, tuple[int, int] | None]:
    """Return the take or file of a query, and its frames if it names them.

    Raises
    ------
    ValueError
        If the frames are not two whole numbers in order.
    """
    name, colon, frames = text.rpartition(":")
    if not colon or not re.fullmatch(r"[\d-]+", frames):
        return text, None
    try:
        return name, parse_frames(frames)
    except ValueError:
        raise ValueError(
            f"the frames of the query {text[:_SHOWN]!r} should be START-END, such as "
            f"{name[:_SHOWN]}:400-560"
        ) from None


def _measure_chance(
    archive: Archive, compared: Sequence[Entry], query: Query, settings: SearchSettings
) -> Chance:
    """Return how near the clips of the takes that were compared are by chance."""
    samples = [sample_count(entry.frames, entry.rate_hz) for entry in compared]
    chosen = choose_pieces(samples, query.rows.shape[1])
    asked = [compared[which] for which in dict.fromkeys(which for which, _, _ in chosen)]
    packed, _ = read_packed_takes(archive.place, asked)
    by_name = {take.name: take for take in packed}
    pieces = [
        cut_piece(by_name[compared[which].take], first, count)
        for which, first, count in chosen
        if compared[which].take in by_name
    ]
    return measure_pieces(query, pieces, sum(samples), settings)


def find_query(
    archive: Archive,
    listing: Listing,
    text: str,
    imported: "ImportSettings | None",
) -> tuple[Query, dict[str, Any]]:
    """Return the query in `text`, and how an answer speaks of it; raises as `answer_query`."""
    name, clip = parse_query(text)
    if Path(name).suffix.lower() in MOTION_SUFFIXES:
        from tasks.motion.importing import (  # only where a file is read
            ImportSettings,
            read_joint_track,
        )

        track, _ = read_joint_track(Path(name), imported or ImportSettings())
        stature_m = track.stature_m or DEFAULT_STATURE_M
        query = clip_motion(track.position, track.rate_hz, stature_m, clip, name=name)
        frames, rate_hz, asked = len(track.position), track.rate_hz, {"file": name}
    else:
        record = next((e for e in listing.entries if e.take == name), None)
        record = record or archive.take(name).record
        packed, faults = read_packed_takes(archive.place, [record])
        if faults:
            raise ArchiveError(faults[name])
        query = clip_take(packed[0], *(clip or (0, record.frames - 1)))
        frames, rate_hz, asked = record.frames, record.rate_hz, {"take": name}
    start, end = clip or (0, frames - 1)
    return query, {**asked, "start": start, "end": end, "rate_hz": rate_hz}


def _no_take(archive: Archive, records: Sequence[Entry], takes: str | None) -> str:
    """Say that there is nothing to search in."""
    if not records:
        return f"the archive {archive.place.location} has no takes; `shosa ingest` brings some in"
    return f"no take of {archive.place.location} is called {takes!r}; it has " + ", ".join(
        [record.take for record in records[:5]] + ["..."] * (len(records) > 5)
    )
