"""Make the background of a camera, pixel by pixel, and measure how bright a frame is beside it."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

_STEP = 3
"""From a pixel to the next one that tells the brightness of a frame, in rows and columns [px].
Every third says enough; chosen by eye on the shared captures, not measured."""

_DARK = 3 * 20.0
"""A pixel of the background that is darker tells no gain [levels, sum of three channels]. Noise is
a large share of it; chosen by eye, not measured."""

_CLIPPED = 3 * 250.0
"""A pixel of a frame that is brighter tells no gain [levels, sum of three channels]. It may be
clipped at 255."""

_LARGEST_GAIN = 2.0
"""How many times as bright as the background a frame is at most, and the other way round [factor].
Beyond that the scene is another one, not the exposure."""

_GAIN_REACH = np.float32(0.1)
"""How far from the median the gain of a pixel may be that tells a frame's gain [share of the
median]. Performer and shadows are farther off; chosen by eye, not measured."""

_BUCKETS = 16384
"""In how many buckets the gains of pixels are put to find their median [buckets]. It changes the
speed only."""

_BUCKETS_TO_ONE = 4096
"""How many of the buckets are for gains up to 1 [buckets]. The last one is for gains from 4 on."""

_LAPLACIAN = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
"""The difference of two Laplacians, which leaves of a picture its noise [factor]. Immerkær 1996."""

_LAPLACIAN_GAIN = 6.0
"""How many times the standard deviation of independent noise it makes larger [factor]. It is the
root of the sum of its squares."""

_SMOOTHED_NOISE = 0.375
"""What 1-2-1 in rows and columns leaves of the standard deviation of independent noise [share]. It
is 6/16, the sum of the squares of 1-2-1 over 4 squared."""

_NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a normal deviate [standard deviations]. From the table of the
normal distribution."""

_FEW = 3
"""With fewer pictures of a background its noise is measured over the picture [pictures]. The median
of one or two pictures leaves nobody out."""


@dataclass(frozen=True)
class Background:
    """What a camera sees where nobody dances."""

    color: NDArray[np.float32]
    """(row, column, 3), RGB 0-255, smoothed as `smooth` does."""
    noise: NDArray[np.float32]
    """(row, column), standard deviation of a smoothed channel, in levels."""
    sure: float = 1.0
    """Share of the picture in which it is no guess."""
    key: str = ""
    """The color of the screen that it was found by, where it was."""
    planes: NDArray[np.float32] = field(init=False, repr=False)
    """(4, row, column), red, green and blue, of which `color` is a view, and their sum."""

    def __post_init__(self) -> None:
        """Lay the color out in planes, once: of 1920 x 1080 pixels it has 25 MB a camera."""
        planes = np.empty((4, *self.color.shape[:2]), np.float32)
        planes[:3] = self.color.transpose(2, 0, 1)
        planes[3] = planes[0] + planes[1] + planes[2]
        object.__setattr__(self, "planes", planes)
        object.__setattr__(self, "color", planes[:3].transpose(1, 2, 0))

    @cached_property
    def brightness(self) -> NDArray[np.float32]:
        """(row / 3, column / 3), sum of the channels of the pixels that tell a frame's gain."""
        red, green, blue = np.moveaxis(self.color[::_STEP, ::_STEP], -1, 0)
        return red + green + blue


