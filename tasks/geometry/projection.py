"""Where the cameras of a capture see the world: pinholes with OpenCV's lens distortion.

A point (x, y, z) is at `(X, Y, Z) = camera_from_world @ (x, y, z, 1)` before a camera. With
a = X / Z, b = Y / Z and s = a a + b b it is bent to

    a' = a f + 2 p1 a b + p2 (s + 2 a a)        b' = b f + p1 (s + 2 b b) + 2 p2 a b
    f  = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)

and filmed at `(u, v, 1) = intrinsics @ (a', b', 1)`, pixel centers at integers, so that its
pixel is (floor(u + 1/2), floor(v + 1/2)). A camera sees the point when Z > 0, sqrt(s) is at
most `one_to_one_radius`, and the pixel is one of its image.

Farther out the radius r f(r r) of a bent point no longer grows: the polynomial folds points
that the lens cannot see back into the image.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

_STRETCH = 1024  # points that are projected together: what is held of them stays near
_WIDEST = 10.0  # 84.3 degrees from the axis; no bent lens is believed farther out


@dataclass(frozen=True, eq=False)
class Projection:
    """The cameras of a capture, as arrays; what is given is copied and never changes.

    Raises
    ------
    ValueError
        If the numbers of cameras differ, a number is not finite, a focal length is not larger
        than 0, the last row of an intrinsic matrix is not 0 0 1 or what is below its diagonal
        not 0, an image is empty, or there are more than 8 coefficients.
    """

    camera_from_world: NDArray[np.float64]
    """(camera, 3, 4) rotation and translation, m."""

    intrinsics: NDArray[np.float64]
    """(camera, 3, 3) px."""

    distortion: NDArray[np.float64]
    """(camera, 0 to 8) k1, k2, p1, p2, k3, k4, k5, k6; kept as (camera, 8)."""

    image_size: NDArray[np.int64]
    """(camera, 2) columns and rows."""

    def __post_init__(self) -> None:
        count = len(self.camera_from_world)
        distortion = np.asarray(self.distortion, np.float64)
        faults = _faults(self, distortion)
        if faults:
            raise ValueError(f"these are no {count} cameras: {'; '.join(faults)}")
        padded = np.zeros((count, 8))
        padded[:, : distortion.shape[1]] = distortion
        for name, array, kind in (
            ("camera_from_world", self.camera_from_world, np.float64),
            ("intrinsics", self.intrinsics, np.float64),
            ("distortion", padded, np.float64),
            ("image_size", self.image_size, np.int64),
        ):
            kept = np.array(array, kind, order="C")
            kept.flags.writeable = False
            object.__setattr__(self, name, kept)

    @property
    def cameras(self) -> int:
        """How many cameras there are."""
        return len(self.camera_from_world)


def _faults(projection: Projection, distortion: NDArray[np.float64]) -> list[str]:
    """Return what is wrong with the arrays of a projection, each in words."""
    count = len(projection.camera_from_world)
    faults = []
    wanted = {"camera_from_world": (3, 4), "intrinsics": (3, 3), "image_size": (2,)}
    for name, rest in wanted.items():
        array = np.asarray(getattr(projection, name))
        if array.shape != (count, *rest):
            faults.append(f"{name} has shape {array.shape}, wanted is {(count, *rest)}")
        elif not np.isfinite(array).all():
            faults.append(f"{name} must be finite")
    if distortion.ndim != 2 or len(distortion) != count or distortion.shape[1] > 8:
        faults.append(f"distortion has shape {distortion.shape}, wanted is ({count}, 0 to 8)")
    elif not np.isfinite(distortion).all():
        faults.append("distortion must be finite")
    if faults:
        return faults
    inner = np.asarray(projection.intrinsics, np.float64)
    below = inner[:, [1, 2, 2], [0, 0, 1]]
    if below.any() or (inner[:, 2, 2] != 1).any() or (inner[:, [0, 1], [0, 1]] <= 0).any():
        faults.append(
            "an intrinsic matrix must be (fx, skew, cx), (0, fy, cy), (0, 0, 1) with fx and fy "
            "larger than 0; divide it by its last element"
        )
    if (np.asarray(projection.image_size) < 1).any():
        faults.append("an image must have at least one row and one column")
    return faults


@lru_cache(maxsize=8)
def one_to_one_radius(projection: Projection) -> NDArray[np.float64]:
    """Return (camera,) the radius before bending up to which a lens is one to one.

    The radius is that of a point at depth 1: the tangent of its angle from the axis. It is
    infinite where nothing bends, and at most 10 elsewhere. Only the radial coefficients
    count.
    """
    radius = np.full(projection.cameras, np.inf)
    for c, (k1, k2, _, _, k3, k4, k5, k6) in enumerate(projection.distortion):
        if not projection.distortion[c].any():
            continue
        above, below = np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])
        twice_s = np.poly1d([2.0, 0.0])
        slope = (above + twice_s * above.deriv()) * below - twice_s * above * below.deriv()
        roots = np.concatenate([slope.roots, below.roots]).astype(np.complex128)
        real = roots.real[(abs(roots.imag) <= 1e-9 * abs(roots)) & (roots.real > 0)]
        radius[c] = np.sqrt(min([_WIDEST**2, *real]))
    radius.flags.writeable = False
    return radius


@lru_cache(maxsize=8)
def camera_centers(projection: Projection) -> NDArray[np.float64]:
    """Return (camera, 3) where the cameras stand in the world, m."""
    pose = projection.camera_from_world
    center = np.linalg.solve(pose[:, :, :3], -pose[:, :, 3:])[:, :, 0].astype(np.float64)
    center.flags.writeable = False
    return center


def project_points(
    points: NDArray[np.float64], projection: Projection
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where each camera films each point.

    Parameters
    ----------
    points : (point, 3) float64
        World, m.
    projection
        The cameras.

    Returns
    -------
    pixel : (camera, point, 2) float64
        Column and row; NaN where the camera does not see the point.
    depth : (camera, point) float64
        Distance along the camera's axis, m; negative behind it.
    """
    pixel = np.empty((projection.cameras, len(points), 2))
    depth = np.empty((projection.cameras, len(points)))
    _project(np.ascontiguousarray(points, np.float64), lens_of(projection), pixel, depth)
    return pixel, depth


