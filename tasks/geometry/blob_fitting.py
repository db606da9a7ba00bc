"""Fit the pose of a body of blobs to the voxels of one frame.

Expectation (`blobs.share_out`) and one step of least squares over all bones
(`articulated.add_points`) by turns, with the blobs wider at first. A blob pulls with at most a
multiple of its own volume, so that cloth around it does not pull more than the body; sleeves and
skirts have blobs of their own, which hang from the body and do not pull.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

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
    carry,
    move,
    place_bones,
)
from tasks.geometry.blobs import Blobs, make_blobs, place_blobs, share_out
from tasks.geometry.joint_centers import CenterSettings, Evidence, move_centers

_B = {name: k for k, name in enumerate(BONES)}


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
# bones carry on, and the spine bends less than limbs turn.
_FORESEEN = np.array([0.5, 2, 4, 1, 0.7, 1, 0.7, 1, 0.7, 1, 0.7, 1, 1, 1, 1])
_REST = np.array([3, 12, 20, 0.2, 0.4, 0.2, 0.4, 0.6, 0.4, 0.6, 0.4, 3, 3, 6, 6])
_BLOBS = np.array([3, 8, 5, 3, 3, 3, 3, 4, 4, 4, 4, 2, 2, 2, 2])  # by size and bending
_THICKNESS = np.array(  # statures: what is farther from a bone's line is cloth
    [0.1, 0.2, 0.2, 0.05, 0.045, 0.05, 0.045, 0.085, 0.06, 0.085, 0.06, 0.045, 0.045, 0.2, 0.2]
)
_CARRIER = {  # what carries the cloth around a bone: sleeves hang from arms, skirts from the waist
    _B[side + part]: _B["Waist" if "Leg" in part else side + part]
    for side in "RL"
    for part in ("UpperArm", "ForeArm", "Hand", "UpperLeg", "LowerLeg")
}
_CLOTHS = np.full(len(BONES), 3)  # blobs of what hangs from a bone
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

    cloth: Blobs
    """What hangs from the arms: blobs that are carried by a point of a bone, and do not turn."""

    hang: Floats
    """(cloth blob, 3) from that point to the blob's middle, m."""

    left: Floats
    """(3,) to the performer's left in the initial pose, horizontally."""

    limits: Floats
    """(limit, 9) as `articulated.add_priors` takes them, information 1."""

    stature: float
    """Height of the initial pose, m."""

    @cached_property
    def kind(self) -> NDArray[np.int64]:
        """(blob + cloth blob,) which column of `Sample.likeness` is each one's."""
        return np.concatenate([self.blobs.bone, np.full(len(self.cloth.bone), len(BONES))])

    @cached_property
    def reach(self) -> Floats:
        """(blob + cloth blob,) square of the distance, m**2, beyond which each weighs nothing."""
        return np.concatenate([self.blobs.reach, self.cloth.reach])

    @cached_property
    def weight(self) -> Floats:
        """(blob + cloth blob,) density of each one's middle, over the median of the body's."""
        own = self.blobs.density
        return np.concatenate([own, self.cloth.density]) / float(np.median(own))


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


@dataclass(frozen=True, eq=False)
class Sample:
    """Some of a frame's voxels."""

    points: Floats
    """(voxel, 3) centers, m."""

    likeness: NDArray[np.float32]
    """(voxel, bone + 1) how much likelier the voxel's color is on a bone than anywhere; 1 where
    it is not known, and for what is not the body's (the last)."""


