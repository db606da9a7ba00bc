"""Label the voxels of a frame by the segments that were fitted to it (digitization paper, 3.4.3).

With the poses of the method `paper` a voxel belongs to the segment whose distribution it is nearest
to, by the squared Mahalanobis distance of equation (5). Then each segment becomes one connected
region.

With the poses of `joint` the bones carry along the voxels that they have in the initial frame. A
voxel belongs to the segment in whose carried voxels it is deepest, or to which it is nearest.
Equation (5) knows of a segment only how its voxels spread; so it moves the border between a long
segment and a short one, a thick and a thin one. On four rendered captures the labels of 91.5, 90.5,
87.9 and 86.0 % of the voxels are right by equation (5), with several blobs a segment, and of 92.4,
90.7, 88.3 and 86.0 % by carried voxels. Cloth that hangs far from every bone takes the label that
it is connected to.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, SEGMENT
from tasks.body.anatomy.nearest_bones import bones_of_voxels, is_limb
from tasks.body.anatomy.proportions import body_size, complete_joints
from tasks.body.labels.fields import BoneFields, make_fields, nearest_bones
from tasks.body.labels.regions import clean_labels
from tasks.body.labels.things import find_things
from tasks.engine.kernels import njit
from tasks.geometry.voxel_lines import VoxelLines

NEAR = 0.05
"""How far from a body a voxel is no part of it, and labeled last [statures]. 8 cm of 1.7 m; chosen
by eye on the shared captures, not measured."""

_LABEL = np.append(SEGMENT + 1, 0).astype(np.uint8)
"""(bone + 1,) the label of each bone, and of none."""

_LESS = np.float32(1 - 1e-4)
"""By what factor bounds are relaxed, so that they hold in spite of rounding."""

_BLOCK = 64
"""Voxels that are looked at together. They lie together, so that few blobs are near all of them."""


def nearest_segments(
    center: NDArray[np.floating],
    mean: NDArray[np.floating],
    inverse: NDArray[np.floating],
    *,
    segment: NDArray[np.integer] | None = None,
) -> NDArray[np.uint8]:
    """Return the segment that each voxel is nearest to; equation (5).

    Distances are computed in single precision; of equally near blobs the first is taken.

    Parameters
    ----------
    center : (voxel, 3) float
        Metres.
    mean : (blob, 3) float
        Of each blob, metres.
    inverse : (blob, 3, 3) float
        Inverse of each blob's covariance, 1 / square metres, symmetric.
    segment : (blob,) int
        The segment, 0 to 10, of each blob; by default the blobs are the segments.

    Returns
    -------
    (voxel,) uint8
        Segment plus one.

    Raises
    ------
    ValueError
        If the arrays do not fit each other, there is no blob, or a blob is not finite.
    """
    mean, inverse = np.asarray(mean, np.float64), np.asarray(inverse, np.float64)
    of = np.arange(len(mean)) if segment is None else np.asarray(segment)
    if mean.shape[1:] != (3,) or inverse.shape != (len(mean), 3, 3) or of.shape != mean.shape[:1]:
        raise ValueError(
            f"means of shape {mean.shape}, inverse covariances of shape {inverse.shape} and "
            f"segments of shape {of.shape} do not fit; pass (blob, 3), (blob, 3, 3) and (blob,)"
        )
    if not len(mean) or not (np.isfinite(mean).all() and np.isfinite(inverse).all()):
        raise ValueError(f"{len(mean)} blobs, one or none of them finite, label nothing; fit first")
    middle = mean.mean(axis=0)  # single precision is for numbers near 0
    voxels = np.ascontiguousarray((np.asarray(center) - middle).T, np.float32)
    whitening = np.linalg.cholesky(inverse).swapaxes(1, 2).astype(np.float32)
    label = np.zeros(voxels.shape[1], np.uint8)
    _label(voxels, (mean - middle).astype(np.float32), whitening, (of + 1).astype(np.uint8), label)
    return label


def label_frame(
    center: NDArray[np.floating],
    lines: VoxelLines,
    mean: NDArray[np.floating],
    inverse: NDArray[np.floating],
    *,
    segment: NDArray[np.integer] | None = None,
) -> NDArray[np.uint8]:
    """Return the final labels of a frame: nearest segments, each one connected region.

    Parameters
    ----------
    center : (voxel, 3) float
        Metres.
    lines
        The voxels.
    mean, inverse, segment
        As `nearest_segments`.

    Returns
    -------
    (voxel,) uint8
        Segment plus one.

    Raises
    ------
    ValueError
        As `nearest_segments` and `clean_labels`.
    """
    label = nearest_segments(center, mean, inverse, segment=segment)
    return clean_labels(label, lines)


def make_body_fields(
    index: NDArray[np.integer],
    center: NDArray[np.floating],
    label: NDArray[np.integer],
    joints: Mapping[str, NDArray[np.floating]],
    voxel_m: float,
) -> BoneFields:
    """Return the body of the initial frame, by which the voxels of other frames are labeled.

    Cloth around arms and legs is left out: it hangs elsewhere in another pose.

    Parameters
    ----------
    index : (voxel, 3) int
        In the grid, of the initial frame's voxels.
    center : (voxel, 3) float
        Metres.
    label : (voxel,) int
        Segment plus one; 0 for none.
    joints
        The initial frame's, metres, by the names of the archive; see `complete_joints` for those
        that may be NaN.
    voxel_m
        Edge of a voxel.
    """
    whole = complete_joints({name: np.asarray(p, np.float64) for name, p in joints.items()})
    left = (whole["LHip"] - whole["RHip"]) * (1.0, 0.0, 1.0)
    forward = np.cross(left / np.linalg.norm(left), (0.0, 1.0, 0.0))
    point = np.asarray(center, np.float64)
    bone = bones_of_voxels(point, np.asarray(label), whole, forward)
    bone[~is_limb(point, whole, label)] = -1
    most = max(1, round(NEAR * body_size(whole) / voxel_m))
    return make_fields(index, bone, len(BONES), most)


def label_carried(
    lines: VoxelLines,
    fields: BoneFields,
    turn: NDArray[np.floating],
    shift: NDArray[np.floating],
    stays: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """Return the final labels of a frame from the initial body's, each one connected region.

    What belongs to no segment has none (`things`).

    Parameters
    ----------
    lines
        The voxels.
    fields
        As `make_body_fields` gives them.
    turn, shift : (bone, 3, 3) and (bone, 3) float
        What takes this frame's voxels back to the initial frame, as `carry_back` gives it.
    stays : (voxel,) bool, optional
        As for `things.find_things`.

    Returns
    -------
    (voxel,) uint8
        Segment plus one, 0 for none; all 0 where no voxel is near the body.
    """
    bone = nearest_bones(lines, fields, turn, shift)
    label = clean_labels(_LABEL[bone], lines)
    label[find_things(lines, bone, fields, turn, shift, stays)] = 0
    return label


@njit(cache=True, nogil=True, fastmath=True)
def _label(voxels: Any, mean: Any, whitening: Any, value: Any, label: Any) -> None:
    """Write the value of the blob that each voxel is nearest to.

    Voxels are looked at in blocks. A blob is skipped that is farther from the box around a block
    than another blob is at most from any of its voxels.
    """
    x, y, z = voxels[0], voxels[1], voxels[2]
    least = np.empty(_BLOCK, np.float32)
    lower = np.empty(len(mean), np.float32)
    for begin in range(0, len(x), _BLOCK):
        end = min(begin + _BLOCK, len(x))
        least[:] = np.float32(np.inf)
        low = (x[begin:end].min(), y[begin:end].min(), z[begin:end].min())
        high = (x[begin:end].max(), y[begin:end].max(), z[begin:end].max())
        most = _bound(low, high, mean, whitening, lower)
        for blob in range(len(mean)):
            if lower[blob] > most:
                continue
            w, m = whitening[blob], mean[blob]
            a, b, c, d, e, f = w[0, 0], w[0, 1], w[0, 2], w[1, 1], w[1, 2], w[2, 2]
            mx, my, mz, own = m[0], m[1], m[2], value[blob]
            for n in range(begin, end):
                p, q, r = x[n] - mx, y[n] - my, z[n] - mz
                u, v, t = a * p + b * q + c * r, d * q + e * r, f * r
                distance = u * u + v * v + t * t
                nearer = distance < least[n - begin]
                least[n - begin] = distance if nearer else least[n - begin]
                label[n] = own if nearer else label[n]


@njit(cache=True, nogil=True)
def _bound(low: Any, high: Any, mean: Any, whitening: Any, lower: Any) -> Any:
    """Write the least distance of a box from each blob; return the largest from the nearest."""
    most = np.float32(np.inf)
    h = ((high[0] - low[0]) / 2, (high[1] - low[1]) / 2, (high[2] - low[2]) / 2)
    for blob in range(len(mean)):
        w, m = whitening[blob], mean[blob]
        nearest, farthest = np.float32(0.0), np.float32(0.0)
        for i in range(3):
            middle, reach = np.float32(0.0), np.float32(0.0)
            for j in range(i, 3):
                middle += w[i, j] * ((low[j] + high[j]) / 2 - m[j])
                reach += abs(w[i, j]) * h[j]
            nearest += max(np.float32(0.0), abs(middle) - reach) ** 2
            farthest += (abs(middle) + reach) ** 2
        lower[blob] = nearest * _LESS
        most = min(most, farthest / _LESS)
    return most
