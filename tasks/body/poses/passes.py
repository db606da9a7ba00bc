"""Passes over a take: frames followed one after the other, and what each pass says made one.

A limb that lost its voxels is looked for where its hand or foot was seen; each limb is taken,
frame by frame, from the pass that explains more; and frames are fitted again near what their
neighbors say.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, Floats, Pose, blend, extrapolate
from tasks.body.blobs.blobs import Voxels, gather_voxels
from tasks.body.blobs.fitting import (
    Fit,
    FitSettings,
    Target,
    fit_frame,
    miss,
    settle_joints,
    worth,
)
from tasks.body.blobs.model import FitModel, middles
from tasks.body.blobs.samples import Drawn
from tasks.body.poses.limbs import LIMBS, Limb, choose_fits, reach_for
from tasks.engine.threads import side_by_side
from tasks.geometry.voxels import VoxelGrid, voxel_centers

_CUE_BONES = tuple(BONES.index(name) for name in ("Head", "RHand", "LHand", "RFoot", "LFoot"))


@dataclass(frozen=True)
class PoseSettings:
    """Everything that changes a fitted pose; lengths are in statures."""

    fit: FitSettings = field(default_factory=FitSettings)

    sample: int = 2000
    """Voxels of a frame that are looked at: 3500 change the mean error by less than 1 mm on six
    captures of seven, and take 30 % longer."""

    most_likeness: float = 5.0
    """A color that was seen on one bone only speaks for it by at most this factor."""

    keep_moving: float = 0.7
    """Share of the last motion of a joint that is expected to go on, at 30 frames a second."""

    hand_pull: float = 60.0
    """Information of a hand seen surely, per m**2 at a stature of 1.7 m."""

    face_pull: float = 20.0
    """The same of the face."""

    foot_pull: float = 8.0
    """The same of a foot: little, for voxels place a foot that they have better."""

    pull_within: float = 0.15
    """Distance from which the pull of a place seen weakens."""

    lost_support: float = 0.45
    """A limb that holds a smaller share of its voxels is looked for."""

    lost_distance: float = 0.09
    """A hand so far from where it was seen is looked for."""

    free_end: float = 0.1
    """An end of the hull so far from all that was fitted is free: a hand may be there."""

    hand_missing: float = 0.1
    """A hand at a free end that explains the voxels of a frame better by so much, in the mean
    logarithm of their likelihoods, is there: 0.13 to 0.24 more where an arm had gone astray, and
    in single frames under a kimono."""

    hand_missing_s: float = 0.1
    """For so long, at least."""

    side_apart: float = 0.09
    """Hands, or feet, that are nearer may be one: a hand's length."""

    side_least_s: float = 0.1
    """For so long, at least, two are apart that are looked at whether they are exchanged."""

    side_frames: int = 6
    """In so many frames of each such time at least, and in one a second."""

    side_margin: float = 0.01
    """A pair may be exchanged where that explains the voxels worse by less than this, in the mean
    logarithm of their likelihoods: by 0.016 or more where it was not, of eighteen captures."""

    swivels: int = 4
    """Places of the elbow that are tried when an arm is looked for."""

    change_step: float = 0.05
    """A leap so long, in changing between the fits forwards and backwards, costs as much as a
    frame in which a limb has no support."""

    unexplained: float = 0.03
    """A fit that explains the voxels of a frame worse by so much, in the mean logarithm of their
    likelihoods, costs 1."""

    alike: float = 0.02
    """Fits of a limb that are nearer than this to each other are taken for one."""

    joint_rounds: int = 6
    """How often joints and the poses that they are told by are found in turn."""

    joint_frames: int = 40
    """Frames that tell the joints, evenly from the take."""

    settle_rounds: int = 3
    """How often all frames are fitted again, near their neighbors, with the joints found."""

    smoothing: float = 0.5
    """How much the two neighbors of a frame weigh together against the frame itself."""

    doubtful_support: float = 0.35
    """A frame in which a limb has less support, in the median of its bones, is doubtful."""


