"""Find what a camera sees before a blue or green screen where nobody dances, from its film.

A pixel's background is the most frequent color of those that have the hue of the screen: it is seen
there in the end, however long the performer stands before it. Where it is never seen, there is
either no screen, which reaches the border of the picture and does not change, and is the background
as it is; or always the performer, before a screen like that around him.
"""

import re
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.capture.backgrounds import Background
from tasks.capture.estimating import (
    ALONE,
    KEPT,
    find_groups,
    follow_stage,
    smooth_alike,
    touches_border,
)

AUTO = "auto"
"""The key that is found in the film."""

_COSINE = 0.9
"""Cosine of the angle between two hues that are one [cosine]. 26 degrees: the shades of a screen
that is lit unevenly."""

_SATURATION = 0.4
"""How saturated the screen is at least, in lamps and shadows [share of the key's]. Chosen by eye on
rendered captures; not measured."""

_LEAST_SATURATION = 0.25
"""How saturated a key color is at least [length of its chroma to its mean]. Gray has no hue; the
rendered screens have 0.6, skin 0.3."""

_DARKEST = 20.0
"""A darker color has no hue [levels, mean of the channels]. Noise is a large share of it."""

_HUES = 72
"""How many hues are told apart where the screen's is looked for [hues]. 5 degrees each."""

_SCREENS = (75.0, 260.0)
"""From which to which hue screens are [degrees]. From yellow green to blue."""

_LEAST_SCREEN = 0.05
"""How much of a picture the screen covers at least [share]. Chosen, not measured."""

_SELDOM = 0.04
"""In how many of the frames the hue of the screen is seen where there is none, at most [share]. A
seam of colors may pass."""


class NoScreenError(ValueError):
    """There is no screen of the key color in the film."""


def key_fault(key: str) -> str | None:
    """Say what is wrong with a key color, if anything is."""
    if key in ("", AUTO):
        return None
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", key):
        return f'key is {key!r}, it must be "auto" or a color such as "#00b140"'
    if _saturation(_color_of(key)) < _LEAST_SATURATION:
        return f"key is {key}, a color without a hue; a screen is green or blue, as #00b140 is"
    return None


def estimate_screen(images: NDArray[np.uint8], key: str) -> Background:
    """Return the background of a camera before a screen.

    Parameters
    ----------
    images : (image, row, column, 3) uint8
        RGB, as filmed, spread over the film: some 50. They are smoothed in place.
    key
        "auto", or the color of the screen, such as "#00b140".

    Raises
    ------
    NoScreenError
        There is no such screen: what there is instead.
    """
    smooth_alike(images)
    wanted = _find_key(images) if key == AUTO else _color_of(key)
    is_screen = np.stack([_has_hue(image, wanted) for image in images])
    share = float(is_screen.mean())
    if share < _LEAST_SCREEN:
        raise NoScreenError(
            f"only {share:.0%} of its film has the hue of the key color {_name(wanted)}; the most "
            f"frequent color with a hue is {_name(_most_frequent_hue(images, (0.0, 360.0))[0])}"
        )
    color, noise, seen = find_groups(images, is_screen, KEPT)
    beside = _beside_screen(images, is_screen)
    if beside.any():
        [plain], [its_noise], _ = find_groups(images, np.ones_like(is_screen))
        color[0][beside], noise[0][beside] = plain[beside], its_noise[beside]
    found = follow_stage(images, (color, noise, seen), beside | (seen[0] >= ALONE))
    return replace(found, key=_name(wanted))


def _beside_screen(images: NDArray[np.uint8], is_screen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels where there is no screen: they reach the border, and do not change."""
    _, _, [seen] = find_groups(images, np.ones(images.shape[:3], np.bool_))
    seldom = is_screen.mean(axis=0) <= _SELDOM
    return touches_border((seldom & (seen >= ALONE)).view(np.uint8))


def _find_key(images: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the color of a screen that most of the pixels with a hue have."""
    color, share = _most_frequent_hue(images, _SCREENS)
    if share < _LEAST_SCREEN:
        raise NoScreenError(
            f"no blue or green screen covers more than {share:.0%} of its film; write its color as "
            'key = "#00b140", or film the empty stage'
        )
    return color


def _most_frequent_hue(
    images: NDArray[np.uint8], within: tuple[float, float]
) -> tuple[NDArray[np.float64], float]:
    """Return the median color of the most frequent hue, and the share of pixels that have it."""
    colors = images[:, ::4, ::4].reshape(-1, 3).astype(np.float64)
    chroma = colors - colors.mean(axis=1, keepdims=True)
    saturated = np.linalg.norm(chroma, axis=1) >= _LEAST_SATURATION * colors.mean(axis=1)
    saturated &= colors.mean(axis=1) >= _DARKEST
    red, green, blue = colors.T
    hue = np.degrees(np.arctan2(np.sqrt(3) * (green - blue), 2 * red - green - blue)) % 360
    saturated &= (hue >= within[0]) & (hue <= within[1])
    if not saturated.any():
        return np.median(colors, axis=0), 0.0
    bins = (hue / 360 * _HUES).astype(np.int64) % _HUES
    held = np.bincount(bins[saturated], minlength=_HUES)
    near = sum(np.roll(held, step) for step in (-2, -1, 0, 1, 2))
    apart = np.abs((bins - int(np.argmax(near)) + _HUES // 2) % _HUES - _HUES // 2)
    chosen = saturated & (apart <= 2)
    return np.median(colors[chosen], axis=0), float(chosen.mean())


def _has_hue(image: NDArray[np.uint8], key: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (row, column) whether a pixel of a picture has the hue of a color."""
    mean = cv2.transform(image.astype(np.float32), np.full((1, 3), 1 / 3, np.float32))
    chroma = image - mean[..., None]
    length = np.sqrt((chroma * chroma).sum(axis=2))
    wanted = (key - key.mean()) / np.linalg.norm(key - key.mean())
    along = chroma @ wanted.astype(np.float32)
    least = _SATURATION * _saturation(key)
    return (along >= _COSINE * length) & (length >= least * mean) & (mean >= _DARKEST)


def _saturation(color: NDArray[np.float64]) -> float:
    """Return the length of a color's chroma to its mean."""
    mean = float(color.mean())
    return float(np.linalg.norm(color - mean)) / max(mean, 1.0)


def _color_of(key: str) -> NDArray[np.float64]:
    """Return RGB of "#rrggbb"."""
    return np.array([int(key[n : n + 2], 16) for n in (1, 3, 5)], np.float64)


def _name(color: NDArray[Any]) -> str:
    """Return "#rrggbb" of RGB."""
    return "#" + "".join(f"{round(float(value)):02x}" for value in color)
