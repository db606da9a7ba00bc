"""The pixels of silhouettes out of pictures, one after another, and which of them is where.

Silhouettes are packed as by `numpy.packbits`: the first of eight pixels is the highest bit.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

_BITS_OF = np.bitwise_count(np.arange(256)).astype(np.int64)
"""How many bits of a byte are set."""

_ALL = 255
"""Eight pixels of a silhouette."""


def take_pixels(packed: NDArray[np.uint8], image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return (pixel, 3) the colors of a silhouette's pixels, row after row.

    Parameters
    ----------
    packed : (row, column / 8) uint8
        The silhouette; no bit is set beside the image.
    image : (row, column, 3) uint8
        What was filmed.
    """
    pixels = np.empty((int(np.bitwise_count(packed).sum(dtype=np.int64)), 3), np.uint8)
    _take(packed, image, pixels)
    return pixels


def number_pixels(packed: NDArray[np.uint8], pixel: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the numbers of pixels among those that `take_pixels` returned of all cameras.

    Parameters
    ----------
    packed : (camera, row, column / 8) uint8
        The silhouettes.
    pixel : (camera, voxel, 2) int32
        Row and column of pixels inside them; a row of -1 where there is none.

    Returns
    -------
    (camera, voxel) int32
        -1 where there is none.
    """
    before = np.empty(packed.shape, np.int32)
    number = np.empty(pixel.shape[:2], np.int32)
    _number(packed, pixel, before, number)
    return number


@njit(cache=True, nogil=True)
def _take(packed: Any, image: Any, pixels: Any) -> None:
    n = 0
    for row in range(packed.shape[0]):
        for byte in range(packed.shape[1]):
            bits = packed[row, byte]
            if bits == 0:
                continue
            if bits == _ALL:
                for bit in range(8):
                    for k in range(3):
                        pixels[n + bit, k] = image[row, 8 * byte + bit, k]
                n += 8
                continue
            for bit in range(8):
                if bits >> (7 - bit) & 1:
                    for k in range(3):
                        pixels[n, k] = image[row, 8 * byte + bit, k]
                    n += 1


@njit(cache=True, nogil=True)
def _number(packed: Any, pixel: Any, before: Any, number: Any) -> None:
    """Count the pixels before each byte, and on from there to those that are asked for."""
    count = 0
    for c in range(packed.shape[0]):
        for row in range(packed.shape[1]):
            for byte in range(packed.shape[2]):
                before[c, row, byte] = count
                count += _BITS_OF[packed[c, row, byte]]
    for c in range(pixel.shape[0]):
        for n in range(pixel.shape[1]):
            row, column = pixel[c, n, 0], pixel[c, n, 1]
            number[c, n] = -1
            if row >= 0:
                byte = column >> 3
                here = packed[c, row, byte] >> (8 - (column & 7))
                number[c, n] = before[c, row, byte] + _BITS_OF[here]
