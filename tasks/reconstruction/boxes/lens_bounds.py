"""Bounds of what OpenCV's lens distortion does to a box (`tasks.geometry.projection`)."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.projection import Projection, one_to_one_radius

_ROUNDED = 32
"""How many rounding errors a point's place before a camera has at most [machine epsilons]. Its
three products and sums have fewer."""

_ROUNDING = 1e-9
"""Bound of the rounding errors of a bound [share]. Double precision is exact to 2e-16, and some
tens of operations are made."""

_NEAR_RADIUS = 3.0
"""Radius up to which a lens is looked at in even steps, and in growing ones beyond [tangent of the
angle from the axis]. It is 72 degrees; few lenses film more. It changes the speed only."""

_STEPS = 2000
"""In how many places a lens is looked at within that radius, and beyond it [places]. It changes the
speed only, for the bounds hold with any number."""

_PIECES = 512
"""In how many pieces the second derivatives of a lens are bounded [pieces]. It changes
the speed only, for the bound holds with any number."""


def lens_table(projection: Projection, axes: tuple[Any, Any, Any]) -> NDArray[np.float64]:
    """Return (camera, 8, 4) everything that carving knows of a camera.

    Rows 0-2 are `camera_from_world`; then fx, skew, cx, columns; fy, cy, one-to-one radius,
    rows; k1, k2, p1, p2; k3, k4, k5, k6; edge, bend (`_lens_bounds`), and a bound of the
    rounding errors of a point's place before the camera, m.
    """
    table = np.zeros((projection.cameras, 8, 4))
    radius, edge, bend = _lens_bounds(projection)
    farthest = np.array([*(abs(axis).max() for axis in axes), 1.0])
    sums = abs(projection.camera_from_world) @ farthest
    rounding = _ROUNDED * np.finfo(np.float64).eps * sums.max(axis=1)
    inner, size = projection.intrinsics, projection.image_size
    table[:, :3] = projection.camera_from_world
    table[:, 3, :3], table[:, 3, 3] = inner[:, 0], size[:, 0]
    table[:, 4] = np.stack([inner[:, 1, 1], inner[:, 1, 2], radius, size[:, 1]], axis=1)
    table[:, 5], table[:, 6] = projection.distortion[:, :4], projection.distortion[:, 4:]
    table[:, 7, :3] = np.stack([edge, bend, rounding], axis=1)
    return table


@lru_cache(maxsize=8)
def _lens_bounds(
    projection: Projection,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return three arrays (camera,): the one-to-one radius, the edge and the bend.

    A point farther from the axis than the edge is not filmed, before bending and at depth 1.
    Within the edge no second derivative of a bent coordinate is larger than the bend, which
    is infinite where that could not be shown. Without distortion: infinite, infinite, 0.

    The radius of a bent point grows by the radial terms alone and is changed by at most
    3 (|p1| + |p2|) s by the others, so that a step from r0 to r1 is bent to at least
    r0 f(r0 r0) - 3 (|p1| + |p2|) r1 r1; the edge is where that stays beyond every corner.
    With |f'| <= f1 and |f''| <= f2 (by s) the second derivatives are at most
    6 r f1 + 4 r^3 f2 + 6 (|p1| + |p2|).
    """
    radius = one_to_one_radius(projection)
    edge, bend = np.full_like(radius, np.inf), np.zeros_like(radius)
    for c in np.flatnonzero(np.isfinite(radius)):
        inner, k = projection.intrinsics[c], projection.distortion[c]
        size = projection.image_size[c]
        corner = np.array([(u, v) for u in (-0.5, size[0] - 0.5) for v in (-0.5, size[1] - 0.5)])
        b = (corner[:, 1] - inner[1, 2]) / inner[1, 1]
        a = (corner[:, 0] - inner[0, 2] - inner[0, 1] * b) / inner[0, 0]
        farthest = np.hypot(a, b).max() * (1 + _ROUNDING)
        near = min(_NEAR_RADIUS, radius[c])
        r = np.unique(
            np.concatenate([np.linspace(0, near, _STEPS), np.geomspace(near, radius[c], _STEPS)])
        )
        s = r * r
        above, below = _polynomial(k[[0, 1, 4]], s), _polynomial(k[[5, 6, 7]], s)
        with np.errstate(divide="ignore"):
            least = (r * above / below)[:-1] - 3 * (abs(k[2]) + abs(k[3])) * s[1:]
        edge[c] = r[1:][~(least > farthest)].max(initial=0.0)
        bend[c] = _bend(k, edge[c])
    return radius, edge, bend


def _polynomial(k: NDArray[np.float64], s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 + k[0] s + k[1] s^2 + k[2] s^3."""
    return 1 + s * (k[0] + s * (k[1] + s * k[2]))


def _bend(k: NDArray[np.float64], radius: float) -> float:
    """Return a bound of the second derivatives of bending within a radius, or infinity."""
    steps = np.linspace(0, radius**2, _PIECES + 1)
    s, half, end = (steps[1:] + steps[:-1]) / 2, steps[1] / 2, steps[1:]
    values = []
    for j in ([0, 1, 4], [5, 6, 7]):
        k1, k2, k3 = k[j]
        second = abs(2 * k2 + 6 * k3 * s) + half * abs(6 * k3)
        first = abs(k1 + s * (2 * k2 + s * 3 * k3)) + half * second
        values.append((_polynomial(k[j], s), half * first, first, second))
    (above, spread, above1, above2), (below, below_spread, below1, below2) = values
    least = below - below_spread
    if not (least > 0).all():
        return np.inf
    f = (abs(above) + spread) / least
    f1 = (above1 + f * below1) / least
    f2 = (above2 + 2 * f1 * below1 + f * below2) / least
    r = np.sqrt(end)
    bound = 6 * r * f1 + 4 * r**3 * f2
    return float(bound.max() + 6 * (abs(k[2]) + abs(k[3]))) * (1 + _ROUNDING)
