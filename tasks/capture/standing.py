"""Which films stand still while the others go on, from their silhouettes.

A recorder that hangs, or a network that stalls, repeats a picture, and the film is as long as the
others. That silhouette cuts the hull as any other does, so that what was danced is lost.

A camera may see a performer who moves toward it as if nothing moved. So a film is compared with
each other one by the planes through both cameras that touch the performer: they are the same planes
for both, and move for both or for none.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tasks.capture.tangency import Touches
from tasks.geometry.runs import runs

_STILL = 0.1
"""How much the planes of a film that stands still move, at most [times what the same planes of the
others do]. Measured over a second: 0.00 of a film that repeats a picture, 0.59 at least of the
cameras of ten captures in which all films go on."""

_MOVING_PX = 0.2
"""How much the planes of the others move at least from frame to frame, in the mean [px]. Where the
performer stands still nothing can be told; chosen."""


def find_standing(touches: Touches, least: int) -> list[tuple[int, int, int]]:
    """Return which film stands still, and in which frames: camera, first and end of each stretch.

    Parameters
    ----------
    touches
        Of frames one after another.
    least
        How long a stretch is, at least [frames].
    """
    if touches.frames <= least:
        return []
    moved = np.abs(np.diff(touches.planes.astype(np.float64), axis=-1))
    found = []
    for camera in range(touches.cameras):
        own, usual = _changes(moved, touches.pairs == camera)
        own_mean, usual_mean = (
            sliding_window_view(each, least).mean(axis=1) for each in (own, usual)
        )
        still = (own_mean <= _STILL * usual_mean) & (usual_mean >= _MOVING_PX)
        stands = np.zeros(touches.frames, np.bool_)
        for first in np.flatnonzero(still):  # at both ends a window may hold a step that moves
            quiet = own[first : first + least] <= _STILL * usual_mean[first]
            steps = first + np.flatnonzero(quiet)
            stands[steps[0] : steps[-1] + 2] = True
        found += [(camera, first, end) for first, end in runs(stands)]
    return found


def _changes(
    moved: NDArray[np.float64], is_own: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (time - 1,) how far planes move to the next frame, by a camera and by the others [px].

    By the camera it is the mean, infinity where none is known; by the others, of which one may
    stand still itself, the median, 0 where none is known.

    Parameters
    ----------
    moved : (pair, 2, 2, time - 1) float64
        How far each of `Touches.planes` moves.
    is_own : (pair, 2) bool
        Which of a pair is the camera.
    """
    pair, side = np.nonzero(is_own)
    own = moved[pair, side].reshape(-1, moved.shape[-1])
    others = moved[pair, 1 - side].reshape(-1, moved.shape[-1])
    known = ~np.isnan(own) & ~np.isnan(others)
    there = known.any(axis=0)
    mean, median = np.full(moved.shape[-1], np.inf), np.zeros(moved.shape[-1])
    mean[there] = np.nanmean(np.where(known, own, np.nan)[:, there], axis=0)
    median[there] = np.nanmedian(np.where(known, others, np.nan)[:, there], axis=0)
    return mean, median
