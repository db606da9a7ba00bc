"""How late each film of a capture began, from its silhouettes alone, in frames.

Of each pair of cameras the planes that touch the performer (`tasks.capture.tangency`) are compared
at every lag. Whole frames are found that make the sum over all pairs least, from several starts;
then the lags of the pairs, between frames, are brought together by least squares. Lateness is
against the majority: the median is not late of the cameras that tell when they began.

How sure a number is tells its *growth*: by how many pixels the disagreement with the other cameras
grows two frames from the best. A performer who stands still, or another film, gives none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.capture.tangency import Touches
from tasks.engine.kernels import njit

SURE_PX = 0.25
"""Growth from which lateness is known [px]. Of 1651 cameras measured with at least so much none
was wrong by more than 0.31 frames."""

LIKELY_PX = 0.1
"""Growth from which lateness is likely [px]. Of 9 cameras measured between this and `SURE_PX` two
were wrong by more than half a frame, of 96 below it 64."""

LEAST_FRAMES = 24
"""How many frames are compared at least [frames]. Fewer hold no movement to be told by: with 32
the error was 0.18 frames."""

_CLIP_PX = 8.0
"""Differences are cut here, so that a hand that one silhouette lacks does not decide [px]."""

_MEETING = 10
"""Frames that are compared at one lag at least [frames]."""

_STARTS = 8
"""From how many cameras whole frames are looked for. Measured with 8 cameras: each once."""

_ROUNDS = 20
"""How often all cameras are moved in turn at most. Three were enough in what was measured."""


@dataclass(frozen=True, eq=False)
class Lateness:
    """What the silhouettes tell; (camera,) arrays."""

    late: NDArray[np.float64]
    """How many frames later each film began than the median of those that tell it."""
    growth: NDArray[np.float64]
    """How sure that is [px]; 0 where a camera cannot be compared."""
    left: NDArray[np.float64]
    """How far the planes of a camera are from those of the others at best, on the mean [px]."""


def reach_of(frames: int, most: int) -> int:
    """Return how late a film can be found to be in so many frames, at most `most` [frames]."""
    return max(0, min(most, frames // 6))


def measure_lateness(touches: Touches, reach: int) -> Lateness:
    """Return how late each film began.

    Parameters
    ----------
    touches
        Of the pairs whose baselines run beside the performer: `usable_touches`.
    reach
        How many frames a film may be away from the median one; `reach_of` says how many can be.
    """
    count = touches.cameras
    nothing = Lateness(np.zeros(count), np.zeros(count), np.full(count, np.nan))
    if not len(touches.pairs) or touches.frames < LEAST_FRAMES or reach < 2:
        return nothing
    cost = _costs(touches, 2 * reach)
    if not np.isfinite(cost).any():
        return nothing
    whole = _whole_frames(cost, reach)
    shift = _between_frames(cost, whole)
    growth, left = _sureness(cost, whole, reach)
    tells = growth >= LIKELY_PX  # any lag fits a film that does not: it is no measure for others
    return Lateness(np.median(shift[tells] if tells.any() else shift) - shift, growth, left)


def _costs(touches: Touches, most: int) -> NDArray[np.float64]:
    """Return (camera, camera, lag) how far the planes of two cameras are apart [px].

    Lag `d - most` compares frame n of the first with frame n + d of the second; NaN where two
    cameras cannot be compared.
    """
    cost = np.full((touches.cameras, touches.cameras, 2 * most + 1), np.nan)
    for (one, other), (first, second) in zip(touches.pairs, touches.planes, strict=True):
        own = np.full(2 * most + 1, np.nan)
        _compare(first, second, most, own)
        if np.isfinite(own[most]):
            own = np.nan_to_num(own, nan=_CLIP_PX)
            cost[one, other], cost[other, one] = own, own[::-1]
    return cost


@njit(cache=True, nogil=True)
def _compare(first: Any, second: Any, most: Any, into: Any) -> None:
    """Write the mean difference at each lag, cut, and less the constant one of calibration."""
    frames = first.shape[1]
    for d in range(-most, most + 1):
        total, count = 0.0, 0
        for k in range(2):
            difference, m = np.empty(frames), 0
            for n in range(max(0, -d), min(frames, frames - d)):
                x = first[k, n] - second[k, n + d]
                if x == x:
                    difference[m] = x
                    m += 1
            if m < _MEETING:
                continue
            middle = np.median(difference[:m])
            for n in range(m):
                total += min(abs(difference[n] - middle), _CLIP_PX)
            count += m
        if count:
            into[d + most] = total / count


def _whole_frames(cost: NDArray[np.float64], reach: int) -> NDArray[np.int64]:
    """Return the shifts of all cameras, whole frames, that make the sum over all pairs least."""
    count, most = len(cost), cost.shape[2] // 2
    known = np.nan_to_num(cost, nan=0.0)
    steps = np.arange(-reach, reach + 1)

    def apart(camera: int, others: Sequence[int], shift: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return how far a camera is from some others at each step."""
        of = np.array(others)
        lags = np.clip(steps - shift[of, None], -most, most) + most
        return known[of[:, None], camera, lags].sum(axis=0)

    best: tuple[float, NDArray[np.int64]] = (np.inf, np.zeros(count, np.int64))
    for start in np.unique(np.linspace(0, count - 1, min(count, _STARTS)).astype(int)):
        shift, placed = np.zeros(count, np.int64), [int(start)]
        while len(placed) < count:  # the surest one next
            trials = []
            for camera in sorted({*range(count)} - {*placed}):
                of = apart(camera, placed, shift)
                trials.append((np.median(of) - of.min(), -camera, steps[of.argmin()]))
            _, camera, step = max(trials)
            shift[-camera] = step
            placed.append(-camera)
        for _ in range(_ROUNDS):
            before = shift.copy()
            for camera in range(count):
                others = [c for c in range(count) if c != camera]
                shift[camera] = steps[apart(camera, others, shift).argmin()]
            if (shift == before).all():
                break
        one, other = np.triu_indices(count, 1)
        lags = np.clip(shift[other] - shift[one], -most, most) + most
        total = float(known[one, other, lags].sum())
        if total < best[0]:
            best = total, shift - int(np.rint(np.median(shift)))
    return best[1]


