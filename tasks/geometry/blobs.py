"""Gaussian blobs that ride on bones, and how voxels share themselves out among them.

The paper gives each segment one ellipsoid (digitization paper, 3.3); here a bone has several,
found by k-means in its voxels of the initial frame, so that a bent or tapering part keeps its
shape. Voxels are shared out softly (Dempster, Laird and Rubin 1977), with a uniform class for
what is nobody's: cloth, and what no camera could carve away. Each blob's share of the voxels
is that of the initial frame, which is the paper's constraint on volumes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_BLOCK = 24  # voxels in order: they lie together, so that few blobs are near all of them
_FARTHEST = 18.0  # squared Mahalanobis distance beyond which a blob weighs nothing


@dataclass(frozen=True, eq=False)
class Blobs:
    """Gaussian blobs on bones, in the initial pose."""

    bone: NDArray[np.int64]
    """(blob,) the bone that each rides on."""

    offset: Floats
    """(blob, 3) mean, m, from the bone's proximal joint."""

    whitening: Floats
    """(blob, 3, 3) W of the squared Mahalanobis distance |W d|**2."""

    share: Floats
    """(blob,) share of the voxels; they sum to 1."""

    @property
    def density(self) -> Floats:
        """(blob,) share of the voxels per m**3 in a blob's middle, but for a common factor."""
        return self.share * np.abs(np.linalg.det(self.whitening))

    @property
    def reach(self) -> Floats:
        """(blob,) square of the distance, m**2, beyond which a blob weighs nothing."""
        least = np.linalg.svd(self.whitening, compute_uv=False).min(1, initial=np.inf)
        return _FARTHEST / least**2


def split(points: Floats, parts: int, rounds: int = 20) -> NDArray[np.int64]:
    """Return (point,) the part of each point: k-means from mutually far starts, no chance."""
    centers = [points[np.argmin(((points - points.mean(0)) ** 2).sum(1))]]
    distance = ((points - centers[0]) ** 2).sum(1)
    for _ in range(parts - 1):
        centers.append(points[distance.argmax()])
        distance = np.minimum(distance, ((points - centers[-1]) ** 2).sum(1))
    middle = np.stack(centers)
    part = np.zeros(len(points), np.int64)
    for _ in range(rounds):
        part = ((points[:, None] - middle) ** 2).sum(2).argmin(1)
        middle = np.stack(
            [points[part == k].mean(0) if (part == k).any() else middle[k] for k in range(parts)]
        )
    return part