@dataclass(frozen=True, eq=False)
class Fitting:
    """What a take is fitted with: its frames' voxels, the body, where its ends were seen."""

    grid: VoxelGrid
    rate_hz: float
    model: FitModel
    settings: PoseSettings
    cues: Floats | None
    cue_weights: Floats | None
    placed: Floats | None
    """(5, 3) of the cues in the initial frame, m."""

    samples: list[Drawn]
    looks: NDArray[np.float32]

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self.samples)

    def part(self, first: int, last: int) -> "Fitting":
        """Return the frames from `first` to before `last` as a take."""
        tables = {"cues": self.cues, "cue_weights": self.cue_weights}
        cut = {name: table[first:last] for name, table in tables.items() if table is not None}
        return replace(self, samples=self.samples[first:last], **cut)

    def sample(self, frame: int) -> Voxels:
        """Return an even sample of a frame's voxels, with what their colors say."""
        index, cell = self.samples[frame]
        return gather_voxels(voxel_centers(self.grid, index), cell, self.looks)

    def targets(self, frame: int) -> list[Target]:
        """Return where face and hands were seen."""
        found: list[Target] = []
        if self.cues is None or self.placed is None:
            return found
        pulls = self.settings
        pull = (pulls.face_pull, *[pulls.hand_pull] * 2, *[pulls.foot_pull] * 2)
        scale = 1.7 / self.model.stature
        for i, k in enumerate(_CUE_BONES):
            offset = self.placed[i] - self.model.origin[k]
            place = self.cues[frame, i]
            sure = 1.0 if self.cue_weights is None else self.cue_weights[frame, i]
            if np.isfinite(offset).all() and np.isfinite(place).all() and sure > 0:
                within = self.settings.pull_within * self.model.stature
                found.append(Target(k, offset, place, pull[i] * sure * scale**2, within))
        return found


def follow(take: Fitting, frames: Sequence[int], start: Pose) -> list[Fit]:
    """Return the fits of frames, each foreseen from the two before it."""
    settings = take.settings
    share = settings.keep_moving ** (30.0 / take.rate_hz)
    fits: list[Fit] = []
    rested = 0
    for frame in frames:
        ahead = start if not fits else fits[-1].pose
        if len(fits) > 1:
            ahead = extrapolate(fits[-2].pose, fits[-1].pose, share, share)
        sample, targets = take.sample(frame), take.targets(frame)
        if not sample.count:
            fits.append(Fit(ahead, 0.0, np.zeros(len(BONES))))
            continue
        fit = fit_frame(take.model, sample, ahead, ahead, targets, settings=settings.fit)
        rested -= 1
        if rested <= 0:
            better = _find_again(take, fit, sample, targets)
            rested = 0 if better is fit else 3
            fit = better
        fits.append(fit)
    return fits


def _find_again(take: Fitting, fit: Fit, sample: Voxels, targets: Sequence[Target]) -> Fit:
    """Return the fit, or a better one in which a lost limb is elsewhere."""
    settings, model = take.settings, take.model
    for limb in LIMBS:
        target = next((t for t in targets if t.bone == limb.end), None)
        if target is None:
            continue
        [away] = miss(model, fit.pose, [target])
        held = fit.support[limb.bones].min()
        if away < settings.lost_distance * model.stature and held > settings.lost_support:
            continue
        best = fit
        for pose in reach_for(
            fit.pose, model.origin, limb, target.offset, target.place, settings.swivels
        ):
            other = fit_frame(
                model, sample, pose, pose, targets, settings=settings.fit, steps=4, widening=1.2
            )
            if worth(model, other, targets) > worth(model, best, targets):
                best = other
        fit = best
    return fit


def reach_best(
    take: Fitting, sample: Voxels, pose: Pose, limb: Limb, offset: Floats, place: Floats
) -> Fit:
    """Return the likeliest fit of a frame that begins with a limb's end at a place, m.

    `offset` is the point of the end bone that comes there, as of `reach_for`.
    """
    model, settings = take.model, take.settings
    ways = reach_for(pose, model.origin, limb, offset, place, settings.swivels)
    fits = [
        fit_frame(model, sample, way, way, settings=settings.fit, steps=3, widening=1.2)
        for way in ways
    ]
    return max(fits, key=lambda fit: fit.likelihood)


