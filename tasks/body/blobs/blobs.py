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
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from tasks.body.anatomy.bones import over, times
from tasks.engine.kernels import njit

Floats = NDArray[np.float64]

_BLOCK = 64  # voxels in order: they lie together, so that few blobs reach into their box
_FARTHEST = np.float32(18.0)  # squared Mahalanobis distance beyond which a blob weighs nothing
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)
_SMALL = np.float32(-1 / 128)
_C3, _C4, _C5 = np.float32(1 / 6), np.float32(1 / 24), np.float32(1 / 120)


@dataclass(frozen=True, eq=False)
class Blobs:
    """Gaussian blobs on bones, in the initial pose."""

    bone: NDArray[np.int64]
    """(blob,) the bone that each rides on."""

    offset: Floats
    """(blob, 3) mean, m, from the bone's proximal joint."""

    covariance: Floats
    """(blob, 3, 3) m**2."""

    share: Floats
    """(blob,) share of the voxels; they sum to 1."""

    @property
    def density(self) -> Floats:
        """(blob,) share of the voxels per m**3 in a blob's middle, but for a common factor."""
        return self.share / np.sqrt(np.linalg.det(self.covariance))


@dataclass(frozen=True, eq=False)
class Voxels:
    """Some of a frame's voxels in blocks of 64, as `share_out` takes them; the last is filled."""

    count: int
    """How many there are."""

    points: NDArray[np.float32]
    """(block, 3, 64) centers, m."""

    likeness: NDArray[np.float32]
    """(block, kind, 64) how much likelier the color is on a kind of blob than anywhere; 0 where
    the last block is filled."""

    boxes: Floats
    """(block, 6) least and greatest coordinates, m."""


