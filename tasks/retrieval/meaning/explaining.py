"""Say why a match is near: how the query was warped onto it, and which joints are how far.

The search keeps only where a match starts and ends. Here the path between is found again, with the
same steps (`slope`, `tasks.retrieval.warping`), and the distance is told by time and by joint.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.retrieval.normalization import (
    OTHER_SIDE,
    PARTS,
    PATH_ROWS,
    SHOULDER_ROWS,
    frame_of_sample,
    mirror_rows,
    sample_count,
    sample_of_frame,
)
from tasks.retrieval.weighting import SearchSettings, joint_weights

_UPPER_JOINTS = {*PARTS["arms"], *PARTS["head"]}
_BY = ("diagonal", "along", "up")


@dataclass(frozen=True, eq=False)
class Explanation:
    """How a query was warped onto a match, and how far apart they are."""

    pairs: NDArray[np.int64]
    """(step, 2) samples of query and match, counted from the start of each clip; both grow."""
    distance: NDArray[np.float64]
    """(step,) distance of the two poses of each pair, statures."""
    by_joint: NDArray[np.float64]
    """(21,) mean distance of each joint along the path, statures; NaN where it is not compared."""
    weights: NDArray[np.float64]
    """(21,) share of each joint in the distance; 0 where it is not compared."""
    total: float
    """The distance of the match as the search tells it."""


def explain_match(
    query: NDArray[np.float32],
    match: NDArray[np.float32],
    joints: NDArray[np.bool_],
    settings: SearchSettings,
    *,
    mirrored: bool = False,
) -> Explanation:
    """Return how a query is warped onto a match with the steps `slope`.

    Parameters
    ----------
    query, match : (row, sample) float32
        Packed rows of the two clips (`tasks.retrieval.normalization`).
    joints : (21,) bool
        The joints that both takes have; of the query's mirror image where `mirrored`.
    settings
        What was compared.
    mirrored
        Whether the query's mirror image was found.

    Raises
    ------
    ValueError
        If no path leads through: the clips are no query and match of each other.
    """
    weights = joint_weights(settings).astype(np.float64)
    shoulders = compared_about_shoulders(weights)
    if mirrored:
        query, weights = mirror_rows(query), weights[OTHER_SIDE]
    weights = np.where(joints, weights, 0.0)
    if not weights.any():
        raise ValueError("the two clips have no joint with weight in common")
    weights /= weights.sum()
    used = np.flatnonzero(weights).tolist()
    apart = np.stack([_apart(query, match, 3 * k, shoulders=shoulders) for k in used])
    whole = np.tensordot(weights[used], apart, 1)
    if settings.path_weight > 0:
        whole += settings.path_weight * _apart(query, match, PATH_ROWS.start, shoulders=False)
    whole = np.where(np.isfinite(whole), whole, np.inf)
    pairs, total = _warping_path(whole)
    at = tuple(pairs.T)
    by_joint = np.full(len(JOINTS), np.nan)
    by_joint[used] = apart[(slice(None), *at)].mean(axis=1)
    return Explanation(pairs, whole[at], by_joint, weights, total)


def compared_about_shoulders(weights: NDArray[np.floating]) -> bool:
    """Say whether poses are compared from the shoulders: only arms, hands or head have weight.

    Parameters
    ----------
    weights : (21,) float
        From `joint_weights`, whichever joints a take has.
    """
    return {JOINTS[k] for k in np.flatnonzero(weights)} <= _UPPER_JOINTS


def samples_of_match(
    start: int, end: int, rate_hz: float, frames: int
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the samples at which a match of these frames can start, and those at which it can end.

    Of a take slower than the index rate, a frame may stand for two of them.
    """
    last = sample_count(frames, rate_hz) - 1

    def of(frame: int) -> tuple[int, ...]:
        near = sample_of_frame(frame, rate_hz, frames)
        around = [s for s in range(near - 1, near + 2) if 0 <= s <= last]
        fitting = (s for s in around if min(frame_of_sample(s, rate_hz), frames - 1) == frame)
        return tuple(fitting) or (near,)

    return of(start), of(end)


def _apart(
    query: NDArray[np.float32], match: NDArray[np.float32], row: int, *, shoulders: bool
) -> NDArray[np.float64]:
    """Return the distances (query sample, match sample) of three rows."""
    rows = slice(row, row + 3)
    a, b = query[rows].astype(np.float64), match[rows].astype(np.float64)
    if shoulders:
        a, b = a - query[SHOULDER_ROWS], b - match[SHOULDER_ROWS]
    return np.sqrt(sum((x[:, None] - y[None]) ** 2 for x, y in zip(a, b, strict=True)))


def _warping_path(apart: NDArray[np.float64]) -> tuple[NDArray[np.int64], float]:
    """Return the best path from the first pair to the last, and its distance."""
    rows, columns = apart.shape
    best = np.full((rows, columns), np.inf)
    step = np.zeros((rows, columns), np.int8)
    best[0, 0] = apart[0, 0]
    for i in range(1, rows):
        ways = np.full((3, columns), np.inf)
        now = apart[i]
        ways[0, 1:] = best[i - 1, :-1] + 2 * now[1:]
        ways[1, 2:] = best[i - 1, :-2] + 2 * now[1:-1] + now[2:]
        if i > 1:
            ways[2, 1:] = best[i - 2, :-1] + 2 * apart[i - 1, 1:] + now[1:]
        step[i] = np.argmin(ways, axis=0)
        best[i] = ways[step[i], np.arange(columns)]
    if not np.isfinite(best[-1, -1]):
        raise ValueError("no path leads from the first pair of frames to the last")
    i, j = rows - 1, columns - 1
    pairs = [(i, j)]
    while i > 0:
        way = _BY[step[i, j]]
        if way == "along":
            pairs.append((i, j - 1))
        elif way == "up":
            pairs.append((i - 1, j))
        i, j = i - (2 if way == "up" else 1), j - (2 if way == "along" else 1)
        pairs.append((i, j))
    return np.array(pairs[::-1]), float(best[-1, -1] / (rows + columns - 1))