def merge(take: Fitting, first: Sequence[Fit], again: Sequence[Fit]) -> list[Pose]:
    """Return poses whose trunk, head and limbs are each from the fit that explains more."""
    model, settings = take.model, take.settings
    both = (first, again)
    limbs = [limb.bones for limb in LIMBS]
    trunk = [k for k in range(len(BONES)) if all(k not in bones for bones in limbs)]
    at = [np.stack([middles(model, fit.pose) for fit in fits]) for fits in both]
    step = settings.change_step * model.stature

    def choose(bones: list[int], explained: Floats) -> NDArray[np.int64]:
        cost = (explained.max(0) - explained) / settings.unexplained
        return choose_fits(cost, [a[:, bones] for a in at], step)

    targets = [take.targets(t) for t in range(len(first))]
    worths = [[worth(model, *each) for each in zip(fits, targets, strict=True)] for fits in both]
    chosen = choose(trunk, np.array(worths))
    merged = [both[chosen[t]][t].pose for t in range(len(first))]
    for bones in limbs:
        explained = _explain_limb(take, merged, both, bones, [a[:, bones] for a in at])
        chosen = choose(bones, explained)
        merged = [_with_limb(pose, both[chosen[t]][t].pose, bones) for t, pose in enumerate(merged)]
    return merged


def _explain_limb(
    take: Fitting, poses: Sequence[Pose], both: Sequence[Sequence[Fit]], bones: list[int],
    at: Sequence[Floats],
) -> Floats:  # fmt: skip
    """Return (fit, time) how well poses explain their frames with a limb as either fit has it.

    `at`: (time, bone, 3) where either has the limb's bones, m.
    """
    model = take.model

    def explain(t: int) -> tuple[float, float]:
        sample, targets, fit = take.sample(t), take.targets(t), take.settings.fit
        tried = [_with_limb(poses[t], fits[t].pose, bones) for fits in both]
        fits = [fit_frame(model, sample, p, p, settings=fit, steps=0, widening=1.0) for p in tried]
        return worth(model, fits[0], targets), worth(model, fits[1], targets)

    explained = np.zeros((2, len(poses)))
    apart = np.linalg.norm(at[0] - at[1], axis=2).max(axis=1)
    differ = np.flatnonzero(apart >= take.settings.alike * model.stature).tolist()
    if differ:
        explained[:, differ] = np.transpose(side_by_side(explain, differ))
    return explained


def _with_limb(pose: Pose, other: Pose, bones: list[int]) -> Pose:
    """Return a pose with the bones turned as in another."""
    rotation = pose.rotation.copy()
    rotation[bones] = other.rotation[bones]
    return Pose(pose.root, rotation)


def settle(take: Fitting, poses: Sequence[Pose]) -> list[Fit]:
    """Fit each frame once more, near what it and its neighbors say; in parallel."""
    last = len(poses) - 1
    weights = np.array([take.settings.smoothing / 2, 1.0, take.settings.smoothing / 2])

    def near(poses: Sequence[Pose], t: int) -> Pose:
        around = [poses[max(t - 1, 0)], poses[t], poses[min(t + 1, last)]]
        return blend(around, weights, poses[t])

    fits = side_by_side(lambda t: _refit(take, t, near(poses, t)), range(len(poses)))
    settled = [fit.pose for fit in fits]
    return [replace(fit, pose=near(settled, t)) for t, fit in enumerate(fits)]


def settle_centers(take: Fitting, poses: Sequence[Pose]) -> FitModel:
    """Return the body with its joints where a take's frames have their centers of rotation.

    Some frames say it: their poses and the joints are found in turn.
    """
    step = max(1, len(poses) // take.settings.joint_frames)
    frames = [t for t in range(0, len(poses), step) if len(take.samples[t][0])]
    settled = [poses[t] for t in frames]
    for earlier in range(take.settings.joint_rounds):
        if earlier:  # with the joints found so far
            pairs = list(zip(frames, settled, strict=True))
            settled = side_by_side(lambda pair, take=take: _refit(take, *pair).pose, pairs)
        seen = ((take.sample(t), pose) for t, pose in zip(frames, settled, strict=True))
        take = replace(take, model=settle_joints(take.model, seen, take.settings.fit))
    return take.model


def _refit(take: Fitting, frame: int, pose: Pose) -> Fit:
    """Return the fit of a frame near a pose that is nearly right; the pose where it is empty."""
    sample = take.sample(frame)
    if not sample.count:
        return Fit(pose, 0.0, np.zeros(len(BONES)))
    targets, settings = take.targets(frame), take.settings.fit
    return fit_frame(
        take.model, sample, pose, pose, targets, settings=settings, steps=3, widening=1.0
    )
