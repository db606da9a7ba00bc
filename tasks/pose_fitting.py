"""Fit the pose of the body to the voxels of every frame: the `joint` method.

The paper fits segment after segment from the head outwards (digitization paper, 3.4.2) and
writes that it lost a foot and an arm for good. Here all segments, what hangs from
them, and a class for what is nobody's are fitted at once, by places and by colors; a limb that
lost its voxels is looked for where its hand or foot was seen; the take is fitted forwards and
backwards, and each limb is taken, frame by frame, from the fit that explains more; joints are
moved to where the bones of all frames turn; at last every frame is fitted once more, near what
its neighbors say.
"""

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS, SEGMENTS
from tasks.geometry.articulated import (
    BONES,
    PROXIMAL,
    Pose,
    blend,
    carry,
    extrapolate,
    place_bones,
    rest_pose,
)
from tasks.geometry.blob_fitting import (
    Fit,
    FitModel,
    FitSettings,
    Sample,
    Target,
    bones_of_voxels,
    fit_frame,
    make_model,
    middles,
    miss,
    settle_joints,
    worth,
)
from tasks.geometry.blobs import place_blobs
from tasks.geometry.initial_shape_labels import complete_joints
from tasks.geometry.limb_search import LIMBS, choose_fits, reach_for
from tasks.geometry.voxel_samples import Drawn, Surfaces, draw_samples, learn_looks
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_index

Floats = NDArray[np.float64]

_logger = logging.getLogger(__name__)

_CUE_BONES = tuple(BONES.index(name) for name in ("Head", "RHand", "LHand", "RFoot", "LFoot"))

_RIDES_ON: dict[str, str] = {"Head": "Head", "Neck": "Body", "Waist": "Waist"}
for _side in "RL":
    for _joint, _bone in (
        ("Shoulder", "UpperArm"), ("Elbow", "ForeArm"), ("Wrist", "Hand"), ("Fin", "Hand"),
        ("Hip", "UpperLeg"), ("Knee", "LowerLeg"), ("Ankle", "Foot"), ("Heel", "Foot"),
        ("Foot", "Foot"),
    ):  # fmt: skip
        _RIDES_ON[_side + _joint] = _side + _bone


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

    joint_rounds: int = 2
    """How often joints are settled between fits."""

    joint_frames: int = 60
    """Frames that settle the joints, evenly from the take."""

    smoothing: float = 0.5
    """How much the two neighbors of a frame weigh together against the frame itself."""

    doubtful_support: float = 0.35
    """A frame in which a limb has less support, in the median of its bones, is doubtful."""


@dataclass(frozen=True, eq=False)
class FittedPoses:
    """The pose of the body in every frame, and the blobs that ride on it."""

    position: Floats
    """(time, 21, 3) m, joints as in `storage.schema.JOINTS`; NaN where the initial model has
    none."""

    initial: Floats
    """(21, 3) joints of the initial model, m, those that bones turn about where they do."""

    rotation: Floats
    """(time, 11, 3, 3) world rotation of each segment since the initial pose."""

    proximal: Floats
    """(time, 11, 3) the joint that each segment turns about, m."""

    quality: Floats
    """(time, 11) share of a segment's voxels that support it, 0 to 1; 0 in an empty frame."""

    doubtful: NDArray[np.bool_]
    """(time,) True where the pose is a guess: an empty frame, or a segment without support."""

    poses: tuple[Pose, ...]
    """The poses of all bones, hands and feet among them."""

    model: FitModel
    """The body that was fitted."""


