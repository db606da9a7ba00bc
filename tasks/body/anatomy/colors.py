"""Histograms of colors, and what a color says of where it is worn.

Colors are two chromaticities, which a change of light leaves alone, and a coarse lightness.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tasks.engine.kernels import njit

CHROMA_STEP = 0.02
"""Width of a cell in either chromaticity [share of the brightness]. Chosen by eye on the shared
captures; not measured."""

LIGHT_STEP = 32
"""Height of a cell in lightness [levels of 0-255]. Coarse, for light changes; chosen by eye on the
shared captures, not measured."""

SHAPE = (100, 150, 8)
"""Cells of a histogram along red, blue and lightness: as many as all colors need."""

COLORS = SHAPE[0] * SHAPE[1] * SHAPE[2]
"""How many cells a histogram has."""

GRAY_CELL = (50, 50, 0)
"""The cell of black."""

LUMA = (0.3, 0.59, 0.11)
"""What red, green and blue add to lightness [shares]. ITU-R BT.601, to two digits."""

LEAST_SUM = 24.0
"""The sum of red, green and blue by which at least a chromaticity is divided [levels of 0-255].
Black has no chromaticity; chosen by eye on the shared captures, not measured."""

SPREAD = 0.8
"""How far counts are spread over the cells around them, a standard deviation [cells]. Chosen by
eye on the shared captures; not measured."""

SPREAD_WITHIN = 3.0
"""How far a count is spread at most [standard deviations]. Beyond is 0.3 % of it."""

LEAST_PROBABILITY = 2e-5
"""Probability that a color has that was never seen [share]. Two such colors have a ratio of 1;
chosen by eye on the shared captures, not measured."""


def color_cells(color: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Return (color,) the cell of the histograms that each RGB color (color, 3) falls into."""
    color = np.ascontiguousarray(color)
    cell = np.empty(len(color), np.intp)
    _find_cells(color, cell)
    return cell


def count_colors(cell: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return (cell,) how many colors fall into each cell, spread over the cells around it."""
    return spread_counts(np.bincount(cell, minlength=COLORS))


def spread_counts(count: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return counts (cell,) spread over the cells around each."""
    whole = count.reshape(SHAPE).astype(np.float64)
    return ndimage.gaussian_filter(whole, SPREAD, truncate=SPREAD_WITHIN).reshape(-1)


def log_ratio(own: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (cell,) the logarithm of the ratio of two distributions, given as counts."""
    share = [h / max(float(h.sum()), 1.0) + LEAST_PROBABILITY for h in (own, other)]
    return np.log(share[0]) - np.log(share[1])


def learn_likeness(
    color: NDArray[np.uint8], group: NDArray[np.integer], groups: int, *, most: float
) -> NDArray[np.float32]:
    """Return (cell, group) how much likelier each color is in a group than anywhere.

    Parameters
    ----------
    color : (voxel, 3) uint8
        RGB.
    group : (voxel,) int
        Of each, from 0; what is negative is in none, but somewhere.
    groups
        How many there are; one without voxels has ratios of 1.
    most
        Ratios are between 1 / most and most.
    """
    cell = color_cells(color)
    everywhere = count_colors(cell)
    likeness = np.ones((len(everywhere), groups), np.float32)
    limit = np.log(most)
    for k in range(groups):
        own = cell[group == k]
        if len(own):
            ratio = log_ratio(count_colors(own), everywhere)
            likeness[:, k] = np.exp(np.clip(ratio, -limit, limit))
    return likeness


@njit(cache=True, nogil=True)
def _find_cells(color: Any, cell: Any) -> None:
    """Write the cells of colors, computed in single precision."""
    one = np.float32
    for n in range(len(color)):
        r, g, b = one(color[n, 0]), one(color[n, 1]), one(color[n, 2])
        total = max(r + g + b, one(LEAST_SUM))
        red = (r - g) / total / one(CHROMA_STEP)
        blue = (r + g - one(2.0) * b) / (one(2.0) * total) / one(CHROMA_STEP)
        light = (one(LUMA[0]) * r + one(LUMA[1]) * g + one(LUMA[2]) * b) / one(LIGHT_STEP)
        i = int(np.floor(np.float64(red) + GRAY_CELL[0]))
        j = int(np.floor(np.float64(blue) + GRAY_CELL[1]))
        k = int(np.floor(np.float64(light) + GRAY_CELL[2]))
        i, j = min(max(i, 0), SHAPE[0] - 1), min(max(j, 0), SHAPE[1] - 1)
        cell[n] = (i * SHAPE[1] + j) * SHAPE[2] + min(max(k, 0), SHAPE[2] - 1)
