"""Summarize packed takes: where each joint is in a block of frames, and how far from it at most.

A block is 4 or 8 samples. What is kept of it does not depend on any query or weight: the mean of
every packed row, and for every joint one number that says how far its frames are from their mean.
`bounds` derives from the two how near a query can be to what is in the block.

That number is the greatest mean distance when each sample counts one, two or three times, for so
often a frame counts in a warping path (see there). It is kept rounded up, so that it is never too
small; joints whose origin may be the shoulders' middle have a second one about that.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.engine.kernels import njit
from tasks.retrieval.normalization import PARTS, PATH_ROWS, ROWS, SHOULDER_ROWS

BLOCKS = (4, 8)
"""How many samples the blocks have. A take begins at a multiple of every one of them."""
UPPER_JOINTS = tuple(k for k, name in enumerate(JOINTS) if name in {*PARTS["arms"], *PARTS["head"]})
"""The joints that may be compared about the shoulders; their second spread is in this order."""

MEAN_STEP = np.float32(1 / 8192)
"""The unit of a mean [statures]. A quarter of a millimeter; 16 bits reach four statures then."""
SPREAD_ROOT = np.float32(161)
"""A spread is (code / 161)^2 statures: 253, the last code, is two and a half."""
SPREAD_UNKNOWN = np.uint8(254)
"""The code of a spread too great to be written."""
SPREAD_MISSING = np.uint8(255)
"""The code of a joint that no sample of the block has."""

_TRIPLES = np.array(
    [
        *((3 * k, -1) for k in range(len(JOINTS))),
        *((3 * k, SHOULDER_ROWS.start) for k in UPPER_JOINTS),
        (PATH_ROWS.start, -1),
    ],
    np.int64,
)
"""(spread row, 2) The first of the three packed rows of each spread, and of those subtracted."""
SPREAD_ROWS = len(_TRIPLES)
"""How many spreads a block has: of 21 joints, of 10 about the shoulders, of the path."""

SUMMARIES: dict[str, tuple[type, int, int]] = {
    f"{kind}_{block}": (dtype, rows, block)
    for block in BLOCKS
    for kind, dtype, rows in (("mean", np.int16, ROWS), ("spread", np.uint8, SPREAD_ROWS))
}
"""The type, the rows and the samples a block of each array of `summarize_rows`."""

_INFLATION = np.float32(1 + 1e-5)
"""By how much a spread is raised before it is rounded up. Summing 24 numbers of single precision
errs by less than a third of it."""
_MEAN_REACH = np.float32(32767)
"""The greatest mean of 16 bits [`MEAN_STEP`]."""


def spread_row(row: int, origin: int) -> int:
    """Return the spread of the three packed rows from `row` on, less those from `origin` on.

    Parameters
    ----------
    row
        The first row of a joint, or of the path.
    origin
        The first row of the shoulders' middle, or -1 where nothing is subtracted.
    """
    return _PLACE[row, origin]


_PLACE = {(int(row), int(origin)): place for place, (row, origin) in enumerate(_TRIPLES)}


def summarize_rows(rows: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    """Return the summaries of packed rows, the arrays that `SUMMARIES` names.

    Parameters
    ----------
    rows : (69, sample) float32
        Takes side by side as in a `Segment`, or one; C-contiguous.

    Returns
    -------
    dict
        `mean_4`, `mean_8` : (69, block) int16, of the samples of a block that are there;
        `spread_4`, `spread_8` : (32, block) uint8. The last block may be of fewer samples.
    """
    view = np.ascontiguousarray(rows).view()
    view.flags.writeable = False  # one type, mapped or not: compiled once
    made: dict[str, NDArray[Any]] = {
        name: np.empty((count, -(-rows.shape[1] // block)), dtype)
        for name, (dtype, count, block) in SUMMARIES.items()
    }
    for block in BLOCKS:
        _summarize(view, block, _TRIPLES, made[f"mean_{block}"], made[f"spread_{block}"])
    return made


@njit(cache=True, nogil=True)
def _worst_mean(x: Any, n: Any) -> Any:
    """Return the greatest mean of x[:n] where each value counts one to three times; sorts x."""
    total = np.float32(0)
    for i in range(n):
        value, j = x[i], i
        total += value
        while j > 0 and x[j - 1] < value:
            x[j] = x[j - 1]
            j -= 1
        x[j] = value
    worst, top = total / np.float32(n), np.float32(0)
    for i in range(n):
        top += x[i]
        worst = max(worst, (total + top + top) / np.float32(n + 2 * (i + 1)))
    return worst


@njit(cache=True, nogil=True)
def _average(row: Any, first: Any, last: Any) -> Any:
    """Return the mean of what is there of row[first:last], in its unit, within what is kept."""
    total, n = np.float32(0), 0
    for j in range(first, last):
        if math.isfinite(row[j]):
            total += row[j]
            n += 1
    if n == 0:
        return np.float32(0)
    units = np.rint(total / np.float32(n) / MEAN_STEP)
    return min(max(units, -_MEAN_REACH), _MEAN_REACH)  # an infinite sum is the greatest


@njit(cache=True, nogil=True)
def _summarize(rows: Any, length: Any, triples: Any, mean: Any, spread: Any) -> None:
    """Write the means of every row and the spreads of every joint, block after block."""
    samples = rows.shape[1]
    for r in range(len(mean)):
        for b in range(mean.shape[1]):
            first = b * length
            mean[r, b] = np.int16(_average(rows[r], first, min(first + length, samples)))
    x = np.empty(length, np.float32)
    for s in range(len(triples)):
        row, origin = triples[s, 0], triples[s, 1]
        for b in range(spread.shape[1]):
            n = 0
            for j in range(b * length, min((b + 1) * length, samples)):
                square = np.float32(0)
                for c in range(3):
                    value, center = rows[row + c, j], np.float32(mean[row + c, b])
                    if origin >= 0:
                        value -= rows[origin + c, j]
                        center -= np.float32(mean[origin + c, b])
                    apart = value - center * MEAN_STEP
                    square += apart * apart
                if square == square:
                    x[n] = math.sqrt(square)
                    n += 1
            if n == 0:
                spread[s, b] = SPREAD_MISSING
                continue
            code = np.ceil(math.sqrt(_worst_mean(x, n) * _INFLATION) * SPREAD_ROOT)
            spread[s, b] = np.uint8(code) if code < SPREAD_UNKNOWN else SPREAD_UNKNOWN
