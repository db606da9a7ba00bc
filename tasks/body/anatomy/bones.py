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

from tasks.engine.kernels import njit

BONES = (
    "Head", "Body", "Waist",
    "RUpperArm", "RForeArm", "LUpperArm", "LForeArm",
    "RUpperLeg", "RLowerLeg", "LUpperLeg", "LLowerLeg",
    "RHand", "LHand", "RFoot", "LFoot",
)  # fmt: skip
"""The bones: the eleven segments in the order of the archive, then what they leave apart."""

PARENT = np.array([1, -1, 1, 1, 3, 1, 5, 2, 7, 2, 9, 4, 6, 8, 10])
"""(bone,) the bone that each hangs on; -1 for the root."""

ORDER = np.array([1, 0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14])
"""(bone,) parents before children."""

SEGMENT = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 4, 6, 8, 10])
"""(bone,) the segment that each bone's voxels belong to."""

PROXIMAL = (
    "Neck", "Neck", "Waist",
    "RShoulder", "RElbow", "LShoulder", "LElbow",
    "RHip", "RKnee", "LHip", "LKnee",
    "RWrist", "LWrist", "RAnkle", "LAnkle",
)  # fmt: skip
"""The joint that each bone turns about."""

UNKNOWNS = 3 + 3 * len(BONES)

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
    """Return (point, 3) where points are that ride on bones, `offset` from the joint at first."""
    return joints[bone] + np.einsum("pij,pj->pi", pose.rotation[bone], offset)


def rotation_of(vector: Floats) -> Floats:
    """Return (3, 3) the rotation about a vector by its length, rad."""
    return _rotation(np.ascontiguousarray(vector, np.float64))


def vector_of(rotation: Floats) -> Floats:
    """Return (3,) the axis of a rotation times its angle, rad, below pi."""
    return _vector(np.ascontiguousarray(rotation, np.float64))


def extrapolate(before: Pose, now: Pose, share: float, root_share: float) -> Pose:
    """Return the pose after `now` if its motion since `before` goes on by a share.

    The root bone's turn goes on by `root_share`, that of the others relative to it by `share`.
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
def times(a: Any, b: Any) -> Any:
    """Return a b: for three by three, a call of the library costs more than the product."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += a[i, k] * b[k, j]
    return out