def fit_frame(
    model: FitModel,
    sample: Sample,
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
    sample
        Of the frame's voxels.
    start, ahead
        Where the fit begins, and the pose foreseen.
    targets
        Points of the body seen elsewhere.
    """
    blobs, pose = model.blobs, start
    stiffness = np.stack([settings.foreseen * _FORESEEN, settings.rest * _REST], 1)
    limits = model.limits * np.array([1, settings.limit, 1, 1, 1, 1, 1, 1, 1.0])
    turns = settings.steps if steps is None else steps
    wide = settings.widening if widening is None else widening
    anneal = max(1.0, 0.6 * turns)
    for turn in range(turns):
        f = wide + (1 - wide) * min(1.0, turn / anneal)
        seen, _, _ = weigh_blobs(model, sample, pose, settings, f)
        joints = seen.joints
        system = np.zeros((UNKNOWNS, UNKNOWNS + 1))
        add_points(blobs.bone, seen.mean, seen.information, seen.residual, joints, system)
        _add_targets(targets, pose, joints, system)
        add_priors(pose.rotation, ahead.rotation, stiffness, limits, system[:, :-1], system[:, -1])
        system[:3, :3] += np.eye(3) * _ROOT_STAYS
        system[:3, -1] += _ROOT_STAYS * (ahead.root - pose.root)
        pose = _step(pose, system, settings.largest_turn)
    last = wide + (1 - wide) * min(1.0, turns / anneal)
    _, likelihood, mass = weigh_blobs(model, sample, pose, settings, last)
    held = np.bincount(blobs.bone, np.minimum(mass, blobs.share), len(BONES))
    whole = np.bincount(blobs.bone, blobs.share, len(BONES))
    return Fit(pose, likelihood - np.log(settings.nobody), held / np.maximum(whole, 1e-9))


def weigh_blobs(
    model: FitModel, sample: Sample, pose: Pose, settings: FitSettings, widening: float = 1.0
) -> tuple[Evidence, float, Floats]:
    """Share a frame's voxels out in a pose.

    Returns
    -------
    Evidence
        Where the blobs' voxels are.
    float
        Mean log likelihood of a voxel.
    (blob,) float64
        Share of the voxels that each blob has.
    """
    blobs, cloth = model.blobs, model.cloth
    own = len(blobs.bone)
    joints = place_bones(pose, model.origin)
    mean, whitening = place_blobs(blobs, joints, pose.rotation)
    hung = carry(pose, joints, cloth.bone, cloth.offset) + model.hang
    sums = np.empty((own + len(hung), 4))
    likelihood = share_out(
        sample.points,
        (sample.likeness, model.kind),
        (np.concatenate([mean, hung]), np.concatenate([whitening, cloth.whitening]) / widening),
        (model.reach * widening**2, model.weight / widening**3),
        settings.nobody,
        sums,
    )
    mass = sums[:own, 0] / max(len(sample.points), 1)
    pull = np.minimum(mass, settings.most_mass * blobs.share)
    pull[mass < 1e-5] = 0
    information = np.einsum("b,bji,bjk->bik", pull, whitening, whitening)
    middle = sums[:own, 1:] / np.maximum(sums[:own, :1], 1e-9)
    seen = Evidence(blobs.bone, mean, information, middle - mean, joints, pose.rotation)
    return seen, likelihood, mass


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
    kept, hangs = bone.copy(), np.full_like(bone, -1)
    for k in range(len(BONES)):
        end = joints[_END[k]]
        mine = np.flatnonzero(bone == k)
        nearest = _nearest(points[mine], origin[k], end)
        away = points[mine] - nearest
        far = np.linalg.norm(away, axis=1) > _THICKNESS[k] * stature
        kept[mine[far]] = -1
        if k in _CARRIER:
            hangs[mine[far & ((away[:, 1] < 0) | (_CARRIER[k] != k))]] = _CARRIER[k]
    soft = 0.005 * stature
    blobs = make_blobs(points, kept, origin, _BLOBS, softness_m=soft)
    cloth, hang = _hang_cloth(points, hangs, (origin, joints), soft, int((kept >= 0).sum()))
    left = np.cross((0.0, 1.0, 0.0), forward)
    return FitModel(origin, blobs, cloth, hang, left, _limits(forward, left, joints), stature)


def _hang_cloth(
    points: Floats, bone: NDArray[np.integer], body: tuple[Floats, dict[str, Floats]],
    softness_m: float, voxels: int,
) -> tuple[Blobs, Floats]:  # fmt: skip
    """Return blobs of what hangs from bones, and (blob, 3) how far below their point of the bone.

    Seen from above they are round: how cloth turns with an arm is not known.
    """
    origin, joints = body
    found = make_blobs(points, bone, origin, _CLOTHS, softness_m=softness_m)
    carried = np.empty_like(found.offset)
    round_ = np.empty_like(found.whitening)
    for b, k in enumerate(found.bone):
        middle = origin[k] + found.offset[b]
        carried[b] = _nearest(middle[None], origin[k], joints[_END[k]])[0] - origin[k]
        spread = np.linalg.inv(found.whitening[b].T @ found.whitening[b])
        level = float(np.sqrt(spread[0, 0] * spread[2, 2]))
        round_[b] = np.diag([level, spread[1, 1], level])
        round_[b] = np.linalg.cholesky(np.linalg.inv(round_[b])).T
    share = found.share * (bone >= 0).sum() / max(voxels, 1)
    return Blobs(found.bone, carried, round_, share), found.offset - carried


def _nearest(points: Floats, a: Floats, b: Floats) -> Floats:
    """Return (point, 3) the points from a to b that are nearest to points."""
    along = b - a
    t = np.clip((points - a) @ along / (along @ along), 0, 1)
    return a + t[:, None] * along


def _limits(forward: Floats, left: Floats, joints: dict[str, Floats]) -> Floats:
    """Return what joints do not do, each row as `articulated.add_priors` takes it.

    Knees bend backwards and hardly sideways; elbows do not fold flat; the head looks over a
    shoulder at most; hips turn against shoulders by 60 degrees; thighs, shins and feet about their
    own length by 80, 60 and 53; a hand bends by 80.
    """
    rows = [
        [_B["Head"], 1, *forward, *-forward, -0.17],
        [_B["Waist"], 1, *left, *-left, -0.5],
    ]
    for side in "RL":
        shin = joints[side + "Ankle"] - joints[side + "Knee"]
        shin = shin / np.linalg.norm(shin)
        for axis, most in ((forward, 0.1), (left, 0.2), (-left, 0.2)):
            rows.append([_B[side + "LowerLeg"], 1, *shin, *axis, most])
        for part, cosine in (("UpperLeg", 0.17), ("LowerLeg", 0.5), ("Foot", 0.6)):
            rows.append([_B[side + part], 1, *left, *-left, -cosine])
        arm = joints[side + "Wrist"] - joints[side + "Elbow"]
        arm = arm / np.linalg.norm(arm)
        rows.append([_B[side + "ForeArm"], 1, *arm, *-arm, 0.9])
        shank = joints[side + "Fin"] - joints[side + "Wrist"]
        shank = shank / np.linalg.norm(shank)
        rows.append([_B[side + "Hand"], 1, *shank, *-shank, -0.17])
    return np.array(rows)


def settle_joints(
    model: FitModel, samples: Iterable[tuple[Sample, Pose]], settings: FitSettings
) -> FitModel:
    """Return the body with its joints where fitted frames have their centers of rotation."""
    frames = (weigh_blobs(model, sample, pose, settings)[0] for sample, pose in samples)
    stiffness = settings.foreseen * _FORESEEN
    moved = move_centers(frames, model.left, model.stature, stiffness, settings.centers)

    def rides(blobs: Blobs) -> Blobs:
        return replace(blobs, offset=blobs.offset - moved[blobs.bone])

    return replace(
        model, origin=model.origin + moved, blobs=rides(model.blobs), cloth=rides(model.cloth)
    )


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
