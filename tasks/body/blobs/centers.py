"""Find the centers that bones turn about from how they move: joints that clothes hide.

The initial model puts joints by the proportions of a body. Once the poses of many frames are
known, better places follow from the same least squares: the joints of the initial pose become
unknowns of all frames together, and each frame's pose is eliminated (bundle adjustment with the
Schur complement; the joints are the centers of rotation of Gamage and Lasenby, "New least squares
solutions for estimating the average centre of rotation", 2002). A joint that hardly bends stays
where it was, and right and left are much alike.

The base of the neck and the hips are not moved: the hull shows both where clothes hide other
joints. Above the one seven vertebrae bend, so that the head has no one center there; moved, it
went 3 cm backwards in a take of a dancer who holds the head forward. What is around the others
does not turn with the thigh; moved, they sank by up to 1.4 cm in rendered takes.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, PARENT, PROXIMAL, Floats
from tasks.body.blobs.least_squares import UNKNOWNS

_HELD = [BONES.index(bone) for bone in ("Body", "Head", "RUpperLeg", "LUpperLeg")]
_BELOW = np.zeros((len(BONES), len(BONES)), np.bool_)  # [j, k]: bone k is j or hangs on it
for _k in range(len(BONES)):
    _j = _k
    while _j >= 0:
        _BELOW[_j, _k] = True
        _j = int(PARENT[_j])


@dataclass(frozen=True)
class CenterSettings:
    """Everything that changes where joints are found to be; lengths in statures."""

    usual: float = 0.02
    """How far the joints of an initial model usually are from the body's, 3 cm."""

    uneven: float = 0.01
    """How much right and left usually differ."""

    trusted: float = 0.002
    """Share of a frame's voxels that what is usual is worth."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What one frame says of its blobs, in a fitted pose."""

    bone: NDArray[np.int64]
    """(blob,) the bone of each."""

    mean: Floats
    """(blob, 3) where the pose has it, m."""

    information: Floats
    """(blob, 3, 3) about its place, per m**2."""

    residual: Floats
    """(blob, 3) from there to the middle of its voxels, m."""

    joints: Floats
    """(bone, 3) proximal joints, m."""

    rotation: Floats
    """(bone, 3, 3) since the initial pose."""


def move_centers(
    frames: Iterable[Evidence],
    left: Floats,
    stature_m: float,
    stiffness: Floats,
    settings: CenterSettings,
) -> Floats:
    """Return how far the proximal joint of each bone should move in the initial pose.

    Parameters
    ----------
    frames
        Of different poses.
    left : (3,) float64
        Unit vector to the performer's left in the initial pose.
    stature_m
        The performer's height.
    stiffness : (bone,) float64
        Information per rad**2 that a fitted pose has but for the voxels.
    settings
        What is usual.

    Returns
    -------
    (bone, 3) float64
        Metres; zero for body and head, which turn about the base of the neck, and upper legs.
    """
    size = 3 * len(BONES)
    normal, right = np.zeros((size, size)), np.zeros(size)
    count = 0
    for frame in frames:
        count += 1
        slope = np.concatenate([_pose_slope(frame), _center_slope(frame)], axis=2)
        weighed = (frame.information @ slope).reshape(-1, slope.shape[2])
        whole = slope.reshape(weighed.shape).T @ weighed
        force = frame.residual.ravel() @ weighed
        own = whole[:UNKNOWNS, :UNKNOWNS] + np.diag(
            np.concatenate([[1e-3] * 3, np.repeat(stiffness, 3)])
        )
        cross = whole[:UNKNOWNS, UNKNOWNS:]
        solved = np.linalg.solve(own, np.column_stack([cross, force[:UNKNOWNS]]))
        normal += whole[UNKNOWNS:, UNKNOWNS:] - cross.T @ solved[:, :-1]
        right += force[UNKNOWNS:] - cross.T @ solved[:, -1]
    worth = settings.trusted * max(count, 1)
    normal += np.eye(size) * worth / (settings.usual * stature_m) ** 2
    _add_symmetry(normal, left, worth / (settings.uneven * stature_m) ** 2)
    return np.asarray(np.linalg.solve(normal, right), np.float64).reshape(-1, 3)


def _pose_slope(frame: Evidence) -> Floats:
    """Return (blob, 3, unknown) how blobs move with the pose: root, then a twist of each bone."""
    bone = frame.bone
    slope = np.zeros((len(bone), 3, UNKNOWNS))
    slope[:, :, :3] = np.eye(3)
    arm = (frame.mean[:, None] - frame.joints) * _BELOW[:, bone].T[:, :, None]
    x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
    slope[:, 1, 3::3], slope[:, 2, 3::3] = -z, y  # twist x arm
    slope[:, 0, 4::3], slope[:, 2, 4::3] = z, -x
    slope[:, 0, 5::3], slope[:, 1, 5::3] = -y, x
    return slope


def _center_slope(frame: Evidence) -> Floats:
    """Return (blob, 3, 3 a bone) how blobs move with the joints of the initial pose."""
    turned = frame.rotation[PARENT] - frame.rotation
    turned[_HELD] = 0.0
    moved = _BELOW[:, frame.bone].T[:, None, :, None] * turned.swapaxes(0, 1)
    return moved.reshape(len(frame.bone), 3, 3 * len(BONES))


def _add_symmetry(normal: Floats, left: Floats, weight: float) -> None:
    """Add that left joints move as the mirror images of right ones; others stay in the middle."""
    mirror = np.eye(3) - 2.0 * np.outer(left, left)
    for j, name in enumerate(PROXIMAL):
        own = slice(3 * j, 3 * j + 3)
        if name[0] == "R":
            twin = 3 * BONES.index("L" + BONES[j][1:])
            other = slice(twin, twin + 3)
            normal[own, own] += weight * np.eye(3)
            normal[other, other] += weight * np.eye(3)
            normal[own, other] -= weight * mirror
            normal[other, own] -= weight * mirror
        elif name[0] != "L":
            normal[own, own] += weight * np.outer(left, left)