@njit(cache=True, nogil=True)
def over(a: Any, b: Any) -> Any:
    """Return a b' of three by three."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += a[i, k] * b[j, k]
    return out


@njit(cache=True, nogil=True)
def _on(a: Any, v: Any) -> Any:
    """Return a v of three by three and three."""
    out = np.zeros(3)
    for i in range(3):
        for j in range(3):
            out[i] += a[i, j] * v[j]
    return out


@njit(cache=True, nogil=True)
def _rotation(vector: Any) -> Any:
    """Return the rotation of a rotation vector (Rodrigues)."""
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
    """Return the rotation vector of a rotation, by way of the quaternion."""
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
            joints[k] = root
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
    """Write the rotations after `now`, each bone's motion in its parent's frame going on."""
    for k in ORDER:
        here = _local(now, k)
        turned = _vector(over(here, _local(before, k)))
        go = share[1] if PARENT[k] < 0 else share[0]
        ahead = times(_rotation(go * turned), here)
        out[k] = ahead if PARENT[k] < 0 else times(out[PARENT[k]], ahead)


@njit(cache=True, nogil=True)
def _average(rotations: Any, share: Any, out: Any) -> None:
    """Move each rotation of `out` to the weighted mean of the given ones."""
    for k in range(out.shape[0]):
        step = np.zeros(3)
        for p in range(rotations.shape[0]):
            step += share[p] * _vector(over(rotations[p, k], out[k]))
        out[k] = times(_rotation(step), out[k])


@njit(cache=True, nogil=True)
def _add_point(
    k: int, point: Any, weight: Any, residual: Any, joints: Any, normal: Any, right: Any
) -> None:
    """Add a point that rides on bone k to the normal equations.

    `weight` (3, 3) is the information about the point's place, `residual` (3,) what it should
    move by. The unknowns are the root's translation, then a twist of each bone about its joint,
    in world axes, that all bones below share.
    """
    force = _on(weight, residual)
    for a in range(3):
        right[a] += force[a]
        for b in range(3):
            normal[a, b] += weight[a, b]
    i = k
    while i >= 0:
        row = 3 + 3 * i
        x, y, z = point[0] - joints[i, 0], point[1] - joints[i, 1], point[2] - joints[i, 2]
        right[row] += y * force[2] - z * force[1]
        right[row + 1] += z * force[0] - x * force[2]
        right[row + 2] += x * force[1] - y * force[0]
        lever = np.empty((3, 3))  # [point - joint] x weight
        for b in range(3):
            lever[0, b] = y * weight[2, b] - z * weight[1, b]
            lever[1, b] = z * weight[0, b] - x * weight[2, b]
            lever[2, b] = x * weight[1, b] - y * weight[0, b]
            for a in range(3):
                normal[row + a, b] += lever[a, b]
                normal[b, row + a] += lever[a, b]
        j = k
        while j >= 0:
            column = 3 + 3 * j
            u, v, w = point[0] - joints[j, 0], point[1] - joints[j, 1], point[2] - joints[j, 2]
            for a in range(3):
                normal[row + a, column] += v * lever[a, 2] - w * lever[a, 1]
                normal[row + a, column + 1] += w * lever[a, 0] - u * lever[a, 2]
                normal[row + a, column + 2] += u * lever[a, 1] - v * lever[a, 0]
            j = PARENT[j]
        i = PARENT[i]


@njit(cache=True, nogil=True)
def _add_turn(k: int, turn: Any, weight: float, normal: Any, right: Any) -> None:
    """Add the wish that bone k turns by a vector about its joint, all directions alike."""
    for a in range(3):
        right[3 + 3 * k + a] += weight * turn[a]
        normal[3 + 3 * k + a, 3 + 3 * k + a] += weight


@njit(cache=True, nogil=True)
def _add_limit(k: int, limit: Any, turned: Any, frame: Any, normal: Any, right: Any) -> None:
    """Add a limit (weight, direction of the bone, axis, most): most >= axis . turned bone."""
    excess = -limit[7]
    along = _on(turned, limit[1:4])
    for a in range(3):
        excess += along[a] * limit[4 + a]
    if excess <= 0:
        return
    slope = _on(frame, np.cross(along, limit[4:7]))
    for a in range(3):
        right[3 + 3 * k + a] -= limit[0] * excess * slope[a]
        for b in range(3):
            normal[3 + 3 * k + a, 3 + 3 * k + b] += limit[0] * slope[a] * slope[b]


@njit(cache=True, nogil=True)
def add_priors(rotation: Any, ahead: Any, stiffness: Any, limits: Any, normal: Any, right: Any):
    """Add what is known of every bone before a frame is seen.

    rotation : (bone, 3, 3) the pose now; ahead : (bone, 3, 3) the pose foreseen
    stiffness : (bone, 2) information per rad**2 of the foreseen and of the initial local turn
    limits : (limit, 9) bone, then what `_add_limit` takes, in axes of the initial pose
    """
    for k in ORDER:
        here = _local(rotation, k)
        frame = np.eye(3) if PARENT[k] < 0 else rotation[PARENT[k]]
        step = _vector(over(_local(ahead, k), here))
        _add_turn(k, _on(frame, step), stiffness[k, 0], normal, right)
        _add_turn(k, -_on(frame, _vector(here)), stiffness[k, 1], normal, right)
        for limit in limits:
            if limit[0] == k:
                _add_limit(k, limit[1:], here, frame, normal, right)


@njit(cache=True, nogil=True)
def add_points(bone: Any, points: Any, weights: Any, residuals: Any, joints: Any, system: Any):
    """Add points on bones to the normal equations `system` (unknown, unknown + 1).

    points, residuals : (point, 3); weights : (point, 3, 3) information, not added where zero
    """
    normal, right = system[:, :-1], system[:, -1]
    for p in range(len(bone)):
        if weights[p, 0, 0] > 0:
            _add_point(bone[p], points[p], weights[p], residuals[p], joints, normal, right)


@njit(cache=True, nogil=True)
def solve(system: Any, step: Any) -> None:
    """Write the solution of the normal equations `system` (unknown, unknown + 1), which change.

    A bone's unknowns meet those of the bones that it hangs on only, and these come before them but
    for the head's, which meets the same: eliminated from the last to the first, no zero is filled
    (George and Liu 1981), and most of the matrix is never looked at.
    """
    count = system.shape[0]
    for k in range(count - 1, -1, -1):
        for i in range(k):
            if system[k, i] != 0.0:
                share = system[k, i] / system[k, k]
                for j in range(i + 1):
                    system[i, j] -= share * system[k, j]
                system[i, count] -= share * system[k, count]
    for k in range(count):
        step[k] = system[k, count]
        for i in range(k):
            step[k] -= system[k, i] * step[i]
        step[k] /= system[k, k]


@njit(cache=True, nogil=True)
def move(step: Any, rotation: Any, turned: Any) -> None:
    """Write the rotations after a step of the unknowns."""
    total = np.zeros((rotation.shape[0], 3))
    for k in ORDER:
        total[k] = step[3 + 3 * k : 6 + 3 * k]
        if PARENT[k] >= 0:
            total[k] += total[PARENT[k]]
        turned[k] = times(_rotation(total[k]), rotation[k])