def nearest_pixels(points: NDArray[np.float64], projection: Projection) -> NDArray[np.int32]:
    """Return (camera, point, 2) row and column of the pixel in which each camera films a point.

    Both are -1 where the camera does not see the point. As `project_points` says, faster.
    """
    pixel = np.empty((projection.cameras, len(points), 2), np.int32)
    axes = np.ascontiguousarray(points.T, np.float64)
    _find_pixels(axes, lens_of(projection), pixel)
    return pixel


def viewing_rays(
    pixel: NDArray[np.number[Any]], projection: Projection, camera: int
) -> NDArray[np.float64]:
    """Return (pixel, 3) the directions in the world in which the pixels of a camera look.

    Parameters
    ----------
    pixel : (pixel, 2)
        Columns and rows.
    projection, camera
        The cameras, and which one.

    Returns
    -------
    (pixel, 3) float64
        Each as long as it is where it is 1 m before the camera, measured along its axis.
    """
    if not len(pixel):
        return np.zeros((0, 3))
    inner, bent = projection.intrinsics[camera], projection.distortion[camera]
    flat = cv2.undistortPoints(pixel[:, None].astype(np.float64), inner, bent)[:, 0]
    ahead = np.column_stack([flat, np.ones(len(flat))])
    return ahead @ projection.camera_from_world[camera, :, :3]


def lens_of(projection: Projection) -> tuple[NDArray[Any], ...]:
    """Return the cameras as kernels take them: poses, intrinsics, lenses, radii and image sizes."""
    return (
        projection.camera_from_world,
        projection.intrinsics,
        projection.distortion,
        one_to_one_radius(projection),
        projection.image_size,
    )


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def bend_point(a: Any, b: Any, s: Any, k: Any) -> Any:
    """Return the point (a', b') that a lens bends (a, b) to, as the head of this module says.

    `s` is a a + b b, and `k` are k1, k2, p1, p2, k3, k4, k5, k6. It is inlined before loops are
    vectorized: as a call it makes `nearest_pixels` take twice as long.
    """
    f = 1 + s * (k[0] + s * (k[1] + s * k[4]))
    f /= 1 + s * (k[5] + s * (k[6] + s * k[7]))
    ab = a * b
    return (
        a * f + (2 * k[2] * ab + k[3] * (s + 2 * a * a)),
        b * f + (k[2] * (s + 2 * b * b) + 2 * k[3] * ab),
    )


