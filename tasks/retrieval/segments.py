"""Many takes laid side by side, as a search reads them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

ALIGNMENT = 16
"""At multiples of how many samples a take begins in a segment. So no block of a summary holds
samples of two takes."""


@dataclass(frozen=True, eq=False)
class PackedTake:
    """A take as the search reads it."""

    name: str
    rows: NDArray[np.float32]
    """(row, sample) from `pack_motion`; may be mapped into memory."""
    rate_hz: float
    """Frames a second of the take itself."""
    frames: int
    joints_present: NDArray[np.bool_]
    """(21,) from `joints_present`."""


@dataclass(frozen=True, eq=False)
class Segment:
    """Takes side by side in one array, and what tells where a query cannot be.

    Each take begins at a multiple of `ALIGNMENT` samples, and at least one sample that is missing
    (NaN) follows it, so that no match reaches from one take into the next.
    """

    rows: NDArray[np.float32]
    """(69, sample) as `pack_motion` makes them, take after take; may be mapped into memory."""
    names: Sequence[str]
    """The take at each place."""
    first: NDArray[np.int64]
    """(take,) The sample at which each take begins."""
    samples: NDArray[np.int64]
    """(take,) How many samples each has."""
    frames: NDArray[np.int64]
    """(take,) How many frames each has."""
    rate_hz: NDArray[np.float64]
    """(take,) Frames a second of each."""
    joints_present: NDArray[np.bool_]
    """(take, 21)"""
    searched: NDArray[np.bool_]
    """(take,) False for what was replaced or deleted since, or is not asked for: a hole."""
    summaries: Mapping[str, NDArray] = field(default_factory=dict)
    """What `summarize_rows` made of the rows, by name; empty where nothing was made."""
    check: Callable[[int, int], None] | None = None
    """Raises an ArchiveError where the samples from one to before another are not what was
    written; called before they are compared, for what has changed could also hide a match."""
