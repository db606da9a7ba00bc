"""Gather what speaks against the pose of each limb, frame by frame.

Nothing is fitted again: the fit left two passes that may disagree, limbs that were tried the other
way round, hands and feet that were seen, and voxels (`voxels`). Each evidence is 0 where nothing
speaks against a limb and about 1 where much does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.body.anatomy.bones import BONES, PARENT, place_bones
from tasks.body.blobs.model import middles
from tasks.body.doubt.colors import tell_unlike
from tasks.body.doubt.voxels import VoxelReport, report_voxels
from tasks.body.extremities.candidates import Candidates
from tasks.body.poses.joint import FittedPoses
from tasks.body.poses.limbs import LIMBS
from tasks.body.poses.passes import Fitting
from tasks.engine.threads import side_by_side
from tasks.geometry.voxels import voxel_centers

Floats = NDArray[np.float64]
Evidence = dict[str, Floats]
"""By its name, (time, limb): right and left arm, right and left leg."""

ARMS, LEGS = slice(0, 2), slice(2, 4)
"""Which limbs are arms, and which are legs."""

_TIPS = tuple(JOINTS.index(side + name) for name in ("Fin", "Foot") for side in "RL")
"""The joint at the tip of each limb."""

_CLEARLY_WORSE = 0.06
"""How much less likely voxels are the other way round where the other way is believed by 1 / e
[mean logarithm of their likelihoods]. Exchanges that stood were .04 to .06 less likely, pairs that
were right .1 to .3, in rendered captures."""

_AS_LIKELY = 0.02
"""By how much one pass may be likelier than the other where both are about as likely [mean
logarithm of the likelihoods of voxels]. A third of `_CLEARLY_WORSE`; chosen."""

_SETTLED = -1.0
"""Limbs that would be so much less likely exchanged surely wear what their sides do [mean logarithm
of the likelihoods of voxels]. It is what colors tell (`poses.worn`)."""

_OF_SIDES = ("contested", "beside_other")
"""What speaks for limbs that are taken for each other, and not where colors told them apart."""

_BESIDE_OTHER = 0.08
"""Distance of elbows, or knees, at which their nearness falls to 1 / e [statures]. It is the
thickness of a thigh; chosen, not measured."""

_NEAR_TRUNK = 0.06
"""Distance from the trunk's axis at which nearness falls to 1 / e [statures]. It is half a trunk's
depth."""

_AT_HAND = 0.05
"""Skin so near the middle of a hand is the hand's; at twice that it is not [statures]. Half a
hand's length; chosen, not measured."""

_MOST_APART = 0.4
"""Farther apart is not more doubtful [statures]. An arm's length."""

_JERKING = 40.0
"""Acceleration of an elbow or knee that is 1 [statures/s**2]. Chosen: a fast dance."""

_MOST_HASTE = 3.0
"""More haste is not more doubtful [times that]. Chosen: it is a leap."""

_IN_VOXELS = 0.015
"""A point so near a voxel is among the voxels [statures]. Those looked at are some 3 cm apart."""

_MOST_OUTSIDE = 0.1
"""Farther outside is not more doubtful [statures]. Chosen, not measured."""

_CROSSED = (-0.2, 0.3)
"""How far an elbow or knee on its own side, or on the other one, makes a difference
[statures]. Chosen, not measured."""

_FORWARD_FOOT = 0.6
"""Least cosine of the angle between where a foot and the pelvis point that is not odd. It is 53
degrees; chosen, not measured."""

_STRAIGHT_FOOT = 0.5
"""A foot that is turned less from its lower leg, since the initial pose, is not odd [rad]. Chosen,
not measured."""

_USUAL_LOOK = -1.2
"""How strange the colors of a foot usually are (`VoxelReport.strangeness`). The median of rendered
captures."""


