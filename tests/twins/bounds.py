"""Slow twins of the bound on a search, in float64, importing nothing of ours."""

import itertools
import math

import numpy as np


def least_excess(d, threshold):
    """Return, for each end, the least sum of d - threshold of all paths of the symmetric steps.

    Counted as the steps weigh: 2 d; 2 d + d; 2 d + d. It is what no bound may exceed.
    """
    e = np.pad(np.asarray(d, float) - threshold, ((0, 0), (2, 0)), constant_values=math.inf)
    before = np.full(e.shape[1], math.inf)
    g = e[0]
    for i in range(1, len(e)):
        new = np.full(e.shape[1], math.inf)
        new[2:] = g[1:-1] + 2 * e[i, 2:]
        new[2:] = np.minimum(new[2:], g[:-2] + 2 * e[i, 1:-1] + e[i, 2:])
        if i >= 2:
            new[2:] = np.minimum(new[2:], before[1:-1] + 2 * e[i - 1, 2:] + e[i, 2:])
        before, g = g, new
    return g[2:]


def every_path(rows, columns):
    """Yield every path of the symmetric steps, as its cells and their weights: tiny cases only."""

    def go_on(path):
        i, j = path[-1][:2]
        if i == rows - 1:
            yield path
        for steps in (((1, 1, 2),), ((1, 1, 2), (1, 2, 1)), ((1, 1, 2), (2, 1, 1))):
            cells = [(i + a, j + b, weight) for a, b, weight in steps]
            if cells[-1][0] < rows and cells[-1][1] < columns:
                yield from go_on([*path, *cells])

    for j in range(columns):
        yield from go_on([(0, j, 1)])


def counts(path):
    """Return how often each row and each column counts: once where it first appears, but the start.

    The dictionaries are by row and by column; what the weights of the steps come to.
    """
    rows, columns = {}, {}
    seen_rows, seen_columns = set(), {path[0][1]}
    for i, j, _ in path:
        new = (i not in seen_rows) + (j not in seen_columns)
        seen_rows.add(i)
        seen_columns.add(j)
        rows[i] = rows.get(i, 0) + new
        columns[j] = columns.get(j, 0) + new
    return rows, columns


def worst_mean(values):
    """Return the greatest mean of values where each counts 1, 2 or 3 times, trying all."""
    return max(
        sum(n * v for n, v in zip(times, values, strict=True)) / sum(times)
        for times in itertools.product((1, 2, 3), repeat=len(values))
    )


def coarse_excess(e, sizes, beta, length):
    """Return the bound of each block of the take: the recurrence of the bound, with loops.

    e : (query block, take block) the least mean excess of a pair of frames; sizes : the frames of
    each query block; beta : how far the frames of a take block are from their mean; length : the
    frames of a take block, of four units.
    """
    unit, units = length // 4, 4 * e.shape[1]
    e, beta = np.repeat(e, 4, axis=1), np.repeat(beta, 4)
    h = [-(length - 1) * beta[p] for p in range(units)]
    for a, size in enumerate(sizes):
        left = [math.inf] * units
        for p in range(units):
            for entry in range(max(0, p - 8), p):
                crossed = sum(unit * e[a, q] for q in range(entry + 1, p))
                rows = size * min(e[a, q] for q in range(entry, p + 1))
                shared = min(e[a, entry], e[a - 1, entry] if a else 0.0)
                left[p] = min(left[p], h[entry] + rows + crossed + unit * shared)
        h = left
    ends = [h[p] + min(unit * e[-1, p], 0.0) - (length - 1) * beta[p] for p in range(units)]
    return np.array(ends).reshape(-1, 4).min(axis=1)
