"""Slow twins of voxels, carving and coloring, written from their definitions alone."""

import math

import numpy as np


def encode(occupied):
    """Walk every voxel of (frame, x, y, z); return starts, lengths and frame offsets."""
    starts, lengths, offset = [], [], [0]
    frames, nx, ny, nz = occupied.shape
    for t in range(frames):
        for x in range(nx):
            for y in range(ny):
                open_run = False
                for z in range(nz):
                    if not occupied[t, x, y, z]:
                        open_run = False
                    elif open_run:
                        lengths[-1] += 1
                    else:
                        starts.append(x * ny * nz + y * nz + z)
                        lengths.append(1)
                        open_run = True
        offset.append(len(starts))
    return starts, lengths, offset


def surface(occupied):
    """Return (x, y, z) True where an occupied voxel has an empty or missing 6-neighbor."""
    found = np.zeros_like(occupied)
    for x, y, z in np.argwhere(occupied):
        for step in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]:
            there = (x + step[0], y + step[1], z + step[2])
            inside = all(0 <= there[k] < occupied.shape[k] for k in range(3))
            if not inside or not occupied[there]:
                found[x, y, z] = True
    return found


def one_to_one_radius(distortion):
    """Return where the distorted radius first stops growing, by walking out and halving."""
    k = list(distortion) + [0.0] * (8 - len(distortion))
    if not any(k):
        return math.inf

    def above(r):
        return 1 + k[0] * r**2 + k[1] * r**4 + k[4] * r**6

    def below(r):
        return 1 + k[5] * r**2 + k[6] * r**4 + k[7] * r**6

    def grows(r):
        top = 1 + 3 * k[0] * r**2 + 5 * k[1] * r**4 + 7 * k[4] * r**6
        slope = top * below(r) - r * above(r) * (2 * k[5] * r + 4 * k[6] * r**3 + 6 * k[7] * r**5)
        return slope > 0 and below(r) > 0

    r = 0.0
    while r < 100:
        ahead = min(r + 1e-3 * max(r, 0.1), 100.0)
        if not grows(ahead):
            for _ in range(200):
                middle = (r + ahead) / 2
                r, ahead = (middle, ahead) if grows(middle) else (r, middle)
            return r
        r = ahead
    return 100.0


def project(points, camera):
    """Return u, v, depth and whether it is seen, of (point, 3) points.

    camera : dict of pose (3, 4), intrinsic (3, 3), distortion (up to 8,), columns and rows.
    """
    m, a = camera["pose"], camera["intrinsic"]
    k1, k2, p1, p2, k3, k4, k5, k6 = list(camera["distortion"]) + [0.0] * (
        8 - len(camera["distortion"])
    )
    x, y, z = np.asarray(points, float).T
    with np.errstate(all="ignore"):
        across = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
        down = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
        depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        a0, b0 = across / depth, down / depth
        s = a0 * a0 + b0 * b0
        radial = (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))
        bent_a, bent_b = a0, b0
        if any(camera["distortion"]):
            bent_a = a0 * radial + (2 * p1 * (a0 * b0) + p2 * (s + 2 * a0 * a0))
            bent_b = b0 * radial + (p1 * (s + 2 * b0 * b0) + 2 * p2 * (a0 * b0))
        u = a[0, 0] * bent_a + a[0, 1] * bent_b + a[0, 2]
        v = a[1, 1] * bent_b + a[1, 2]
        seen = (depth > 0) & (np.sqrt(s) <= one_to_one_radius(camera["distortion"]))
        column, row = np.floor(u + 0.5), np.floor(v + 0.5)
        seen &= (column >= 0) & (column < camera["columns"])
        seen &= (row >= 0) & (row < camera["rows"])
    return u, v, depth, seen


def carve(silhouettes, cameras, grid, misses_allowed, min_cameras):
    """Test every voxel before every camera; grid is (origin, voxel size, shape)."""
    origin, voxel, shape = grid
    index = np.indices(shape).reshape(3, -1).T
    points = np.asarray(origin) + index * voxel
    votes, misses = np.zeros(len(index), int), np.zeros(len(index), int)
    for silhouette, camera in zip(silhouettes, cameras, strict=True):
        u, v, _, seen = project(points, camera)
        row = np.floor(v[seen] + 0.5).astype(int)
        column = np.floor(u[seen] + 0.5).astype(int)
        votes[seen] += 1
        misses[seen] += ~silhouette[row, column]
    return ((votes >= min_cameras) & (misses <= misses_allowed)).reshape(shape)