@dataclass(frozen=True, eq=False)
class _Laid:
    """The fitted body in every frame; lengths in statures."""

    joints: Floats
    """(time, bone, 3) where each bone begins."""
    middle: Floats
    """(time, bone, 3)"""
    tip: Floats
    """(time, limb, 3) finger tips and toes."""
    hips: Floats
    """(time, 3) the middle of the hips."""
    left: Floats
    """(time, 3) unit vector from the right hip to the left one."""
    forward: Floats
    """(time, 3) unit vector to where the pelvis points."""
    turn: Floats
    """(time, bone) angle by which each bone is turned in its parent's frame, rad."""


def gather_evidence(fitted: FittedPoses, candidates: Sequence[Candidates]) -> Evidence:
    """Return what speaks against each limb in each frame.

    Parameters
    ----------
    fitted
        The fitted take.
    candidates
        Where hands could be in each frame.
    """
    account, stature = fitted.account, fitted.model.stature
    laid = _lay(fitted)
    reports = _report_all(fitted, laid)
    support = np.stack([fit.support for fit in account.fits])
    found = _of_passes(fitted)
    found |= _of_sight(fitted, laid)
    found |= _of_exchange(account.exchange_gains)
    found |= _of_reports(reports)
    found |= _of_colors(reports, account.take)
    outside = found.pop("outside_m") / stature - _IN_VOXELS
    found["outside"] = 20.0 * np.clip(outside, 0.0, _MOST_OUTSIDE)
    found |= _of_anatomy(laid)
    found["without_end"] = np.clip(1.0 - support[:, [limb.end for limb in LIMBS]], 0.0, 1.0)
    found |= _of_motion(laid, account.take.rate_hz)
    found["handless"] = _handless(laid.middle, candidates, stature)
    found["odd_foot"] = np.clip(found["end_turned"] - _STRAIGHT_FOOT, 0, 2) * np.clip(
        found["strange_end"] - _USUAL_LOOK, 0, 2
    )
    settled = np.repeat(account.exchange_gains <= _SETTLED, 2, axis=1)
    for name in _OF_SIDES:
        found[name] = np.where(settled, 0.0, found[name])
    return found


def _lay(fitted: FittedPoses) -> _Laid:
    """Return the fitted body in every frame, in statures."""
    model, poses = fitted.model, fitted.poses
    size = model.stature
    joints = np.stack([place_bones(pose, model.origin) for pose in poses]) / size
    right, left = (joints[:, BONES.index(name)] for name in ("RUpperLeg", "LUpperLeg"))
    hips = (right + left) / 2.0
    to_left = _unit(left - right)
    up = _unit(joints[:, BONES.index("Body")] - hips)
    rotation = np.stack([pose.rotation for pose in poses])
    local = np.swapaxes(rotation[:, PARENT], 2, 3) @ rotation
    cosine = (np.trace(local, axis1=2, axis2=3) - 1.0) / 2.0
    return _Laid(
        joints,
        np.stack([middles(model, pose) for pose in poses]) / size,
        fitted.position[:, _TIPS] / size,
        hips,
        to_left,
        _unit(np.cross(to_left, up)),
        np.arccos(np.clip(cosine, -1.0, 1.0)),
    )


def _of_motion(laid: _Laid, rate_hz: float) -> Evidence:
    """Return how hastily elbows and knees change their motion."""
    lower = laid.joints[:, [limb.lower for limb in LIMBS]]
    accelerated = np.linalg.norm(_rate_of(_rate_of(lower, rate_hz), rate_hz), axis=2)
    return {"jerking_lower": np.minimum(accelerated / _JERKING, _MOST_HASTE)}


def _of_passes(fitted: FittedPoses) -> Evidence:
    """Return how far the passes have a limb apart, in tenths of a stature, and how likely it is."""
    model, account = fitted.model, fitted.account
    there, back = (
        np.stack([middles(model, fit.pose) for fit in fits]) / model.stature
        for fits in account.passes
    )
    apart = np.linalg.norm(there - back, axis=2)
    farthest = np.stack([apart[:, limb.bones].max(axis=1) for limb in LIMBS], axis=1)
    far = 10.0 * np.minimum(farthest, _MOST_APART)
    likelier = np.array([a.likelihood - b.likelihood for a, b in zip(*account.passes, strict=True)])
    return {"apart": far, "contested": far * np.exp(-np.abs(likelier) / _AS_LIKELY)[:, None]}


