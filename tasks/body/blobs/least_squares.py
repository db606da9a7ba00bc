"""Make one least-squares step over all bones of an articulated body.

The step is that of Gauss and Newton on local twists, with analytic derivatives (Bregler and Malik
1998). All bones are solved at once, so that the evidence of a child corrects its parents. The
unknowns are the root's translation and a twist of each bone.
"""

from typing import Any

import numpy as np

from tasks.body.anatomy.bones import (
    BONES,
    ORDER,
    PARENT,
    _local,
    _on,
    _rotation,
    _vector,
    over,
    put,
    times,
)
from tasks.engine.kernels import njit

UNKNOWNS = 3 + 3 * len(BONES)
"""Unknowns of a pose [numbers]. They are a translation and a twist of each bone."""


@njit(cache=True, nogil=True, inline="always")
def _add_point(
    k: int, point: Any, weight: Any, residual: Any, joints: Any, normal: Any, right: Any
) -> None:
    """Add a point that rides on bone k to the normal equations.

    `weight` (3, 3) is the information about the point's place, and `residual` (3,) the move that
    the point should make. The unknowns are the root's translation, then a twist of each bone about
    its joint, in world axes; all bones below share the twist.
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
    """Add the wish that bone k turns by a vector about its joint, with one weight for all axes."""
    for a in range(3):
        right[3 + 3 * k + a] += weight * turn[a]
        normal[3 + 3 * k + a, 3 + 3 * k + a] += weight


@njit(cache=True, nogil=True, inline="always")
def _add_limit(k: int, limit: Any, turned: Any, frame: Any, normal: Any, right: Any) -> None:
    """Add the limit that a turned direction of bone k goes along an axis by at most a share.

    `limit` is the weight, the direction (3,), the axis (3,) and the share.
    """
    excess = -limit[7]
    along = _on(turned, limit[1:4])
    for a in range(3):
        excess += along[a] * limit[4 + a]
    if excess <= 0:
        return
    across = np.empty(3)  # as numpy's cross, which takes a second to compile
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        across[a] = along[b] * limit[4 + c] - along[c] * limit[4 + b]
    slope = _on(frame, across)
    for a in range(3):
        right[3 + 3 * k + a] -= limit[0] * excess * slope[a]
        for b in range(3):
            normal[3 + 3 * k + a, 3 + 3 * k + b] += limit[0] * slope[a] * slope[b]


@njit(cache=True, nogil=True, inline="always")
def add_priors(rotation: Any, ahead: Any, stiffness: Any, limits: Any, normal: Any, right: Any):
    """Add what is known of every bone before a frame is looked at.

    rotation : (bone, 3, 3) of the pose now
    ahead : (bone, 3, 3) of the pose that is foreseen
    stiffness : (bone, 2) information per rad**2 of the foreseen and of the initial local turn
    limits : (limit, 9) the bone, then what `_add_limit` takes, in axes of the initial pose
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

    points, residuals : (point, 3)
    weights : (point, 3, 3) information; a point without any is left out
    """
    normal, right = system[:, :-1], system[:, -1]
    for p in range(len(bone)):
        if weights[p, 0, 0] > 0:
            _add_point(bone[p], points[p], weights[p], residuals[p], joints, normal, right)


@njit(cache=True, nogil=True, inline="always")
def solve(system: Any, step: Any) -> None:
    """Write the solution of the normal equations `system` (unknown, unknown + 1); change them.

    The unknowns of a bone share equations only with those of the bones that it hangs on. These come
    before it, but for the head, which stands before the body and shares equations with it alone. So
    when unknowns are eliminated from the last to the first, no zero is filled (George and Liu 1981)
    and most of the matrix is never looked at.
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


@njit(cache=True, nogil=True, inline="always")
def move(step: Any, rotation: Any, turned: Any) -> None:
    """Write the rotations after a step of the unknowns."""
    total = np.zeros((rotation.shape[0], 3))
    for k in ORDER:
        for a in range(3):
            total[k, a] = step[3 + 3 * k + a]
            if PARENT[k] >= 0:
                total[k, a] += total[PARENT[k], a]
        put(times(_rotation(total[k]), rotation[k]), turned[k])