def _between_frames(cost: NDArray[np.float64], whole: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the shifts, between frames, that agree best with the lags of all pairs."""
    count, most = len(cost), cost.shape[2] // 2
    rows, lags = [], []
    for one, other in np.argwhere(np.triu(np.isfinite(cost[:, :, most]))):
        own = cost[one, other]
        at = int(np.clip(whole[other] - whole[one], -most + 3, most - 3)) + most
        weight = max(float(own[[at - 2, at + 2]].mean() - own[at]), 1e-6)
        row = np.zeros(count)
        row[one], row[other] = -weight, weight
        rows.append(row)
        lags.append(weight * (_tip(own[at - 3 : at + 4]) + at - 3 - most))
    return np.linalg.lstsq(np.array(rows), np.array(lags), rcond=None)[0]


def _tip(values: NDArray[np.float64]) -> float:
    """Return where the least value is between samples: the tip of a tent."""
    at = int(values.argmin())  # a parabola would be drawn to whole frames
    if not 0 < at < len(values) - 1:
        return float(at)
    before, least, after = values[at - 1 : at + 2]
    high = max(before, after)
    return at + (0.5 * (before - after) / (high - least) if high > least else 0.0)


def _sureness(
    cost: NDArray[np.float64], whole: NDArray[np.int64], reach: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return growth and what is left of each camera, against the others where they are."""
    count, most = len(cost), cost.shape[2] // 2
    steps = np.arange(-reach, reach + 1)
    growth, left = np.zeros(count), np.full(count, np.nan)
    for camera in range(count):
        others = np.flatnonzero(np.isfinite(cost[:, camera, most]))
        if not len(others):
            continue
        lags = np.clip(steps + whole[camera] - whole[others, None], -most, most) + most
        mean = cost[others[:, None], camera, lags].mean(axis=0)
        left[camera] = mean.min()
        away = np.abs(steps - steps[mean.argmin()]) >= 2
        growth[camera] = mean[away].min() - mean.min()
    return growth, left


def find_loss(touches: Touches, late: NDArray[np.float64], camera: int, after: float) -> int:
    """Return the frame from which on a film is late by another number of frames.

    Parameters
    ----------
    touches
        Of frames before and after it.
    late : (camera,) float64
        How late each film is before it.
    camera
        Whose film it is.
    after
        How late that one is after it.
    """
    apart = np.zeros((2, touches.frames))
    for pair, both in zip(touches.pairs, touches.planes, strict=True):
        if camera not in pair:
            continue
        own, other = both if pair[0] == camera else both[::-1]
        partner = int(pair[pair != camera][0])
        for row, lateness in zip(apart, (late[camera], after), strict=True):
            difference = own - _shifted(other, round(float(lateness - late[partner])))
            middle = np.nanmedian(difference) if np.isfinite(difference).any() else 0.0
            row += np.nan_to_num(np.minimum(abs(difference - middle), _CLIP_PX)).sum(axis=0)
    before = np.concatenate([[0.0], np.cumsum(apart[0])])
    rest = np.concatenate([[0.0], np.cumsum(apart[1][::-1])])[::-1]
    return int((before + rest).argmin())


def _shifted(planes: NDArray[np.float32], by: int) -> NDArray[np.float32]:
    """Return planes whose frame n is frame n + by of the given ones; NaN where there is none."""
    shifted = np.full_like(planes, np.nan)
    count = planes.shape[-1]
    if abs(by) < count:
        shifted[..., max(0, -by) : count - max(0, by)] = planes[
            ..., max(0, by) : count + min(0, by)
        ]
    return shifted
