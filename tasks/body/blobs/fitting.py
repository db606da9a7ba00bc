"""Fit the pose of a body of blobs to the voxels of one frame.

The fit alternates between sharing the voxels out among the blobs (`blobs.share_out`) and one step
of least squares over all bones (`least_squares.add_points`). The blobs are wider at first, so that
they find voxels that are far away. A blob pulls with at most a multiple of its own volume, so that
the cloth around it does not pull more than the body.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from tasks.body.anatomy.bones import BONES, Floats, Pose, place_bones, place_joints, put
from tasks.body.blobs.blobs import Blobs, Voxels, place_blobs, share_out
from tasks.body.blobs.centers import CenterSettings, Evidence, move_centers
from tasks.body.blobs.least_squares import UNKNOWNS, add_points, add_priors, move, solve
from tasks.body.blobs.model import FitModel, number_bones
from tasks.engine.kernels import njit
from tasks.engine.settings import Count, NotNegative, Positive, check_ranges
from tasks.engine.threads import side_by_side


@dataclass(frozen=True)
class FitSettings:
    """Everything that changes the fit of one frame.

    Information is relative to that of the hull: all voxels of a frame together weigh 1.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    steps: Count = 6
    """How often at most a frame's voxels are shared out and the pose is moved [turns]. Chosen by
    eye on the shared captures; not measured."""

    widening: Positive = 1.5
    """Factor of the blobs' size in the first turn [factor]. It falls to 1 while the fit goes on.
    Chosen by eye on the shared captures; not measured."""

    nobody: Positive = 0.006
    """Density of the voxels of nobody [share of the median density of a blob's middle]. Chosen by
    eye on the shared captures; not measured."""

    most_mass: Positive = 1.6
    """A blob pulls with at most so many times its share of the voxels [factor]. Cloth around a bone
    has more voxels than the bone. Chosen by eye on the shared captures; not measured."""

    foreseen: NotNegative = 0.02
    """Information that the turn of a bone is the foreseen one [1/rad²]. Chosen by eye on the shared
    captures; not measured."""

    rest: NotNegative = 0.001
    """Information that the turn of a bone is that of the initial pose [1/rad²]. The spine bends
    little. Chosen by eye on the shared captures; not measured."""

    limit: NotNegative = 2.0
    """Information that a joint keeps its limits [1/rad²]. Chosen by eye on the shared captures; not
    measured."""

    centers: CenterSettings = field(default_factory=CenterSettings)

    largest_turn: Positive = 0.4
    """How far a joint turns in a step at most [rad]. Chosen by eye on the shared captures; not
    measured."""

    def __post_init__(self) -> None:
        check_ranges(self)


_FORESEEN = number_bones(
    {
        "Head": 0.5, "Body": 2, "Waist": 4, "UpperArm": 2, "ForeArm": 1.4, "Hand": 2,
        "UpperLeg": 1, "LowerLeg": 0.7, "Foot": 1,
    }
)  # fmt: skip
"""How much the foreseen turn of each bone weighs [times `FitSettings.foreseen`]. Heavy bones keep
their motion. Chosen by eye on the shared captures; not measured."""

_REST = number_bones(
    {
        "Head": 3, "Body": 12, "Waist": 20, "UpperArm": 0, "ForeArm": 0, "Hand": 1,
        "UpperLeg": 0.6, "LowerLeg": 0.4, "Foot": 6,
    }
)  # fmt: skip
"""How much the initial turn of each bone weighs [times `FitSettings.rest`]. The spine bends less
than limbs turn. Arms have 0: for a second no voxel may tell an arm that is held before the trunk,
and it should stay as it was then, not stretch out to the side again. Chosen by eye on the shared
captures; not measured."""

_ROOT_STAYS = 0.3
"""Information that the root is at its foreseen place, on each axis [1/m²]. It is next to none
beside that of the voxels."""

_WIDE_SHARE = 0.6
"""Share of a frame's turns over which the blobs shrink to their size. Chosen by eye on the shared
captures; not measured."""

_DAMPING = 1e-6
"""What is added to the diagonal of the normal equations [1/m² or 1/rad²]. It keeps them solvable
where nothing tells an unknown."""

_LEAST_MASS = 1e-5
"""A blob with a smaller share of a frame's voxels does not pull. Not one of some thousand voxels is
its own then, so that their middle says nothing."""

_NOT_ZERO = 1e-9
"""What divides at least, where a divisor may be 0 [number]."""


@dataclass(frozen=True)
class Target:
    """A place where a point of the body was seen."""

    bone: int
    """The bone that the point rides on."""

    offset: Floats
    """(3,) the point in the initial pose, m from the bone's proximal joint."""

    place: Floats
    """(3,) where the point was seen, m."""

    weight: float
    """Information about the place, per m**2."""

    scale_m: float
    """Distance from which the pull weakens (Cauchy)."""


