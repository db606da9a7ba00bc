"""Find the centers that bones turn about from how the bones move: joints that clothes hide.

The initial model places joints by the proportions of a body. The poses of many frames tell better
places by the same least squares: the joints of the initial pose become unknowns of all frames
together, and each frame's pose is eliminated (bundle adjustment with the Schur complement; the
joints are the centers of rotation of Gamage and Lasenby, "New least squares solutions for
estimating the average centre of rotation", 2002). A joint that hardly bends stays where it was, and
right and left joints stay much alike.

The base of the neck, the hips and the ankles are not moved, for the hull shows them where clothes
hide other joints. Seven vertebrae bend above the base of the neck, so that the head has no single
center there: when it was moved, it went 3 cm backwards in a take of a dancer who holds the head
forward. The voxels around the hips do not turn with the thighs: when the hips were moved, they sank
by up to 1.4 cm in rendered takes. The sole tells how high an ankle is, and under a skirt it is the
hem that moves: when ankles were moved, they rose by 7 cm in a rendered take of lunges.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, PARENT, PROXIMAL, Floats
from tasks.body.blobs.least_squares import UNKNOWNS
from tasks.engine.settings import Positive, check_ranges
from tasks.engine.threads import side_by_side

_HELD = [BONES.index(bone) for bone in ("Body", "Head", "RUpperLeg", "LUpperLeg", "RFoot", "LFoot")]
"""The bones whose proximal joints are not moved."""

_ROOT_HELD = 1e-3
"""Information by which a frame's root stays where it is, on each axis [1/m²]. It is next to none:
it keeps the equations solvable when no blob has voxels."""

_BELOW = np.zeros((len(BONES), len(BONES)), np.bool_)
"""(bone, bone) True at [j, k] where bone k is bone j or hangs on it."""

for _k in range(len(BONES)):
    _j = _k
    while _j >= 0:
        _BELOW[_j, _k] = True
        _j = int(PARENT[_j])


@dataclass(frozen=True)
class CenterSettings:
    """Everything that changes where joints are found to be.

    Raises
    ------
    ValueError
        If a number is not larger than 0.
    """

    usual: Positive = 0.02
    """How far the joints of an initial model usually are from the body's [statures]. It is 3 cm of
    a dancer; chosen by eye on the shared captures, not measured."""

    uneven: Positive = 0.01
    """How much a right and a left joint usually differ [statures]. Chosen by eye on the shared
    captures; not measured."""

    trusted: Positive = 0.002
    """How much the usual distances weigh in a frame [share of the frame's voxels]. Chosen by eye on
    the shared captures; not measured."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Where the voxels of one frame draw the blobs of a fitted pose."""

    bone: NDArray[np.int64]
    """(blob,) the bone of each."""

    mean: Floats
    """(blob, 3) where the pose puts the blob, m."""

    information: Floats
    """(blob, 3, 3) about the blob's place, per m**2."""

    residual: Floats
    """(blob, 3) from the blob to the middle of its voxels, m."""

    joints: Floats
    """(bone, 3) proximal joints, m."""

    rotation: Floats
    """(bone, 3, 3) since the initial pose."""


def move_centers(
    frames: Sequence[Evidence],
    left: Floats,
    stature_m: float,
    stiffness: Floats,
    settings: CenterSettings,
) -> Floats:
    """Return by how much the proximal joint of each bone should move in the initial pose.

    Parameters
    ----------
    frames
        Frames in different poses.
    left : (3,) float64
        Unit vector to the performer's left in the initial pose.
    stature_m
        The performer's height.
    stiffness : (bone,) float64
        Information per rad**2 about a bone's turn that does not come from voxels.
    settings
        Which moves are usual.

    Returns
    -------
    (bone, 3) float64
        Metres. It is zero for the body and the head, which turn about the base of the neck, for the
        upper legs and for the feet.
    """
    size = 3 * len(BONES)
    normal, right = np.zeros((size, size)), np.zeros(size)

    def reduce(frame: Evidence) -> tuple[Floats, Floats]:
        slope = np.concatenate([_pose_slope(frame), _center_slope(frame)], axis=2)
        weighed = (frame.information @ slope).reshape(-1, slope.shape[2])
        whole = slope.reshape(weighed.shape).T @ weighed
        force = frame.residual.ravel() @ weighed
        own = whole[:UNKNOWNS, :UNKNOWNS] + np.diag(
            np.concatenate([[_ROOT_HELD] * 3, np.repeat(stiffness, 3)])
        )
        cross = whole[:UNKNOWNS, UNKNOWNS:]
        solved = np.linalg.solve(own, np.column_stack([cross, force[:UNKNOWNS]]))
        return (
            whole[UNKNOWNS:, UNKNOWNS:] - cross.T @ solved[:, :-1],
            force[UNKNOWNS:] - cross.T @ solved[:, -1],
        )

    for of_frame, pull in side_by_side(reduce, frames):
        normal += of_frame
        right += pull
    weight = settings.trusted * max(len(frames), 1)
    normal += np.eye(size) * weight / (settings.usual * stature_m) ** 2
    _add_symmetry(normal, left, weight / (settings.uneven * stature_m) ** 2)
    return np.asarray(np.linalg.solve(normal, right), np.float64).reshape(-1, 3)


def _pose_slope(frame: Evidence) -> Floats:
    """Return (blob, 3, unknown) how blobs move with the root and with a twist of each bone."""
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
    """Return (blob, 3, 3 bones) how blobs move with the joints of the initial pose."""
    turned = frame.rotation[PARENT] - frame.rotation
    turned[_HELD] = 0.0
    moved = _BELOW[:, frame.bone].T[:, None, :, None] * turned.swapaxes(0, 1)
    return moved.reshape(len(frame.bone), 3, 3 * len(BONES))


def _add_symmetry(normal: Floats, left: Floats, weight: float) -> None:
    """Add the wish that left and right joints move as mirror images, and others in the middle."""
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
