"""Which cameras see the voxels of a hull's surface.

A camera sees a voxel when it films it inside its silhouette and the straight line from the camera
to a point above the voxel, along the outward normal, is not blocked by a voxel (a walk through
the grid, to where the line is clear; Amanatides and Woo 1987). Cameras behind the surface count
only where none in front sees the voxel: at its horizon, and on the edges of cloth. From the voxel's
own center the line would graze its neighbors, for a hull's surface is where lines of sight touch
it: a fixed tolerance in depth leaves 13 % of a dancer without color, and the walk from the center
just as many; from two voxels above it 1 %. The normal points from what is occupied within two
voxels to what is empty; where that is symmetric, as on thin cloth, there is none, and every camera
is in front.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.reconstruction.sight.clear_lines import clear_shares

REACH = 2
"""How far around a voxel its normal is taken from [voxels]. Chosen by eye on the shared captures;
not measured."""

_NEAR = 0
"""A line to a camera begins so near to its own voxel that it may pass through it."""

_FREE = 1
"""A line to a camera begins in what is empty beyond its own voxel."""

_OUTSIDE = 2
"""A line to a camera begins outside the crop, so that nothing blocks it."""

_INSIDE = 3
"""A line to a camera begins in another voxel, which blocks it."""

_CORNER = 0.76
"""Square of the distance from a voxel's center to beyond its corner [voxels²]. The corner is at
0.75."""

_ROUNDING = 1e-9
"""By how much a walk ends before the border of the crop [share of the line]. Rounding then never
walks out of it."""


def hide_pixels(
    crop: NDArray[np.uint8],
    place: NDArray[np.int64],
    cameras: NDArray[np.float64],
    lift: float,
    pixel: NDArray[np.int32],
) -> None:
    """Write -1 for the pixels of the cameras that do not see a voxel.

    Parameters
    ----------
    crop : (x, y, z) uint8
        1 where occupied, with at least `REACH` empty layers on each side.
    place : (voxel, 3) int64
        Index in the crop of the voxels of the surface.
    cameras : (camera, 3) float64
        Where the cameras are, in the crop, in voxels.
    lift
        How far above a voxel the lines to the cameras begin, in voxels.
    pixel : (camera, voxel, 2) int32
        Where the cameras film the voxels; row and column are -1 where they do not. Changed in
        place, the row only.
    """
    normal = np.empty((3, len(place)))
    _find_normals(_code_lines(crop), place, normal)
    start = place.T + lift * normal
    state, own = np.empty(len(place), np.uint8), np.empty(len(place), np.int64)
    _look_around(crop, place, start, state, own)
    share, saved = clear_shares(place, start.T, cameras, crop.shape)
    surface = (start, normal, state, own)
    seen = np.zeros(len(place), np.bool_)
    for c, camera in enumerate(cameras):  # lines that go the same way take the same branches
        _hide_in_front(crop, surface, camera, (share[c], saved[c]), pixel[c, :, 0], seen)
    for c, camera in enumerate(cameras):
        _hide_behind(crop, surface, camera, share[c], pixel[c, :, 0], seen)


@njit(cache=True, nogil=True)
def _code_lines(crop: Any) -> Any:
    """Return which of the voxels from two under to two above each one, along z, are occupied.

    The lowest bit is that of the one under; what lies outside the crop is empty.
    """
    code = np.zeros(crop.shape, np.uint8)
    depth = crop.shape[2]
    for i in range(crop.shape[0]):
        for j in range(crop.shape[1]):
            line, bits = crop[i, j], code[i, j]
            for bit in range(2 * REACH + 1):
                first, end = max(0, REACH - bit), min(depth, depth + REACH - bit)
                from_line, into = line[first + bit - REACH : end + bit - REACH], bits[first:end]
                for k in range(len(into)):
                    into[k] |= from_line[k] << bit
    return code


@njit(cache=True, nogil=True)
def _find_normals(code: Any, place: Any, normal: Any) -> None:
    """Write the outward unit normal of each voxel; 0 where what is around is symmetric.

    Away from what is occupied is toward what is empty, for the voxels around have the mean 0. Of
    each line along z its count and its weight are in a number, and so are the sums of them.
    """
    unit = 1 << 16
    table = np.zeros(1 << (2 * REACH + 1), np.int64)
    for bits in range(len(table)):
        for k in range(2 * REACH + 1):
            table[bits] += (unit + k - REACH) * (bits >> k & 1)
    for n in range(len(place)):
        x, y, z = place[n, 0], place[n, 1], place[n, 2]
        total = along_x = along_y = 0
        for i in range(-REACH, REACH + 1):
            for j in range(-REACH, REACH + 1):
                found = table[code[x + i, y + j, z]]
                total += found
                along_x += i * found
                along_y += j * found
        half = unit >> 1  # weights may be negative
        count = (total + half) >> 16
        a, b = -((along_x + half) >> 16), -((along_y + half) >> 16)
        c = count * unit - total
        length = max(np.sqrt(a * a + b * b + c * c), 1.0)
        normal[0, n], normal[1, n], normal[2, n] = a / length, b / length, c / length


@njit(cache=True, nogil=True)
def _look_around(crop: Any, place: Any, start: Any, state: Any, own: Any) -> None:
    """Write what is where lines begin, and the number of the voxel that they begin above."""
    nx, ny, nz = crop.shape
    for n in range(len(place)):
        x, y, z = start[0, n], start[1, n], start[2, n]
        i, j, k = int(np.floor(x + 0.5)), int(np.floor(y + 0.5)), int(np.floor(z + 0.5))
        own[n] = (place[n, 0] * ny + place[n, 1]) * nz + place[n, 2]
        if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
            state[n] = _OUTSIDE
        elif crop[i, j, k] and (i * ny + j) * nz + k != own[n]:
            state[n] = _INSIDE
        else:
            away = (x - place[n, 0]) ** 2 + (y - place[n, 1]) ** 2 + (z - place[n, 2]) ** 2
            state[n] = _FREE if away > _CORNER else _NEAR


@njit(cache=True, nogil=True)
def _hide_in_front(crop: Any, surface: Any, camera: Any, clear: Any, row: Any, seen: Any) -> None:
    """Write -1 for the rows that a camera before the surface does not see; mark what it sees.

    Those that it would see from behind are written as -2 less the row, for they wait. The loops
    before the walk have no branches: whether a voxel is seen cannot be foreseen. A line that begins
    beyond its own voxel leads away from it, so that what it meets first is of the surface.
    """
    start, normal, state, _ = surface
    share, saved = clear
    toward = np.empty(len(row))
    for n in range(len(row)):
        along = (camera[0] - start[0, n]) * normal[0, n] + (camera[1] - start[1, n]) * normal[1, n]
        toward[n] = along + (camera[2] - start[2, n]) * normal[2, n]
    lines, count = np.empty(len(row), np.int32), 0
    end = np.empty(len(row), np.float32)
    for n in range(len(row)):
        end[n] = share[n] - (saved if state[n] == _FREE else np.float32(0.0))
    for n in range(len(row)):
        own = row[n]
        front = (own >= 0) & (toward[n] >= 0)
        is_clear = end[n] <= 0
        is_clear = (state[n] == _OUTSIDE) | (is_clear & (state[n] != _INSIDE))
        row[n] = own if front | (own < 0) else -2 - own
        row[n] = -1 if front & (state[n] == _INSIDE) else row[n]
        seen[n] |= front & is_clear
        lines[count] = n
        count += front & (not is_clear) & (state[n] != _INSIDE)
    _walk(crop, surface, camera, (lines[:count], end), row, seen)


@njit(cache=True, nogil=True)
def _hide_behind(crop: Any, surface: Any, camera: Any, share: Any, row: Any, seen: Any) -> None:
    """Write the rows that wait, or -1 where another camera sees the voxel or this one does not."""
    lines, count = np.empty(len(row), np.int32), 0
    for n in range(len(row)):
        waiting = -2 - row[n]
        waits = (waiting >= 0) & (not seen[n])
        hidden = row[n] if waiting < 0 else -1
        row[n] = waiting if waits else hidden
        lines[count] = n
        count += waits
    found = np.zeros(len(row), np.bool_)  # those behind a surface do not stand in for each other
    _walk(crop, surface, camera, (lines[:count], share), row, found)


@njit(cache=True, nogil=True)
def _walk(crop: Any, surface: Any, camera: Any, chosen: Any, row: Any, seen: Any) -> None:
    """Write -1 for the rows whose lines to a camera are blocked; mark the others as seen."""
    start, _, _, own = surface
    lines, share = chosen
    grid = (crop.ravel(), crop.shape)
    for n in lines:
        x, y, z = start[0, n], start[1, n], start[2, n]
        way = (camera[0] - x, camera[1] - y, camera[2] - z)
        if _blocked(grid, (x, y, z), way, own[n], share[n]):
            row[n] = -1
        else:
            seen[n] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _blocked(grid: Any, start: Any, way: Any, own: Any, share: Any) -> Any:
    """Return whether a line meets an occupied voxel of a grid, other than its own.

    `share`: from which share of its way on it does not.
    """
    occupied, (nx, ny, nz) = grid
    x, y, z = start
    dx, dy, dz = way
    i, j, k = int(np.floor(x + 0.5)), int(np.floor(y + 0.5)), int(np.floor(z + 0.5))
    if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
        return False
    at = (i * ny + j) * nz + k
    if share <= 0:
        return occupied[at] and at != own
    step_x, far_x, tx, end_x = _steps(x, dx, i, nx)
    step_y, far_y, ty, end_y = _steps(y, dy, j, ny)
    step_z, far_z, tz, end_z = _steps(z, dz, k, nz)
    step_x, step_y = step_x * ny * nz, step_y * nz
    end = min(min(end_x, end_y), min(end_z, 1.0)) * (1 - _ROUNDING)
    end = min(end, np.float64(share))
    while not occupied[at] or at == own:
        if tx < ty and tx < tz:
            if tx >= end:
                return False
            at, tx = at + step_x, tx + far_x
        elif ty < tz:
            if ty >= end:
                return False
            at, ty = at + step_y, ty + far_y
        else:
            if tz >= end:
                return False
            at, tz = at + step_z, tz + far_z
    return True


@njit(cache=True, nogil=True)
def _steps(x: Any, dx: Any, i: Any, count: Any) -> Any:
    """Return a line's direction along an axis, its share from plane to plane, to the first, out."""
    if dx == 0:
        return 1, np.inf, np.inf, np.inf
    share = 1 / dx
    if dx > 0:
        return 1, share, (i + 0.5 - x) * share, (count - 0.5 - x) * share
    return -1, -share, (i - 0.5 - x) * share, (-0.5 - x) * share
