"""Tell which pixels of a picture differ from the background in color.

The rules and their numbers are those of `tasks.reconstruction.silhouettes`.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.capture.backgrounds import Background
from tasks.engine.kernels import njit

_BLACK = np.float32(1.0)
"""Square of a length that is added to that of the background's color [levels²]. It gives black,
which has no color, a direction that divides."""

_AT_ONCE = 64
"""How many pixels of a row are compared roughly at a time [px]. Eight times the bytes of a number
of 64 bits. It changes the speed only."""

_GAIN_BITS = 7
"""How many bits the gain has below 1 where pixels are compared roughly [bits]. With them a gain of
2 times 255 levels is a number of 16 bits."""

_LARGEST_FACTOR = 256
"""The largest gain in such bits that is compared roughly [1/128]. It is a gain of 2."""

_ROUGH = 1.5
"""How far the background of whole levels times such a gain is from that times the gain at most
[levels]. The gain is 1/256 off, times 255 levels, and the product half a level."""

_SPARE = 1.0
"""By how much the rough comparison is stricter than it had to be [levels]. It covers `_BLACK`,
for which no brightness is quite the nearest (half a level at most), and the rounding of floats."""

_LUMA_OF_RED = np.float32(0.299)
"""Share of red in luma. ITU-R BT.601."""

_LUMA_OF_GREEN = np.float32(0.587)
"""Share of green in luma. ITU-R BT.601."""

_LUMA_OF_BLUE = np.float32(0.114)
"""Share of blue in luma. ITU-R BT.601."""

_CR_OF_RED = np.float32(0.713)
"""Factor from the difference of red and luma to Cr [factor]. ITU-R BT.601: 0.5 / (1 - 0.299)."""

_CB_OF_BLUE = np.float32(0.564)
"""Factor from the difference of blue and luma to Cb [factor]. ITU-R BT.601: 0.5 / (1 - 0.114)."""


class Planes:
    """Arrays of the size of a picture, made once: the system takes its time to hand them out."""

    def __init__(self, background: Background) -> None:
        size = background.color.shape[:2]
        self.behind = background.planes
        self.levels = background.levels
        self.planes = np.empty((3, *size), np.uint8)
        self.seed = np.empty(size, np.uint8)


def differ_in_color(held: Planes, noise: NDArray[np.float32], limits: NDArray[np.float32]) -> None:
    """Set the pixels whose color no brightness of the background between the limits explains.

    Parameters
    ----------
    held
        The picture, and where it is written: 1 at these pixels, 0 at the others.
    noise : (row, column) float32
        Of the background.
    limits : (5,) float32
        How bright the picture is beside the background; threshold; how many times the noise it is
        at least; the least and the greatest brightness.
    """
    gain, threshold = float(limits[0]), float(limits[1])
    # as near in all three channels, a color is within the threshold of the background's own
    near = (threshold - _SPARE) / math.sqrt(3.0) - 0.5 * gain - _ROUGH
    factor = round(gain * (1 << _GAIN_BITS))
    bits = int(math.log2(near + 1.0)) if near >= 1.0 and factor <= _LARGEST_FACTOR else 0
    rough = held.levels, np.uint16(min(factor, _LARGEST_FACTOR)), bits
    _differ(held.planes, held.behind, noise, limits, rough, held.seed)


@njit(cache=True, nogil=True, error_model="numpy")
def _differ(image: Any, behind: Any, noise: Any, limits: Any, rough: Any, seed: Any) -> None:
    """Set pixels as `differ_in_color`; of most parts of a row a rough comparison tells: none."""
    levels, factor, bits = rough
    rows, columns = seed.shape
    parts = -(-columns // _AT_ONCE)
    away = np.zeros(parts * _AT_ONCE, np.uint8)  # beyond the row nothing is away
    eights, far = away.view(np.uint64), np.ones(parts + 1, np.bool_)
    for i in range(rows):
        if bits:
            _compare_roughly(image, levels, factor, i, away)
            _find_far(eights, bits, far)
        for j in range(columns):
            seed[i, j] = 0
        begin = 0
        while begin < parts:
            end = begin
            while end < parts and far[end]:
                end += 1
            if end > begin:
                part = (i, begin * _AT_ONCE, min(end * _AT_ONCE, columns))
                _differ_exactly(image, behind, noise, limits, part, seed)
            begin = end + 1


@njit(cache=True, nogil=True)
def _compare_roughly(image: Any, levels: Any, factor: Any, i: Any, away: Any) -> None:
    """Write half of how far a row's pixels are from the background, the channels' levels or-ed.

    All in 16 bits and without a branch, so that many pixels are compared at once.
    """
    half = np.uint16(1 << (_GAIN_BITS - 1))
    for j in range(image.shape[2]):
        away[j] = 0
    for k in range(3):
        here, there = image[k, i], levels[k, i]
        for j in range(len(here)):
            times = np.uint16(np.uint16(np.uint16(there[j]) * factor) + half)
            wanted, found = np.uint16(times >> np.uint16(_GAIN_BITS)), np.uint16(here[j])
            apart = np.uint16(wanted - found) if wanted > found else np.uint16(found - wanted)
            away[j] |= np.uint8(apart >> np.uint16(1))


@njit(cache=True, nogil=True)
def _find_far(eights: Any, bits: Any, far: Any) -> None:
    """Write in which parts of a row a pixel is away by so many bits or more, eight in a number."""
    more = np.uint64(0xFF & ~((1 << (bits - 1)) - 1)) * np.uint64(0x0101010101010101)
    for part in range(len(far) - 1):
        some = np.uint64(0)
        for n in range(part * (_AT_ONCE // 8), (part + 1) * (_AT_ONCE // 8)):
            some |= eights[n]
        far[part] = (some & more) != 0


@njit(cache=True, nogil=True, error_model="numpy")
def _differ_exactly(image: Any, behind: Any, noise: Any, limits: Any, part: Any, seed: Any) -> None:
    """Set pixels of a part of a row, planes of a channel each.

    The loops have no branches, so that they are vectorized.
    """
    gain, threshold, levels, darkest, brightest = limits
    i, begin, end = part
    far, limit = np.empty(end - begin, np.float32), np.empty(end - begin, np.float32)
    red, green, blue = image[0, i, begin:end], image[1, i, begin:end], image[2, i, begin:end]
    red_behind, green_behind = behind[0, i, begin:end], behind[1, i, begin:end]
    blue_behind, rough, into = behind[2, i, begin:end], noise[i, begin:end], seed[i, begin:end]
    for j in range(end - begin):
        r, g, b = np.float32(red[j]), np.float32(green[j]), np.float32(blue[j])
        br, bg, bb = gain * red_behind[j], gain * green_behind[j], gain * blue_behind[j]
        length = br * br + bg * bg + bb * bb + _BLACK
        share = (r * br + g * bg + b * bb) / length
        share = share if share > darkest else darkest
        share = share if share < brightest else brightest
        r, g, b = r - share * br, g - share * bg, b - share * bb
        far[j] = r * r + g * g + b * b
    for j in range(end - begin):
        least = levels * rough[j]
        least = least if least > threshold else threshold
        limit[j] = least * least
    for j in range(end - begin):
        into[j] = far[j] > limit[j]


@njit(cache=True, nogil=True, error_model="numpy")
def differ_in_chroma(image, color, threshold, seed):
    """Set the pixels whose Cr or Cb (ITU-R BT.601) is farther than `threshold` from the color's."""
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            r = np.float32(image[i, j, 0]) - color[i, j, 0]
            g = np.float32(image[i, j, 1]) - color[i, j, 1]
            b = np.float32(image[i, j, 2]) - color[i, j, 2]
            y = _LUMA_OF_RED * r + _LUMA_OF_GREEN * g + _LUMA_OF_BLUE * b
            cr, cb = _CR_OF_RED * (r - y), _CB_OF_BLUE * (b - y)
            seed[i, j] = max(abs(cr), abs(cb)) > threshold
