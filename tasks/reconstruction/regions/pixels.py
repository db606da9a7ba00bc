"""The pixels of silhouettes out of pictures, one after another, and back into them.

Silhouettes are packed as by `numpy.packbits`: the first of eight pixels is the highest bit.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

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


def place_pixels(
    packed: NDArray[np.uint8], pixels: NDArray[np.uint8], images: NDArray[np.uint8]
) -> None:
    """Write the pixels of silhouettes where they were filmed.

    Parameters
    ----------
    packed : (camera, row, column / 8) uint8
        The silhouettes.
    pixels : (pixel, 3) uint8
        As `take_pixels` returned them of one camera after another.
    images : (camera, row, column, 3) uint8
        Changed in place, inside the silhouettes.
    """
    _place(packed, pixels, images)


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
def _place(packed: Any, pixels: Any, images: Any) -> None:
    n = 0
    for c in range(packed.shape[0]):
        for row in range(packed.shape[1]):
            for byte in range(packed.shape[2]):
                bits = packed[c, row, byte]
                if bits == 0:
                    continue
                for bit in range(8):
                    if bits >> (7 - bit) & 1:
                        for k in range(3):
                            images[c, row, 8 * byte + bit, k] = pixels[n, k]
                        n += 1
