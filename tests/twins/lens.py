"""Where a calibrated camera films a point, and what a pixel looks along: x = K (R X + t).

A camera is given by its intrinsic matrix, its distortion (k1, k2, p1, p2, k3, k4, k5, k6 of
OpenCV's model, or the first of them), its rotation and translation; metres in, pixels out, pixel
centers at integers.
"""

import numpy as np
from numpy.typing import NDArray

_STEPS = 50  # of Newton's method; three or four are usual
_CLOSE = 1e-14


def image_from_world(
    intrinsics: NDArray[np.float64],
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the (..., 3, 4) projection matrices of cameras, without their distortion.

    Parameters
    ----------
    intrinsics, rotation : (..., 3, 3) float64
    translation : (..., 3) float64
    """
    return intrinsics @ np.concatenate([rotation, translation[..., None]], axis=-1)


def camera_center(
    rotation: NDArray[np.float64], translation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where cameras stand, (..., 3), of (..., 3, 3) rotations and (..., 3) translations."""
    return -np.einsum("...ji,...j->...i", rotation, translation)


def project(
    points: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    distortion: NDArray[np.float64],
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where a camera films points, inside its image or not.

    Parameters
    ----------
    points : (..., 3) float64
        World, m.
    intrinsics, distortion, rotation, translation
        The camera.

    Returns
    -------
    pixel : (..., 2) float64
        Column and row; NaN behind the camera, and farther from its axis than `widest_radius`.
    depth : (...,) float64
        Distance along the axis, m; negative behind the camera.
    """
    seen = np.asarray(points, np.float64) @ rotation.T + translation
    depth = seen[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = np.where(depth[..., None] > 0, seen[..., :2] / depth[..., None], np.nan)
    folded = np.sum(plane**2, axis=-1) > widest_radius(distortion) ** 2
    plane[folded] = np.nan
    return bend(plane, distortion) @ intrinsics[:2, :2].T + intrinsics[:2, 2], depth


def bend(plane: NDArray[np.float64], distortion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 2) points at depth 1 as the lens bends them (OpenCV's rational model)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = _padded(distortion)
    a, b = plane[..., 0], plane[..., 1]
    s = a * a + b * b
    f = (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))
    return np.stack(
        [
            a * f + 2 * p1 * a * b + p2 * (s + 2 * a * a),
            b * f + p1 * (s + 2 * b * b) + 2 * p2 * a * b,
        ],
        axis=-1,
    )


def widest_radius(distortion: NDArray[np.float64]) -> float:
    """Return how far from the axis, at depth 1, the lens is one to one.

    Farther out the polynomial turns back and would film in the image what is far beside it. Only
    the radial coefficients count; infinite where they never turn back.
    """
    k1, k2, _, _, k3, k4, k5, k6 = _padded(distortion)
    above, below = np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])
    s = np.poly1d([1.0, 0.0])
    slope = (above + 2 * s * above.deriv()) * below - 2 * s * above * below.deriv()
    roots = np.asarray(np.concatenate([slope.roots, below.roots]), np.complex128)
    real = roots.real[(abs(roots.imag) <= 1e-9 * abs(roots)) & (roots.real > 0)]
    return float(np.sqrt(real.min())) if real.size else np.inf


def undistort(
    pixel: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    distortion: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the points at depth 1 that are filmed at pixels.

    By Newton's method on `bend`, so that it undoes it to the last digits, where OpenCV's fixed
    number of steps stops short.

    Parameters
    ----------
    pixel : (..., 2) float64
        Column and row.

    Returns
    -------
    (..., 2) float64
        Right and down of the axis; NaN where the lens films nothing at a pixel.
    """
    focal = np.linalg.inv(intrinsics[:2, :2])
    target = (np.asarray(pixel, np.float64) - intrinsics[:2, 2]) @ focal.T
    if not _padded(distortion).any():
        return target
    widest = widest_radius(distortion)
    # from within the one-to-one radius, where Newton's method cannot run away over the fold
    start = np.linalg.norm(target, axis=-1, keepdims=True)
    plane = target * np.minimum(1.0, 0.9 * widest / np.maximum(start, 1e-300))
    for _ in range(_STEPS):
        off = bend(plane, distortion) - target
        if not (abs(off) > _CLOSE).any():
            break
        step = _solved(_slope(plane, distortion), off)
        plane = plane - step
        radius = np.linalg.norm(plane, axis=-1, keepdims=True)
        plane = plane * np.minimum(1.0, 0.999 * widest / np.maximum(radius, 1e-300))
    missed = np.linalg.norm(bend(plane, distortion) - target, axis=-1, keepdims=True) > 1e-9
    return np.where(missed, np.nan, plane)


def viewing_ray(
    pixel: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    distortion: NDArray[np.float64],
    rotation: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the unit directions (..., 3) in the world that pixels (..., 2) look along."""
    plane = undistort(pixel, intrinsics, distortion)
    ahead = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
    return (ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)) @ rotation


def _padded(distortion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return all eight coefficients."""
    if np.ndim(distortion) != 1 or len(distortion) > 8:
        raise ValueError(
            f"distortion has shape {np.shape(distortion)}; a row of at most 8 coefficients is "
            "wanted"
        )
    return np.pad(np.asarray(distortion, np.float64), (0, 8 - len(distortion)))


def _slope(plane: NDArray[np.float64], distortion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (..., 2, 2) derivatives of `bend`."""
    k1, k2, p1, p2, k3, k4, k5, k6 = _padded(distortion)
    a, b = plane[..., 0], plane[..., 1]
    s = a * a + b * b
    above, below = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    f = above / below
    f_s = ((k1 + s * (2 * k2 + 3 * k3 * s)) - f * (k4 + s * (2 * k5 + 3 * k6 * s))) / below
    across = 2 * a * b * f_s + 2 * p1 * a + 2 * p2 * b
    first = f + 2 * a * a * f_s + 2 * p1 * b + 6 * p2 * a
    second = f + 2 * b * b * f_s + 6 * p1 * b + 2 * p2 * a
    return np.stack([np.stack([first, across], -1), np.stack([across, second], -1)], -2)


def _solved(slope: NDArray[np.float64], off: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the steps whose images under the 2x2 slopes are `off`; NaN where there is none."""
    a, b, c, d = slope[..., 0, 0], slope[..., 0, 1], slope[..., 1, 0], slope[..., 1, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = a * d - b * c
        return np.stack(
            [
                (d * off[..., 0] - b * off[..., 1]) / determinant,
                (a * off[..., 1] - c * off[..., 0]) / determinant,
            ],
            axis=-1,
        )
