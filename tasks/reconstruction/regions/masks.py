"""Silhouettes and colors from masks that were made elsewhere.

A mask is white where a pixel is the performer, black where it is not, and between where it is in
part: its edge is soft, or a codec made it so. What is filmed at the rim is the stage in part too.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

HALF = 128
"""From which value on a pixel of a mask is of the silhouette [levels of 0 to 255]. Then its center
is inside where the edge is straight."""

OPAQUE = 230
"""From which value on a pixel is wholly the performer [levels of 0 to 255]. Below white by what
codecs change."""

_BLACK = 25
"""Up to which value a pixel is wholly the stage [levels of 0 to 255]. Above black by what codecs
change."""

MASK_FACTS = 4
"""How many numbers tell whether a mask is one [numbers]. See `mask_facts`."""

_CORNER = 0.5
"""How much farther than it is grown a pixel may be [px]. So one pixel fills the corners, too, that
a square of three by three takes off."""

_RIM = 2
"""How far from the outline the rim reaches inside [px]. A pixel by which masks are too large, and
one beside it: codecs keep one color for two by two pixels."""

_REACH = 5
"""How far from a pixel of the rim its color is looked for [px]. What is thinner than twice the rim
has no inside near and keeps its own."""


def silhouettes_of(masks: NDArray[np.uint8], grow_px: float = 0.0) -> NDArray[np.bool_]:
    """Return the silhouettes (time, row, column) of masks, grown by so many pixels.

    Parameters
    ----------
    masks : (time, row, column) uint8
        How much each pixel is the performer.
    grow_px
        How far the outline is moved outward; inward where it is negative.
    """
    found = masks >= HALF
    if grow_px:
        for silhouette in found:
            silhouette[:] = _grown(silhouette, grow_px)
    return found


def _grown(silhouette: NDArray[np.bool_], by_px: float) -> NDArray[np.bool_]:
    """Return a silhouette (row, column) whose outline is moved outward."""
    if by_px < 0:
        return ~_grown(~silhouette, -by_px)
    if not silhouette.any():
        return silhouette
    outside = (~silhouette).view(np.uint8)
    away = cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return away <= by_px + _CORNER


def mask_facts(mask: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return what tells whether a mask (row, column) is one.

    Returns
    -------
    (4,) float64
        Share of the picture that is silhouette; share of the picture's border that is; share of the
        picture that is neither black nor white; the largest value, of 255.
    """
    found = mask >= HALF
    border = np.concatenate([found[0], found[-1], found[:, 0], found[:, -1]])
    between = (mask > _BLACK) & (mask < OPAQUE)
    return np.array([found.mean(), border.mean(), between.mean(), mask.max()], np.float64)


def color_rim(
    image: NDArray[np.uint8], mask: NDArray[np.uint8], silhouette: NDArray[np.bool_]
) -> None:
    """Give the pixels at the rim of a silhouette the color of the nearest pixel inside.

    Parameters
    ----------
    image : (row, column, 3) uint8
        As filmed; changed in place, inside the silhouette alone.
    mask : (row, column) uint8
        How much each pixel is the performer.
    silhouette : (row, column) bool
        Of the mask. At the border of the picture it has no rim.
    """
    square = np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8)
    inside: Any = cv2.erode(silhouette.view(np.uint8), square)
    inside &= mask >= OPAQUE
    _color_rim(image, silhouette, inside)


@njit(cache=True, nogil=True)
def _color_rim(image: Any, silhouette: Any, inside: Any) -> None:
    """Write the color of the nearest pixel that is inside; of equally near ones the first's."""
    rows, columns = silhouette.shape
    for i in range(rows):
        for j in range(columns):
            if not silhouette[i, j] or inside[i, j]:
                continue
            least, row, column = _REACH * _REACH + 1, 0, 0
            for y in range(max(i - _REACH, 0), min(i + _REACH + 1, rows)):
                for x in range(max(j - _REACH, 0), min(j + _REACH + 1, columns)):
                    away = (y - i) ** 2 + (x - j) ** 2
                    if inside[y, x] and away < least:
                        least, row, column = away, y, x
            if least <= _REACH * _REACH:
                for k in range(3):
                    image[i, j, k] = image[row, column, k]