def gather_voxels(points: Floats, cell: NDArray[np.integer], looks: NDArray[np.float32]) -> Voxels:
    """Return voxels with what their colors say of kinds of blobs.

    Parameters
    ----------
    points : (voxel, 3) float64
        Centers, m, near ones near each other.
    cell : (voxel,) int
        Row of `looks` of each.
    looks : (cell, kind) float32
        How much likelier a color is on a kind of blob than anywhere.
    """
    blocks = -(-len(points) // _BLOCK)
    placed = np.empty((blocks, 3, _BLOCK), np.float32)
    likeness = np.empty((blocks, looks.shape[1], _BLOCK), np.float32)
    boxes = np.empty((blocks, 6))
    _fill_blocks(points, cell, looks, placed, likeness, boxes)
    return Voxels(len(points), placed, likeness, boxes)


@njit(cache=True, nogil=True)
def _fill_blocks(points: Any, cell: Any, looks: Any, placed: Any, likeness: Any, boxes: Any):
    """Write points, likenesses and boxes of blocks; the last is filled with its last voxel."""
    for k in range(len(boxes)):
        boxes[k, :3], boxes[k, 3:] = np.inf, -np.inf
        for i in range(_BLOCK):
            n = min(k * _BLOCK + i, len(points) - 1)
            for a in range(3):
                placed[k, a, i] = points[n, a]
                boxes[k, a] = min(boxes[k, a], points[n, a])
                boxes[k, 3 + a] = max(boxes[k, 3 + a], points[n, a])
            for kind in range(looks.shape[1]):
                likeness[k, kind, i] = looks[cell[n], kind] if k * _BLOCK + i == n else _ZERO


def split(points: Floats, parts: int, rounds: int = 20) -> NDArray[np.int64]:
    """Return (point,) the part of each point: k-means from mutually far starts, no chance."""
    centers = [points[np.argmin(((points - points.mean(0)) ** 2).sum(1))]]
    distance = ((points - centers[0]) ** 2).sum(1)
    for _ in range(parts - 1):
        centers.append(points[distance.argmax()])
        distance = np.minimum(distance, ((points - centers[-1]) ** 2).sum(1))
    return kmeans2(points, np.stack(centers), rounds, minit="matrix")[1]


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
            share = len(of_part) / len(some) * len(mine)
            middle = np.asarray(of_part.mean(0) - origin[k], np.float64)
            found.append((k, middle, np.asarray(spread, np.float64), share))
    share = np.array([f[3] for f in found])
    return Blobs(
        np.array([f[0] for f in found], np.int64),
        np.array([f[1] for f in found]).reshape(-1, 3),
        np.array([f[2] for f in found]).reshape(-1, 3, 3),
        share / max(share.sum(), 1.0),
    )


@njit(cache=True, nogil=True)
def _find_near(box: Any, mean: Any, half: Any, near: Any) -> int:
    """Write the blobs whose boxes meet a box; return how many they are."""
    found = 0
    for b in range(len(mean)):
        meets = True
        for a in range(3):
            meets &= (mean[b, a] + half[b, a] >= box[a]) & (mean[b, a] - half[b, a] <= box[3 + a])
        if meets:
            near[found] = b
            found += 1
    return found


@njit(cache=True, nogil=True, fastmath=True)
def _weigh(points: Any, look: Any, mean: Any, inverse: Any, middle: Any, weight: Any, whole: Any):
    """Write what the voxels of a block weigh in a blob, and add it to their sums.

    The exponential is the 64th power of its series at a 64th: within 1e-6, and without a branch
    or a call, so that the loop goes over several voxels at once.
    """
    mx, my, mz = np.float32(mean[0]), np.float32(mean[1]), np.float32(mean[2])
    xx, xy = np.float32(inverse[0, 0]), np.float32(2 * inverse[0, 1])
    yy, yz = np.float32(inverse[1, 1]), np.float32(2 * inverse[1, 2])
    zz, xz = np.float32(inverse[2, 2]), np.float32(2 * inverse[0, 2])
    for i in range(_BLOCK):
        x, y, z = points[0, i] - mx, points[1, i] - my, points[2, i] - mz
        squared = x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + zz * z * z
        u = min(squared, _FARTHEST) * _SMALL
        e = _ONE + u * (_ONE + u * (_HALF + u * (_C3 + u * (_C4 + u * _C5))))
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        weight[i] = middle * look[i] * e if squared < _FARTHEST else _ZERO
        whole[i] += weight[i]


@njit(cache=True, nogil=True, fastmath=True)
def _add_shares(points: Any, weight: Any, over: Any, sums: Any) -> None:
    """Add a block's weights, times `over`, to a blob's sums, and that times the places."""
    shares, x, y, z = _ZERO, _ZERO, _ZERO, _ZERO
    for i in range(_BLOCK):
        share = weight[i] * over[i]
        shares += share
        x += share * points[0, i]
        y += share * points[1, i]
        z += share * points[2, i]
    sums[0] += shares
    sums[1] += x
    sums[2] += y
    sums[3] += z


@njit(cache=True, nogil=True)
def share_out(voxels: Any, blobs: Any, nobody: float, sums: Any) -> float:
    """Share voxels out among blobs; return the mean log likelihood of a voxel.

    voxels : count, points, likeness and boxes of `Voxels`
    blobs : mean (blob, 3), inverse covariance (blob, 3, 3), half (blob, 3) the size of the box
        that holds all within reach, factor (blob,) float32 what a voxel in the middle weighs, and
        kind (blob,) which likeness is the blob's
    nobody : what the uniform class weighs
    sums : (blob, 4) written: sum of the shares, and of shares times places
    """
    count, points, likeness, boxes = voxels
    mean, inverse, half, factor, kind = blobs
    weight, whole = np.empty((len(mean), _BLOCK), np.float32), np.empty(_BLOCK, np.float32)
    near = np.empty(len(mean), np.int64)
    sums[:] = 0.0
    total = 0.0
    for k in range(len(boxes)):
        found = _find_near(boxes[k], mean, half, near)
        whole[:] = nobody
        for c in range(found):
            b = near[c]
            _weigh(
                points[k], likeness[k, kind[b]], mean[b], inverse[b], factor[b], weight[c], whole
            )
        product = 1.0  # of four, for a logarithm costs more than all else of a voxel
        for i in range(min(_BLOCK, count - k * _BLOCK)):
            product *= np.float64(whole[i])
            if i & 3 == 3:
                total += np.log(product)
                product = 1.0
        total += np.log(product)
        for i in range(_BLOCK):
            whole[i] = _ONE / whole[i]
        for c in range(found):
            _add_shares(points[k], weight[c], whole, sums[near[c]])
    return total / max(count, 1)


@njit(cache=True, nogil=True)
def place_blobs(body: Any, joints: Any, rotation: Any, widening: float, placed: Any) -> None:
    """Write where blobs are in a pose, and how wide.

    body : bone (blob,), offset (blob, 3), hang (blob, 3), inverse and covariance (blob, 3, 3), and
        how many of them, the first, turn with their bones; the others hang from a point of it
    widening : factor of their size
    placed : mean (blob, 3), inverse (blob, 3, 3) and half (blob, 3) as `share_out` takes them
    """
    bone, offset, hang, inverse, covariance, turning = body
    mean, turned, half = placed
    for b in range(len(bone)):
        rotated = rotation[bone[b]]
        for i in range(3):
            mean[b, i] = joints[bone[b], i] + hang[b, i]
            for j in range(3):
                mean[b, i] += rotated[i, j] * offset[b, j]
        if b < turning:
            turned[b] = over(times(rotated, inverse[b]), rotated)
            spread = over(times(rotated, covariance[b]), rotated)
        else:
            turned[b] = inverse[b]
            spread = covariance[b]
        for i in range(3):
            half[b, i] = widening * np.sqrt(_FARTHEST * spread[i, i])
            for j in range(3):
                turned[b, i, j] /= widening**2
