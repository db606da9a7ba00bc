"""Fit the frames of a take in passes, and make one pose a frame of what the passes found.

A pass follows the body from frame to frame, looks for a limb that lost its voxels where its hand or
foot was seen, and turns a trunk that did not turn with the performer. Two passes are merged: each
limb is taken, frame by frame, from the pass that explains the frame better. At last every frame is
fitted again near the poses of its neighbors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES, Floats, Pose, blend, extrapolate, place_bones, turn
from tasks.body.blobs.blobs import Voxels, gather_voxels
from tasks.body.blobs.fitting import (
    Fit,
    Target,
    fit_frame,
    penalized_likelihood,
    settle_joints,
    target_distances,
)
from tasks.body.blobs.model import FitModel, middles
from tasks.body.blobs.samples import Drawn
from tasks.body.poses.limbs import LIMBS, Limb, choose_fits, reach_for
from tasks.body.poses.settings import JointMethodSettings
from tasks.engine.progress import report, within
from tasks.engine.threads import side_by_side
from tasks.geometry.voxels import VoxelGrid, voxel_centers

_CUE_BONES = tuple(BONES.index(name) for name in ("Head", "RHand", "LHand", "RFoot", "LFoot"))
"""The bones that cues tell of, in the order of the cues."""

_STATURE_OF_PULLS_M = 1.7
"""The stature that the pulls of the settings are for. They were chosen on dancers of about this
size, and are scaled to that of the performer."""

_RATE_OF_MOTION_HZ = 30.0
"""The rate that `JointMethodSettings.keep_moving` is for. The shared captures have it."""

_FRAMES_WITHOUT_SEARCH = 3
"""How long lost limbs are not looked for after one was found elsewhere [frames]. The fit comes to
rest meanwhile. Chosen by eye on the shared captures; not measured."""

_CROSSED = np.pi / 2
"""A trunk that faces farther away from where hands, and feet, say is tried as they say [rad]. Arms
and legs are crossed there. In thirteen rendered captures one trunk of 116 was better so, and it
was the one that faced backwards."""

_LOST_STEPS = 4
"""Turns of the fit that begins with a lost limb elsewhere [turns]. Chosen by eye on the shared
captures; not measured."""

_REACH_STEPS = 3
"""Turns of the fit that begins with a limb's end at a given place [turns]. Chosen by eye on the
shared captures; not measured."""

_REFIT_STEPS = 3
"""Turns of the fit that begins with a pose that is nearly right [turns]. Chosen by eye on the
shared captures; not measured."""

_REACH_WIDENING = 1.2
"""Factor of the blobs' size at first, in a fit that begins with a limb elsewhere [factor]. Chosen
by eye on the shared captures; not measured."""


@dataclass(frozen=True, eq=False)
class Fitting:
    """What a take is fitted with: its voxels, the body, and where extremities were seen."""

    grid: VoxelGrid
    rate_hz: float
    model: FitModel
    settings: JointMethodSettings
    cues: Floats | None
    """(time, 5, 3) where face, hands and feet were seen, m; NaN where they were not."""

    cue_weights: Floats | None
    """(time, 5) how sure that is, 0 to 1."""

    placed: Floats | None
    """(5, 3) the cues of the initial frame, m."""

    samples: list[Drawn]
    """The voxels of each frame that are looked at."""

    looks: NDArray[np.float32]
    """(cell, kind) how many times likelier a color is on a kind of blob than anywhere."""

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return len(self.samples)

    def part(self, first: int, last: int) -> "Fitting":
        """Return the frames from `first` to before `last` as a take of their own."""
        tables = {"cues": self.cues, "cue_weights": self.cue_weights}
        cut = {name: table[first:last] for name, table in tables.items() if table is not None}
        return replace(self, samples=self.samples[first:last], **cut)

    def sample(self, frame: int) -> Voxels:
        """Return an even sample of a frame's voxels, with what their colors say of bones."""
        index, cell = self.samples[frame]
        return gather_voxels(voxel_centers(self.grid, index), cell, self.looks)

    def targets(self, frame: int) -> list[Target]:
        """Return where face, hands and feet were seen in a frame."""
        if self.cues is None or self.placed is None:
            return []
        known, offset, weight = self._pulls
        within, cues = self.settings.pull_within * self.model.stature, self.cues[frame]
        return [
            Target(_CUE_BONES[i], offset[i], cues[i], weight[frame, i], within)
            for i in np.flatnonzero(known[frame]).tolist()
        ]

    @cached_property
    def _pulls(self) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Which cues are known (time, 5), what is seen there (5, 3) and how it pulls (time, 5).

        For all frames at once: each is asked for ten times.
        """
        assert self.cues is not None
        assert self.placed is not None
        pulls = self.settings
        pull = np.array([pulls.face_pull, *[pulls.hand_pull] * 2, *[pulls.foot_pull] * 2])
        scale = _STATURE_OF_PULLS_M / self.model.stature
        offset = self.placed - self.model.origin[list(_CUE_BONES)]
        sure = np.ones(self.cues.shape[:2]) if self.cue_weights is None else self.cue_weights
        known = np.isfinite(offset + self.cues).all(axis=2) & (sure > 0)
        return known, offset, pull * sure * scale**2


def follow(take: Fitting, frames: Sequence[int], start: Pose) -> list[Fit]:
    """Return the fits of consecutive frames; each pose is foreseen from the two before it."""
    settings = take.settings
    share = settings.keep_moving ** (_RATE_OF_MOTION_HZ / take.rate_hz)
    fits: list[Fit] = []
    wait = 0
    for done, frame in enumerate(frames):
        report(done, len(frames))
        ahead = start if not fits else fits[-1].pose
        if len(fits) > 1:
            ahead = extrapolate(fits[-2].pose, fits[-1].pose, share, share)
        sample, targets = take.sample(frame), take.targets(frame)
        if not sample.count:
            fits.append(Fit(ahead, 0.0, np.zeros(len(BONES))))
            continue
        fit = fit_frame(take.model, sample, ahead, ahead, targets, settings=settings.fit)
        wait -= 1
        if wait <= 0:
            better = _turn_trunk(take, _find_again(take, fit, sample, targets), sample, targets)
            wait = 0 if better is fit else _FRAMES_WITHOUT_SEARCH
            fit = better
        fits.append(fit)
    return fits


def _find_again(take: Fitting, fit: Fit, sample: Voxels, targets: Sequence[Target]) -> Fit:
    """Return the fit, or a better one in which a lost limb is where its end was seen."""
    settings, model = take.settings, take.model

    def explained(each: Fit) -> float:
        return penalized_likelihood(model, each, targets)

    for limb in LIMBS:
        target = next((t for t in targets if t.bone == limb.end), None)
        if target is None:
            continue
        [away] = target_distances(model, fit.pose, [target])
        held = fit.support[limb.bones].min()
        if away < settings.lost_distance * model.stature and held > settings.lost_support:
            continue
        best = fit
        for pose in reach_for(
            fit.pose, model.origin, limb, target.offset, target.place, settings.swivels
        ):
            other = fit_frame(
                model, sample, pose, pose, targets,
                settings=settings.fit, steps=_LOST_STEPS, widening=_REACH_WIDENING,
            )  # fmt: skip
            if explained(other) > explained(best):
                best = other
        fit = best
    return fit


def _turn_trunk(take: Fitting, fit: Fit, sample: Voxels, targets: Sequence[Target]) -> Fit:
    """Return the fit, or a better one whose trunk faces as hands and feet say.

    Where the trunk did not turn with the performer, arms and legs that are led to their ends are
    crossed, and no limb by itself finds back.
    """
    settings, model = take.settings, take.model
    joints = place_bones(fit.pose, model.origin)
    seen = {target.bone: target for target in targets}
    across: list[complex] = []
    for right, left in (LIMBS[:2], LIMBS[2:]):
        if right.end not in seen or left.end not in seen:
            return fit
        here = joints[left.upper] - joints[right.upper]
        there = seen[left.end].place - seen[right.end].place
        across.append(complex(here[0], here[2]) * complex(there[0], there[2]).conjugate())
    yaw = float(np.angle(sum(across)))
    if np.abs(np.angle(across)).min() < _CROSSED:
        return fit
    pose = turn(fit.pose, yaw, joints[[limb.upper for limb in LIMBS]].mean(axis=0))
    for limb in LIMBS:
        target = seen[limb.end]
        [pose] = reach_for(pose, model.origin, limb, target.offset, target.place, 1)
    other = fit_frame(
        model, sample, pose, pose, targets,
        settings=settings.fit, steps=_LOST_STEPS, widening=_REACH_WIDENING,
    )  # fmt: skip
    return max(fit, other, key=lambda each: penalized_likelihood(model, each, targets))


def reach_best(
    take: Fitting, sample: Voxels, pose: Pose, limb: Limb, offset: Floats, place: Floats
) -> Fit:
    """Return the likeliest fit of a frame among those that begin with a limb's end at a place, m.

    `offset` is the point of the limb's last bone that comes there, as for `reach_for`.
    """
    model, settings = take.model, take.settings
    ways = reach_for(pose, model.origin, limb, offset, place, settings.swivels)
    fits = [
        fit_frame(
            model,
            sample,
            way,
            way,
            settings=settings.fit,
            steps=_REACH_STEPS,
            widening=_REACH_WIDENING,
        )
        for way in ways
    ]
    return max(fits, key=lambda fit: fit.likelihood)


def merge(take: Fitting, first: Sequence[Fit], again: Sequence[Fit]) -> list[Pose]:
    """Return poses whose trunk and limbs are each from the fit that explains the frame better.

    The head goes with the trunk.
    """
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
    whole = [
        [penalized_likelihood(model, *each) for each in zip(fits, targets, strict=True)]
        for fits in both
    ]
    chosen = choose(trunk, np.array(whole))
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

    `at` is (time, bone, 3) where each of the fits has the limb's bones, m.
    """
    model = take.model

    def explain(t: int) -> tuple[float, float]:
        sample, targets, fit = take.sample(t), take.targets(t), take.settings.fit
        tried = [_with_limb(poses[t], fits[t].pose, bones) for fits in both]
        fits = [fit_frame(model, sample, p, p, settings=fit, steps=0, widening=1.0) for p in tried]
        first, again = (penalized_likelihood(model, each, targets) for each in fits)
        return first, again

    explained = np.zeros((2, len(poses)))
    apart = np.linalg.norm(at[0] - at[1], axis=2).max(axis=1)
    differ = np.flatnonzero(apart >= take.settings.alike * model.stature).tolist()
    if differ:
        explained[:, differ] = np.transpose(side_by_side(explain, differ))
    return explained


