"""Integral images of silhouettes, cropped to what they show (Crow 1984)."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray


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
    crops = np.zeros((len(silhouettes), 5), np.int64)
    _find_crops(silhouettes, image_size, crops)
    counts = np.zeros(int(crops[-1, 4]), np.int32)
    _integrate(silhouettes, crops, counts)
    return counts, crops


@njit(cache=True, nogil=True)
def _find_crops(silhouettes: Any, image_size: Any, crops: Any) -> None:
    """Write the box of each silhouette (top, left, bottom, right), and where its counts end."""
    end = 0
    for c in range(len(silhouettes)):
        columns, rows = image_size[c, 0], image_size[c, 1]
        top, left, bottom, right = rows, columns, 0, 0
        for row in range(rows):
            line = silhouettes[c, row]
            first = 0
            while first < columns and not line[first]:
                first += 1
            if first == columns:
                continue
            last = columns - 1
            while not line[last]:
                last -= 1
            top, bottom = min(top, row), row + 1
            left, right = min(left, first), max(right, last + 1)
        if bottom == 0:
            top = left = 0
        end += (bottom - top + 1) * (right - left + 1)
        crops[c, 0], crops[c, 1], crops[c, 2], crops[c, 3] = top, left, bottom, right
        crops[c, 4] = end


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
