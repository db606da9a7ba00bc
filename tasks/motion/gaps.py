"""Short gaps and noise of tracks, one marker or joint after the other.

SciPy is imported where it is needed: a file without gaps, and a search, must not pay for it.
"""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.runs import inner_runs, runs

_ORDER = 2
"""Order of the Butterworth low-pass, before it is run back. The usual one of gait analysis."""
_TWICE = (2**0.5 - 1) ** 0.25  # run forth and back, a filter's cut-off comes down by this much


def fill_gaps(track: NDArray[np.float64], longest: int) -> NDArray[np.float64]:
    """Return the track with its short gaps filled by a cubic spline.

    The spline goes through every frame that is there, between two gaps that are too long to
    fill. Nothing is put before the first or behind the last frame that is there.

    Parameters
    ----------
    track : (time, marker, space) float64
        NaN in all three where a marker is missing.
    longest
        The length, in frames, of the longest gap to fill.
    """
    missing = np.isnan(track[..., 0])
    if not missing.any():
        return track
    filled = track.copy()
    for marker in np.flatnonzero(missing.any(axis=0)):
        gaps = list(inner_runs(missing[:, marker]))
        edges = [(0, 0), *(gap for gap in gaps if gap[1] - gap[0] > longest)]
        edges.append((len(track), len(track)))
        for (_, start), (end, _) in pairwise(edges):
            _fill_between(filled[start:end, marker], missing[start:end, marker])
    return filled


def filter_low_pass(
    track: NDArray[np.float64], rate_hz: float, low_pass_hz: float
) -> NDArray[np.float64]:
    """Return the track without what is faster than `low_pass_hz`, nothing shifted in time.

    A Butterworth filter of second order, forth and back over each run of frames that are there
    (Winter, *Biomechanics and Motor Control of Human Movement*, 2.2.4.4: its own cut-off is
    set higher, so that both passes together have half the power at `low_pass_hz`). A run too
    short for the filter to settle stays as it is.

    Parameters
    ----------
    track : (time, joint, space) float64
        NaN in all three where a joint is missing.
    low_pass_hz
        Less than half of the rate.

    Raises
    ------
    ValueError
        The frequency is not above zero, or too high for the rate.
    """
    from scipy.signal import butter, sosfiltfilt

    if not 0 < low_pass_hz < rate_hz / 2:
        raise ValueError(
            f"low_pass_hz is {low_pass_hz:g}; at {rate_hz:g} frames a second it must lie "
            f"above 0 and below {rate_hz / 2:g}"
        )
    own = math.atan(math.tan(math.pi * low_pass_hz / rate_hz) / _TWICE) * 2 / math.pi
    sections = butter(_ORDER, own, output="sos")
    padding = 3 * (_ORDER + 1)
    smooth = track.copy()
    for joint in range(track.shape[1]):
        for start, stop in runs(~np.isnan(track[:, joint, 0])):
            if stop - start > padding:
                run = track[start:stop, joint]
                smooth[start:stop, joint] = sosfiltfilt(sections, run, axis=0, padlen=padding)
    return smooth


def _fill_between(track: NDArray[np.float64], missing: NDArray[np.bool_]) -> None:
    """Fill, in place, every inner gap of one marker's track."""
    from scipy.interpolate import CubicSpline

    frames = np.flatnonzero(~missing)
    if len(frames) < 2 or len(frames) == frames[-1] - frames[0] + 1:
        return
    inside = np.arange(frames[0], frames[-1])
    inside = inside[missing[inside]]
    track[inside] = CubicSpline(frames, track[frames])(inside)
