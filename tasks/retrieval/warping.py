"""Warp a query onto every part of a take, and select matches (retrieval paper, section 3.1).

The whole query, frames i = 1..I, is matched with any part of a take, frames j. The steps are
weighted 1-2-1, and G(i, j) tracks the frame at which the best match of (i, j) starts:

    slope  (default) Sakoe and Chiba's symmetric steps, P = 1 (1978): g(1, j) = d(1, j), and
           g(i, j) is the least of  g(i-1, j-1) + 2 d(i, j),
           g(i-1, j-2) + 2 d(i, j-1) + d(i, j)  and  g(i-2, j-1) + 2 d(i-1, j) + d(i, j).
    paper  equations (1) and (2) as printed, where g(i, 1) accumulates, the third line of (2)
           adds d, and a match ends at j. On dance its matches collapse to a few frames.

Of equal sums the step written first is taken. The distance of the match that ends at j is
g(I, j) / (I + J' - 1), J' = j - G(I, j) + 1 frames long.

No step of `slope` stays in a row i, so that rows are computed over many j at once. A take is
read a tile of frames at a time, straight from its packed rows; beside a tile, the last two
columns of g are all that is kept. What is missing (NaN) is infinitely far away.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.retrieval.normalization import INDEX_RATE_HZ

STEPS = ("slope", "paper")
"""The names of the steps."""

_TILE = 512
"""How many frames of a take are warped at a time. Their 54 rows stay in the second cache, and the
row's set-up is shared."""
_LANES = 64
"""A tile is padded to a multiple of so many frames. No loop has a rest then to round in another
way."""
_BLOCK = 256
"""How many ends stand behind one remembered best end, when matches are selected. It changes the
speed only; chosen, not measured."""
_INF = np.float32(np.inf)
_GREATEST = 3e38
"""Up to where a threshold is one: near the greatest number of single precision."""
_LOOK = 8
"""After how many rows it is looked whether a tile can be left. Chosen: it costs little then."""

Clip = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]
"""A query ready to be warped: its frames (frame, 3 joints), C-contiguous; the weight of each
joint; and (3 joints, 2) the packed row of each column and the row subtracted from it, or -1.
"""


def shortest_match(frames: int, steps: str) -> int:
    """Return how many frames the shortest match of a query of `frames` frames has."""
    return 1 + frames // 2 if steps == "slope" else 1


def warm_up(frames: int) -> int:
    """Return how many frames before its end a match with `slope` steps may start."""
    return 2 * frames - 2


def warp(
    clip: Clip,
    rows: NDArray[np.float32],
    span: tuple[int, int, int],
    distance: NDArray[np.float32],
    start: NDArray[np.int32],
    *,
    steps: str = "slope",
) -> None:
    """Write, for each frame of a take, the best match of the query that ends there.

    Parameters
    ----------
    clip
        The query.
    rows : (row, frame) float32
        The packed take; C-contiguous, may be mapped into memory. Lengths are in frames of the
        index rate.
    span
        The frame to begin at, the first end to write, and the frame after the last one. With
        `slope` steps, the ends are those of the whole take if `warm_up` frames precede them.
    distance, start : (frame,) float32, int32
        Written for the ends in the span: the distance, infinite where no match ends, and the
        match's first frame, of no meaning there.
    """
    warp_spans(clip, rows, np.array([span]), distance, start, steps=steps)


def warp_spans(
    clip: Clip,
    rows: NDArray[np.float32],
    spans: NDArray[np.int64],
    distance: NDArray[np.float32],
    start: NDArray[np.int32],
    *,
    steps: str = "slope",
    threshold: float = math.inf,
) -> None:
    """Write the best matches that end in many spans, a row of `spans` each, as `warp` one's.

    With a threshold, a tile is left as soon as no match through it can be within: all distances
    up to the threshold are as they were, and what is beyond may become infinite. A sum of more than
    3 I times the threshold, I the frames of the query, never comes to a distance within it: sums
    do not fall, in single precision either, and no path counts as often. So it does not matter
    that a path left had a lesser sum than the one found in its place.
    """
    view = np.ascontiguousarray(rows).view()
    view.flags.writeable = False  # one type, mapped or not: compiled once
    slope = steps == "slope"
    limit = np.float32(min(3.0 * len(clip[0]) * threshold if slope else math.inf, _GREATEST))
    _warp(clip, view, spans, (distance, start), slope, np.nextafter(limit, _INF))


