"""Bound from below how far a query is from every match that ends in a block of frames.

**Excess.** A warping path of `slope` steps counts the distance of a pair of frames once for each
query frame that first appears in it, and once for each take frame (but the match's first) that
first appears in it: that is what the weights of the steps come to, 2 for a diagonal, 2 + 1 for
the others. So g is a sum of I + J' - 1 distances d, and a match is within tau only where the sum
of its d - tau, its *excess*, is at most 0. The bound is one of the least excess of all paths
that end in a block. (A scan takes the path of least g, whose excess is no less.)

**One pair of blocks.** Query frames i of a block a have the mean Q, take frames j of a block b
the mean T. By the triangle inequality in each joint,

    d(i, j) >= D(a, b) - x_i - y_j,    D = sum_k w_k |Q_k - T_k|,
    x_i = sum_k w_k |q_ik - Q_k|,    y_j = sum_k w_k |t_jk - T_k|.

Along a path a take frame counts once for itself (the first frame of a match: not), and once for
each query frame that first appears with it: none, one or two; the first frame of a match has
one. That is one to three times, and the same holds for a query frame. So the sum of x_i over a
path is at most alpha, the greatest mean of x_i when every frame of the block counts one to
three times, times how often the block's frames count; all query frames are in every path. So too
with y_j and beta, of the joints' spreads (see `summaries`: the greatest mean of a sum
is at most the sum of the greatest means), as long as the path passes all frames of the block.
At its first and its last block it may not. Let each frame there that it does not pass count
once, in addition: then the whole block counts, so beta times one less than the length of a block
is subtracted, once at either end. What is missing in a block is in no path. A path's excess
therefore is at least, with W(a, b) for how often it counts in a pair of blocks,

    sum W(a, b) E(a, b) - (L - 1) beta(first) - (L - 1) beta(last),    E = D - alpha - beta - tau.

This holds for whole blocks, not for each pair of frames: so E may **not** be raised to -tau where
it is less, though no d is negative.

**Following paths.** A path is followed from query block to query block by the *unit* of the take,
a quarter of a block of the take, in which it leaves them. A query block has L / 2 to L frames, so
that between leaving one block and leaving the next, a path advances by at least (n - 1) / 2 >=
L / 4 - 1 / 2 frames, and those being whole, by one unit of L / 4 frames or more, by at most 2 n
frames, which is 8 units. Say it leaves block a - 1 in unit p and block a in unit p'. Then

- its query frames first appear in units p..p': n times the least E(a, .) of them is not more;
- the take frames of the units between p and p' all first appear in block a: a unit's length
  times E(a, .);
- those of unit p first appear in block a - 1 or in a, as p is no unit that block a - 1 was
  entered in: a unit's length times the lesser E is not more. They are counted when the path goes
  on. Where the match begins in p, fewer count, or none: a unit's length times E or 0, the lesser;
- those of unit p' are left to the next block; after the last one some of them count, or all: a
  unit's length times E or 0, the lesser.

A tile hands on E and the sums of the eight units at its end, for every query block and for
what begins there: paths that begin in a tile end in the next ones.

**Rounding.** With u = 2^-24, and A = tau + max alpha + 3 max beta. A scan sums 2 I times and over
joints: if the distance it finds is within tau, the excess of that path is at most
1.1 u (2 I + K + 8) tau W, where W <= 3 I is how often frames count. An E errs by
u (K + 12) (D + alpha + beta + tau), and as sum W E is at most 0 but for what the ends correct,
sum W D <= W A: together 3 u (K + 12) W A. Sums are rounded twelve times a query block, and none
of a path that matters leaves +-3 W A, for neither what comes before nor what comes after a
place in it can be below -W A: 36 u (blocks + 1) W A. `margin` adds these up; what is at most
the margin may be a match. Means are kept in units of a power of two, and are exact.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.retrieval.pruned.summaries import (
    MEAN_STEP,
    SPREAD_MISSING,
    SPREAD_ROOT,
    SPREAD_UNKNOWN,
    spread_row,
)
from tasks.retrieval.warping import Clip, _fill_distances

UNITS = 4
"""How many units a block of a take has."""
_REACH = 8
"""How many units a path advances in a query block at most."""
_TILE = 256
"""How many blocks are bounded at a time [blocks]. Their means stay in the second cache."""
_LANES = 32
"""A tile is padded to a multiple of so many blocks. Chosen, as in warping."""
_FAR = np.float32(1e9)
"""Further than any sum of a query gets; half of the numbers of single precision lie below 1."""
_SPREAD_UNIT = np.float32(1) / SPREAD_ROOT
"""The root of a spread, a step of its code [square roots of statures]."""
_UNIT_ROUNDING = 2.0**-24
"""How much rounding to single precision changes a number at most, over the number."""
GREATEST_VALUE = 64.0
"""Up to where a query is bounded [statures]. Twice as far as a mean reaches is eight; beyond 64 a
query is damaged, and the sums would come near to what is further than any."""


@dataclass(frozen=True, eq=False)
class CoarseClip:
    """A query in blocks, ready to be bounded. Its weights are scaled so that their sum is 1."""

    mean: NDArray[np.float32]
    """(block, 3 joints)"""
    alpha: NDArray[np.float32]
    """(block,) The greatest mean of how far its frames are from their mean."""
    size: NDArray[np.float32]
    """(block,) How many frames each has: from half the length of a take's blocks to all."""
    weights: NDArray[np.float32]
    """(joint,)"""
    columns: NDArray[np.int64]
    """(3 joints, 2) The row of each column in the means, and the one subtracted, or -1."""
    spreads: NDArray[np.int64]
    """(joint,) The row of each joint in the spreads."""
    scale: float
    """What distances of frames are multiplied by, to be those of these weights."""
    length: int
    """How many frames the blocks of a take have."""
    frames: int


