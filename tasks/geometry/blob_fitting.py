"""Fit the pose of a body of blobs to the voxels of one frame.

Expectation (`blobs.share_out`) and one step of least squares over all bones
(`articulated.add_points`) by turns, with the blobs wider at first. A blob pulls with at most a
multiple of its own volume, so that cloth around it does not pull more than the body.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.articulated import (
    BONES,
    PROXIMAL,
    UNKNOWNS,
    Floats,
    Pose,
    add_points,
    add_priors,
    move,
    place_bones,
)
from tasks.geometry.blobs import Blobs, make_blobs, place_blobs, share_out

_B = {name: k for k, name in enumerate(BONES)}


@dataclass(frozen=True)
class FitSettings:
    """Everything that changes the fit of one frame; information is in units of the hull."""

    steps: int = 8
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

    largest_turn: float = 0.4
    """Largest turn of a joint in a step, rad."""


# Head, body, waist, then arms and legs (upper, lower, right before left), hands and feet: heavy
# bones carry on, and the spine bends less than limbs turn.
_FORESEEN = np.array([0.5, 2, 4, 1, 0.7, 1, 0.7, 1, 0.7, 1, 0.7, 1, 1, 1, 1])
_REST = np.array([3, 12, 20, 0.2, 0.4, 0.2, 0.4, 0.6, 0.4, 0.6, 0.4, 3, 3, 6, 6])
_BLOBS = np.array([3, 8, 5, 3, 3, 3, 3, 4, 4, 4, 4, 2, 2, 2, 2])  # by size and bending
_THICKNESS = np.array(  # statures: what is farther from a bone's line is cloth
    [0.1, 0.2, 0.2, 0.05, 0.045, 0.05, 0.045, 0.085, 0.06, 0.085, 0.06, 0.045, 0.045, 0.2, 0.2]
)
_END = (
    "Head", "Waist", "Hips", "RElbow", "RWrist", "LElbow", "LWrist",
    "RKnee", "RAnkle", "LKnee", "LAnkle", "RFin", "LFin", "RFoot", "LFoot",
)  # fmt: skip
_ROOT_STAYS = 0.3  # information of the foreseen place of the root, per m**2: next to none


@dataclass(frozen=True, eq=False)
class FitModel:
    """A body of blobs in its initial pose."""

    origin: Floats
    """(bone, 3) proximal joints, m."""

    blobs: Blobs

    limits: Floats
    """(limit, 9) as `articulated.add_priors` takes them, information 1."""

    stature: float
    """Height of the initial pose, m."""


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
    points: Floats,
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
    points : (voxel, 3) float64
        Centers of a sample of the frame's voxels, m.
    start, ahead
        Where the fit begins, and the pose foreseen.
    targets
        Points of the body seen elsewhere.
    """
    blobs, pose = model.blobs, start
    density = blobs.density
    level = float(np.median(density))
    relative = density / level
    stiffness = np.stack([settings.foreseen * _FORESEEN, settings.rest * _REST], 1)
    limits = model.limits * np.array([1, settings.limit, 1, 1, 1, 1, 1, 1, 1.0])
    sums = np.empty((len(relative), 4))
    turns = settings.steps if steps is None else steps
    wide = settings.widening if widening is None else widening
    anneal = max(1.0, 0.6 * turns)
    reach = blobs.reach
    likelihood, mass = 0.0, np.zeros(len(relative))
    for turn in range(turns + 1):
        f = wide + (1 - wide) * min(1.0, turn / anneal)
        joints = place_bones(pose, model.origin)
        mean, whitening = place_blobs(blobs, joints, pose.rotation)
        factor = relative / f**3
        likelihood = share_out(
            points, (mean, whitening / f), reach * f**2, factor, settings.nobody, sums
        )
        mass = sums[:, 0] / max(len(points), 1)
        if turn == turns:
            break
        weight = np.minimum(mass, settings.most_mass * blobs.share)
        information = np.einsum("b,bji,bjk->bik", weight, whitening, whitening)
        middle = sums[:, 1:] / np.maximum(sums[:, :1], 1e-9)
        information[mass < 1e-5] = 0
        system = np.zeros((UNKNOWNS, UNKNOWNS + 1))
        add_points(blobs.bone, mean, information, middle - mean, joints, system)
        _add_targets(targets, pose, joints, system)
        add_priors(pose.rotation, ahead.rotation, stiffness, limits, system[:, :-1], system[:, -1])
        system[:3, :3] += np.eye(3) * _ROOT_STAYS
        system[:3, -1] += _ROOT_STAYS * (ahead.root - pose.root)
        pose = _step(pose, system, settings.largest_turn)
    held = np.bincount(blobs.bone, np.minimum(mass, blobs.share), len(BONES))
    whole = np.bincount(blobs.bone, blobs.share, len(BONES))
    return Fit(pose, likelihood - np.log(settings.nobody), held / np.maximum(whole, 1e-9))