def smooth(image: NDArray[np.uint8], into: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
    """Return a picture (row, column, 3) smoothed by 1-2-1 in rows and in columns.

    Beyond the border the picture is mirrored, its outermost pixels not repeated. Where an array
    (3, row, column) is given, the picture is written into it, a plane a channel.
    """
    planes = np.empty((3, *image.shape[:2]), np.uint8) if into is None else into
    _smooth(image, planes)
    return planes.transpose(1, 2, 0)


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
    if len(images) < _FEW:
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
    behind = background.brightness
    planes = np.ascontiguousarray(image.transpose(2, 0, 1))  # as `smooth` made them
    gain = _gain(planes, behind, np.empty(behind.size, np.float32), np.empty_like(behind.ravel()))
    return np.float32(min(max(gain, 1.0 / _LARGEST_GAIN), _LARGEST_GAIN))


def _image_noise(image: NDArray[np.uint8]) -> np.float32:
    """Return the standard deviation of the noise of a channel, from what no surface explains."""
    rough = cv2.filter2D(image.astype(np.float32), -1, _LAPLACIAN)
    return np.float32(np.median(np.abs(rough)) / _NORMAL_MEDIAN / _LAPLACIAN_GAIN)


@njit(cache=True, nogil=True)
def _smooth(image: Any, planes: Any) -> None:
    """Write a picture smoothed by 1-2-1, a plane a channel; loops vectorize without branches."""
    rows, columns = image.shape[:2]
    width = 3 * columns
    first, last = 3 * min(1, columns - 1), 3 * max(columns - 2, 0)  # what mirrors the border
    lines = np.ascontiguousarray(image).reshape(rows, width)
    sums, smoothed = np.empty(width + 6, np.uint16), np.empty(width, np.uint8)
    inner = sums[3 : width + 3]
    for i in range(rows):
        above, line = lines[min(abs(i - 1), rows - 1)], lines[i]
        below = lines[i + 1 if i + 1 < rows else max(rows - 2, 0)]
        for j in range(width):
            inner[j] = np.uint16(above[j]) + np.uint16(2) * line[j] + np.uint16(below[j])
        for k in range(3):
            sums[k], sums[width + 3 + k] = inner[first + k], inner[last + k]
        for j in range(width):
            total = sums[j] + np.uint16(2) * sums[j + 3] + sums[j + 6] + np.uint16(8)
            smoothed[j] = total >> np.uint16(4)
        red, green, blue = planes[0, i], planes[1, i], planes[2, i]
        for j in range(columns):
            red[j], green[j], blue[j] = smoothed[3 * j], smoothed[3 * j + 1], smoothed[3 * j + 2]


@njit(cache=True, nogil=True, error_model="numpy")
def _gain(planes: Any, behind: Any, front: Any, ratio: Any) -> Any:
    """Return how bright planes are, by the pixels within a tenth of the median's gain.

    The sums are exact, in whatever order: no bit is lost of the brightness of a picture.
    """
    count = _compare(planes, behind, front, ratio)
    if not count:
        return 1.0
    median = _median(ratio, count)
    reach, there = _GAIN_REACH * median, behind.reshape(-1)
    ahead = back = 0.0
    for n in range(len(ratio)):
        if abs(ratio[n] - median) <= reach:
            ahead += front[n]
            back += there[n]
    return ahead / back


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _compare(planes: Any, behind: Any, front: Any, ratio: Any) -> Any:
    """Write the brightness of every third pixel and its gain; say of how many it can be told.

    The gain of a pixel that is dark or clipped is infinite. The loops have no branches, so that
    they are vectorized.
    """
    rows, columns = behind.shape
    count = 0
    for i in range(rows):
        red, green, blue = planes[0, _STEP * i], planes[1, _STEP * i], planes[2, _STEP * i]
        there, shade = behind[i], front[i * columns : (i + 1) * columns]
        gain = ratio[i * columns : (i + 1) * columns]
        for j in range(columns):
            k = _STEP * j
            shade[j] = np.float32(np.int32(red[k]) + np.int32(green[k]) + np.int32(blue[k]))
        for j in range(columns):
            usable = (there[j] > _DARK) & (shade[j] < _CLIPPED)
            gain[j] = shade[j] / there[j] if usable else np.float32(np.inf)
            count += usable
    return count


@njit(cache=True, nogil=True)
def _median(values: Any, count: Any) -> Any:
    """Return the median of the least `count` of values from 0: it is looked for in its bucket."""
    first, second = (count - 1) // 2, count // 2
    held = np.zeros(_BUCKETS, np.int32)
    for n in range(len(values)):
        held[_bucket(values[n])] += 1
    low = before = 0
    while before + held[low] <= first:
        before += held[low]
        low += 1
    high, end = low, before + held[low]
    while end <= second:
        high += 1
        end += held[high]
    near, n = np.empty(end - before, np.float32), 0
    for value in values:
        if low <= _bucket(value) <= high:
            near[n] = value
            n += 1
    one, other = _select(near, first - before), _select(near, second - before)
    return (one + other) / np.float32(2.0)


@njit(cache=True, nogil=True)
def _select(values: Any, wanted: Any) -> Any:
    """Return the value that would stand at a place if they were sorted; numpy's sort compiles 5 s.

    What is smaller goes before what is larger, around a value in the middle of those among which
    the place is (Hoare 1961).
    """
    low, high = 0, len(values) - 1
    while low < high:
        middle, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < middle:
                i += 1
            while middle < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if wanted <= j:
            high = j
        elif wanted >= i:
            low = i
        else:
            break
    return values[wanted]


@njit(cache=True, nogil=True)
def _bucket(value: Any) -> Any:
    """Return a number that does not fall as values rise."""
    return np.int32(min(value * np.float32(_BUCKETS_TO_ONE), np.float32(_BUCKETS - 1)))
