"""Integral images of silhouettes, cropped to what they show (Crow 1984)."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit


def count_pixels(
    silhouettes: NDArray[np.bool_], image_size: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return counts from which the pixels in any rectangle follow by four look-ups.

    Parameters
    ----------
    silhouettes : (camera, row, column) bool
        C-contiguous.
    image_size : (camera, 2) int64
        Columns and rows that are looked at.

    Returns
    -------
    counts : (count,) int32
        Camera after camera, (bottom - top + 1, right - left + 1) in rows: the pixels of the
        silhouette above and left of each corner of its crop.
    crops : (camera, 5) int64
        Top, left, bottom and right of the box around each silhouette, ends exclusive, all 0
        where it shows nothing; and where its counts end.
    """
    crops = _find_crops(silhouettes, image_size)
    counts = np.zeros(int(crops[-1, 4]), np.int32)
    _integrate(silhouettes, crops, counts)
    return counts, crops


def _find_crops(silhouettes: NDArray[np.bool_], image_size: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the box of each silhouette (top, left, bottom, right), and where its counts end."""
    crops = np.zeros((len(silhouettes), 5), np.int64)
    for c, (columns, rows) in enumerate(image_size.tolist()):
        image = silhouettes[c, :rows, :columns].view(np.uint8)
        left, top, width, height = cv2.boundingRect(image)
        crops[c, :4] = top, left, top + height, left + width
    crops[:, 4] = np.cumsum((crops[:, 2:4] - crops[:, :2] + 1).prod(axis=1))
    return crops


@njit(cache=True, nogil=True)
def _integrate(silhouettes: Any, crops: Any, counts: Any) -> None:
    """Write each crop's integral image: the count of pixels above and left of a corner."""
    for c in range(len(crops)):
        top, left, bottom, right, end = crops[c]
        width = right - left + 1
        at = end - (bottom - top + 1) * width
        for row in range(top, bottom):
            line = silhouettes[c, row]
            total = 0
            for column in range(left, right):
                total += line[column]
                place = at + width + column - left + 1
                counts[place] = counts[place - width] + total
            at += width