@dataclass(frozen=True)
class Fit:
    """A pose that was fitted to a frame, and how well it fits."""

    pose: Pose
    likelihood: float
    """Mean log likelihood of a voxel, relative to the uniform class."""

    support: Floats
    """(bone,) the voxels that a bone has, as a share of those that it had at first; 1 is all."""


def fit_frame(
    model: FitModel,
    voxels: Voxels,
    start: Pose,
    ahead: Pose,
    targets: Sequence[Target] = (),
    *,
    settings: FitSettings,
    steps: int | None = None,
    widening: float | None = None,
) -> Fit:
    """Return the pose near a start that fits a frame's voxels best.

    Parameters
    ----------
    voxels
        An even sample of the frame's voxels.
    start, ahead
        The pose that the fit begins with, and the pose that is foreseen.
    targets
        Where points of the body were seen.
    settings
        The numbers of the fit.
    steps, widening
        Instead of those of the settings.
    """
    stiffness = _stiffness(settings)
    limits = model.limits * np.array([1, settings.limit, 1, 1, 1, 1, 1, 1, 1.0])
    root, rotation = start.root.copy(), start.rotation.copy()
    mass = np.empty(len(model.blobs.bone))
    likelihood = _climb(
        *_pack(model, voxels),
        (root, rotation),
        (ahead.root, ahead.rotation, stiffness, limits),
        _gather(targets),
        (settings.nobody, settings.most_mass, settings.largest_turn),
        (
            settings.steps if steps is None else steps,
            settings.widening if widening is None else widening,
        ),
        mass,
    )
    blobs = model.blobs
    held = np.bincount(blobs.bone, np.minimum(mass, blobs.share), len(BONES))
    whole = np.bincount(blobs.bone, blobs.share, len(BONES))
    relative = likelihood - np.log(settings.nobody)
    return Fit(Pose(root, rotation), relative, held / np.maximum(whole, _NOT_ZERO))


@cache
def _stiffness(settings: FitSettings) -> Floats:
    """Return (bone, 2) how much the foreseen and the initial turn of each bone weigh."""
    return np.stack([settings.foreseen * _FORESEEN, settings.rest * _REST], 1)