def fit_poses(
    runs: VoxelRuns,
    grid: VoxelGrid,
    rate_hz: float,
    position: Floats,
    label: NDArray[np.integer],
    *,
    initial_frame: int = 0,
    surfaces: Surfaces | None = None,
    cues: Floats | None = None,
    cue_weights: Floats | None = None,
    settings: PoseSettings | None = None,
) -> FittedPoses:
    """Return the pose of the body in every frame of a take.

    Parameters
    ----------
    runs, grid
        The hulls of the whole take.
    rate_hz
        Frames a second.
    position : (21, 3) float64
        Joints of the initial model, m; NaN is allowed for wrists, ankles, heels and waist.
    label : (voxel,) uint8
        Segment plus one of the initial frame's voxels, in order; 0 for none.
    initial_frame
        The frame of the initial model.
    surfaces
        Gives for a frame which of its voxels (voxel,) are on the surface, and color (surface
        voxel, 3) and camera (surface voxel,) of these. Without it, colors say nothing.
    cues : (time, 5, 3) float64
        Where face, right and left hand, right and left foot were seen, m; NaN where they were not.
    cue_weights : (time, 5) float64
        How sure that is, 0 to 1.

    Raises
    ------
    ValueError
        If arrays do not fit the take, or a joint that is needed is missing.
    """
    settings = settings or PoseSettings()
    joints = _check(runs, rate_hz, position, label, initial_frame, cues, cue_weights)
    points = voxel_centers(grid, voxel_index(runs, initial_frame))
    left = (joints["LHip"] - joints["RHip"]) * (1.0, 0.0, 1.0)
    forward = np.cross(left / np.linalg.norm(left), (0.0, 1.0, 0.0))
    ends = {**joints, "Hips": (joints["RHip"] + joints["LHip"]) / 2}
    bone = bones_of_voxels(points, label, ends, forward)
    model = make_model(points, bone, ends, forward)
    take = _Take(
        grid,
        rate_hz,
        model,
        settings,
        cues,
        cue_weights,
        initial_frame,
        draw_samples(runs, surfaces, settings.sample),
        learn_looks(bone, surfaces, initial_frame, settings.most_likeness),
    )
    there = _follow(take, range(initial_frame, runs.frames), rest_pose(model.origin))
    before = _follow(take, range(initial_frame, -1, -1), rest_pose(model.origin))
    first = [*before[:0:-1], *there]
    again = _follow(take, range(runs.frames - 1, -1, -1), first[-1].pose)[::-1]
    merged = _merge(take, first, again)
    for _ in range(settings.joint_rounds):
        take = replace(take, model=_settle_joints(take, merged))
        merged = [fit.pose for fit in _settle(take, merged)]
    fits = _settle(take, merged)
    return _describe(take, fits, position, model.origin)


def fitted_blobs(fitted: FittedPoses, frame: int) -> tuple[Floats, Floats]:
    """Return where the blobs of the fitted body are in a frame.

    Returns
    -------
    mean : (blob, 3) float64
        Metres.
    inverse : (blob, 3, 3) float64
        Inverse covariances, 1 / m**2.
    """
    model, pose = fitted.model, fitted.poses[frame]
    joints = place_bones(pose, model.origin)
    mean, whitening = place_blobs(model.blobs, joints, pose.rotation)
    return mean, np.einsum("bji,bjk->bik", whitening, whitening)


@dataclass(frozen=True, eq=False)
class _Take:
    grid: VoxelGrid
    rate_hz: float
    model: FitModel
    settings: PoseSettings
    cues: Floats | None
    cue_weights: Floats | None
    initial_frame: int
    samples: list[Drawn]
    looks: NDArray[np.float32]

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self.samples)

    def sample(self, frame: int) -> Sample:
        """Return an even sample of a frame's voxels, with what their colors say."""
        index, cell = self.samples[frame]
        return Sample(voxel_centers(self.grid, index), self.looks[cell])

    def targets(self, frame: int) -> list[Target]:
        """Return where face and hands were seen."""
        found: list[Target] = []
        if self.cues is None:
            return found
        pulls = self.settings
        pull = (pulls.face_pull, *[pulls.hand_pull] * 2, *[pulls.foot_pull] * 2)
        scale = 1.7 / self.model.stature
        for i, k in enumerate(_CUE_BONES):
            offset = self.cues[self.initial_frame, i] - self.model.origin[k]
            place = self.cues[frame, i]
            sure = 1.0 if self.cue_weights is None else self.cue_weights[frame, i]
            if np.isfinite(offset).all() and np.isfinite(place).all() and sure > 0:
                within = self.settings.pull_within * self.model.stature
                found.append(Target(k, offset, place, pull[i] * sure * scale**2, within))
        return found