def make_blobs(
    points: Floats,
    bone: NDArray[np.integer],
    origin: Floats,
    number: NDArray[np.integer],
    *,
    softness_m: float,
    most_points: int = 3000,
) -> Blobs:
    """Return the blobs of voxels whose bones are known.

    Parameters
    ----------
    points : (voxel, 3) float64
        Centers, m.
    bone : (voxel,) int
        The bone of each, -1 for none.
    origin : (bone, 3) float64
        Proximal joints, m.
    number : (bone,) int
        How many blobs a bone has, if it has voxels enough.
    softness_m
        Standard deviation added to every blob.
    most_points
        A bone's voxels are thinned to this number.
    """
    found: list[tuple[int, Floats, Floats, float]] = []
    for k in range(len(origin)):
        mine = points[bone == k]
        if len(mine) < 8:
            continue
        some = mine[:: max(1, len(mine) // most_points)]
        part = split(some, int(min(number[k], max(1, len(some) // 20))))
        for b in range(int(part.max()) + 1):
            of_part = some[part == b]
            if len(of_part) < 4:
                continue
            spread = np.cov(of_part.T) + np.eye(3) * softness_m**2
            whitening = np.linalg.cholesky(np.linalg.inv(spread)).T
            share = len(of_part) / len(some) * len(mine)
            middle = np.asarray(of_part.mean(0) - origin[k], np.float64)
            found.append((k, middle, np.asarray(whitening, np.float64), share))
    share = np.array([f[3] for f in found])
    return Blobs(
        np.array([f[0] for f in found], np.int64),
        np.array([f[1] for f in found]).reshape(-1, 3),
        np.array([f[2] for f in found]).reshape(-1, 3, 3),
        share / max(share.sum(), 1.0),
    )


def place_blobs(blobs: Blobs, joints: Floats, rotation: Floats) -> tuple[Floats, Floats]:
    """Return (blob, 3) means and (blob, 3, 3) whitenings in the world, for a pose."""
    turned = rotation[blobs.bone]
    mean = joints[blobs.bone] + np.einsum("bij,bj->bi", turned, blobs.offset)
    return mean, np.einsum("bij,bkj->bik", blobs.whitening, turned)


@njit(cache=True, nogil=True)
def _find_close(points: Any, mean: Any, reach: Any, close: Any) -> int:
    """Write the blobs that reach into the box around points; return how many they are."""
    x0 = x1 = points[0, 0]
    y0 = y1 = points[0, 1]
    z0 = z1 = points[0, 2]
    for i in range(1, len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        x0, x1 = min(x0, x), max(x1, x)
        y0, y1 = min(y0, y), max(y1, y)
        z0, z1 = min(z0, z), max(z1, z)
    found = 0
    for b in range(len(mean)):
        x = max(x0 - mean[b, 0], mean[b, 0] - x1, 0.0)
        y = max(y0 - mean[b, 1], mean[b, 1] - y1, 0.0)
        z = max(z0 - mean[b, 2], mean[b, 2] - z1, 0.0)
        if x * x + y * y + z * z <= reach[b]:
            close[found] = b
            found += 1
    return found


@njit(cache=True, nogil=True, fastmath=True)
def share_out(points: Any, look: Any, blobs: Any, weigh: Any, nobody: float, sums: Any) -> float:
    """Share voxels out among blobs; return the mean log likelihood of a voxel.

    points : (voxel, 3)
    look : likeness (voxel, kind) of each voxel's color to each kind of blob, and kind (blob,)
    blobs : mean (blob, 3) and whitening (blob, 3, 3) of `place_blobs`
    weigh : square of the distance (blob,) beyond which a voxel is none of the blob's, and what a
        voxel in the blob's middle weighs (blob,)
    nobody : what the uniform class weighs
    sums : (blob, 4) written: sum of the shares, and of shares times places
    """
    mean, whitening = blobs
    likeness, kind = look
    reach, factor = weigh
    count = mean.shape[0]
    sums[:] = 0.0
    weight, near = np.empty(count), np.empty(count, np.int64)
    close = np.empty(count, np.int64)  # blobs that reach into the box around some voxels
    total = 0.0
    for begin in range(0, points.shape[0], _BLOCK):
        end = min(begin + _BLOCK, points.shape[0])
        closing = _find_close(points[begin:end], mean, reach, close)
        for i in range(begin, end):
            all_weights = nobody
            found = 0
            for c in range(closing):
                b = close[c]
                x = points[i, 0] - mean[b, 0]
                y = points[i, 1] - mean[b, 1]
                z = points[i, 2] - mean[b, 2]
                u = whitening[b, 0, 0] * x + whitening[b, 0, 1] * y + whitening[b, 0, 2] * z
                v = whitening[b, 1, 0] * x + whitening[b, 1, 1] * y + whitening[b, 1, 2] * z
                w = whitening[b, 2, 0] * x + whitening[b, 2, 1] * y + whitening[b, 2, 2] * z
                squared = u * u + v * v + w * w
                if squared < _FARTHEST:
                    weight[found] = factor[b] * likeness[i, kind[b]] * np.exp(-0.5 * squared)
                    all_weights += weight[found]
                    near[found] = b
                    found += 1
            for n in range(found):
                share = weight[n] / all_weights
                b = near[n]
                sums[b, 0] += share
                sums[b, 1] += share * points[i, 0]
                sums[b, 2] += share * points[i, 1]
                sums[b, 3] += share * points[i, 2]
            total += np.log(all_weights)
    return total / max(points.shape[0], 1)
