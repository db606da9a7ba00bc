"""The tree of the eleven segments and its kinematics (digitization paper, 3.2, Table 1).

Every segment has a joint, its origin, and a local system whose X axis runs through the joint of a
child. A segment's joint position and rotation are given in its parent's local system. The position
of every joint but the root's is constant there.

What the paper leaves open is settled here. The root is the head, and its joint the top of the
head, so that its child's, the neck, is not the same point. Where several children hang on a
segment X runs through the waist (body) or the middle of the hips (waist); at the ends of the
tree through the wrist or ankle. X points away from the child, as the paper prints it. Y and Z
are free in the paper: Z is as near as it can be to the way the performer faces at t = 0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS, SEGMENTS

PARENTS = (-1, 0, 1, 1, 3, 1, 5, 2, 7, 2, 9)
"""The place of each segment's parent in the list of segments; parents stand before children."""

SEGMENT_COUNT = len(SEGMENTS)
"""How many segments a body has."""

ORIGINS = (
    *("Head", "Neck", "Waist", "RShoulder", "RElbow", "LShoulder", "LElbow"),
    *("RHip", "RKnee", "LHip", "LKnee"),
)
"""The joint of each segment: where it is bound to its parent."""

ENDS = (
    *(("Neck",), ("Waist",), ("RHip", "LHip")),
    *(("RElbow",), ("RWrist",), ("LElbow",), ("LWrist",)),
    *(("RKnee",), ("RAnkle",), ("LKnee",), ("LAnkle",)),
)
"""The joints through whose mean each segment's X axis runs, besides its own."""

CARRIERS = (0, 1, 2, *(3, 4, 4, 4, 7, 8, 8, 8, 8), *(5, 6, 6, 6, 9, 10, 10, 10, 10))
"""The segment that each of the 21 joints is fixed to."""

_FURTHER = {"RWrist": "RFin", "LWrist": "LFin", "RAnkle": "RFoot", "LAnkle": "LFoot"}
"""The joint that stands in for a missing one: the next one outward."""

_LEAST_SINE = 0.2
"""Sine of the least angle between an axis and the way faced; an axis that is closer takes its Z
from the way up. 11 degrees, chosen by eye on the shared captures, not measured."""


@dataclass(frozen=True, eq=False)
class BodyShape:
    """What of a body does not move: Table 1 without the pose, each value in a local system."""

    centroid: NDArray[np.float64]
    """(11, 3) g, metres."""

    axes: NDArray[np.float64]
    """(11, 3, 3) R(tau): the principal axes, in columns."""

    variance: NDArray[np.float64]
    """(11, 3) V along these axes, square metres, smallest first."""

    offset: NDArray[np.float64]
    """(11, 3) J: a segment's joint in its parent's system; the root's is 0."""

    joint: NDArray[np.float64]
    """(21, 3) each joint in the system of the segment that carries it; NaN where unknown."""

    volume_share: NDArray[np.float64]
    """(11,) share of all labeled voxels; they sum to one."""