def select_matches(
    distance: NDArray[np.float32],
    start: NDArray[np.int32],
    rate_hz: float,
    *,
    threshold: float = math.inf,
    top: int = 10,
) -> list[tuple[int, int, int, float]]:
    """Return the nearest matches of a take that share no frame of it.

    Parameters
    ----------
    distance, start : (version, sample) float32, int32
        The matches ending at each sample, from `warp`, for one or more versions of the query.
        `distance` is used up: what is taken or dropped becomes infinite.
    rate_hz
        The rate of the take; matches are disjoint in its frames, not only in the samples.
    threshold, top
        Only distances below the one, and at most as many as the other.

    Returns
    -------
    list of (version, start, end, distance)
        In samples; by distance, then start, then end, then version.
    """
    top = min(top, distance.shape[1])
    found = np.empty((top, 3), np.int64)
    value = np.empty(top, np.float32)
    count = _select(distance, start, rate_hz, threshold, found, value)
    return [
        (int(version), int(first), int(last), float(near))
        for (version, first, last), near in zip(found[:count], value[:count], strict=True)
    ]


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_joint(q: Any, weight: Any, tile: Any, d: Any) -> None:
    """Add the weighted distance of one joint to a row."""
    x, y, z = q[0], q[1], q[2]
    tx, ty, tz = tile[0], tile[1], tile[2]
    for j in range(len(d)):
        a, b, c = x - tx[j], y - ty[j], z - tz[j]
        d[j] += weight * math.sqrt(a * a + b * b + c * c)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_three_joints(q: Any, weights: Any, tile: Any, d: Any) -> None:
    """Add the weighted distances of three joints to a row, which is read and written once."""
    x0, y0, z0, x1, y1, z1, x2, y2, z2 = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7], q[8]
    w0, w1, w2 = weights[0], weights[1], weights[2]
    tx0, ty0, tz0, tx1, ty1, tz1 = tile[0], tile[1], tile[2], tile[3], tile[4], tile[5]
    tx2, ty2, tz2 = tile[6], tile[7], tile[8]
    for j in range(len(d)):
        s = d[j]
        a, b, c = x0 - tx0[j], y0 - ty0[j], z0 - tz0[j]
        s += w0 * math.sqrt(a * a + b * b + c * c)
        a, b, c = x1 - tx1[j], y1 - ty1[j], z1 - tz1[j]
        s += w1 * math.sqrt(a * a + b * b + c * c)
        a, b, c = x2 - tx2[j], y2 - ty2[j], z2 - tz2[j]
        s += w2 * math.sqrt(a * a + b * b + c * c)
        d[j] = s


@njit(cache=True, nogil=True)
def _load_tile(rows: Any, columns: Any, first: Any, end: Any, tile: Any, wide: Any) -> None:
    """Copy the frames from `first` on into the tile, less their origin; from `end` on, NaN."""
    n = min(wide, end - first)
    for c in range(len(columns)):
        row, origin, lanes = rows[columns[c, 0]], rows[columns[c, 1]], tile[c]
        if columns[c, 1] < 0:
            for j in range(n):
                lanes[j] = row[first + j]
        else:
            for j in range(n):
                lanes[j] = row[first + j] - origin[first + j]
        for j in range(n, wide):
            lanes[j] = np.nan


@njit(cache=True, nogil=True)
def _fill_distances(q: Any, weights: Any, tile: Any, d: Any) -> None:
    """Write the distances of one query frame to the frames of a tile; missing is infinite."""
    for j in range(len(d)):
        d[j] = np.float32(0)
    joints = len(weights)
    grouped = joints - joints % 3
    for k in range(0, grouped, 3):
        _add_three_joints(q[3 * k :], weights[k:], tile[3 * k :], d)
    for k in range(grouped, joints):
        _add_joint(q[3 * k :], weights[k], tile[3 * k :], d)
    for j in range(len(d)):
        x = d[j]
        d[j] = x if x < _INF else _INF