def coarsen(clip: Clip, length: int) -> CoarseClip | None:
    """Return a query in blocks of at most `length` frames, or None where it cannot be bounded.

    It cannot where it is shorter than half a block, or holds values that are no motion.
    """
    frames, weights, columns = clip
    total = float(weights.astype(np.float64).sum())
    if len(frames) < length // 2 or not (np.abs(frames) <= GREATEST_VALUE).all() or total <= 0:
        return None
    scaled = (weights.astype(np.float64) / total).astype(np.float32)
    blocks = -(-len(frames) // length)
    ends = np.linspace(0, len(frames), blocks + 1).astype(int)
    mean = np.add.reduceat(frames.astype(np.float64), ends[:-1]) / np.diff(ends)[:, None]
    mean = mean.astype(np.float32)
    apart = frames.astype(np.float64) - np.repeat(mean, np.diff(ends), axis=0)
    apart = np.sqrt((apart.reshape(len(frames), -1, 3) ** 2).sum(axis=2)) @ scaled
    alpha = [_greatest_mean(part) for part in np.split(apart, ends[1:-1])]
    first = columns[::3]
    spreads = [spread_row(int(row), int(origin)) for row, origin in first]
    return CoarseClip(
        mean,
        np.nextafter(np.array(alpha, np.float32), np.float32(np.inf)),
        np.diff(ends).astype(np.float32),
        scaled,
        columns,
        np.array(spreads, np.int64),
        1 / total,
        length,
        len(frames),
    )


def _greatest_mean(values: NDArray[np.float64]) -> float:
    """Return the greatest mean of values where each counts one to three times."""
    top = np.cumsum(np.sort(values)[::-1])
    count = np.arange(1, len(values) + 1)
    means = (values.sum() + 2 * top) / (len(values) + 2 * count)
    return max(float(means.max()), float(values.mean()))


def greatest_weight(frames: int) -> int:
    """Return what no path's weights come to: those of a match are I + J' - 1, J' < 2 I."""
    return 3 * frames


def margin(clip: CoarseClip, threshold: float) -> tuple[float, float]:
    """Return (c, m): an excess up to c + m beta may be rounding, beta the greatest in a path.

    Parameters
    ----------
    threshold
        Scaled as the weights of the clip.
    """
    joints, blocks = len(clip.weights), len(clip.mean)
    weight = _UNIT_ROUNDING * greatest_weight(clip.frames)
    sums = 3 * (joints + 12) + 36 * (blocks + 1)
    scan = 1.1 * (2 * clip.frames + joints + 8) * threshold
    return weight * (scan + sums * (threshold + float(clip.alpha.max()))), weight * sums * 3


def nearest_match(
    clip: CoarseClip, threshold: float, excess: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return how near a match with at least such an excess is at least [statures].

    Its weights come to at least I + I // 2, and the margin of the excess is that of a scan too.
    """
    weight = clip.frames + clip.frames // 2
    below = np.minimum(excess.astype(np.float64), 0) / clip.scale / weight
    return np.maximum(threshold + below, 0)


def bound_ends(
    clip: CoarseClip,
    mean: NDArray[np.int16],
    spread: NDArray[np.uint8],
    spans: NDArray[np.int64],
    threshold: float,
    excess: NDArray[np.float32],
) -> None:
    """Write, for each block of the take in the spans, the least excess of a match that ends there.

    Parameters
    ----------
    clip
        The query, from `coarsen` with the length of the blocks.
    mean, spread : (row, block)
        The summaries; C-contiguous.
    spans : (span, 3) int64
        The block to begin at, the first to write, and the one after the last. Matches that begin
        before a span are not seen, so `warm_up` frames precede what is written.
    threshold
        The distance from which excess counts, of the weights of the query as it was [statures].
    excess : (block,) float32
        Written: at most the excess of any match within the threshold, less the margin of rounding:
        **above 0 there is none**. Scaled as the weights of the clip.
    """
    scaled = threshold * clip.scale
    numbers = np.array([scaled, *margin(clip, scaled)], np.float32)
    numbers = np.nextafter(numbers, np.float32(np.inf))
    query = clip.mean, clip.alpha, clip.size, clip.weights
    arrays = []
    for array in (mean, spread):
        view = array.view()
        view.flags.writeable = False  # one type, mapped or not: compiled once
        arrays.append(view)
    places = clip.columns, clip.spreads
    _bound(query, places, (arrays[0], arrays[1]), spans, (clip.length, *numbers), excess)


@njit(cache=True, nogil=True)
def _load_blocks(places: Any, arrays: Any, first: Any, end: Any, tile: Any, wide: Any) -> None:
    """Copy the means of the blocks from `first` on into the tile, in statures; then, zeros."""
    columns, mean = places[0], arrays[0]
    n = min(wide, end - first)
    for c in range(len(columns)):
        row, origin, lanes = mean[columns[c, 0]], mean[columns[c, 1]], tile[c]
        if columns[c, 1] < 0:
            for b in range(n):
                lanes[b] = np.float32(row[first + b]) * MEAN_STEP
        else:
            for b in range(n):
                lanes[b] = (np.float32(row[first + b]) - np.float32(origin[first + b])) * MEAN_STEP
        for b in range(n, wide):
            lanes[b] = np.float32(0)


@njit(cache=True, nogil=True)
def _load_spreads(w: Any, places: Any, arrays: Any, first: Any, end: Any, beta: Any) -> Any:
    """Write beta of the blocks from `first` on; return the greatest that is one.

    It is `_FAR` for a block whose spread is unknown, and -`_FAR` where nothing is in it.
    """
    spreads, spread = places[1], arrays[1]
    n = min(len(beta), end - first)
    worst = np.zeros(len(beta), np.uint8)
    for b in range(len(beta)):
        beta[b] = np.float32(0) if b < n else -_FAR
    for k in range(len(w)):
        codes = spread[spreads[k]]
        for b in range(n):
            root = np.float32(codes[first + b]) * _SPREAD_UNIT
            beta[b] += w[k] * root * root
        for b in range(n):
            worst[b] = max(worst[b], codes[first + b])
    greatest = np.float32(0)
    for b in range(n):
        if worst[b] < SPREAD_UNKNOWN:
            greatest = max(greatest, beta[b])
        else:
            beta[b] = -_FAR if worst[b] == SPREAD_MISSING else _FAR
    return greatest


@njit(cache=True, nogil=True, fastmath={"contract", "nnan", "ninf", "nsz"})
def _step(before: Any, now: Any, g: Any, h: Any, numbers: Any) -> None:
    """Follow paths through one query block: from the sums g where they enter to h where they leave.

    before, now : E of the last block and of this one, a unit; numbers : its frames, a unit's.
    """
    size, unit = numbers
    for p in range(len(now) - _REACH):
        least, crossed, best = now[p + _REACH], np.float32(0), _FAR * _FAR
        for back in range(_REACH):
            e, o = now[p + _REACH - 1 - back], before[p + _REACH - 1 - back]
            least = e if e < least else least
            o = e if e < o else o
            v = g[p + _REACH - 1 - back] + size * least + crossed + unit * o
            best = v if v < best else best
            crossed += unit * e
        h[p + _REACH] = best


@njit(cache=True, nogil=True)
def _bound(query: Any, places: Any, arrays: Any, spans: Any, options: Any, excess: Any) -> None:
    """Bound span after span, tile after tile; `edge_e` and `edge_g` hold what is left of a tile."""
    means, alpha, sizes, w = query
    length, tau, least_margin, margin_rate = options
    blocks, unit = len(means), np.float32(length // UNITS)
    tile = np.empty((means.shape[1], _TILE), np.float32)
    beta, x = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
    e = np.empty((2, _TILE * UNITS + _REACH), np.float32)
    g = np.empty((2, _TILE * UNITS + _REACH), np.float32)
    none = np.zeros(_TILE * UNITS + _REACH, np.float32)
    edge_e = np.empty((blocks, _REACH), np.float32)
    edge_g = np.empty((blocks, _REACH), np.float32)
    for s in range(len(spans)):
        edge_e[:], edge_g[:] = _FAR, _FAR
        greatest = np.float32(0)
        for first in range(spans[s, 0], spans[s, 2], _TILE):
            n = min(_TILE, spans[s, 2] - first)
            wide = (n + _LANES - 1) // _LANES * _LANES
            end = _REACH + wide * UNITS
            _load_blocks(places, arrays, first, first + n, tile, wide)
            greatest = max(
                greatest, _load_spreads(w, places, arrays, first, first + n, beta[:wide])
            )
            for b in range(wide):
                begin = -np.float32(length - 1) * beta[b]
                for q in range(UNITS):
                    g[0, _REACH + b * UNITS + q] = begin
            for a in range(blocks):
                now, before = e[a % 2, :end], e[(a + 1) % 2, :end]
                source, target = g[a % 2, :end], g[(a + 1) % 2, :end]
                _fill_distances(means[a], w, tile, x[:wide])
                for b in range(wide):
                    v = x[b] - alpha[a] - beta[b] - tau
                    for q in range(UNITS):
                        now[_REACH + b * UNITS + q] = v
                now[:_REACH], source[:_REACH] = edge_e[a], edge_g[a]
                _step(before if a else none[:end], now, source, target, (sizes[a], unit))
                edge_e[a], edge_g[a] = now[end - _REACH :], source[end - _REACH :]
            out, last = g[blocks % 2], e[(blocks - 1) % 2]
            rounding = least_margin + margin_rate * greatest
            for b in range(max(spans[s, 1] - first, 0), n):
                v = _FAR
                for q in range(UNITS):
                    p = _REACH + b * UNITS + q
                    v = min(v, out[p] + min(unit * last[p], np.float32(0)))
                excess[first + b] = v - np.float32(length - 1) * beta[b] - rounding
