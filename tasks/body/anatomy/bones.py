"""An articulated body that rides on blobs: its tree, and one least-squares step over all bones.

Fifteen bones: the eleven segments of the body model (digitization paper, Table 1), hands and
feet apart, because they move against forearm and lower leg. The pose is the world rotation of
every bone since the initial pose and the position of the root, the base of the neck. Unlike the
paper, which searches segment after segment from the head outwards, all bones are solved at
once: a child's evidence corrects its parents (Gauss-Newton on local twists, with analytic
derivatives; Bregler and Malik 1998).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import SEGMENTS
from tasks.engine.kernels import njit

BONES = (*SEGMENTS, "RHand", "LHand", "RFoot", "LFoot")
"""The bones: the eleven segments in the order of the archive, then what they leave apart."""

BONE_NUMBER = {name: k for k, name in enumerate(BONES)}
"""The place of each bone in that list."""

PARENT = np.array([1, -1, 1, 1, 3, 1, 5, 2, 7, 2, 9, 4, 6, 8, 10])
"""(bone,) the bone that each bone hangs on; -1 for the root."""

ORDER = np.array([1, 0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14])
"""(bone,) all bones, parents before children."""

SEGMENT = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 4, 6, 8, 10])
"""(bone,) the segment that each bone's voxels belong to."""

PROXIMAL = (
    "Neck", "Neck", "Waist",
    "RShoulder", "RElbow", "LShoulder", "LElbow",
    "RHip", "RKnee", "LHip", "LKnee",
    "RWrist", "LWrist", "RAnkle", "LAnkle",
)  # fmt: skip
"""The joint that each bone turns about."""


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Where a body is in one frame."""

    root: Floats
    """(3,) the base of the neck, m."""

    rotation: Floats
    """(bone, 3, 3) world rotation of every bone since the initial pose."""


def rest_pose(origin: Floats) -> Pose:
    """Return the initial pose of a body whose bones begin at (bone, 3) `origin`."""
    return Pose(origin[ORDER[0]].copy(), np.tile(np.eye(3), (len(BONES), 1, 1)))


def place_bones(pose: Pose, origin: Floats) -> Floats:
    """Return (bone, 3) the proximal joint of every bone; `origin` is that of the initial pose."""
    joints = np.empty((len(BONES), 3))
    place_joints(pose.root, pose.rotation, origin, joints)
    return joints


def carry(pose: Pose, joints: Floats, bone: NDArray[np.integer], offset: Floats) -> Floats:
    """Return (point, 3) where points that ride on bones are, at first `offset` from their joint."""
    return joints[bone] + np.einsum("pij,pj->pi", pose.rotation[bone], offset)


def rotation_of(vector: Floats) -> Floats:
    """Return (3, 3) the rotation about a vector by its length, rad."""
    return _rotation(np.ascontiguousarray(vector, np.float64))


def vector_of(rotation: Floats) -> Floats:
    """Return (3,) the axis of a rotation times its angle, rad, below pi."""
    return _vector(np.ascontiguousarray(rotation, np.float64))


def extrapolate(before: Pose, now: Pose, share: float, root_share: float) -> Pose:
    """Return the pose after `now` if the motion since `before` goes on by a share of itself.

    The root moves and turns on by `root_share`; every other bone turns on in its parent's frame by
    `share`.
    """
    rotation = np.empty_like(now.rotation)
    _extrapolate(before.rotation, now.rotation, np.array([share, root_share]), rotation)
    return Pose(now.root + root_share * (now.root - before.root), rotation)


def turn(pose: Pose, yaw: float, about: Floats) -> Pose:
    """Return the pose turned as a whole about the vertical through a point, by `yaw` rad."""
    around = rotation_of(np.array([0.0, yaw, 0.0]))
    return Pose(about + around @ (pose.root - about), around @ pose.rotation)


def blend(poses: Sequence[Pose], weights: Floats, near: Pose) -> Pose:
    """Return the weighted mean of poses close to `near` (one step of the Karcher mean)."""
    share = weights / weights.sum()
    root = np.einsum("p,pi->i", share, np.stack([pose.root for pose in poses]))
    rotation = near.rotation.copy()
    _average(np.stack([pose.rotation for pose in poses]), share, rotation)
    return Pose(root, rotation)


@njit(cache=True, nogil=True)
def put(matrix: Any, into: Any) -> None:
    """Write a matrix (3, 3). Numpy's way compiles the texts of errors too, for seconds."""
    for i in range(3):
        for j in range(3):
            into[i, j] = matrix[i, j]