@njit(cache=True, nogil=True)
def _step_slope(e: Any, x: Any, g: Any, s: Any, n: Any) -> None:
    """Write a row of g and its starts from the two before; columns begin two frames early.

    e, x : the distances of the row before and of this one.
    """
    g2, g1, g0 = g
    s2, s1, s0 = s
    for j in range(n):  # every value is loaded, and no index is negative: so it is vectorized
        now = x[j + 2]
        diagonal, diagonal_start = g1[j + 1] + (now + now), s1[j + 1]
        along, along_start = g1[j] + (x[j + 1] + x[j + 1]) + now, s1[j]
        up, up_start = g2[j + 1] + (e[j + 2] + e[j + 2]) + now, s2[j + 1]
        nearer = along < diagonal
        best = along if nearer else diagonal
        first = along_start if nearer else diagonal_start
        nearer = up < best
        g0[j + 2] = up if nearer else best
        s0[j + 2] = up_start if nearer else first


@njit(cache=True, nogil=True)
def _step_paper(x: Any, g: Any, s: Any, n: Any) -> None:
    """Write a row of g and its starts with equations (1) and (2), frame after frame."""
    _, g1, g0 = g
    _, s1, s0 = s
    for j in range(2, n + 2):
        now = x[j]
        best, first = g1[j] + now, s1[j]
        diagonal = g1[j - 1] + (now + now)
        if diagonal < best:
            best, first = diagonal, s1[j - 1]
        along = g0[j - 1] + now
        if along < best:
            best, first = along, s0[j - 1]
        g0[j], s0[j] = best, first


@njit(cache=True, nogil=True)
def _any_within(g: Any, n: Any, edge: Any, limit: Any) -> Any:
    """Say whether a path goes on from a row, or comes from the left after it, within a limit."""
    least = _INF
    for j in range(n + 2):
        least = min(least, g[j])
    for i in range(len(edge)):
        least = min(least, edge[i, 1], edge[i, 2])
    return least <= limit