def _with_limb(pose: Pose, other: Pose, bones: list[int]) -> Pose:
    """Return a pose in which some bones are turned as in another pose."""
    rotation = pose.rotation.copy()
    rotation[bones] = other.rotation[bones]
    return Pose(pose.root, rotation)


def settle(take: Fitting, poses: Sequence[Pose]) -> list[Fit]:
    """Fit each frame once more, near the mean of its pose and its neighbors' poses."""
    last = len(poses) - 1
    weights = np.array([take.settings.smoothing / 2, 1.0, take.settings.smoothing / 2])

    def near(poses: Sequence[Pose], t: int) -> Pose:
        around = [poses[max(t - 1, 0)], poses[t], poses[min(t + 1, last)]]
        return blend(around, weights, poses[t])

    fits = side_by_side(lambda t: _refit(take, t, near(poses, t)), range(len(poses)))
    settled = [fit.pose for fit in fits]
    return [replace(fit, pose=near(settled, t)) for t, fit in enumerate(fits)]


def settle_centers(take: Fitting, poses: Sequence[Pose]) -> FitModel:
    """Return the body with its joints at the centers that bones turn about in a take.

    Some of the take's frames tell the joints: their poses and the joints are found in turn.
    """
    step = max(1, len(poses) // take.settings.joint_frames)
    frames = [t for t in range(0, len(poses), step) if len(take.samples[t][0])]
    settled = [poses[t] for t in frames]
    rounds = take.settings.joint_rounds
    for earlier in range(rounds):
        with within(earlier / rounds, (earlier + 1) / rounds):
            if earlier:  # with the joints found so far
                pairs = list(zip(frames, settled, strict=True))
                settled = side_by_side(lambda pair, take=take: _refit(take, *pair).pose, pairs)
            seen = ((take.sample(t), pose) for t, pose in zip(frames, settled, strict=True))
            take = replace(take, model=settle_joints(take.model, seen, take.settings.fit))
    return take.model


def _refit(take: Fitting, frame: int, pose: Pose) -> Fit:
    """Return the fit of a frame near a pose that is nearly right; an empty frame keeps the pose."""
    sample = take.sample(frame)
    if not sample.count:
        return Fit(pose, 0.0, np.zeros(len(BONES)))
    targets, settings = take.targets(frame), take.settings.fit
    return fit_frame(
        take.model, sample, pose, pose, targets,
        settings=settings, steps=_REFIT_STEPS, widening=1.0,
    )  # fmt: skip