def _add_targets(targets: Sequence[Target], pose: Pose, joints: Floats, system: Floats) -> None:
    if not targets:
        return
    bone = np.array([t.bone for t in targets])
    offset = np.stack([t.offset for t in targets])
    places = joints[bone] + np.einsum("pij,pj->pi", pose.rotation[bone], offset)
    residual = np.stack([t.place for t in targets]) - places
    far = np.linalg.norm(residual, axis=1) / np.array([t.scale_m for t in targets])
    weight = np.array([t.weight for t in targets]) / (1 + far**2)
    add_points(bone, places, weight[:, None, None] * np.eye(3), residual, joints, system)


def _step(pose: Pose, system: Floats, largest: float) -> Pose:
    """Solve, shorten a step that turns a joint too far, and move."""
    normal = system[:, :-1] + 1e-6 * np.eye(UNKNOWNS)
    step = np.linalg.solve(normal, system[:, -1])
    size = float(np.abs(step[3:]).max())
    step *= min(1.0, largest / max(size, 1e-9))
    rotation = np.empty_like(pose.rotation)
    move(step, pose.rotation, rotation)
    return Pose(pose.root + step[:3], rotation)


def bones_of_voxels(
    points: Floats, labels: NDArray[np.integer], ends: dict[str, Floats], forward: Floats
) -> NDArray[np.int64]:
    """Return (voxel,) the bone of each labeled voxel, -1 for unlabeled: hands and feet apart.

    `ends` are the joints by name; a hand begins at the wrist, a foot before or below the ankle.
    """
    bone = labels.astype(np.int64) - 1
    stature = ends["Head"][1] - min(ends["RFoot"][1], ends["LFoot"][1])
    for side in "RL":
        arm = ends[side + "Fin"] - ends[side + "Elbow"]
        beyond = (points - ends[side + "Wrist"]) @ arm > 0
        bone[(bone == _B[side + "ForeArm"]) & beyond] = _B[side + "Hand"]
        below = points - ends[side + "Ankle"]
        low = below[:, 1] < 0.03 * stature
        foot = (below[:, 1] < 0) | (low & (below @ forward > 0.03 * stature))
        bone[(bone == _B[side + "LowerLeg"]) & foot] = _B[side + "Foot"]
    return bone


def make_model(
    points: Floats, bone: NDArray[np.integer], joints: dict[str, Floats], forward: Floats
) -> FitModel:
    """Return the body of blobs of labeled voxels; cloth far from a bone's line is left out."""
    origin = np.stack([joints[name] for name in PROXIMAL])
    stature = float(joints["Head"][1] - min(joints["RFoot"][1], joints["LFoot"][1]))
    kept = bone.copy()
    for k in range(len(BONES)):
        end = joints[_END[k]]
        mine = np.flatnonzero(bone == k)
        away = _distance(points[mine], origin[k], end)
        kept[mine[away > _THICKNESS[k] * stature]] = -1
    blobs = make_blobs(points, kept, origin, _BLOBS, softness_m=0.005 * stature)
    left = np.cross((0.0, 1.0, 0.0), forward)
    return FitModel(origin, blobs, _limits(forward, left, joints), stature)


def _distance(points: Floats, a: Floats, b: Floats) -> Floats:
    along = b - a
    t = np.clip((points - a) @ along / (along @ along), 0, 1)
    return np.linalg.norm(points - a - t[:, None] * along, axis=1)


def _limits(forward: Floats, left: Floats, joints: dict[str, Floats]) -> Floats:
    """Knees bend backwards and hardly sideways; elbows do not fold flat."""
    rows = []
    for side in "RL":
        shin = joints[side + "Ankle"] - joints[side + "Knee"]
        shin = shin / np.linalg.norm(shin)
        for axis, most in ((forward, 0.1), (left, 0.2), (-left, 0.2)):
            rows.append([_B[side + "LowerLeg"], 1, *shin, *axis, most])
        arm = joints[side + "Wrist"] - joints[side + "Elbow"]
        arm = arm / np.linalg.norm(arm)
        rows.append([_B[side + "ForeArm"], 1, *arm, *-arm, 0.9])
        shank = joints[side + "Fin"] - joints[side + "Wrist"]
        shank = shank / np.linalg.norm(shank)
        rows.append([_B[side + "Hand"], 1, *shank, *-shank, 0.0])
    return np.array(rows)


def middles(model: FitModel, pose: Pose) -> Floats:
    """Return (bone, 3) the middle of each bone's blobs, m."""
    joints = place_bones(pose, model.origin)
    mean, _ = place_blobs(model.blobs, joints, pose.rotation)
    count = np.maximum(np.bincount(model.blobs.bone, minlength=len(BONES)), 1)
    columns = [np.bincount(model.blobs.bone, mean[:, i], len(BONES)) / count for i in range(3)]
    return np.stack(columns, 1)


def miss(model: FitModel, pose: Pose, target: Target) -> float:
    """Return how far a point of the body is from where it was seen, m."""
    joint = place_bones(pose, model.origin)[target.bone]
    at = joint + pose.rotation[target.bone] @ target.offset
    return float(np.linalg.norm(at - target.place))


def worth(model: FitModel, fit: Fit, targets: Sequence[Target]) -> float:
    """Return how well a fit explains voxels and places seen; larger is better."""
    missed = 0.0
    for target in targets:
        far = miss(model, fit.pose, target) / target.scale_m
        missed += 0.5 * target.weight * target.scale_m**2 * np.log1p(far**2)
    return fit.likelihood - missed