@njit(cache=True, nogil=True)
def _warp(clip: Any, rows: Any, spans: Any, out: Any, slope: Any, limit: Any) -> None:
    """Warp span after span."""
    widest = 0
    for span in spans:
        widest = max(widest, span[2] - span[0])
    width = min(_TILE, (widest + _LANES - 1) // _LANES * _LANES)
    query = clip[0]
    tile = np.empty((query.shape[1], width), np.float32)
    d = np.empty((2, width + 2), np.float32)
    g = np.empty((3, width + 2), np.float32)
    s = np.zeros((3, width + 2), np.int32)
    edge = np.empty((len(query), 3), np.float32)
    edge_start = np.empty((len(query), 2), np.int32)
    for span in spans:
        edge[:], edge_start[:] = _INF, span[0]
        work = tile, d, g, s, edge, edge_start
        _warp_span(clip, rows, span, work, out, (slope, limit))


@njit(cache=True, nogil=True)
def _warp_span(clip: Any, rows: Any, span: Any, work: Any, out: Any, options: Any) -> None:
    """Warp tile after tile; `edge` holds the columns left of the tile, a row a query frame."""
    query, weights, columns = clip
    tile, d, g, s, edge, edge_start = work
    distance, start = out
    slope, limit = options
    frames, width = len(query), tile.shape[1]
    begin, written, end = span[0], span[1], span[2]
    for first in range(begin, end, width):
        n = min(width, (end - first + _LANES - 1) // _LANES * _LANES)
        _load_tile(rows, columns, first, end, tile, n)
        g[:] = _INF
        for i in range(frames):
            x, e = d[i % 2], d[(i + 1) % 2]
            g0, g1, g2 = g[i % 3], g[(i + 2) % 3], g[(i + 1) % 3]
            s0, s1, s2 = s[i % 3], s[(i + 2) % 3], s[(i + 1) % 3]
            _fill_distances(query[i], weights, tile, x[2 : n + 2])
            x[1], g0[0], g0[1] = edge[i, 0], edge[i, 1], edge[i, 2]
            s0[0], s0[1] = edge_start[i, 0], edge_start[i, 1]
            if i == 0:
                for j in range(n):
                    g0[j + 2], s0[j + 2] = x[j + 2], first + j
            elif slope:
                _step_slope(e, x, (g2, g1, g0), (s2, s1, s0), n)
            else:
                _step_paper(x, (g2, g1, g0), (s2, s1, s0), n)
            edge[i, 0], edge[i, 1], edge[i, 2] = x[n + 1], g0[n], g0[n + 1]
            edge_start[i, 0], edge_start[i, 1] = s0[n], s0[n + 1]
            if i % _LOOK == _LOOK - 1 and not _any_within(g0, n, edge[i + 1 :], limit):
                edge[i + 1 :] = _INF
                edge_start[i + 1 :] = first
                g[(frames - 1) % 3, :] = _INF
                s[(frames - 1) % 3, :] = first
                break
        g0, s0 = g[(frames - 1) % 3], s[(frames - 1) % 3]
        for j in range(max(first, written), min(first + n, end)):
            first_frame = s0[j - first + 2]
            distance[j] = g0[j - first + 2] / np.float32(frames + j - first_frame)
            start[j] = first_frame


@njit(cache=True, nogil=True)
def _frame(sample: Any, rate_hz: Any) -> Any:
    """Return the take's frame nearest to a sample, as `normalization.frame_of_sample`."""
    return math.floor(sample * rate_hz / INDEX_RATE_HZ + 0.5)


@njit(cache=True, nogil=True)
def _precedes(distance: Any, start: Any, a: Any, b: Any) -> Any:
    """Say whether the match that ends at a comes before the one that ends at b."""
    if distance[a] != distance[b]:
        return distance[a] < distance[b]
    if start[a] != start[b]:
        return start[a] < start[b]
    return a < b


@njit(cache=True, nogil=True)
def _remember_blocks(distance: Any, start: Any, first: Any, last: Any, best: Any) -> None:
    """Write the best end of each block that holds one of the ends `first` to `last`."""
    for block in range(first // _BLOCK, last // _BLOCK + 1):
        near = block * _BLOCK
        for j in range(near + 1, min((block + 1) * _BLOCK, len(distance))):
            if distance[j] < distance[near] or (
                distance[j] == distance[near] and _precedes(distance, start, j, near)
            ):
                near = j
        best[block] = near


@njit(cache=True, nogil=True)
def _nearest(distance: Any, start: Any, best: Any) -> Any:
    """Return the version and end of the best match left."""
    version, end = 0, best[0, 0]
    for v in range(len(best)):
        for near in best[v]:
            a, b = distance[v, near], distance[version, end]
            if a < b or (a == b and (start[v, near], near) < (start[version, end], end)):
                version, end = v, near
    return version, end


@njit(cache=True, nogil=True)
def _select(distance: Any, start: Any, rate_hz: Any, threshold: Any, found: Any, value: Any) -> Any:
    """Take the best match, drop what shares a frame with it, and again; return how many."""
    versions, samples = distance.shape
    best = np.empty((versions, (samples + _BLOCK - 1) // _BLOCK), np.int32)
    reach = 0
    for v in range(versions):
        _remember_blocks(distance[v], start[v], 0, samples - 1, best[v])
        for j in range(samples):
            if distance[v, j] < threshold:
                reach = max(reach, j - start[v, j])
    for count in range(len(found)):
        version, end = _nearest(distance, start, best)
        if not distance[version, end] < threshold:
            return count
        first = start[version, end]
        found[count, 0], found[count, 1], found[count, 2] = version, first, end
        value[count] = distance[version, end]
        low, high = first, end
        while low > 0 and _frame(low - 1, rate_hz) >= _frame(first, rate_hz):
            low -= 1
        while high < samples - 1 and _frame(high + 1, rate_hz) <= _frame(end, rate_hz):
            high += 1
        last = min(high + reach, samples - 1)
        for v in range(versions):
            dropped = distance[v, low : last + 1]
            dropped[start[v, low : last + 1] <= high] = _INF
            _remember_blocks(distance[v], start[v], low, last, best[v])
    return len(found)
