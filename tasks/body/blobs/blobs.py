"""Describe a body by Gaussian blobs on its bones, and share a frame's voxels out among them.

The paper gives each segment one ellipsoid (digitization paper, 3.3). Here a bone has several
blobs, so that a bent or tapering segment keeps its shape; k-means finds them in the bone's voxels
of the initial frame. Each voxel belongs to several blobs by shares (expectation of Dempster, Laird
and Rubin 1977). A uniform class takes the voxels of nobody: cloth, and what no camera could carve
away. A blob weighs as much as its share of the initial frame's voxels, which is the paper's
constraint on volumes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from tasks.body.anatomy.bones import over, put, times
from tasks.engine.kernels import njit

Floats = NDArray[np.float64]

_BLOCK = 64
"""How many voxels are weighed together [voxels]. They are neighbors, so that few blobs reach into
the box around them."""

_FARTHEST = np.float32(18.0)
"""Squared Mahalanobis distance beyond which a blob weighs nothing [variances]. A blob weighs there
exp(-9) = 1.2e-4 of what it weighs in its middle."""

_ZERO = np.float32(0)
"""0 in single precision. A literal would turn the loops over a block to double precision."""

_ONE = np.float32(1)
"""1 in single precision. A literal would turn the loops over a block to double precision."""

_HALF = np.float32(0.5)
"""Coefficient of the square in the series of the exponential [factor]. It is 1 / 2!."""

_CUBE = np.float32(1 / 6)
"""Coefficient of the third power in the series of the exponential [factor]. It is 1 / 3!."""

_FOURTH = np.float32(1 / 24)
"""Coefficient of the fourth power in the series of the exponential [factor]. It is 1 / 4!."""

_FIFTH = np.float32(1 / 120)
"""Coefficient of the fifth power in the series of the exponential [factor]. It is 1 / 5!."""

_EXPONENT = np.float32(-1 / 128)
"""Factor from a squared distance to a 64th of a Gaussian's exponent [factor]. The exponent is minus
half the squared distance."""

_LOGARITHM_OF = 4
"""How many voxels' likelihoods are multiplied before their logarithm is taken [voxels]. A logarithm
costs more than all else of a voxel, and a product of four cannot leave double precision."""

_MOST_OF_BONE = 3000
"""How many voxels of a bone are looked at, about [voxels]. Chosen by eye on the shared captures;
not measured."""

_LEAST_OF_BONE = 8
"""A bone with fewer voxels has no blob [voxels]. Chosen by eye on the shared captures; not
measured."""

_VOXELS_FOR_BLOB = 20
"""A bone has at most one blob for so many of its voxels [voxels]. Chosen by eye on the shared
captures; not measured."""

_LEAST_OF_BLOB = 4
"""A blob of fewer voxels is left out [voxels]. A covariance of three or fewer points is flat."""

_KMEANS_ROUNDS = 20
"""How often k-means moves its centers [rounds]. Chosen by eye on the shared captures; not
measured."""


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
    """Some of a frame's voxels in blocks of 64, as `share_out` takes them.

    The last block is filled up with its last voxel, which weighs nothing there.
    """

    count: int
    """How many there are."""

    points: NDArray[np.float32]
    """(block, 3, 64) centers, m."""

    likeness: NDArray[np.float32]
    """(block, kind, 64) how many times likelier the color is on a kind of blob than anywhere; 0
    where the last block is filled up."""

    boxes: Floats
    """(block, 6) least and greatest coordinates, m."""


def gather_voxels(points: Floats, cell: NDArray[np.integer], looks: NDArray[np.float32]) -> Voxels:
    """Return voxels in blocks, with how likely their colors are on each kind of blob.

    Parameters
    ----------
    points : (voxel, 3) float64
        Centers, m. Voxels that are near in space should be near in this order.
    cell : (voxel,) int
        Row of `looks` that belongs to each voxel's color.
    looks : (cell, kind) float32
        How many times likelier a color is on a kind of blob than anywhere.
    """
    blocks = -(-len(points) // _BLOCK)
    placed = np.empty((blocks, 3, _BLOCK), np.float32)
    likeness = np.empty((blocks, looks.shape[1], _BLOCK), np.float32)
    boxes = np.empty((blocks, 6))
    _fill_blocks(points, cell, looks, placed, likeness, boxes)
    return Voxels(len(points), placed, likeness, boxes)


@njit(cache=True, nogil=True)
def _fill_blocks(points: Any, cell: Any, looks: Any, placed: Any, likeness: Any, boxes: Any):
    """Write points, likenesses and boxes of blocks; fill the last one up with its last voxel."""
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


def _split(points: Floats, parts: int) -> NDArray[np.int64]:
    """Return (point,) the cluster of each point by k-means.

    The first center is the point nearest to the mean, each next one the point farthest from all
    centers before, so that equal points are always split alike.
    """
    centers = [points[np.argmin(((points - points.mean(0)) ** 2).sum(1))]]
    distance = ((points - centers[0]) ** 2).sum(1)
    for _ in range(parts - 1):
        centers.append(points[distance.argmax()])
        distance = np.minimum(distance, ((points - centers[-1]) ** 2).sum(1))
    return kmeans2(points, np.stack(centers), _KMEANS_ROUNDS, minit="matrix")[1]


def make_blobs(
    points: Floats,
    bone: NDArray[np.integer],
    origin: Floats,
    number: NDArray[np.integer],
    *,
    softness_m: float,
) -> Blobs:
    """Return the blobs that describe voxels whose bones are known.

    Parameters
    ----------
    points : (voxel, 3) float64
        Centers, m.
    bone : (voxel,) int
        The bone of each, -1 for none.
    origin : (bone, 3) float64
        Proximal joints, m.
    number : (bone,) int
        How many blobs each bone gets, if it has voxels enough.
    softness_m
        Standard deviation by which every blob is widened.
    """
    found: list[tuple[int, Floats, Floats, float]] = []
    for k in range(len(origin)):
        mine = points[bone == k]
        if len(mine) < _LEAST_OF_BONE:
            continue
        some = mine[:: max(1, len(mine) // _MOST_OF_BONE)]
        part = _split(some, int(min(number[k], max(1, len(some) // _VOXELS_FOR_BLOB))))
        for b in range(int(part.max()) + 1):
            of_part = some[part == b]
            if len(of_part) < _LEAST_OF_BLOB:
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


@njit(cache=True, nogil=True, inline="always")
def _find_near(box: Any, mean: Any, half: Any, near: Any) -> int:
    """Write the numbers of the blobs whose boxes meet a box; return how many they are."""
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
    """Write what each voxel of a block weighs in a blob, and add it to the voxel's sum over blobs.

    The exponential is its series at a 64th of the exponent, to the 64th power. It is exact to 1e-6
    and has neither branch nor call, so that the compiler works on several voxels at once.
    """
    mx, my, mz = np.float32(mean[0]), np.float32(mean[1]), np.float32(mean[2])
    xx, xy = np.float32(inverse[0, 0]), np.float32(2 * inverse[0, 1])
    yy, yz = np.float32(inverse[1, 1]), np.float32(2 * inverse[1, 2])
    zz, xz = np.float32(inverse[2, 2]), np.float32(2 * inverse[0, 2])
    for i in range(_BLOCK):
        x, y, z = points[0, i] - mx, points[1, i] - my, points[2, i] - mz
        squared = x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + zz * z * z
        u = min(squared, _FARTHEST) * _EXPONENT
        e = _ONE + u * (_ONE + u * (_HALF + u * (_CUBE + u * (_FOURTH + u * _FIFTH))))
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
    """Add the shares of a block's voxels to a blob's sums, and the shares times the places.

    A share is a voxel's weight in the blob times `over`, 1 over its weight in all.
    """
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


@njit(cache=True, nogil=True, inline="always")
def share_out(voxels: Any, blobs: Any, nobody: float, sums: Any) -> float:
    """Share voxels out among blobs; return the mean log likelihood of a voxel.

    voxels : count, points, likeness and boxes of `Voxels`
    blobs : mean (blob, 3), inverse covariance (blob, 3, 3), half (blob, 3) the size of the box
        that holds all that the blob reaches, factor (blob,) float32 what a voxel in the middle
        weighs, and kind (blob,) which likeness counts for the blob
    nobody : what a voxel weighs in the uniform class
    sums : (blob, 4) written: the sum of the shares, and the sums of shares times places
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
        product = 1.0
        for i in range(min(_BLOCK, count - k * _BLOCK)):
            product *= np.float64(whole[i])
            if i % _LOGARITHM_OF == _LOGARITHM_OF - 1:
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
    """Write where the blobs are in a pose, and how wide they are.

    body : bone (blob,), offset (blob, 3), hang (blob, 3), inverse and covariance (blob, 3, 3), and
        how many blobs turn with their bones; these come first, the others hang from their bones
    widening : factor by which blobs are larger than in the body
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
            put(over(times(rotated, inverse[b]), rotated), turned[b])
            spread = over(times(rotated, covariance[b]), rotated)
        else:
            put(inverse[b], turned[b])
            spread = covariance[b]
        for i in range(3):
            half[b, i] = widening * np.sqrt(_FARTHEST * spread[i, i])
            for j in range(3):
                turned[b, i, j] /= widening**2
