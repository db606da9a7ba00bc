"""Make the body of blobs that is fitted from the labeled voxels of the initial frame.

The blobs of a body ride on its bones and pull them to their voxels. Sleeves and skirts have blobs
of their own, which hang from the bones, take the voxels of cloth and pull nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONE_NUMBER, BONES, PROXIMAL, Floats, Pose, place_bones
from tasks.body.blobs.blobs import Blobs, make_blobs, place_blobs


def number_bones(of_part: Mapping[str, float]) -> NDArray[Any]:
    """Return (bone,) the number of each bone; right and left bones have the same."""
    return np.array([of_part[bone[1:] if bone[0] in "RL" else bone] for bone in BONES])


_BLOBS = number_bones(
    {
        "Head": 3, "Body": 8, "Waist": 5, "UpperArm": 3, "ForeArm": 3, "Hand": 2,
        "UpperLeg": 4, "LowerLeg": 4, "Foot": 2,
    }
)  # fmt: skip
"""How many blobs each bone has [blobs]. Bones that are large or bend have more. Chosen by eye on
the shared captures; not measured."""

_CLOTH_BLOBS = 3
"""How many blobs hang from a bone [blobs]. Chosen by eye on the shared captures; not measured."""

_THICKNESS = number_bones(
    {
        "Head": 0.1, "Body": 0.2, "Waist": 0.2, "UpperArm": 0.05, "ForeArm": 0.045, "Hand": 0.045,
        "UpperLeg": 0.085, "LowerLeg": 0.06, "Foot": 0.2,
    }
)  # fmt: skip
"""How far from a bone's line its voxels may be; those beyond are cloth [statures]. Chosen by eye on
the shared captures; not measured."""

_SOFTNESS = 0.005
"""Standard deviation by which every blob is widened [statures]. It is 8 mm of a dancer, less than a
voxel of 1 cm. Chosen by eye on the shared captures; not measured."""

_HEAD_TURN = 0.17
"""Least cosine of the angle between where head and body look [cosine]. It is 80 degrees: the head
looks over a shoulder at most. Chosen by eye on the shared captures; not measured."""

_WAIST_TURN = 0.5
"""Least cosine of the angle between the line of the hips and that of the shoulders [cosine]. It is
60 degrees. Chosen by eye on the shared captures; not measured."""

_KNEE_FORWARD = 0.1
"""Largest sine of a lower leg's angle forwards from the line of the thigh [sine]. It is 6
degrees: a knee bends backwards. Chosen by eye on the shared captures; not measured."""

_KNEE_ASIDE = 0.2
"""Largest sine of a lower leg's angle to a side from the line of the thigh [sine]. It is 12
degrees: a knee hardly bends sideways. Chosen by eye on the shared captures; not measured."""

_LEG_TURNS = {"UpperLeg": 0.17, "LowerLeg": 0.5, "Foot": 0.6}
"""Least cosine of the angle by which a bone of a leg turns about its own length, or to a side
[cosine]. The angles are 80, 60 and 53 degrees. Chosen by eye on the shared captures; not
measured."""

_FOOT_UP = 0.5
"""Largest sine of the angle by which a foot bends up from standing [sine]. It is 30 degrees: feet
stood up along the shin under the skirt of a rendered take of lunges."""

_ELBOW_BEND = -0.9
"""Least cosine of the angle by which an elbow bends [cosine]. It is 154 degrees: an elbow does not
fold flat. Chosen by eye on the shared captures; not measured."""

_HAND_BEND = 0.17
"""Least cosine of the angle by which a hand bends from the line of the forearm [cosine]. It is 80
degrees. Chosen by eye on the shared captures; not measured."""

_CARRIER = {
    BONE_NUMBER[side + part]: BONE_NUMBER["Waist" if "Leg" in part else side + part]
    for side in "RL"
    for part in ("UpperArm", "ForeArm", "Hand", "UpperLeg", "LowerLeg")
}
"""What carries the cloth around a bone: sleeves hang from arms, skirts from the waist."""

_END = (
    "Head", "Waist", "Hips", "RElbow", "RWrist", "LElbow", "LWrist",
    "RKnee", "RAnkle", "LKnee", "LAnkle", "RFin", "LFin", "RFoot", "LFoot",
)  # fmt: skip
"""(bone,) the joint that each bone's line ends at."""