def _follow(take: _Take, frames: Sequence[int], start: Pose) -> list[Fit]:
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
        if not len(sample.points):
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


def _find_again(take: _Take, fit: Fit, sample: Sample, targets: Sequence[Target]) -> Fit:
    """Return the fit, or a better one in which a lost limb is elsewhere."""
    settings, model = take.settings, take.model
    for limb in LIMBS:
        target = next((t for t in targets if t.bone == limb.end), None)
        if target is None:
            continue
        away = miss(model, fit.pose, target)
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


def _merge(take: _Take, first: Sequence[Fit], again: Sequence[Fit]) -> list[Pose]:
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

    worths = [[worth(model, fit, take.targets(t)) for t, fit in enumerate(fits)] for fits in both]
    chosen = choose(trunk, np.array(worths))
    merged = [both[chosen[t]][t].pose for t in range(len(first))]
    for bones in limbs:
        explained = _explain_limb(take, merged, both, bones)
        chosen = choose(bones, explained)
        merged = [_with_limb(pose, both[chosen[t]][t].pose, bones) for t, pose in enumerate(merged)]
    return merged


def _explain_limb(
    take: _Take, poses: Sequence[Pose], both: Sequence[Sequence[Fit]], bones: list[int]
) -> Floats:
    """Return (fit, time) how well poses explain their frames with a limb as either fit has it."""
    model = take.model

    def explain(t: int) -> tuple[float, float]:
        at = [middles(model, fits[t].pose)[bones] for fits in both]
        if np.linalg.norm(at[0] - at[1], axis=1).max() < take.settings.alike * model.stature:
            return 0.0, 0.0
        sample, targets, fit = take.sample(t), take.targets(t), take.settings.fit
        tried = [_with_limb(poses[t], fits[t].pose, bones) for fits in both]
        fits = [fit_frame(model, sample, p, p, settings=fit, steps=0, widening=1.0) for p in tried]
        return worth(model, fits[0], targets), worth(model, fits[1], targets)

    with ThreadPoolExecutor() as pool:
        return np.array(list(pool.map(explain, range(len(poses))))).T


def _with_limb(pose: Pose, other: Pose, bones: list[int]) -> Pose:
    """Return a pose with the bones turned as in another."""
    rotation = pose.rotation.copy()
    rotation[bones] = other.rotation[bones]
    return Pose(pose.root, rotation)


def _settle(take: _Take, poses: Sequence[Pose]) -> list[Fit]:
    """Fit each frame once more, near what it and its neighbors say; in parallel."""
    last = len(poses) - 1
    weights = np.array([take.settings.smoothing / 2, 1.0, take.settings.smoothing / 2])

    def near(poses: Sequence[Pose], t: int) -> Pose:
        around = [poses[max(t - 1, 0)], poses[t], poses[min(t + 1, last)]]
        return blend(around, weights, poses[t])

    def settle(t: int) -> Fit:
        sample, ahead = take.sample(t), near(poses, t)
        if not len(sample.points):
            return Fit(ahead, 0.0, np.zeros(len(BONES)))
        return fit_frame(
            take.model,
            sample,
            ahead,
            ahead,
            take.targets(t),
            settings=take.settings.fit,
            steps=3,
            widening=1.0,
        )

    with ThreadPoolExecutor() as pool:
        fits = list(pool.map(settle, range(len(poses))))
    settled = [fit.pose for fit in fits]
    return [replace(fit, pose=near(settled, t)) for t, fit in enumerate(fits)]


