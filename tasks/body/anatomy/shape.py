"""Measure a performer's body at t = 0: shape and pose of eleven segments (digitization paper, 3.3).

A segment's shape tells how its voxels lie in space: centroid, principal axes, and the variances
along these. It is kept in the segment's own system, so that it moves with the body. It needs no
rigid outline, which clothes do not have.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tasks.body.anatomy.segments import (
    CARRIERS,
    SEGMENT_COUNT,
    BodyShape,
    local_systems,
    pose_in_parents,
)

LEAST_VOXELS = 20
"""Voxels that a segment needs. With fewer, three variances say nothing."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body and its pose at t = 0."""

    shape: BodyShape
    """What does not move."""

    position: NDArray[np.float64]
    """(11, 3) each segment's joint in the world, metres."""

    rotation: NDArray[np.float64]
    """(11, 3, 3) each segment's axes in the world, in columns."""


@dataclass(frozen=True, eq=False)
class SegmentMotion:
    """One segment's motion, frame by frame, on its own."""

    time_s: NDArray[np.float64]
    """(time,)."""

    position: NDArray[np.float64]
    """(time, 3) of its joint in the world, metres."""

    quaternion: NDArray[np.float64]
    """(time, 4) x, y, z, w of its rotation in the world; neighbors never change sign."""

    velocity: NDArray[np.float64]
    """(time, 3) metres a second."""

    angular_velocity: NDArray[np.float64]
    """(time, 3) radians a second, about the world's axes."""


def measure_body(
    center: NDArray[np.floating], label: NDArray[np.integer], joint: NDArray[np.floating]
) -> BodyModel:
    """Return the body of one labeled frame.

    Parameters
    ----------
    center : (voxel, 3) float
        Of the voxels, metres.
    label : (voxel,) int
        Segment of each voxel, 1 to 11; 0 is none.
    joint : (21, 3) float
        The joints, metres; see `local_systems` for those that may be NaN.

    Raises
    ------
    ValueError
        If a segment has fewer than 20 voxels or no extent, a joint is missing, or labels and
        voxels do not fit.
    """
    center, label = np.asarray(center, np.float64), np.asarray(label)
    if label.shape != center.shape[:1] or center.shape[1:] != (3,):
        raise ValueError(
            f"{label.shape} labels and centers of shape {center.shape} do not fit; pass a label "
            "and three coordinates for each voxel"
        )
    count = np.bincount(label, minlength=SEGMENT_COUNT + 1)[1:]
    bad = [f"{k + 1} ({n})" for k, n in enumerate(count) if n < LEAST_VOXELS or k >= SEGMENT_COUNT]
    if bad:
        raise ValueError(
            f"labels {', '.join(bad)} cannot be measured: there are labels 1 to 11, and each "
            f"needs {LEAST_VOXELS} voxels; label the frame anew"
        )
    position, rotation = local_systems(joint)
    centroid, axes, variance = np.empty((11, 3)), np.empty((11, 3, 3)), np.empty((11, 3))
    for segment in range(SEGMENT_COUNT):
        voxels = center[label == segment + 1]
        mean, spread, principal = principal_axes(voxels)
        back = rotation[segment].T
        centroid[segment] = back @ (mean - position[segment])  # equation (2)
        axes[segment] = back @ principal
        variance[segment] = spread
    if not (variance > 0).all():
        flat = int((variance.min(axis=1) <= 0).argmax()) + 1
        raise ValueError(f"the voxels of label {flat} lie in a plane; label the frame anew")
    offset, _ = pose_in_parents(position, rotation)
    offset[0] = 0.0
    carrier = np.array(CARRIERS)
    away = np.asarray(joint, np.float64) - position[carrier]
    local = (np.swapaxes(rotation[carrier], 1, 2) @ away[:, :, None])[:, :, 0]
    shape = BodyShape(centroid, axes, variance, offset, local, count / count.sum())
    return BodyModel(shape, position, rotation)


def principal_axes(
    center: NDArray[np.floating],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (3,), variances (3,) smallest first, and axes (3, 3) in columns, of points.

    The axes are right-handed, and the one of the largest variance points along the world axis
    that it is nearest to: nothing else decides the sign of a principal axis.
    """
    mean = center.mean(axis=0)
    variance, axes = np.linalg.eigh(np.cov(center, rowvar=False, bias=True))
    for column in (2, 1):
        main = np.abs(axes[:, column]).argmax()
        axes[:, column] *= np.sign(axes[main, column])
    axes[:, 0] = np.cross(axes[:, 1], axes[:, 2])
    return mean, variance, axes


def segment_motion(
    time_s: NDArray[np.floating],
    position: NDArray[np.floating],
    rotation: NDArray[np.floating],
    segment: int,
) -> SegmentMotion:
    """Return the motion of one segment over a take.

    Velocities are central differences, one-sided at both ends.

    Parameters
    ----------
    time_s : (time,) float
        Rising.
    position : (time, 11, 3) float
        Joints of the segments in the world, metres.
    rotation : (time, 11, 3, 3) float
        Their axes in the world, in columns.
    segment
        Its place in the list of segments, 0 to 10.

    Raises
    ------
    ValueError
        If there is no such segment, there are fewer than two frames, or times do not rise.
    """
    if not 0 <= segment < SEGMENT_COUNT:
        raise ValueError(f"there is no segment {segment}; the eleven are 0 to 10")
    time_s = np.asarray(time_s, np.float64)
    if len(time_s) < 2 or not (np.diff(time_s) > 0).all():
        raise ValueError(f"{len(time_s)} times do not make a motion; pass two or more that rise")
    place = np.asarray(position[:, segment], np.float64)
    quaternion = Rotation.from_matrix(rotation[:, segment]).as_quat()
    flips = np.sign((quaternion[1:] * quaternion[:-1]).sum(axis=1))
    quaternion[1:] *= np.cumprod(np.where(flips < 0, -1.0, 1.0))[:, None]
    before = np.maximum(np.arange(len(time_s)) - 1, 0)
    after = np.minimum(np.arange(len(time_s)) + 1, len(time_s) - 1)
    lasted = (time_s[after] - time_s[before])[:, None]
    velocity = (place[after] - place[before]) / lasted
    matrix = np.asarray(rotation[:, segment], np.float64)
    spun = matrix[after] @ np.swapaxes(matrix[before], 1, 2)
    spin = Rotation.from_matrix(spun).as_rotvec() / lasted
    return SegmentMotion(time_s, place, quaternion, velocity, spin)
