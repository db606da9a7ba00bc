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
    while r < 10:
        ahead = min(r + 1e-3 * max(r, 0.1), 10.0)
        if not grows(ahead):
            for _ in range(200):
                middle = (r + ahead) / 2
                r, ahead = (middle, ahead) if grows(middle) else (r, middle)
            return r
        r = ahead
    return 10.0


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


def outward(occupied, voxel):
    """Return the unit vector from what is occupied within two voxels to what is empty."""
    total = np.zeros(3)
    for step in np.ndindex(5, 5, 5):
        there = voxel + np.array(step) - 2
        inside = (there >= 0).all() and (there < occupied.shape).all()
        if not inside or not occupied[tuple(there)]:
            total += np.array(step) - 2
    return total / max(np.linalg.norm(total), 1.0)


def meets(boxes, start, end):
    """Return whether a segment passes through the inside of any unit cube around (box, 3)."""
    way = end - start
    with np.errstate(all="ignore"):
        a, b = (boxes - 0.5 - start) / way, (boxes + 0.5 - start) / way
    first = np.maximum(np.minimum(a, b).max(axis=1), 0.0)
    last = np.minimum(np.maximum(a, b).min(axis=1), 1.0)
    return bool((first < last).any())


def color(occupied, grid, images, silhouettes, cameras, lift):
    """Return index, color and camera of each surface voxel, one after another."""
    origin, size, _ = grid
    index = np.argwhere(surface(occupied))
    everything = np.argwhere(occupied)
    color, chosen = np.zeros((len(index), 3), np.uint8), np.full(len(index), 255)
    filmed = [project(np.asarray(origin) + index * size, camera) for camera in cameras]
    for n, voxel in enumerate(index):
        normal = outward(occupied, voxel)
        start = voxel + lift * normal
        others = everything[(everything != voxel).any(axis=1)]
        front, back = [], []
        for c, camera in enumerate(cameras):
            u, v, _, seen = (numbers[n] for numbers in filmed[c])
            if not seen:
                continue
            row, column = math.floor(v + 0.5), math.floor(u + 0.5)
            turned, moved = camera["pose"][:, :3], camera["pose"][:, 3]
            eye = (-turned.T @ moved - origin) / size
            if silhouettes[c, row, column] and not meets(others, start, eye):
                side = front if (eye - start) @ normal >= 0 else back
                side.append((c, images[c, row, column].astype(int)))
        candidates = front or back
        if candidates:
            mean = np.mean([pixel for _, pixel in candidates], axis=0)
            far = [round(((pixel - mean) ** 2).sum(), 6) for _, pixel in candidates]
            chosen[n], color[n] = candidates[int(np.argmin(far))]
    for n in np.flatnonzero(chosen == 255):
        if (chosen < 255).any():
            far = ((index[chosen < 255] - index[n]) ** 2).sum(axis=1)
            color[n] = color[chosen < 255][np.argmin(far)]
    return index, color, chosen


def face_neighbors(index):
    """Return the places in a list of voxels of each one's neighbors; -1 where there is none."""
    steps = [(0, 0, -1), (0, 0, 1), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0)]
    place = {tuple(voxel): n for n, voxel in enumerate(index.tolist())}
    return [[place.get((x + i, y + j, z + k), -1) for i, j, k in steps] for x, y, z in index]
