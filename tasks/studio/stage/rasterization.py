"""Draw triangles: which one a camera sees at each sample of its image.

Triangles are bent by the lens at their corners only, so they should be small.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

NEAR_M = 0.05
"""A triangle with a corner nearer to the camera than this is not drawn."""


def project_bent(
    point: NDArray[np.floating],
    camera_from_world: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    distortion: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where a camera films points, also outside its image.

    Parameters
    ----------
    point : (..., 3) float
        World, metres.
    camera_from_world : (3, 4) float64
        Rotation and translation.
    intrinsics : (3, 3) float64
        Pixels.
    distortion : (0 to 5,) float64
        OpenCV's k1, k2, p1, p2 and k3; the rest are 0.

    Returns
    -------
    pixel : (..., 2) float32
        Column and row, pixel centers at integers.
    depth : (...) float32
        Metres along the camera's axis; 0 for what the lens cannot see, because it is behind
        it or so far out that the polynomial of the distortion folds it back.
    """
    seen = np.asarray(point, np.float64) @ camera_from_world[:, :3].T + camera_from_world[:, 3]
    depth = seen[..., 2]
    flat = seen[..., :2] / np.where(depth > NEAR_M, depth, 1.0)[..., None]
    square = (flat**2).sum(axis=-1)
    k1, k2, p1, p2, k3 = np.pad(distortion, (0, 5 - len(distortion)))
    unfolded = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * 7.0 * k3)) > 0.0
    bent = flat * (1.0 + square * (k1 + square * (k2 + square * k3)))[..., None]
    aside = 2.0 * flat[..., 0] * flat[..., 1]
    bent[..., 0] += p1 * aside + p2 * (square + 2.0 * flat[..., 0] ** 2)
    bent[..., 1] += p2 * aside + p1 * (square + 2.0 * flat[..., 1] ** 2)
    pixel = bent @ intrinsics[:2, :2].T + intrinsics[:2, 2]
    visible = (depth > NEAR_M) & unfolded
    return pixel.astype(np.float32), np.where(visible, depth, 0.0).astype(np.float32)


def draw_triangles(
    pixel: NDArray[np.float32],
    depth: NDArray[np.float32],
    triangle: NDArray[np.int32],
    nearest: NDArray[np.float32],
    seen: NDArray[np.int32],
    *,
    samples: int = 1,
) -> None:
    """Draw triangles into a depth buffer, in place.

    Parameters
    ----------
    pixel : (vertex, 2) float32
        Column and row, pixel centers at integers.
    depth : (vertex,) float32
        Metres before the camera; a triangle with a corner at 0 is left out.
    triangle : (triangle, 3) int32
        Vertices.
    nearest : (row * samples, column * samples) float32
        One over the depth of what is seen; 0 where nothing is.
    seen : (row * samples, column * samples) int32
        Number of the triangle that is seen; left as it is where nothing nearer comes.
    samples : int
        Samples along each side of a pixel, at (k + 0.5) / samples - 0.5 from its center; with
        an odd number, the middle one is the center itself.
    """
    grid = np.asarray(samples * (pixel + 0.5) - 0.5, np.float32)
    _draw(grid, depth, triangle, nearest, seen)


@njit(cache=True, nogil=True)
def _draw(pixel: Any, depth: Any, triangle: Any, nearest: Any, seen: Any) -> None:
    """Draw each triangle on the samples that it covers, edges included."""
    rows, columns = seen.shape
    for t in range(len(triangle)):
        a, b, c = triangle[t]
        if depth[a] <= 0 or depth[b] <= 0 or depth[c] <= 0:
            continue
        ax, ay, bx, by, cx, cy = (
            np.float64(pixel[a, 0]),
            np.float64(pixel[a, 1]),
            np.float64(pixel[b, 0]),
            np.float64(pixel[b, 1]),
            np.float64(pixel[c, 0]),
            np.float64(pixel[c, 1]),
        )
        left, right = max(np.ceil(min(ax, bx, cx)), 0.0), min(max(ax, bx, cx), columns - 1.0)
        top, bottom = max(np.ceil(min(ay, by, cy)), 0.0), min(max(ay, by, cy), rows - 1.0)
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0 or left > right or top > bottom:
            continue
        na, nb, nc = 1.0 / depth[a], 1.0 / depth[b], 1.0 / depth[c]
        for y in range(int(top), int(bottom) + 1):
            for x in range(int(left), int(right) + 1):
                wa = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                wb = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                wc = 1.0 - wa - wb
                if wa < -1e-9 or wb < -1e-9 or wc < -1e-9:
                    continue
                near = wa * na + wb * nb + wc * nc
                if near > nearest[y, x]:
                    nearest[y, x] = near
                    seen[y, x] = t


def lay_over(
    image: NDArray[np.float32],
    seen: NDArray[np.int32],
    color: NDArray[np.float32],
    *,
    samples: int = 1,
) -> None:
    """Lay what was drawn over an image, in place; a pixel is the mean of its samples.

    Parameters
    ----------
    image : (row, column, 3) float32
        Any color space.
    seen : (row * samples, column * samples) int32
        Number of a triangle, or -1 where the image stays.
    color : (triangle, 3) float32
        In the color space of the image.
    samples : int
        As in `draw_triangles`.
    """
    _lay(image, seen, color, samples)


@njit(cache=True, nogil=True)
def _lay(image: Any, seen: Any, color: Any, samples: Any) -> None:
    """Mix each pixel from its samples."""
    rows, columns, _ = image.shape
    for y in range(rows):
        for x in range(columns):
            covered = 0
            red = green = blue = np.float32(0.0)
            for sy in range(y * samples, (y + 1) * samples):
                for sx in range(x * samples, (x + 1) * samples):
                    t = seen[sy, sx]
                    if t >= 0:
                        covered += 1
                        red += color[t, 0]
                        green += color[t, 1]
                        blue += color[t, 2]
            if covered:
                every = np.float32(samples * samples)
                bare = (every - covered) / every
                image[y, x, 0] = bare * image[y, x, 0] + red / every
                image[y, x, 1] = bare * image[y, x, 1] + green / every
                image[y, x, 2] = bare * image[y, x, 2] + blue / every
