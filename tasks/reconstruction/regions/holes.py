"""Fill the holes of silhouettes that the other cameras contradict.

A print of the stage's color on a shirt is a hole in a silhouette, and the hull has a tunnel behind
it. So is the gap between an arm and a trunk; but there the other cameras see nothing all along the
ray of some pixel, while behind each pixel of a print they see a trunk.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.geometry.projection import (
    Projection,
    bend_point,
    camera_centers,
    lens_of,
    viewing_rays,
)
from tasks.geometry.voxels import VoxelGrid

_SLIT = np.ones((3, 3), np.uint8)
"""What closes a slit through which a hole is open: it is two pixels wide at most."""

_LEAST = 8
"""How many pixels a hole has at least [pixels]."""

_PIXELS = 6
"""How many pixels of a hole are asked first, evenly [pixels]. Chosen, not measured."""

_SHARED = 0.3
"""Of how many of these the body begins on the ray where another camera has a hole, too, at least
[share]. A print is seen by all that see its place; behind the gaps of a kimono that others do not
see, the body begins where it ends for them."""

_HOLE = 2
"""How a hole is marked."""

_NEARLY_ALL = 0.9
"""Of how many pixels of a hole they see a body at last where it is none [share]."""

_THICK_M = 0.05
"""How thick what the other cameras see behind a pixel is at least [m]."""

_STEPS = 2.0
"""How many voxels a ray is gone along at a time [voxels]."""

_ROUNDS = 6
"""How often the pixels that are left are asked: what is filled in one camera may be what another
has not seen [rounds]. The tunnels of two cameras through one print cross behind it."""

_OTHERS = 2
"""How many other cameras have to see a place at least [cameras]. With the hole's own they are the
fewest that carve a hull."""


def fill_holes(
    silhouettes: NDArray[np.bool_], projection: Projection, grid: VoxelGrid
) -> NDArray[np.int64]:
    """Fill, in place, the holes of a frame's silhouettes behind which the other cameras see a body.

    A hole is filled as a whole or stays; what is open to the outside of a silhouette is no hole.

    Parameters
    ----------
    silhouettes : (camera, row, column) bool
        Of one frame, as filmed; beside a smaller image, False.
    projection
        The cameras, in the same order.
    grid
        The volume.

    Returns
    -------
    (camera,) int64
        How many pixels were filled.
    """
    filled = np.zeros(len(silhouettes), np.int64)
    holes = [(c, hole) for c, silhouette in enumerate(silhouettes) for hole in _holes(silhouette)]

    def ask(c: int, pixels: NDArray[np.integer], seen: NDArray[np.uint8]) -> NDArray[np.bool_]:
        return measure_rays(c, pixels, seen, projection, grid)[0] >= _THICK_M

    if len({c for c, _ in holes}) < 2:
        return filled
    marks = silhouettes.astype(np.uint8)
    for c, hole in holes:
        marks[c][tuple(hole.T)] = _HOLE
    holes = [
        (c, hole)
        for c, hole in holes
        if np.mean(_fronts(c, _some(hole), marks, projection, grid)) >= _SHARED
    ]
    if not holes:
        return filled
    tried = silhouettes.astype(np.uint8)
    left = [hole for _, hole in holes]
    for _ in range(_ROUNDS):
        found = [ask(c, pixels, tried) for (c, _), pixels in zip(holes, left, strict=True)]
        if not any(each.any() for each in found):
            break
        for n, ((c, _), contradicted) in enumerate(zip(holes, found, strict=True)):
            tried[c][tuple(left[n][contradicted].T)] = True
            left[n] = left[n][~contradicted]
    for (c, hole), pixels in zip(holes, left, strict=True):
        if len(pixels) <= (1.0 - _NEARLY_ALL) * len(hole):
            silhouettes[c][tuple(hole.T)] = True
            filled[c] += len(hole)
    return filled


def _some(hole: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return some pixels of a hole, evenly."""
    return hole[np.linspace(0, len(hole) - 1, min(_PIXELS, len(hole))).round().astype(int)]


