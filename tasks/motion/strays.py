"""Positions at which no body can be: a marker far from the body, a body far off its way."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

Positions = NDArray[np.float64]

FARTHEST_M = 1000.0
"""How far a body may be from the file's zero, and from where it is in the median. No stage is as
large, and what is stored in single precision grows coarse beyond."""
REACH_M = 5.0
"""How far a marker may be from the middle of the body. An arm reaches 1.5 m, what it holds not
much farther."""
_OFF_WAY_M = 10.0
"""How far the body may be from where it is half a second before and after. Nobody runs so far."""
_FASTEST_MPS = 15.0
"""What a body may travel where frames are seconds apart. The fastest sprinters run 12 m/s."""
_HALF_WINDOW_S = 0.5
"""Frames so far before and after tell where a body is. Chosen: damage is shorter."""
_FRAMES_AT_ONCE = 4096
"""How many frames are looked at together. It changes the memory only; chosen, not measured."""


def remove_strays(
    position: Positions, names: Sequence[str], rate_hz: float
) -> tuple[Positions, list[str], list[str]]:
    """Return the positions with NaN where no body can be, notes, and faults (a clause each).

    A marker strays where it is farther than `REACH_M` from the median of all of the frame, a whole
    frame where that median is farther than 10 m from its running median over a second, or than
    `FARTHEST_M` from where the body is in the median over the take.

    Parameters
    ----------
    position : (time, marker, 3) float64
        The markers of one body, in metres; NaN where missing.
    """
    size = np.abs(_extent(position))
    if not size.size or ((size[1] - size[0] <= REACH_M).all() and (size <= FARTHEST_M).all()):
        return position, [], []
    middle = np.concatenate([_medians(block) for block in _blocks(position)])
    seen = np.flatnonzero(~np.isnan(middle[:, 0]))
    if not len(seen):
        return position, [], []
    far_m = float(np.median(np.linalg.norm(middle[seen], axis=1)))
    if far_m > FARTHEST_M:
        fault = (
            f"the body is {_length(far_m)} from the file's zero, where {_length(FARTHEST_M)} at "
            "most is wanted: bring it near to zero, or give the metres in one unit with --scale"
        )
        return position, [], [fault]
    lost = np.zeros(len(position), bool)
    lost[seen] = _off_the_way(middle[seen], rate_hz)
    stray = np.zeros(position.shape[:2], bool)
    for start in range(0, len(position), _FRAMES_AT_ONCE):
        block = slice(start, start + _FRAMES_AT_ONCE)
        there = position[block] - middle[block, None]
        stray[block] = np.linalg.norm(there, axis=-1) > REACH_M
    stray |= lost[:, None] & ~np.isnan(position[..., 0])
    if not stray.any():
        return position, [], []
    counts = [f"{names[int(n)]} {stray[:, n].sum()}" for n in np.flatnonzero(stray.any(axis=0))]
    note = (
        f"{stray.sum()} positions are more than {REACH_M:g} m from the body, or with it more than "
        f"{_OFF_WAY_M:g} m off its way, and were taken as missing (frames of {', '.join(counts)})."
    )
    return np.where(stray[..., None], np.nan, position), [note], []


def _extent(position: Positions) -> Positions:
    """Return the least and the greatest coordinates, (2, 3), or nothing where there is none."""
    ends = [
        (np.nanmin(block, axis=(0, 1)), np.nanmax(block, axis=(0, 1)))
        for block in _blocks(position)
        if not np.isnan(block).all()
    ]
    if not ends:
        return np.zeros((0, 3))
    return np.stack([np.min([a for a, _ in ends], axis=0), np.max([b for _, b in ends], axis=0)])


def _blocks(position: Positions) -> Iterator[Positions]:
    for start in range(0, len(position), _FRAMES_AT_ONCE):
        yield position[start : start + _FRAMES_AT_ONCE]


def _medians(position: Positions) -> Positions:
    """Return the median of the markers that are there in each frame, NaN where none is."""
    middle = np.full((len(position), 3), np.nan)
    seen = ~np.isnan(position[..., 0]).all(axis=1)
    middle[seen] = np.nanmedian(position[seen], axis=1)
    return middle


def _off_the_way(middle: Positions, rate_hz: float) -> NDArray[np.bool_]:
    """Return the frames in which a body is far from where it is before and after them."""
    from scipy.ndimage import median_filter

    half = max(2, math.ceil(_HALF_WINDOW_S * rate_hz))
    usual = median_filter(middle, size=(2 * half + 1, 1), mode="mirror")
    limit = max(_OFF_WAY_M, _FASTEST_MPS * half / rate_hz)
    elsewhere = np.linalg.norm(middle - np.median(middle, axis=0), axis=1) > FARTHEST_M
    return elsewhere | (np.linalg.norm(middle - usual, axis=1) > limit)


def _length(meters: float) -> str:
    return f"{meters / 1000:,.4g} km" if meters >= 1000 else f"{meters:.3g} m"