def _of_sight(fitted: FittedPoses, laid: _Laid) -> Evidence:
    """Return how far hands and feet are from where they were seen, in tenths of a stature."""
    take, ends = fitted.account.take, [limb.end for limb in LIMBS]
    if take.cues is None or take.cue_weights is None:
        return {"off_sight": np.zeros((take.frames, len(LIMBS)))}
    away = np.linalg.norm(take.cues[:, 1:] / fitted.model.stature - laid.middle[:, ends], axis=2)
    sure = np.nan_to_num(take.cue_weights[:, 1:])
    return {"off_sight": 10.0 * sure * np.nan_to_num(np.minimum(away, _MOST_APART))}


def _of_exchange(gains: Floats) -> Evidence:
    """Return how well both limbs of a pair could be exchanged, from `gains` (time, pair)."""
    gain = np.repeat(np.minimum(gains, 0.0), 2, axis=1)
    return {"exchangeable": np.nan_to_num(np.exp(gain / _CLEARLY_WORSE))}


def _of_anatomy(laid: _Laid) -> Evidence:
    """Return how little the limbs are where limbs can be."""
    neck = laid.joints[:, BONES.index("Body")]
    middle = laid.joints[:, [limb.lower for limb in LIMBS]]
    ends = laid.middle[:, [limb.end for limb in LIMBS]]
    in_trunk, end_in_trunk = (
        np.exp(-_from_line(place, laid.hips, neck) / _NEAR_TRUNK) for place in (middle, ends)
    )
    between = np.linalg.norm(middle[:, ::2] - middle[:, 1::2], axis=2)
    own_side = np.array([1.0, -1.0, 1.0, -1.0])
    aside = ((middle - laid.hips[:, None]) * laid.left[:, None]).sum(axis=2) * own_side
    ankle = laid.joints[:, [limb.end for limb in LIMBS]]
    foot = _unit(laid.tip - ankle)
    forward = (foot * laid.forward[:, None]).sum(axis=2)
    return {
        "in_trunk": in_trunk,
        "end_in_trunk": end_in_trunk,
        "beside_other": np.repeat(np.exp(-between / _BESIDE_OTHER), 2, axis=1),
        "crossed": 5.0 * np.clip(aside, *_CROSSED),
        "foot_back": np.clip(_FORWARD_FOOT - forward, 0.0, None),
        "end_turned": laid.turn[:, [limb.end for limb in LIMBS]],
    }


def _report_all(fitted: FittedPoses, laid: _Laid) -> list[VoxelReport | None]:
    """Return what the voxels of each frame say; None of a frame without voxels."""
    take, size = fitted.account.take, fitted.model.stature
    looks = np.log(take.looks[:, : len(BONES)])
    end = np.empty_like(laid.joints)
    for limb in LIMBS:
        end[:, [limb.upper, limb.lower]] = laid.joints[:, [limb.lower, limb.end]]
    end[:, BONES.index("Head")] = fitted.position[:, JOINTS.index("Head")] / size
    end[:, BONES.index("Body")] = laid.joints[:, BONES.index("Waist")]
    end[:, BONES.index("Waist")] = laid.hips
    end[:, [limb.end for limb in LIMBS]] = laid.tip
    bone = [k for limb in LIMBS for k in limb.bones]
    half = (laid.joints[:, bone] + end[:, bone]) / 2.0
    inside = np.concatenate([half, end[:, bone]], axis=1)
    begin, end = (
        np.concatenate(both, axis=1)
        for both in zip((laid.joints, end), _skirt_lines(laid.joints), strict=True)
    )

    def report(t: int) -> VoxelReport | None:
        index, cell = take.samples[t]
        if not len(index):
            return None
        points = voxel_centers(take.grid, index)
        lines = begin[t] * size, end[t] * size
        return report_voxels(
            points, cell, looks, lines, laid.middle[t] * size, inside[t] * size, size
        )

    return side_by_side(report, range(take.frames))


