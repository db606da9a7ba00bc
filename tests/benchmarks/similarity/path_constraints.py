"""Other constraints of the warping's path than the search has, for `similarity.retrieval`.

A constraint is a list of moves, each the cells that it adds to a path, from the last one back. A
path's sum is divided by the sum of its weights, as in the search: 2 a frame of both, 1 a frame of
one of them (Sakoe and Chiba 1978, symmetric).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.retrieval.searching import Query
from tasks.retrieval.segments import PackedTake
from tasks.retrieval.warping import select_matches
from tests.benchmarks.similarity.truth import RATE_HZ

Constraint = list[list[tuple[int, int, int]]]
"""Moves; of each, (frames of the query back, frames of the take back, weight) of its cells. The
last entry has the weight 0: where the path was before."""

_DIAGONAL = [(0, 0, 2), (1, 1, 0)]


def _slope(most: int, each: int) -> Constraint:
    """Return up to `most` frames of one alone after `each` of both."""
    moves = [_DIAGONAL]
    for alone in range(1, most + 1):
        for query, take in ((0, 1), (1, 0)):
            cells = [(query * k, take * k, 1) for k in range(alone)]
            at = (query * alone, take * alone)
            cells += [(at[0] + k, at[1] + k, 2) for k in range(each)]
            moves.append([*cells, (at[0] + each, at[1] + each, 0)])
    return moves


CONSTRAINTS: dict[str, Constraint] = {
    "no warping": [_DIAGONAL],
    "P = 2: lengths 2/3 to 3/2": _slope(1, 2),
    "P = 1: lengths 1/2 to 2 (slope)": _slope(1, 1),
    "P = 1/2: lengths 1/3 to 3": _slope(2, 1),
    "P = 0: any length": [_DIAGONAL, [(0, 0, 1), (0, 1, 0)], [(0, 0, 1), (1, 0, 0)]],
}


def warp_by(constraint: Constraint, query: Query, take: PackedTake) -> list[tuple[int, int, float]]:
    """Return start, end and distance of the disjoint matches of a whole body, nearest first."""
    cells = np.full((len(constraint), max(map(len, constraint)), 3), -1, np.int64)
    for number, move in enumerate(constraint):
        cells[number, : len(move)] = move
    joints = np.flatnonzero(query.joints_present & take.joints_present)
    a, b = (
        rows[:63].reshape(21, 3, -1)[joints].astype(np.float32) for rows in (query.rows, take.rows)
    )
    apart = np.zeros((a.shape[2], b.shape[2]), np.float32)
    for p, q in zip(a, b, strict=True):
        apart += np.sqrt(((p[:, :, None] - q[:, None]) ** 2).sum(axis=0)) / len(joints)
    distance, start = _warp(np.where(np.isfinite(apart), apart, np.inf), cells)
    found = select_matches(distance[None], start[None], RATE_HZ, top=apart.shape[1])
    return [(first, last, near) for _, first, last, near in found]


@njit
def _warp(
    apart: NDArray[np.float32], moves: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return the distance and the start of the best path to each frame of the take."""
    frames, samples = apart.shape
    best = np.full((frames, samples), np.inf, np.float32)
    start = np.zeros((frames, samples), np.int32)
    best[0] = apart[0]
    start[0] = np.arange(samples)
    for i in range(1, frames):
        for j in range(samples):
            for move in moves:
                total = np.float32(0.0)
                for n in range(len(move)):
                    ii, jj, weight = i - move[n, 0], j - move[n, 1], move[n, 2]
                    if ii < 0 or jj < 0:
                        break
                    if weight > 0:
                        if ii == 0:  # the first frame of the query has no move before it
                            break
                        total += weight * apart[ii, jj]
                        continue
                    if best[ii, jj] + total < best[i, j]:
                        best[i, j], start[i, j] = best[ii, jj] + total, start[ii, jj]
                    break
    last = np.arange(samples).astype(np.int32)
    return best[-1] / (frames + last - start[-1]).astype(np.float32), start[-1]
