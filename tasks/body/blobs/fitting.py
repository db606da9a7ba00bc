"""Fit the pose of a body of blobs to the voxels of one frame.

Expectation (`blobs.share_out`) and one step of least squares over all bones
(`articulated.add_points`) by turns, with the blobs wider at first. A blob pulls with at most a
multiple of its own volume, so that cloth around it does not pull more than the body.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tasks.body.anatomy.bones import BONES, Floats, Pose, place_bones, place_joints
from tasks.body.blobs.blobs import Blobs, Voxels, place_blobs, share_out
from tasks.body.blobs.centers import CenterSettings, Evidence, move_centers
from tasks.body.blobs.least_squares import UNKNOWNS, add_points, add_priors, move, solve
from tasks.body.blobs.model import FitModel
from tasks.engine.kernels import njit


@dataclass(frozen=True)
class FitSettings:
    """Everything that changes the fit of one frame; information is in units of the hull."""

    steps: int = 6
    """Most turns of expectation and least squares a frame."""

    widening: float = 1.5
    """Factor of the blobs' size in the first turn; it falls to 1 over the first 60 %."""

    nobody: float = 0.006
    """Density of the uniform class, as a share of the median density of a blob's middle."""

    most_mass: float = 1.6
    """A blob pulls with at most this multiple of its share of the voxels."""

    foreseen: float = 0.02
    """Information of the foreseen pose."""

    rest: float = 0.001
    """Information of the initial pose: the spine bends little."""

    limit: float = 2.0
    """Information of the limits of knees and elbows."""

    centers: CenterSettings = field(default_factory=CenterSettings)

    largest_turn: float = 0.4
    """Largest turn of a joint in a step, rad."""


# Head, body, waist, then arms and legs (upper, lower, right before left), hands and feet: heavy
# bones carry on, and the spine bends less than limbs turn. An arm before the trunk may show
# nowhere for a second: it goes on as it was, where rest would stretch it out to the side again.
_FORESEEN = np.array([0.5, 2, 4, 2, 1.4, 2, 1.4, 1, 0.7, 1, 0.7, 2, 2, 1, 1])
_REST = np.array([3, 12, 20, 0, 0, 0, 0, 0.6, 0.4, 0.6, 0.4, 1, 1, 6, 6])
_ROOT_STAYS = 0.3  # information of the foreseen place of the root, per m**2: next to none


@dataclass(frozen=True)
class Target:
    """A place that a point of the body was seen at."""

    bone: int
    offset: Floats
    """(3,) the point in the initial pose, m from the bone's proximal joint."""

    place: Floats
    """(3,) m."""

    weight: float
    """Information, per m**2."""

    scale_m: float
    """Distance from which the pull weakens (Cauchy)."""


@dataclass(frozen=True)
class Fit:
    """A fitted frame."""

    pose: Pose
    likelihood: float
    """Mean log likelihood of a voxel, relative to the uniform class."""

    support: Floats
    """(bone,) voxels that belong to a bone, as a share of the bone's at first; 1 is all."""


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
    """Return the pose that fits a frame's voxels best, near a start.

    Parameters
    ----------
    voxels
        An even sample of the frame's.
    start, ahead
        Where the fit begins, and the pose foreseen.
    targets
        Points of the body seen elsewhere.
    """
    stiffness = np.stack([settings.foreseen * _FORESEEN, settings.rest * _REST], 1)
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
    return Fit(Pose(root, rotation), relative, held / np.maximum(whole, 1e-9))


def _pack(model: FitModel, voxels: Voxels) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return voxels and body as `weigh` takes them."""
    return (
        (voxels.count, voxels.points, voxels.likeness, voxels.boxes),
        (model.origin, model.body, model.blobs.share, model.weight, model.kind),
    )


def _gather(targets: Sequence[Target]) -> tuple[Any, ...]:
    """Return bone, offset, place, weight and scale of targets as arrays."""
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
    """Move a pose (root, rotation) until it fits; write each blob's share of the voxels.

    body : origin, blobs, share, weight and kind of `FitModel`
    foreseen : root, rotation, then stiffness and limits as `add_priors` takes them
    targets : as of `_gather`; numbers : nobody, most_mass and largest_turn of `FitSettings`
    turns : how many, and how wide the blobs are in the first
    """
    origin, blobs, share = body[0], body[1], body[2]
    root, rotation = pose
    steps, wide = turns
    anneal = max(1.0, 0.6 * steps)
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
            normal[k, k] += 1e-6
        solve(system, step)
        largest = np.abs(step[3:]).max()
        step *= min(1.0, numbers[2] / max(largest, 1e-9))
        move(step, rotation, turned)
        rotation[:] = turned
        root += step[:3]
    return likelihood


@njit(cache=True, nogil=True)
def weigh(
    voxels: Any, body: Any, joints: Any, rotation: Any, widening: float, numbers: Any,
    placed: Any, evidence: Any, mass: Any,
) -> float:  # fmt: skip
    """Share voxels out in a pose; return the mean log likelihood of a voxel.

    voxels, body, numbers : as for `_climb`
    placed : written as by `place_blobs`
    evidence : written: information (blob, 3, 3) about the place of each of the body's blobs, and
        residual (blob, 3) from there to the middle of its voxels
    mass : (blob,) written: share of the voxels that each has
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
        pull = min(mass[b], numbers[1] * share[b]) if mass[b] >= 1e-5 else 0.0
        for i in range(3):
            residual[b, i] = sums[b, 1 + i] / max(sums[b, 0], 1e-9) - mean[b, i]
            for j in range(3):
                information[b, i, j] = pull * inverse[b, i, j] * widening**2
    return likelihood


@njit(cache=True, nogil=True)
def _add_targets(targets: Any, rotation: Any, joints: Any, system: Any) -> None:
    """Add the pull of places seen, weaker where they are far."""
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
    """Return the body with its joints where fitted frames have their centers of rotation."""
    seen = (_weigh_pose(model, voxels, pose, settings) for voxels, pose in frames)
    stiffness = settings.foreseen * _FORESEEN
    moved = move_centers(seen, model.left, model.stature, stiffness, settings.centers)

    def rides(blobs: Blobs) -> Blobs:
        return replace(blobs, offset=blobs.offset - moved[blobs.bone])

    return replace(
        model, origin=model.origin + moved, blobs=rides(model.blobs), cloth=rides(model.cloth)
    )


def _weigh_pose(model: FitModel, voxels: Voxels, pose: Pose, settings: FitSettings) -> Evidence:
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


def miss(model: FitModel, pose: Pose, targets: Sequence[Target]) -> Floats:
    """Return (target,) how far points of the body are from where they were seen, m."""
    joints = place_bones(pose, model.origin)
    away = [joints[t.bone] + pose.rotation[t.bone] @ t.offset - t.place for t in targets]
    return np.array([np.linalg.norm(each) for each in away], np.float64)


def worth(model: FitModel, fit: Fit, targets: Sequence[Target]) -> float:
    """Return how well a fit explains voxels and places seen; larger is better."""
    missed = 0.0
    for target, away in zip(targets, miss(model, fit.pose, targets), strict=True):
        far = away / target.scale_m
        missed += 0.5 * target.weight * target.scale_m**2 * np.log1p(far**2)
    return fit.likelihood - missed
