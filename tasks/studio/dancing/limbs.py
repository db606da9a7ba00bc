"""Limbs of two segments, and the upright frames that they hang from.

Axes: y up; a body that faces heading 0 looks along +z and has +x on its left. A heading grows
to the left (counter-clockwise seen from above).
"""

import numpy as np
from numpy.typing import NDArray


def bend_limb(
    root: NDArray[np.float64],
    target: NDArray[np.float64],
    pole: NDArray[np.float64],
    *,
    upper_m: float,
    lower_m: float,
    reach: float = 0.985,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle joint and the end of a limb that reaches for a target.

    Two-bone inverse kinematics by the law of cosines: the middle joint lies in the plane of
    root, end and pole, on the pole's side.

    Parameters
    ----------
    root, target : (time, 3) float64
        Where the limb hangs (hip, shoulder) and where its end should be, metres.
    pole : (time, 3) float64
        Direction in which the middle joint moves when the limb bends; any length, but not
        along the limb.
    upper_m, lower_m : float
        Lengths of the two segments; both are kept exactly.
    reach : float
        Share of the full length beyond which the limb does not stretch. The last two percent
        before it are approached smoothly, so a target that is out of reach makes no jerk.

    Returns
    -------
    middle, end : (time, 3) float64
        The end is the target wherever the limb reaches that far.
    """
    along = target - root
    distance = np.linalg.norm(along, axis=-1, keepdims=True)
    along = along / np.maximum(distance, 1e-12)
    full = upper_m + lower_m
    distance = _less(distance, reach * full, 0.004 * full)
    distance = np.maximum(distance, abs(upper_m - lower_m) + 0.02 * full)
    aside = unit(pole - (pole * along).sum(axis=-1, keepdims=True) * along)
    foot = (distance**2 + upper_m**2 - lower_m**2) / (2.0 * distance)
    height = np.sqrt(np.maximum(upper_m**2 - foot**2, 0.0))
    return root + foot * along + height * aside, root + distance * along


def turned(
    yaw: NDArray[np.float64], bow: NDArray[np.float64], side: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the frames of a trunk that turns left, bows forward, then leans to its left.

    Parameters
    ----------
    yaw, bow, side : (time,) float64
        Radians.

    Returns
    -------
    (time, 3, 3) float64
        World from body: the columns are the body's left, up and forward.
    """
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)

    def rows(*entries: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack(entries, axis=-1).reshape(*yaw.shape, 3, 3)

    c, s = np.cos(yaw), np.sin(yaw)
    about_up = rows(c, zero, s, zero, one, zero, -s, zero, c)
    c, s = np.cos(bow), np.sin(bow)
    about_left = rows(one, zero, zero, zero, c, -s, zero, s, c)
    c, s = np.cos(side), np.sin(side)
    about_forward = rows(c, s, zero, -s, c, zero, zero, zero, one)
    return about_up @ about_left @ about_forward


def facing(heading: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the horizontal direction (time, 3) of a heading (time,) in radians."""
    return np.stack([np.sin(heading), np.zeros_like(heading), np.cos(heading)], axis=-1)


def unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (..., 3) with length 1."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12)


def _less(value: NDArray[np.float64], most: float, soft: float) -> NDArray[np.float64]:
    """Return the smaller of value and most, rounded off over the width `soft`."""
    return -soft * np.logaddexp(-value / soft, -most / soft)
