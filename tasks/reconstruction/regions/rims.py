"""How far the rim of a mask is from where the film has its edge: masks that are too narrow.

All masks of a take that were made by one tool may be too narrow by the same pixel. Their hulls
agree with each other, so nothing contradicts them, but hands and forearms are gone. The film knows:
along the normal of the rim colors change fastest where the performer ends.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

DISTANCES = np.arange(-3.5, 3.51, 0.5)
"""Where the change of color is measured, outward from the rim [px of a picture of `_ROWS` rows]."""

_ROWS = 240
"""Larger pictures are made as small as this by a whole number [rows]. What is lost with a rim
counts by its share of a hand, and a codec blurs what is finer."""
_SHARP = 0.7
"""Smoothing of the picture before it is compared [px]. Chosen: noise of a pixel counts less."""
_SMOOTH = 1.0
"""Smoothing of the distance from the rim, whose slope is the normal [px]. Chosen: without it
normals have steps of 45 degrees."""
_STRAIGHT = 0.5
"""Least slope of that distance where the rim has a side [share]. Chosen: a finger of two pixels has
none."""
_LEAST_RIM = 200
"""How many pixels of rim tell something [pixels]. Chosen; a performer of 60 pixels has as many."""
_CLEAR = 1.25
"""How many times as much color has to change at the edge as at the distances' median. Measured at
least 1.6 in the worst camera of a real capture, and 1.0 where a mask is of another moment."""


def edge_profile(image: NDArray[np.uint8], silhouette: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how fast colors change across the rim of a silhouette, at each of `DISTANCES`.

    Parameters
    ----------
    image : (row, column, 3) uint8
        As filmed.
    silhouette : (row, column) bool
        Of the same size.

    Returns
    -------
    (DISTANCES + 1,) float64
        Sums over the rim; the last one is how many pixels the rim has.
    """
    inside = silhouette.astype(np.uint8)
    if (factor := shrinking(image.shape[0])) > 1:
        size = (image.shape[1] // factor, image.shape[0] // factor)
        crop = np.s_[: size[1] * factor, : size[0] * factor]
        image = cv2.resize(image[crop], size, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        share = cv2.resize(255 * inside[crop], size, interpolation=cv2.INTER_AREA)
        inside = (share > 127).astype(np.uint8)
    rows, columns, across, down = _normals(inside)
    profile = np.zeros(len(DISTANCES) + 1)
    if not len(rows):
        return profile
    # the center of a pixel at the rim is half a pixel inside
    half = 0.5 * (DISTANCES[1] - DISTANCES[0])
    away = 0.5 + np.arange(DISTANCES[0] - half, DISTANCES[-1] + 2 * half, 2 * half)
    x = (columns[:, None] + across[:, None] * away).astype(np.float32)
    y = (rows[:, None] + down[:, None] * away).astype(np.float32)
    smooth = cv2.GaussianBlur(image, (0, 0), _SHARP).astype(np.float32)
    color = cv2.remap(smooth, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    change = np.sqrt((np.diff(color, axis=1) ** 2).sum(axis=2))
    profile[:-1] = change.sum(axis=0)
    profile[-1] = len(rows)
    return profile


def _normals(inside: NDArray[np.uint8]) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return rows and columns of the pixels at the rim, and the way out there in columns, rows."""
    none = np.empty(0)
    if not inside.any() or inside.all():
        return none, none, none, none
    within = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_5)
    beside = cv2.distanceTransform(1 - inside, cv2.DIST_L2, cv2.DIST_MASK_5)
    away = np.where(inside > 0, 0.5 - within, beside - 0.5).astype(np.float32)
    down, across = np.gradient(cv2.GaussianBlur(away, (0, 0), _SMOOTH))
    slope = np.hypot(down, across)
    at = (inside > 0) & (within <= 1.0) & (slope > _STRAIGHT)
    at[[0, -1]] = at[:, [0, -1]] = False  # cut off by the picture, not by an edge
    rows, columns = np.nonzero(at)
    return rows, columns, across[at] / slope[at], down[at] / slope[at]


def too_narrow_px(profiles: NDArray[np.float64]) -> float:
    """Return how far outside the rim the film's edge is [px of `DISTANCES`]; negative: inside.

    Parameters
    ----------
    profiles : (time, DISTANCES + 1) float64
        Of `edge_profile`, in some frames of a camera.

    Returns
    -------
    float
        NaN where no edge stands out.
    """
    *change, rim = profiles.sum(axis=0)
    if rim < _LEAST_RIM or max(change) < _CLEAR * np.median(change):
        return float("nan")
    n = int(np.argmax(change))
    if not 0 < n < len(change) - 1:
        return float(DISTANCES[n])
    before, most, after = change[n - 1 : n + 2]
    step = float(DISTANCES[1] - DISTANCES[0])
    return float(DISTANCES[n] + 0.5 * step * (before - after) / (before - 2 * most + after))


def shrinking(rows: int) -> int:
    """Return by which number a picture of so many rows is made smaller before it is compared."""
    return max(rows // _ROWS, 1)