def local_systems(joint: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the segments' local systems in the world, from the joints at t = 0.

    Parameters
    ----------
    joint : (21, 3) float
        Metres. Wrists and ankles may be NaN where fingers and toes are not; heels may be NaN.

    Returns
    -------
    position : (11, 3) float64
        The joint of each segment.
    rotation : (11, 3, 3) float64
        X, Y and Z axis of each segment in columns.

    Raises
    ------
    ValueError
        If a joint that bounds a segment is not finite, or the ends of a segment coincide.
    """
    joint = np.asarray(joint, np.float64)
    if joint.shape != (len(JOINTS), 3):
        raise ValueError(
            f"joints of shape {joint.shape} are no body: pass the 21 joints as (21, 3)"
        )
    position = np.stack([joint[JOINTS.index(name)] for name in ORIGINS])
    end = np.stack([_mean_of(joint, names) for names in ENDS])
    missing = [
        name for name, p, e in zip(ORIGINS, position, end, strict=True)
        if not np.isfinite(p + e).all()
    ]  # fmt: skip
    if missing:
        raise ValueError(
            f"the segments that begin at {', '.join(missing)} have no two finite ends; "
            "place all joints that bound a segment"
        )
    away = position - end
    length = np.linalg.norm(away, axis=1)
    if not (length > 0).all():
        name = ORIGINS[int(length.argmin())]
        raise ValueError(f"the segment at {name} has no length; place its two ends apart")
    forward, up = _facing(position)
    return position, np.stack([_axes_along(x, forward, up) for x in away / length[:, None]])


def pose_in_parents(
    position: NDArray[np.floating], rotation: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each segment's joint position and rotation in its parent's system; equation (1).

    Parameters
    ----------
    position : (..., 11, 3) float
        Joints in the world, metres.
    rotation : (..., 11, 3, 3) float
        Local axes in the world, in columns.

    Returns
    -------
    position : (..., 11, 3) float64
        J, metres; the root's is the world's.
    rotation : (..., 11, 3, 3) float64
        R(r); the root's is the world's.
    """
    local, turn = np.array(position, np.float64), np.array(rotation, np.float64)
    for segment, parent in enumerate(PARENTS):
        if parent >= 0:
            back = np.swapaxes(rotation[..., parent, :, :], -1, -2)
            away = position[..., segment, :] - position[..., parent, :]
            local[..., segment, :] = (back @ away[..., None])[..., 0]
            turn[..., segment, :, :] = back @ rotation[..., segment, :, :]
    return local, turn


def carry_joints(
    joint: NDArray[np.floating], position: NDArray[np.floating], rotation: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the 21 joints in the world, each fixed to the segment that carries it.

    Parameters
    ----------
    joint : (21, 3) float
        In the carriers' local systems, metres.
    position : (..., 11, 3) float
        Joints of the segments in the world, metres.
    rotation : (..., 11, 3, 3) float
        Local axes in the world, in columns.

    Returns
    -------
    (..., 21, 3) float64
        Metres; NaN where the joint is.
    """
    carrier = np.array(CARRIERS)
    turned = rotation[..., carrier, :, :] @ np.asarray(joint, np.float64)[..., None]
    return position[..., carrier, :] + turned[..., 0]


def place_ellipsoids(
    shape: BodyShape, position: NDArray[np.floating], rotation: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the segments are in space and how they spread; equation (4), inverted.

    Parameters
    ----------
    shape
        Of the body.
    position : (..., 11, 3) float
        Joints in the world, metres.
    rotation : (..., 11, 3, 3) float
        Local axes in the world, in columns.

    Returns
    -------
    mean : (..., 11, 3) float64
        g in the world, metres.
    inverse : (..., 11, 3, 3) float64
        The inverse of K, 1 / square metres.
    """
    mean = position + (rotation @ shape.centroid[..., None])[..., 0]
    axes = rotation @ shape.axes
    return mean, axes / shape.variance[:, None, :] @ np.swapaxes(axes, -1, -2)


def _mean_of(joint: NDArray[np.float64], names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the mean of some joints. The next joint outward stands in for a missing one."""
    found = []
    for name in names:
        point = joint[JOINTS.index(name)]
        if name in _FURTHER and not np.isfinite(point).all():
            point = joint[JOINTS.index(_FURTHER[name])]
        found.append(point)
    return np.mean(found, axis=0)


def _facing(position: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the directions in which a body faces and stands, unit vectors, from its joints."""
    neck, right, left, right_hip, left_hip = position[[1, 3, 5, 7, 9]]
    up = neck - (right_hip + left_hip) / 2
    forward = np.cross(left - right + left_hip - right_hip, up)
    return forward / np.linalg.norm(forward), up / np.linalg.norm(up)


def _axes_along(
    x: NDArray[np.float64], forward: NDArray[np.float64], up: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return axes in columns: X is given, Z is as near as it can be to forward, else to up."""
    z = forward - (forward @ x) * x
    if np.linalg.norm(z) < _LEAST_SINE:
        z = up - (up @ x) * x
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)