@njit(cache=True, nogil=True)
def _project(points: Any, lens: Any, pixel: Any, depth: Any) -> None:
    """Write the pixel and the depth of each point before each camera."""
    poses, intrinsics, distortion, radius, image_size = lens
    for c in range(len(poses)):
        m, inner, k = poses[c], intrinsics[c], distortion[c]
        columns, rows = image_size[c, 0], image_size[c, 1]
        for n in range(len(points)):
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            d = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            depth[c, n] = d
            pixel[c, n, 0] = pixel[c, n, 1] = np.nan
            if d <= 0:
                continue
            a = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / d
            b = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / d
            s = a * a + b * b
            if s > radius[c] * radius[c]:
                continue
            if radius[c] < np.inf:
                a, b = bend_point(a, b, s, k)
            u = inner[0, 0] * a + inner[0, 1] * b + inner[0, 2]
            v = inner[1, 1] * b + inner[1, 2]
            if 0 <= np.floor(u + 0.5) < columns and 0 <= np.floor(v + 0.5) < rows:
                pixel[c, n, 0], pixel[c, n, 1] = u, v


@njit(cache=True, nogil=True, error_model="numpy")
def _find_pixels(points: Any, lens: Any, pixel: Any) -> None:
    """Write the nearest pixel of each point, (3, point), before each camera."""
    poses, intrinsics, distortion, radius, image_size = lens
    for c in range(len(poses)):
        camera = (poses[c], intrinsics[c], distortion[c], radius[c], image_size[c])
        _find_pixels_of(points, camera, pixel[c])


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _find_pixels_of(points: Any, camera: Any, pixel: Any) -> None:
    """Write the nearest pixel of each point, (3, point), before a camera.

    The loops have no branches, and what they write is their own, so that they are vectorized.
    """
    m, inner, (k1, k2, p1, p2, k3, k4, k5, k6), radius, (columns, rows) = camera
    k = (k1, k2, p1, p2, k3, k4, k5, k6)
    u, v, s = np.empty(_STRETCH), np.empty(_STRETCH), np.empty(_STRETCH)
    for first in range(0, points.shape[1], _STRETCH):
        count = min(_STRETCH, points.shape[1] - first)
        x, y = points[0, first : first + count], points[1, first : first + count]
        z = points[2, first : first + count]
        for n in range(count):
            d = m[2, 0] * x[n] + m[2, 1] * y[n] + m[2, 2] * z[n] + m[2, 3]
            a = m[0, 0] * x[n] + m[0, 1] * y[n] + m[0, 2] * z[n] + m[0, 3]
            b = m[1, 0] * x[n] + m[1, 1] * y[n] + m[1, 2] * z[n] + m[1, 3]
            ahead = d > 0
            d = d if ahead else 1.0
            u[n], v[n] = a / d, b / d
            s[n] = u[n] * u[n] + v[n] * v[n] if ahead else np.inf
        if radius < np.inf:
            for n in range(count):
                seen = s[n] <= radius * radius
                q = s[n] if seen else 0.0
                u[n], v[n] = bend_point(u[n], v[n], q, k)
                s[n] = q if seen else np.inf
        for n in range(count):
            column = np.floor(inner[0, 0] * u[n] + inner[0, 1] * v[n] + inner[0, 2] + 0.5)
            row = np.floor(inner[1, 1] * v[n] + inner[1, 2] + 0.5)
            filmed = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            filmed &= s[n] < np.inf
            u[n] = row if filmed else -1.0
            v[n] = column if filmed else -1.0
        for n in range(count):
            pixel[first + n, 0], pixel[first + n, 1] = np.int32(u[n]), np.int32(v[n])
