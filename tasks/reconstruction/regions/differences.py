"""Tell which pixels of a picture differ from the background in color.

The rules and their numbers are those of `tasks.reconstruction.silhouettes`.
"""

from typing import Any

import numpy as np

from tasks.capture.backgrounds import Background
from tasks.engine.kernels import njit

_BLACK = np.float32(1.0)
"""Square of a length that is added to that of the background's color [levels²]. It gives black,
which has no color, a direction that divides."""

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
        self.planes = np.empty((3, *size), np.uint8)
        self.seed = np.empty(size, np.uint8)


@njit(cache=True, nogil=True, error_model="numpy")
def differ_in_color(image: Any, behind: Any, noise: Any, limits: Any, seed: Any) -> None:
    """Set the pixels whose color no brightness of the background between the limits explains.

    Planes of a channel each, and loops without branches, so that they are vectorized.
    """
    gain, threshold, levels, darkest, brightest = limits
    columns = seed.shape[1]
    far, limit = np.empty(columns, np.float32), np.empty(columns, np.float32)
    for i in range(seed.shape[0]):
        red, green, blue = image[0, i], image[1, i], image[2, i]
        red_behind, green_behind, blue_behind = behind[0, i], behind[1, i], behind[2, i]
        for j in range(columns):
            r, g, b = np.float32(red[j]), np.float32(green[j]), np.float32(blue[j])
            br, bg, bb = gain * red_behind[j], gain * green_behind[j], gain * blue_behind[j]
            length = br * br + bg * bg + bb * bb + _BLACK
            share = (r * br + g * bg + b * bb) / length
            share = share if share > darkest else darkest
            share = share if share < brightest else brightest
            r, g, b = r - share * br, g - share * bg, b - share * bb
            far[j] = r * r + g * g + b * b
        for j in range(columns):
            least = levels * noise[i, j]
            least = least if least > threshold else threshold
            limit[j] = least * least
        for j in range(columns):
            seed[i, j] = far[j] > limit[j]


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
