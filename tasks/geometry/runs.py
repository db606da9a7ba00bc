"""Runs of True along an axis."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


def inner_runs(flags: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield start and stop of each run of True that touches neither end."""
    for start, stop in runs(flags):
        if start > 0 and stop < len(flags):
            yield start, stop


def runs(flags: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield start and stop (exclusive) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