def _pack(model: FitModel, voxels: Voxels) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return the voxels and the body as `weigh` takes them."""
    return (
        (voxels.count, voxels.points, voxels.likeness, voxels.boxes),
        (model.origin, model.body, model.blobs.share, model.weight, model.kind),
    )


def _gather(targets: Sequence[Target]) -> tuple[Any, ...]:
    """Return the bones, offsets, places, weights and scales of targets as arrays."""
    return (
        np.array([t.bone for t in targets], np.int64),
        np.array([t.offset for t in targets]).reshape(-1, 3),
        np.array([t.place for t in targets]).reshape(-1, 3),
        np.array([t.weight for t in targets], np.float64),
        np.array([t.scale_m for t in targets], np.float64),
    )


@njit(cache=True, nogil=True)
def _climb(
    voxels: Any, body: Any, pose: Any, foreseen: Any, targets: Any, numbers: Any, turns: Any,
    mass: Any,
) -> float:  # fmt: skip
    """Move a pose until it fits; return the mean log likelihood of a voxel.

    body : origin, blobs, share, weight and kind of `FitModel`
    pose : root and rotation; written
    foreseen : root and rotation, then stiffness and limits as `add_priors` takes them
    targets : as `_gather` returns them
    numbers : nobody, most_mass and largest_turn of `FitSettings`
    turns : how many turns there are, and how wide the blobs are in the first
    mass : (blob,) written: the share of the voxels that each blob has
    """
    origin, blobs, share = body[0], body[1], body[2]
    root, rotation = pose
    steps, wide = turns
    anneal = max(1.0, _WIDE_SHARE * steps)
    own, count = len(share), len(blobs[0])
    placed = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
    evidence = np.empty((own, 3, 3)), np.empty((own, 3))
    joints, turned = np.empty((len(origin), 3)), np.empty_like(rotation)
    step = np.empty(UNKNOWNS)
    likelihood = 0.0
    for turn in range(steps + 1):
        widening = wide + (1.0 - wide) * min(1.0, turn / anneal)
        place_joints(root, rotation, origin, joints)
        likelihood = weigh(
            voxels, body, joints, rotation, widening, numbers, placed, evidence, mass
        )
        if turn == steps:
            break
        system = np.zeros((UNKNOWNS, UNKNOWNS + 1))
        add_points(blobs[0][:own], placed[0], evidence[0], evidence[1], joints, system)
        _add_targets(targets, rotation, joints, system)
        normal, right = system[:, :-1], system[:, -1]
        add_priors(rotation, foreseen[1], foreseen[2], foreseen[3], normal, right)
        for a in range(3):
            normal[a, a] += _ROOT_STAYS
            right[a] += _ROOT_STAYS * (foreseen[0][a] - root[a])
        for k in range(UNKNOWNS):
            normal[k, k] += _DAMPING
        solve(system, step)
        largest = np.abs(step[3:]).max()
        share_of_step = min(1.0, numbers[2] / max(largest, _NOT_ZERO))
        for k in range(UNKNOWNS):
            step[k] *= share_of_step
        move(step, rotation, turned)
        for k in range(len(rotation)):
            put(turned[k], rotation[k])
        for a in range(3):
            root[a] += step[a]
    return likelihood


@njit(cache=True, nogil=True)
def weigh(
    voxels: Any, body: Any, joints: Any, rotation: Any, widening: float, numbers: Any,
    placed: Any, evidence: Any, mass: Any,
) -> float:  # fmt: skip
    """Share voxels out among the blobs of a pose; return the mean log likelihood of a voxel.

    voxels, body, numbers : as for `_climb`
    placed : written as by `place_blobs`
    evidence : written: information (blob, 3, 3) about the place of each of the body's blobs, and
        residual (blob, 3) from the blob to the middle of its voxels
    mass : (blob,) written: the share of the voxels that each blob has
    """
    _, blobs, share, weight, kind = body
    mean, inverse, half = placed
    information, residual = evidence
    place_blobs(blobs, joints, rotation, widening, placed)
    sums = np.empty((len(mean), 4))
    around = (mean, inverse, half, (weight / widening**3).astype(np.float32), kind)
    likelihood = share_out(voxels, around, numbers[0], sums)
    for b in range(len(share)):
        mass[b] = sums[b, 0] / max(voxels[0], 1)
        pull = min(mass[b], numbers[1] * share[b]) if mass[b] >= _LEAST_MASS else 0.0
        for i in range(3):
            residual[b, i] = sums[b, 1 + i] / max(sums[b, 0], _NOT_ZERO) - mean[b, i]
            for j in range(3):
                information[b, i, j] = pull * inverse[b, i, j] * widening**2
    return likelihood


@njit(cache=True, nogil=True, inline="always")
def _add_targets(targets: Any, rotation: Any, joints: Any, system: Any) -> None:
    """Add the pull of places where points were seen; the farther a place, the weaker it pulls."""
    bone, offset, place, weight, scale = targets
    points, residual = np.empty((len(bone), 3)), np.empty((len(bone), 3))
    information = np.zeros((len(bone), 3, 3))
    for t in range(len(bone)):
        far = 0.0
        for i in range(3):
            points[t, i] = joints[bone[t], i]
            for j in range(3):
                points[t, i] += rotation[bone[t], i, j] * offset[t, j]
            residual[t, i] = place[t, i] - points[t, i]
            far += (residual[t, i] / scale[t]) ** 2
        for i in range(3):
            information[t, i, i] = weight[t] / (1.0 + far)
    add_points(bone, points, information, residual, joints, system)


def settle_joints(
    model: FitModel, frames: Iterable[tuple[Voxels, Pose]], settings: FitSettings
) -> FitModel:
    """Return the body with its joints at the centers that bones turn about in fitted frames."""
    seen = side_by_side(lambda frame: _weigh_pose(model, *frame, settings), list(frames))
    stiffness = settings.foreseen * _FORESEEN
    moved = move_centers(seen, model.left, model.stature, stiffness, settings.centers)

    def rides(blobs: Blobs) -> Blobs:
        return replace(blobs, offset=blobs.offset - moved[blobs.bone])

    return replace(
        model, origin=model.origin + moved, blobs=rides(model.blobs), cloth=rides(model.cloth)
    )


def _weigh_pose(model: FitModel, voxels: Voxels, pose: Pose, settings: FitSettings) -> Evidence:
    """Return where a frame's voxels draw the blobs of a pose."""
    own, count = len(model.blobs.bone), len(model.kind)
    placed = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
    evidence = np.empty((own, 3, 3)), np.empty((own, 3))
    joints = place_bones(pose, model.origin)
    weigh(
        *_pack(model, voxels),
        joints,
        pose.rotation,
        1.0,
        (settings.nobody, settings.most_mass, settings.largest_turn),
        placed,
        evidence,
        np.empty(own),
    )
    return Evidence(model.blobs.bone, placed[0][:own], *evidence, joints, pose.rotation)


def target_distances(model: FitModel, pose: Pose, targets: Sequence[Target]) -> Floats:
    """Return (target,) how far points of the body are from where they were seen, m."""
    joints = place_bones(pose, model.origin)
    away = [joints[t.bone] + pose.rotation[t.bone] @ t.offset - t.place for t in targets]
    return np.array([math.sqrt(each @ each) for each in away], np.float64)


def penalized_likelihood(model: FitModel, fit: Fit, targets: Sequence[Target]) -> float:
    """Return the likelihood of a fit less the cost of its distances to targets.

    Of two fits, the one with the larger value explains the frame better.
    """
    penalty = 0.0
    for target, away in zip(targets, target_distances(model, fit.pose, targets), strict=True):
        far = away / target.scale_m
        penalty += 0.5 * target.weight * target.scale_m**2 * np.log1p(far**2)
    return fit.likelihood - penalty
