"""The background of a camera, pixel by pixel, and how bright a frame is beside it."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

_STEP = 3  # every third pixel of every third row says enough about the brightness of a frame
_DARK, _CLIPPED = 3 * 20.0, 3 * 250.0
_LARGEST_GAIN = 2.0
_LAPLACIAN = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
_SMOOTHED_NOISE = 0.375  # what 1-2-1 in rows and columns leaves of independent noise
_NORMAL_MEDIAN = 0.6745  # of the absolute value of a normal deviate


@dataclass(frozen=True)
class Background:
    """What a camera sees where nobody dances."""

    color: NDArray[np.float32]
    """(row, column, 3), RGB 0-255, smoothed as `smooth` does."""
    noise: NDArray[np.float32]
    """(row, column), standard deviation of a smoothed channel, in levels."""


def smooth(image: NDArray[np.uint8], into: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
    """Return a picture (row, column, 3) smoothed by 1-2-1 in rows and in columns.

    Where an array is given, the picture is written into it.
    """
    smoothed: Any = cv2.GaussianBlur(image, (3, 3), 0.0, into)
    return smoothed


def make_background(images: NDArray[np.uint8]) -> Background:
    """Return the background of a camera from one or more pictures of it.

    Of three pictures or more each pixel takes the median, so that somebody who walks through is
    left out, and its noise is the median deviation from it; before that each picture is brought
    to the brightness of the first. Of one or two pictures the noise is measured over the picture
    (Immerkær, "Fast noise variance estimation", 1996; with the median, so that edges do not
    count) and is the same everywhere.

    Parameters
    ----------
    images : (image, row, column, 3) uint8
        RGB, as filmed: pictures, or frames of a film. Some 25 spread over a film are enough.

    Returns
    -------
    Background

    Raises
    ------
    ValueError
        There is no picture, or it is none.
    """
    if images.dtype != np.uint8 or images.ndim != 4 or images.shape[3] != 3 or not images.size:
        raise ValueError(
            f"a {images.dtype} array of shape {images.shape} is no background; "
            "(image, row, column, 3) uint8 with at least one image is wanted"
        )
    smoothed = np.stack([smooth(image) for image in images]).astype(np.float32)
    flat = np.zeros(images.shape[1:3], np.float32)
    first = Background(smoothed[0], flat)
    for n, image in enumerate(images):
        smoothed[n] /= measure_gain(smooth(image), first)
    # the median of one picture is the picture
    color = np.median(smoothed, axis=0).astype(np.float32) if len(images) > 1 else smoothed[0]
    if len(images) < 3:
        return Background(color, flat + _SMOOTHED_NOISE * _image_noise(images[0]))
    spread = np.median(np.abs(smoothed - color).mean(axis=3), axis=0) / _NORMAL_MEDIAN
    # few pictures that happen to agree at a pixel do not make it free of noise
    return Background(color, np.maximum(spread, np.median(spread)).astype(np.float32))


def measure_gain(image: NDArray[np.uint8], background: Background) -> np.float32:
    """Return how many times as bright as the background a smoothed frame of its camera is.

    The performer, shadows and lamps are left out as long as they cover less than half of the
    picture: the gain is that of the pixels within a tenth of the median's. Where nothing can be
    compared it is 1.

    Parameters
    ----------
    image : (row, column, 3) uint8
        Smoothed.
    background
        Of the same camera.

    Returns
    -------
    float32
        From 0.5 to 2: beyond that the scene is another one, not the exposure.
    """
    rows, columns = (-(-side // _STEP) for side in image.shape[:2])
    seen, behind = np.empty(rows * columns, np.float32), np.empty(rows * columns, np.float32)
    count = _gather(image, background.color, seen, behind)
    if not count:
        return np.float32(1.0)
    seen, behind = seen[:count], behind[:count]
    ratio = seen / behind
    middle = np.partition(ratio, [(count - 1) // 2, count // 2])
    median = (middle[(count - 1) // 2] + middle[count // 2]) / np.float32(2.0)
    gain = _gain_near(seen, behind, ratio, median)
    return np.float32(min(max(gain, 1.0 / _LARGEST_GAIN), _LARGEST_GAIN))


def _image_noise(image: NDArray[np.uint8]) -> np.float32:
    """Return the standard deviation of the noise of a channel, from what no surface explains."""
    rough = cv2.filter2D(image.astype(np.float32), -1, _LAPLACIAN)
    return np.float32(np.median(np.abs(rough)) / _NORMAL_MEDIAN / 6.0)


@njit(cache=True, nogil=True)
def _gain_near(seen: Any, behind: Any, ratio: Any, median: Any) -> Any:
    """Return the gain of the pixels within a tenth of the median's.

    The sums are exact, in whatever order: no bit is lost of the brightness of a picture.
    """
    front = back = 0.0
    reach = np.float32(0.1) * median
    for n in range(len(ratio)):
        if abs(ratio[n] - median) <= reach:
            front += seen[n]
            back += behind[n]
    return front / back


@njit(cache=True, nogil=True)
def _gather(image, color, seen, behind):
    """Write the brightness of every third pixel that is neither dark nor clipped; say how many."""
    count = 0
    for i in range(0, image.shape[0], _STEP):
        for j in range(0, image.shape[1], _STEP):
            back = color[i, j, 0] + color[i, j, 1] + color[i, j, 2]
            front = np.float32(image[i, j, 0]) + image[i, j, 1] + image[i, j, 2]
            if back > _DARK and front < _CLIPPED:
                seen[count] = front
                behind[count] = back
                count += 1
    return count