@njit(cache=True, nogil=True)
def times(a: Any, b: Any) -> Any:
    """Return the product a b of matrices (3, 3). The library's call costs more than the product."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += a[i, k] * b[k, j]
    return out


@njit(cache=True, nogil=True)
def over(a: Any, b: Any) -> Any:
    """Return the product of a matrix (3, 3) and the transpose of another."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += a[i, k] * b[j, k]
    return out


@njit(cache=True, nogil=True)
def _on(a: Any, v: Any) -> Any:
    """Return the product of a matrix (3, 3) and a vector (3,)."""
    out = np.zeros(3)
    for i in range(3):
        for j in range(3):
            out[i] += a[i, j] * v[j]
    return out


@njit(cache=True, nogil=True)
def _rotation(vector: Any) -> Any:
    """Return the rotation about a vector by its length (Rodrigues)."""
    angle = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    out = np.eye(3)
    if angle < 1e-12:
        return out
    x, y, z = vector[0] / angle, vector[1] / angle, vector[2] / angle
    c, s = np.cos(angle), np.sin(angle)
    d = 1 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * d, x * y * d - z * s, x * z * d + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * d + z * s, c + y * y * d, y * z * d - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * d - y * s, z * y * d + x * s, c + z * z * d
    return out


@njit(cache=True, nogil=True)
def _vector(rotation: Any) -> Any:
    """Return the axis of a rotation times its angle, by way of the quaternion."""
    q = np.empty(4)
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    if trace > 0:
        s = 2 * np.sqrt(trace + 1)
        q[0] = s / 4
        q[1] = (rotation[2, 1] - rotation[1, 2]) / s
        q[2] = (rotation[0, 2] - rotation[2, 0]) / s
        q[3] = (rotation[1, 0] - rotation[0, 1]) / s
    else:
        i = 0
        for k in range(1, 3):
            if rotation[k, k] > rotation[i, i]:
                i = k
        j, k = (i + 1) % 3, (i + 2) % 3
        s = 2 * np.sqrt(max(1 + rotation[i, i] - rotation[j, j] - rotation[k, k], 1e-12))
        q[0] = (rotation[k, j] - rotation[j, k]) / s
        q[1 + i] = s / 4
        q[1 + j] = (rotation[j, i] + rotation[i, j]) / s
        q[1 + k] = (rotation[k, i] + rotation[i, k]) / s
    if q[0] < 0:
        q = -q
    sine = np.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    scale = 2.0 if sine < 1e-9 else 2 * np.arctan2(sine, q[0]) / sine
    return scale * q[1:]


@njit(cache=True, nogil=True)
def place_joints(root: Any, rotation: Any, origin: Any, joints: Any) -> None:
    """Write the proximal joint of each bone (forward kinematics)."""
    for k in ORDER:
        p = PARENT[k]
        if p < 0:
            for i in range(3):
                joints[k, i] = root[i]
            continue
        for i in range(3):
            value = joints[p, i]
            for j in range(3):
                value += rotation[p, i, j] * (origin[k, j] - origin[p, j])
            joints[k, i] = value


@njit(cache=True, nogil=True)
def _local(rotation: Any, k: int) -> Any:
    """Return a bone's rotation relative to its parent's."""
    if PARENT[k] < 0:
        return rotation[k].copy()
    return times(rotation[PARENT[k]].T, rotation[k])


@njit(cache=True, nogil=True)
def _extrapolate(before: Any, now: Any, share: Any, out: Any) -> None:
    """Write the rotations after `now` if each bone's motion in its parent's frame goes on."""
    for k in ORDER:
        here = _local(now, k)
        turned = _vector(over(here, _local(before, k)))
        go = share[1] if PARENT[k] < 0 else share[0]
        ahead = times(_rotation(go * turned), here)
        put(ahead if PARENT[k] < 0 else times(out[PARENT[k]], ahead), out[k])


@njit(cache=True, nogil=True)
def _average(rotations: Any, share: Any, out: Any) -> None:
    """Move each rotation of `out` to the weighted mean of the given ones."""
    for k in range(out.shape[0]):
        step = np.zeros(3)
        for p in range(rotations.shape[0]):
            step += share[p] * _vector(over(rotations[p, k], out[k]))
        put(times(_rotation(step), out[k]), out[k])