def _holes(silhouette: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return (pixel, 2) rows and columns of each hole of a silhouette (row, column).

    One that is open by a narrow slit is one, with the slit.
    """
    left, top, columns, rows = cv2.boundingRect(silhouette.view(np.uint8))
    own = silhouette[top : top + rows, left : left + columns]
    if not rows:
        return []
    closed = cv2.morphologyEx(own.astype(np.uint8), cv2.MORPH_CLOSE, _SLIT)
    lines, inside = cv2.findContours(closed, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    holes = []
    for n, line in enumerate(lines):
        if inside[0, n, 3] < 0:  # an outline
            continue
        x, y, wide, high = cv2.boundingRect(line)
        within: Any = np.zeros((high, wide), np.uint8)
        cv2.drawContours(within, [line - (x, y)], 0, 1, cv2.FILLED)
        within &= ~own[y : y + high, x : x + wide]
        if within.sum() >= _LEAST:
            holes.append(np.argwhere(within) + np.array([top + y, left + x]))
    return holes


def _fronts(
    camera: int, pixels: NDArray[np.integer], marks: NDArray[np.uint8], projection: Projection,
    grid: VoxelGrid,
) -> NDArray[np.bool_]:  # fmt: skip
    """Return of which pixels the body begins on the ray where another camera has a hole, too."""
    thick, shared = measure_rays(camera, pixels, marks, projection, grid)
    return shared & (thick >= _THICK_M)


def measure_rays(
    camera: int, pixels: NDArray[np.integer], marks: NDArray[np.uint8],
    projection: Projection, grid: VoxelGrid,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:  # fmt: skip
    """Return how thick what the other cameras see on the ray of each pixel is, and what is before.

    Parameters
    ----------
    camera
        Whose pixels they are.
    pixels : (pixel, 2) int
        Rows and columns.
    marks : (camera, row, column) uint8
        1 in the silhouettes, 2 in their holes, 0 outside.
    projection, grid
        As for `fill_holes`.

    Returns
    -------
    thick : (pixel,) float64
        The longest stretch inside all silhouettes of the other cameras, m.
    shared : (pixel,) bool
        Whether just before it nothing but holes of other cameras speaks against a body.
    """
    thick, shared = np.zeros(len(pixels)), np.zeros(len(pixels), np.bool_)
    if not len(pixels):
        return thick, shared
    ray = viewing_rays(pixels[:, ::-1], projection, camera)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    low = np.array(grid.origin_m)
    box = np.array([low, low + (np.array(grid.shape) - 1) * grid.voxel_m])
    step_m = _STEPS * grid.voxel_m
    center = camera_centers(projection)[camera]
    _measure(center, ray, (box, step_m, camera), marks, lens_of(projection), (thick, shared))
    return thick, shared


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(center: Any, ray: Any, within: Any, marks: Any, lens: Any, found: Any) -> None:
    """Write the longest stretch of each ray inside the silhouettes of the other cameras.

    `within`: the corners of the volume, the step along a ray, and the camera of the rays. `found`:
    the lengths, and whether only holes are before them.
    """
    box, step, own = within
    thick, shared = found
    for n in range(len(ray)):
        first, last = 0.0, np.inf
        for a in range(3):
            one = (box[0, a] - center[a]) / ray[n, a]
            other = (box[1, a] - center[a]) / ray[n, a]
            first, last = max(first, min(one, other)), min(last, max(one, other))
        run = most = ahead = 0
        far = first
        while far <= last:
            x, y = center[0] + far * ray[n, 0], center[1] + far * ray[n, 1]
            z = center[2] + far * ray[n, 2]
            seen = _look(x, y, z, own, marks, lens)
            if seen == 1:
                run += 1
                if run > most:
                    most, shared[n] = run, ahead == 2
            else:
                run, ahead = 0, seen
            far += step
        thick[n] = most * step


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def _look(x: Any, y: Any, z: Any, own: Any, marks: Any, lens: Any) -> Any:
    """Return 1 where all other cameras see a point inside, 2 where some see a hole, else 0."""
    poses, intrinsics, distortion, radius, image_size = lens
    seeing, found = 0, 1
    count = len(poses)
    for n in range(count):
        c = (own + count // 4 + n) % count  # cameras at a right angle say no soonest
        m, inner = poses[c], intrinsics[c]
        d = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        if c == own or d <= 0:
            continue
        a = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / d
        b = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / d
        s = a * a + b * b
        if s > radius[c] * radius[c]:
            continue
        if radius[c] < np.inf:
            a, b = bend_point(a, b, s, distortion[c])
        column = int(np.floor(inner[0, 0] * a + inner[0, 1] * b + inner[0, 2] + 0.5))
        row = int(np.floor(inner[1, 1] * b + inner[1, 2] + 0.5))
        if not (0 <= column < image_size[c, 0] and 0 <= row < image_size[c, 1]):
            continue
        mark = marks[c, row, column]
        if mark == 0:
            return 0
        found = max(found, np.int64(mark))
        seeing += 1
    return found if seeing >= _OTHERS else 0