def _skirt_lines(joints: Floats) -> tuple[Floats, Floats]:
    """Return where lines across a skirt begin and end, (time, line, 3) each.

    They join thighs, knees, shanks and ankles: of legs that are apart a skirt is far.
    """
    right, left = (
        np.concatenate([leg[:, 1:], (leg[:, 1:] + leg[:, :-1]) / 2.0], axis=1)
        for leg in (joints[:, limb.bones] for limb in LIMBS[LEGS])
    )
    return right, left


def _of_reports(reports: Sequence[VoxelReport | None]) -> Evidence:
    """Return what the voxels leave unexplained about each limb; 0 in frames without voxels."""
    bones, limbs = len(BONES), len(LIMBS)
    none = np.zeros(bones)
    empty = VoxelReport(none, none, none, none, np.zeros(2 * 3 * limbs), np.zeros(0, np.int8))
    told = [each or empty for each in reports]

    def of(name: str) -> Floats:
        return np.stack([getattr(each, name) for each in told])

    ends, lowers = [limb.end for limb in LIMBS], [limb.lower for limb in LIMBS]
    own, strange, far = of("own"), of("strangeness"), of("far")
    usual = np.maximum(np.median(own, axis=0), 1.0)
    few = np.clip(1.0 - own / usual, 0.0, 1.0)
    return {
        "few_at_end": few[:, ends],
        "few_lower": few[:, lowers],
        "strange_end": strange[:, ends],
        "far": 20.0 * np.stack([far[:, limb.bones].sum(axis=1) for limb in LIMBS], axis=1),
        "beside_end": of("beside")[:, ends],
        "outside_m": of("outside").reshape(len(told), 2, limbs, 3).max(axis=(1, 3)),
    }


def _of_colors(reports: Sequence[VoxelReport | None], take: Fitting) -> Evidence:
    """Return how unlike the colors of limbs are to what they wear in the rest of a take."""
    bones = [np.zeros(0, np.int8) if each is None else each.bone for each in reports]
    return tell_unlike(bones, [cell for _, cell in take.samples], take.rate_hz)


def _handless(middle: Floats, candidates: Sequence[Candidates], stature_m: float) -> Floats:
    """Return (time, limb) how much skin lacks where hands are, 0 to 1; 0 of legs."""
    lack = np.zeros((len(candidates), len(LIMBS)))
    for t, found in enumerate(candidates):
        for n, limb in enumerate(LIMBS[ARMS]):
            away = np.linalg.norm(found.hand / stature_m - middle[t, limb.end], axis=1)
            near = 1.0 - np.clip(away / _AT_HAND - 1.0, 0.0, 1.0)
            lack[t, n] = 1.0 - np.clip((found.hand_skin * near).max(initial=0.0), 0.0, 1.0)
    return lack


def _rate_of(place: Floats, rate_hz: float) -> Floats:
    """Return how fast places (time, ...) change [1/s]; 0 in a take of one frame."""
    if len(place) < 2:
        return np.zeros_like(place)
    return np.gradient(place, axis=0) * rate_hz


def _from_line(point: Floats, start: Floats, end: Floats) -> Floats:
    """Return (time, point) how far points (time, point, 3) are from lines between (time, 3)."""
    line = (end - start)[:, None]
    away = point - start[:, None]
    length = np.maximum((line**2).sum(axis=2), 1e-12)
    share = np.clip((away * line).sum(axis=2) / length, 0.0, 1.0)
    return np.linalg.norm(away - share[..., None] * line, axis=2)


def _unit(vector: Floats) -> Floats:
    """Return vectors (..., 3) with length 1."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)