def _settle_joints(take: _Take, poses: Sequence[Pose]) -> FitModel:
    """Return the body with its joints where a take's frames have their centers of rotation."""
    step = max(1, len(poses) // take.settings.joint_frames)
    frames = [t for t in range(0, len(poses), step)]
    samples = ((take.sample(t), poses[t]) for t in frames)
    return settle_joints(
        take.model, ((s, p) for s, p in samples if len(s.points)), take.settings.fit
    )


def _describe(take: _Take, fits: Sequence[Fit], placed: Floats, origin: Floats) -> FittedPoses:
    model = take.model
    initial = placed.copy()
    for k, name in enumerate(PROXIMAL):
        if BONES[k] != "Body":
            initial[JOINTS.index(name)] += model.origin[k] - origin[k]
    frames = len(fits)
    position = np.full((frames, len(JOINTS), 3), np.nan)
    bone = np.array([BONES.index(_RIDES_ON[name]) for name in JOINTS])
    known = np.isfinite(initial).all(1)
    offset = initial - model.origin[bone]
    proximal = np.empty((frames, len(SEGMENTS), 3))
    for t, fit in enumerate(fits):
        joints = place_bones(fit.pose, model.origin)
        proximal[t] = joints[: len(SEGMENTS)]
        position[t, known] = carry(fit.pose, joints, bone[known], offset[known])
    rotation = np.stack([fit.pose.rotation[: len(SEGMENTS)] for fit in fits])
    support = np.stack([fit.support for fit in fits])
    quality = np.clip(support[:, : len(SEGMENTS)], 0.0, 1.0)
    doubtful = quality.min(1) < take.settings.doubtful_support
    _logger.info("fitted %d frames, %d doubtful", frames, int(doubtful.sum()))
    poses = tuple(fit.pose for fit in fits)
    return FittedPoses(position, initial, rotation, proximal, quality, doubtful, poses, model)


def _check(
    runs: VoxelRuns,
    rate_hz: float,
    position: Floats,
    label: NDArray[np.integer],
    initial_frame: int,
    cues: Floats | None,
    cue_weights: Floats | None,
) -> Mapping[str, Floats]:
    """Return the joints of the initial model by name, complete."""
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(f"rate_hz {rate_hz} must be positive; give frames a second")
    if not 0 <= initial_frame < runs.frames:
        raise ValueError(
            f"initial_frame {initial_frame} is not one of the take's {runs.frames} frames; give "
            "the frame that the initial model is of"
        )
    if position.shape != (len(JOINTS), 3):
        raise ValueError(
            f"position has shape {position.shape}, but ({len(JOINTS)}, 3) is wanted: give the "
            "joints of the initial model in the order of the archive"
        )
    voxels = int(runs.length[runs.offset[initial_frame] : runs.offset[initial_frame + 1]].sum())
    if label.shape != (voxels,):
        raise ValueError(
            f"label has shape {label.shape}, but frame {initial_frame} has {voxels} voxels; give "
            "a label for each"
        )
    for name, value, shape in (
        ("cues", cues, (runs.frames, 5, 3)),
        ("cue_weights", cue_weights, (runs.frames, 5)),
    ):
        if value is not None and value.shape != shape:
            raise ValueError(
                f"{name} has shape {value.shape}, but {shape} is wanted; give face, right hand "
                "and left hand of every frame"
            )
    optional = {"Waist"} | {s + n for s in "RL" for n in ("Wrist", "Ankle", "Heel")}
    known = dict(zip(JOINTS, np.asarray(position, np.float64), strict=True))
    missing = [n for n in JOINTS if n not in optional and not np.isfinite(known[n]).all()]
    if missing:
        raise ValueError(
            f"the initial model has no {', '.join(missing)}; place these joints in initial.json"
        )
    return complete_joints(known)
