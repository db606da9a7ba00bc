"""Which films stand still while the others go on, from their silhouettes.

A recorder that hangs, or a network that stalls, repeats a picture, and the film is as long as the
others. That silhouette cuts the hull as any other does, so that what was danced is lost.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tasks.capture.tangency import Touches
from tasks.geometry.runs import runs

_STILL = 0.05
"""How much the silhouette of a film that stands still changes, at most [times what the others'
do]. Measured over half a second: 0.00 of a film that repeats a picture, 0.19 at least of the
cameras of three captures in which all films go on."""

_MOVING_PX = 0.2
"""How much the silhouettes of the others change at least from frame to frame, in the mean [px].
Where the performer stands still nothing can be told; chosen."""


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
    change = _changes(touches)
    found = []
    for camera in range(touches.cameras):
        others = np.delete(change, camera, axis=0)
        told = np.isfinite(others).sum(axis=0) > 0
        usual = np.zeros(others.shape[1])
        usual[told] = np.nanmedian(others[:, told], axis=0)
        own = np.where(np.isnan(change[camera]), np.inf, change[camera])
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


def _changes(touches: Touches) -> NDArray[np.float64]:
    """Return (camera, time - 1) how far the planes of a camera move to the next frame [px].

    NaN where none is known in both.
    """
    moved = np.abs(np.diff(touches.planes.astype(np.float64), axis=-1))
    change = np.full((touches.cameras, moved.shape[-1]), np.nan)
    for camera in range(touches.cameras):
        own = [moved[touches.pairs[:, side] == camera, side] for side in (0, 1)]
        planes = np.concatenate(own).reshape(-1, moved.shape[-1])
        known = ~np.isnan(planes)
        total, count = np.where(known, planes, 0.0).sum(axis=0), known.sum(axis=0)
        change[camera] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return change
