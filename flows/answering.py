"""From what a user asks to an answer: find the query, open the index, search.

No Prefect here: the command line calls this directly, and the flow `search_archive` calls it too.
"""

import time
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from storage import Archive, open_archive
from storage.errors import InputError, UnknownNameError
from storage.publication import Record
from tasks.retrieval.normalization import INDEX_RATE_HZ
from tasks.searching import (
    Match,
    Query,
    SearchSettings,
    parse_query,
    query_take,
    read_packed_takes,
    search_takes,
)

if TYPE_CHECKING:
    from tasks.importing import ImportSettings


@dataclass(frozen=True)
class Answer:
    """What was found, and in what."""

    query: dict[str, Any]
    settings: SearchSettings
    matches: list[Match]
    records: dict[str, Record] = field(repr=False)
    """The records of the takes that were searched, by name."""
    skipped: dict[str, str]
    """Takes that could not be compared, and why."""
    searched_takes: int
    searched_frames: int
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """Return the answer as `search --json` prints it (DESIGN, section 6)."""
        matches = [
            {"rank": rank, **asdict(match)} for rank, match in enumerate(self.matches, start=1)
        ]
        return {
            "query": self.query,
            "settings": {**asdict(self.settings), "weights": dict(self.settings.weights)},
            "matches": matches,
            "searched": {"takes": self.searched_takes, "frames": self.searched_frames},
            "skipped": [{"take": take, "reason": why} for take, why in self.skipped.items()],
            "seconds": round(self.seconds, 3),
        }
