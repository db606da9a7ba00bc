"""The body of blobs that is fitted: made from the labeled voxels of the initial frame.

Blobs ride on bones and take their voxels along; sleeves and skirts have blobs of their own, which
hang from the body and do not pull.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONE_NUMBER, BONES, PROXIMAL, Floats, Pose, place_bones
from tasks.body.blobs.blobs import Blobs, make_blobs, place_blobs

_BLOBS = np.array([3, 8, 5, 3, 3, 3, 3, 4, 4, 4, 4, 2, 2, 2, 2])  # by size and bending
_THICKNESS = np.array(  # statures: what is farther from a bone's line is cloth
    [0.1, 0.2, 0.2, 0.05, 0.045, 0.05, 0.045, 0.085, 0.06, 0.085, 0.06, 0.045, 0.045, 0.2, 0.2]
)
_CARRIER = {  # what carries the cloth around a bone: sleeves hang from arms, skirts from the waist
    BONE_NUMBER[side + part]: BONE_NUMBER["Waist" if "Leg" in part else side + part]
    for side in "RL"
    for part in ("UpperArm", "ForeArm", "Hand", "UpperLeg", "LowerLeg")
}
_CLOTHS = np.full(len(BONES), 3)  # blobs of what hangs from a bone
_END = (
    "Head", "Waist", "Hips", "RElbow", "RWrist", "LElbow", "LWrist",
    "RKnee", "RAnkle", "LKnee", "LAnkle", "RFin", "LFin", "RFoot", "LFoot",
)  # fmt: skip


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
        """(blob + cloth blob,) which likeness of `Voxels` is each one's."""
        return np.concatenate([self.blobs.bone, np.full(len(self.cloth.bone), len(BONES))])

    @cached_property
    def body(self) -> tuple[Any, ...]:
        """All blobs, as `blobs.place_blobs` takes them."""
        both = (self.blobs, self.cloth)
        covariance = np.concatenate([blobs.covariance for blobs in both])
        return (
            np.concatenate([blobs.bone for blobs in both]),
            np.concatenate([blobs.offset for blobs in both]),
            np.concatenate([np.zeros_like(self.blobs.offset), self.hang]),
            np.linalg.inv(covariance),
            covariance,
            len(self.blobs.bone),
        )

    @cached_property
    def middle(self) -> Floats:
        """(bone, 3) from each bone's joint to the middle of its blobs, m."""
        count = np.maximum(np.bincount(self.blobs.bone, minlength=len(BONES)), 1)
        sums = [np.bincount(self.blobs.bone, of, len(BONES)) for of in self.blobs.offset.T]
        return np.stack(sums, 1) / count[:, None]

    @cached_property
    def weight(self) -> Floats:
        """(blob + cloth blob,) density of each one's middle, over the median of the body's."""
        own = self.blobs.density
        return np.concatenate([own, self.cloth.density]) / float(np.median(own))


def middles(model: FitModel, pose: Pose) -> Floats:
    """Return (bone, 3) the middle of each bone's blobs, m."""
    joints = place_bones(pose, model.origin)
    return joints + np.einsum("bij,bj->bi", pose.rotation, model.middle)


def place_model(model: FitModel, pose: Pose) -> tuple[Floats, Floats]:
    """Return mean (blob, 3) and inverse covariance (blob, 3, 3) of the body's blobs in a pose."""
    total, own = len(model.body[0]), len(model.blobs.bone)
    placed = np.empty((total, 3)), np.empty((total, 3, 3)), np.empty((total, 3))
    joints = place_bones(pose, model.origin)
    place_blobs(model.body, joints, pose.rotation, 1.0, placed)
    return placed[0][:own], placed[1][:own]


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
    round_ = np.empty_like(found.covariance)
    for b, k in enumerate(found.bone):
        middle = origin[k] + found.offset[b]
        carried[b] = _nearest(middle[None], origin[k], joints[_END[k]])[0] - origin[k]
        spread = found.covariance[b]
        level = float(np.sqrt(spread[0, 0] * spread[2, 2]))
        round_[b] = np.diag([level, spread[1, 1], level])
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
        [BONE_NUMBER["Head"], 1, *forward, *-forward, -0.17],
        [BONE_NUMBER["Waist"], 1, *left, *-left, -0.5],
    ]
    for side in "RL":
        shin = joints[side + "Ankle"] - joints[side + "Knee"]
        shin = shin / np.linalg.norm(shin)
        for axis, most in ((forward, 0.1), (left, 0.2), (-left, 0.2)):
            rows.append([BONE_NUMBER[side + "LowerLeg"], 1, *shin, *axis, most])
        for part, cosine in (("UpperLeg", 0.17), ("LowerLeg", 0.5), ("Foot", 0.6)):
            rows.append([BONE_NUMBER[side + part], 1, *left, *-left, -cosine])
        arm = joints[side + "Wrist"] - joints[side + "Elbow"]
        arm = arm / np.linalg.norm(arm)
        rows.append([BONE_NUMBER[side + "ForeArm"], 1, *arm, *-arm, 0.9])
        shank = joints[side + "Fin"] - joints[side + "Wrist"]
        shank = shank / np.linalg.norm(shank)
        rows.append([BONE_NUMBER[side + "Hand"], 1, *shank, *-shank, -0.17])
    return np.array(rows)