@dataclass(frozen=True, eq=False)
class FitModel:
    """A body of blobs in its initial pose."""

    origin: Floats
    """(bone, 3) proximal joints, m."""

    blobs: Blobs
    """The blobs of the body, which ride on bones."""

    cloth: Blobs
    """The blobs of cloth: each hangs from a point of a bone and does not turn with the bone."""

    hang: Floats
    """(cloth blob, 3) from the point of the bone to the blob's middle, m."""

    left: Floats
    """(3,) unit vector to the performer's left in the initial pose, horizontal."""

    limits: Floats
    """(limit, 9) what joints do not do, as `least_squares.add_priors` takes it; information 1."""

    stature: float
    """Height of the initial pose, m."""

    @cached_property
    def kind(self) -> NDArray[np.int64]:
        """(blob + cloth blob,) which likeness of `Voxels` counts for each blob."""
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
        """(blob + cloth blob,) density in each blob's middle, over the median of the body's."""
        own = self.blobs.density
        return np.concatenate([own, self.cloth.density]) / float(np.median(own))


def middles(model: FitModel, pose: Pose) -> Floats:
    """Return (bone, 3) the middle of each bone's blobs, m."""
    joints = place_bones(pose, model.origin)
    return joints + np.einsum("bij,bj->bi", pose.rotation, model.middle)


def place_model(model: FitModel, pose: Pose) -> tuple[Floats, Floats]:
    """Return the means (blob, 3) and inverse covariances (blob, 3, 3) of the body in a pose."""
    total, own = len(model.body[0]), len(model.blobs.bone)
    placed = np.empty((total, 3)), np.empty((total, 3, 3)), np.empty((total, 3))
    joints = place_bones(pose, model.origin)
    place_blobs(model.body, joints, pose.rotation, 1.0, placed)
    return placed[0][:own], placed[1][:own]


def make_model(
    points: Floats, bone: NDArray[np.integer], joints: dict[str, Floats], forward: Floats
) -> FitModel:
    """Return the body of blobs that labeled voxels make.

    Parameters
    ----------
    points : (voxel, 3) float64
        Centers in the initial frame, m.
    bone : (voxel,) int
        The bone of each, -1 for none.
    joints
        Places of the joints by name, m, `Hips` among them.
    forward : (3,) float64
        Unit vector to where the performer looks, horizontal.
    """
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
    soft = _SOFTNESS * stature
    blobs = make_blobs(points, kept, origin, _BLOBS, softness_m=soft)
    cloth, hang = _hang_cloth(points, hangs, (origin, joints), soft, int((kept >= 0).sum()))
    left = np.cross((0.0, 1.0, 0.0), forward)
    return FitModel(origin, blobs, cloth, hang, left, _limits(forward, left, joints), stature)


def _hang_cloth(
    points: Floats, bone: NDArray[np.integer], body: tuple[Floats, dict[str, Floats]],
    softness_m: float, voxels: int,
) -> tuple[Blobs, Floats]:  # fmt: skip
    """Return the blobs of cloth, and (blob, 3) from the point that each hangs from to its middle.

    The blobs are round seen from above, for nobody knows how cloth turns with an arm.
    """
    origin, joints = body
    number = np.full(len(BONES), _CLOTH_BLOBS)
    found = make_blobs(points, bone, origin, number, softness_m=softness_m)
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
    """Return (point, 3) the point between a and b that is nearest to each point."""
    along = b - a
    t = np.clip((points - a) @ along / (along @ along), 0, 1)
    return a + t[:, None] * along


def _limits(forward: Floats, left: Floats, joints: dict[str, Floats]) -> Floats:
    """Return (limit, 9) what joints do not do, as `least_squares.add_priors` takes it."""
    rows = [
        _keep_near("Head", forward, _HEAD_TURN),
        _keep_near("Waist", left, _WAIST_TURN),
    ]
    for side in "RL":
        shin = _direction(joints, side + "Knee", side + "Ankle")
        for axis, most in ((forward, _KNEE_FORWARD), (left, _KNEE_ASIDE), (-left, _KNEE_ASIDE)):
            rows.append([BONE_NUMBER[side + "LowerLeg"], 1, *shin, *axis, most])
        for part, cosine in _LEG_TURNS.items():
            rows.append(_keep_near(side + part, left, cosine))
        toes = (joints[side + "Foot"] - joints[side + "Ankle"]) * (1.0, 0.0, 1.0)
        toes /= np.linalg.norm(toes)
        rows.append([BONE_NUMBER[side + "Foot"], 1, *toes, *-shin, _FOOT_UP])
        forearm = _direction(joints, side + "Elbow", side + "Wrist")
        rows.append(_keep_near(side + "ForeArm", forearm, _ELBOW_BEND))
        hand = _direction(joints, side + "Wrist", side + "Fin")
        rows.append(_keep_near(side + "Hand", hand, _HAND_BEND))
    return np.array(rows)


def _keep_near(bone: str, axis: Floats, cosine: float) -> list[float]:
    """Return the limit that an axis of a bone turns by no angle of a smaller cosine."""
    return [BONE_NUMBER[bone], 1, *axis, *-axis, -cosine]


def _direction(joints: dict[str, Floats], first: str, second: str) -> Floats:
    """Return (3,) the unit vector from a joint to another."""
    along = joints[second] - joints[first]
    return along / np.linalg.norm(along)
