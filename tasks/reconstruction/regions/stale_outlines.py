"""Find outlines of silhouettes that are of the background picture, not of the frame.

Where the performer stands in a background, a silhouette is found there in frames in which nobody
is. Its outline is an edge of the background and none of the frame; that of a performer is an edge
of the frame. (The idea of telling ghosts by gradients: Cucchiara, Grana, Piccardi and Prati,
"Detecting moving objects, ghosts, and shadows in video streams", 2003, who use motion for it.)
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.capture.backgrounds import smooth

_EDGE = 24.0
"""How much a channel changes over three pixels at an edge of the background, at least [levels of 0
to 255]. Twice what noise does in a picture smoothed; chosen by eye on the shared captures."""

_FAINTER = 0.5
"""How much of that the frame changes there, at most [share]. Chosen by eye; not measured."""

_SIDE = np.ones((3, 3), np.uint8)
"""A pixel and those around it."""

_AROUND_PX = 2
"""How far from a pixel what tells whether it is an edge lies at most [pixels]: the frame's edges
around it, and what they change over."""


def outline_of(silhouette: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the outermost pixels of a silhouette (row, column); the picture's border is none."""
    inner: Any = cv2.erode(silhouette.view(np.uint8), _SIDE)
    return silhouette & (inner == 0)


def stale_outline(
    silhouette: NDArray[np.bool_], frame: NDArray[np.uint8], color: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return (row, column) which pixels of an outline are an edge of the background only.

    Parameters
    ----------
    silhouette : (row, column) bool
        Of the frame.
    frame : (row, column, 3) uint8
        RGB, as filmed.
    color : (row, column, 3) float32
        The background, smoothed.
    """
    stale = np.zeros(silhouette.shape, np.bool_)
    column, row, columns, rows = cv2.boundingRect(silhouette.view(np.uint8))
    if columns == 0:
        return stale
    box = (
        slice(max(0, row - _AROUND_PX), row + rows + _AROUND_PX),
        slice(max(0, column - _AROUND_PX), column + columns + _AROUND_PX),
    )
    behind = _edges(color[box])
    ahead = cv2.dilate(_edges(smooth(frame)[box].astype(np.float32)), _SIDE)
    edge = (behind >= _EDGE) & (ahead <= _FAINTER * behind)
    stale[box] = outline_of(silhouette)[box] & edge
    return stale


def _edges(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (row, column) how much a picture changes over three pixels, in any channel."""
    change: Any = cv2.morphologyEx(np.ascontiguousarray(picture), cv2.MORPH_GRADIENT, _SIDE)
    return np.maximum(np.maximum(change[..., 0], change[..., 1]), change[..., 2])
