"""Fit the pose of the body to the voxels of every frame: the `joint` method.

The paper fits segment after segment from the head outwards (digitization paper, 3.4.2) and
writes that it lost a foot and an arm for good. Here all segments, the cloth that hangs from them,
and a class for the voxels of nobody are fitted at once, by places and by colors. A limb that lost
its voxels is looked for where its hand or foot was seen. The take is fitted forwards and backwards,
and each limb is taken, frame by frame, from the fit that explains the frame better. Joints are
moved to the centers that bones turn about in all frames. At last every frame is fitted again, near
the poses of its neighbors.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS, SEGMENTS
from tasks.body.anatomy.bones import (
    BONES,
    PROXIMAL,
    Pose,
    carry,
    place_bones,
    rest_pose,
)
from tasks.body.anatomy.nearest_bones import bones_of_voxels
from tasks.body.anatomy.proportions import complete_joints
from tasks.body.blobs.fitting import Fit
from tasks.body.blobs.model import FitModel, make_model, place_model
from tasks.body.blobs.samples import Surfaces, draw_samples, learn_looks
from tasks.body.poses.feet import turn_feet
from tasks.body.poses.hands import look_for_hands
from tasks.body.poses.passes import Fitting, follow, merge, settle, settle_centers
from tasks.body.poses.settings import JointMethodSettings
from tasks.body.poses.sides import tell_sides
from tasks.body.poses.worn import exchange_by_colors
from tasks.engine.progress import within
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_index

Floats = NDArray[np.float64]


RIDES_ON: dict[str, str] = {"Head": "Head", "Neck": "Body", "Waist": "Waist"}
"""The bone that carries each joint."""

for _side in "RL":
    for _joint, _bone in (
        ("Shoulder", "UpperArm"), ("Elbow", "ForeArm"), ("Wrist", "Hand"), ("Fin", "Hand"),
        ("Hip", "UpperLeg"), ("Knee", "LowerLeg"), ("Ankle", "Foot"), ("Heel", "Foot"),
        ("Foot", "Foot"),
    ):  # fmt: skip
        RIDES_ON[_side + _joint] = _side + _bone


_SAMPLED = 0.12
"""How much of the time of the fit is over when the voxels are drawn [share]. Measured with a take
of 150 frames, for one of 1500."""
_STEPS = (0.29, 0.31, 0.48, 0.52, 0.78, 0.97)
"""How much of it is over after each of the next steps [share]. As the first; the centers take as
long with any number of frames."""


@dataclass(frozen=True, eq=False)
class FittedPoses:
    """The pose of the body in every frame, and the blobs that ride on it."""

    position: Floats
    """(time, 21, 3) m, joints as in `storage.schema.JOINTS`; NaN where the initial model has
    none."""

    initial: Floats
    """(21, 3) joints of the initial model, m, moved to the centers that bones turn about."""

    rotation: Floats
    """(time, 11, 3, 3) world rotation of each segment since the initial pose."""

    proximal: Floats
    """(time, 11, 3) the joint that each segment turns about, m."""

    quality: Floats
    """(time, 11) share of its initial voxels that a segment has, 0 to 1; 0 in an empty frame."""

    doubtful: NDArray[np.bool_]
    """(time,) True where the pose is a guess: the frame is empty, or a segment lacks its voxels."""

    unsure_sides: NDArray[np.bool_]
    """(time, 2) True where right and left hand, or right and left foot, could be exchanged."""

    poses: tuple[Pose, ...]
    """The pose of all bones in each frame, hands and feet among them."""

    model: FitModel
    """The body that was fitted."""

    account: "Account"
    """What the fit came by, for those who doubt it."""


@dataclass(frozen=True, eq=False)
class Account:
    """What a fit came by on its way."""

    take: Fitting
    """What was fitted, with hands where they were looked for, and the body as it was fitted."""

    passes: tuple[tuple[Fit, ...], tuple[Fit, ...]]
    """The fits of all frames forwards and backwards, before they were merged."""

    fits: tuple[Fit, ...]
    """The fits that the poses are of."""

    exchange_gains: Floats
    """(time, 2) how much likelier arms, or legs, would be exchanged, as of `sides.tell_sides`."""

    def part(self, first: int, last: int) -> "Account":
        """Return the frames from `first` to before `last` as a take of their own."""
        there, back = self.passes
        own = slice(first, last)
        take = self.take.part(first, last)
        return Account(take, (there[own], back[own]), self.fits[own], self.exchange_gains[own])


def fit_poses(
    hulls: Sequence[VoxelRuns],
    grid: VoxelGrid,
    rate_hz: float,
    position: Floats,
    label: NDArray[np.integer],
    *,
    initial_frame: int = 0,
    surfaces: Surfaces | None = None,
    cues: Floats | None = None,
    cue_weights: Floats | None = None,
    hand_ends: Sequence[Floats] | None = None,
    settings: JointMethodSettings | None = None,
) -> FittedPoses:
    """Return the pose of the body in every frame of a take.

    Parameters
    ----------
    hulls, grid
        Hulls of the whole take, a single frame each; they may be made when they are asked for.
    rate_hz
        Frames a second.
    position : (21, 3) float64
        Joints of the initial model, m; NaN is allowed for wrists, ankles, heels and waist.
    label : (voxel,) uint8
        Segment plus one of each voxel of the initial frame, in order; 0 for none.
    initial_frame
        The frame of the initial model.
    surfaces
        Gives of a frame which voxels (voxel,) are on the surface, and the colors (surface voxel, 3)
        and cameras (surface voxel,) of the voxels there. Without it, no color says anything.
    cues : (time, 5, 3) float64
        Where face, right and left hand, right and left foot were seen, m; NaN where they were not.
    cue_weights : (time, 5) float64
        How sure that is, 0 to 1.
    hand_ends : sequence of (place, 3) float64
        Where else a hand could be in each frame, m.
    settings
        The numbers of the method.

    Raises
    ------
    ValueError
        If arrays do not fit the take, or a joint that is needed is missing.
    """
    settings = settings or JointMethodSettings()
    joints = _check(hulls, rate_hz, position, label, initial_frame, cues, cue_weights)
    if hand_ends is not None and len(hand_ends) != len(hulls):
        raise ValueError(
            f"hand_ends are of {len(hand_ends)} frames, the take has {len(hulls)}; give those of "
            "every frame"
        )
    points = voxel_centers(grid, voxel_index(hulls[initial_frame], 0))
    left = (joints["LHip"] - joints["RHip"]) * (1.0, 0.0, 1.0)
    forward = np.cross(left / np.linalg.norm(left), (0.0, 1.0, 0.0))
    ends = {**joints, "Hips": (joints["RHip"] + joints["LHip"]) / 2}
    bone = bones_of_voxels(points, label, ends, forward)
    model = make_model(points, bone, ends, forward)
    with within(0.0, _SAMPLED):
        samples = draw_samples(hulls, surfaces, settings.sample)
    take = Fitting(
        grid,
        rate_hz,
        model,
        settings,
        cues,
        cue_weights,
        None if cues is None else cues[initial_frame],
        samples,
        learn_looks(bone, surfaces, initial_frame, settings.most_likeness),
    )
    with within(_SAMPLED, 1.0):
        account, unsure = fit_in_passes(take, initial_frame, rest_pose(model.origin), hand_ends)
    return describe_fits(account, unsure, position, model.origin)


def fit_in_passes(
    take: Fitting, frame: int, start: Pose, hand_ends: Sequence[Floats] | None
) -> tuple[Account, NDArray[np.bool_]]:
    """Return how the frames of a take were fitted, its joints where bones turn, and unsure sides.

    Parameters
    ----------
    take
        The take with a body in any pose.
    frame, start
        A frame, and the pose of that body in it.
    hand_ends
        As for `fit_poses`.

    Returns
    -------
    account : Account
    unsure : (time, 2) bool
        As `FittedPoses.unsure_sides`.
    """
    done = [(share - _SAMPLED) / (1.0 - _SAMPLED) for share in _STEPS]
    with within(0.0, done[0]):
        first = _follow_both_ways(_led_by_feet(take), frame, start)
    if hand_ends is not None:
        with within(done[0], done[1]):
            take = look_for_hands(take, first, hand_ends)
    with within(done[1], done[2]):
        led = _led_by_feet(take)
        again = follow(led, range(take.frames - 1, -1, -1), first[-1].pose)[::-1]
    with within(done[2], done[3]):
        merged = merge(led, first, again)
    with within(done[3], done[4]):
        take = replace(take, model=settle_centers(take, merged))
    with within(done[4], done[5]):
        fits = _settle_in_rounds(take, merged)
    with within(done[5], 1.0):
        take, fits, unsure, gains = tell_sides(take, fits)
        take, fits, gains = exchange_by_colors(take, fits, gains, frame)
        fits = turn_feet(take, fits)
    return Account(take, (tuple(first), tuple(again)), tuple(fits), gains), unsure


def _led_by_feet(take: Fitting) -> Fitting:
    """Return the take with feet that pull as they do while the body is followed."""
    settings = take.settings
    return replace(take, settings=replace(settings, foot_pull=settings.foot_pull_followed))


def _follow_both_ways(take: Fitting, initial_frame: int, rest: Pose) -> list[Fit]:
    """Return the fits of all frames, followed from the initial one to the end and the beginning."""
    ways = range(initial_frame, take.frames), range(initial_frame, -1, -1)
    longer = int(len(ways[1]) > len(ways[0]))
    with ThreadPoolExecutor(1) as beside:
        other = beside.submit(follow, take, ways[1 - longer], rest)
        fits = [follow(take, ways[longer], rest)]  # who listens hears of this one
        fits.insert(1 - longer, other.result())
    there, before = fits
    return [*before[:0:-1], *there]


def _settle_in_rounds(take: Fitting, poses: Sequence[Pose]) -> list[Fit]:
    """Return the fits of all frames after the last round near their neighbors."""
    rounds = take.settings.settle_rounds
    fits: list[Fit] = []
    for n in range(rounds):
        with within(n / rounds, (n + 1) / rounds):
            fits = settle(take, [fit.pose for fit in fits] if n else poses)
    return fits


def fitted_blobs(fitted: FittedPoses, frame: int) -> tuple[Floats, Floats]:
    """Return the places and sizes of the fitted body's blobs in a frame.

    Returns
    -------
    mean : (blob, 3) float64
        Metres.
    inverse : (blob, 3, 3) float64
        Inverse covariances, 1 / m**2.
    """
    return place_model(fitted.model, fitted.poses[frame])


def describe_fits(
    account: Account, unsure: NDArray[np.bool_], placed: Floats, origin: Floats
) -> FittedPoses:
    """Return the poses of a take's fits, with the joints of the archive.

    Parameters
    ----------
    account
        What was fitted, and the fits.
    unsure : (time, 2) bool
        True where arms, or legs, could be exchanged.
    placed : (21, 3) float64
        Joints of the initial model before the bones' joints were moved, m.
    origin : (bone, 3) float64
        The bones' joints before they were moved, m.
    """
    take, fits = account.take, account.fits
    model = take.model
    initial = placed.copy()
    for k, name in enumerate(PROXIMAL):
        if BONES[k] != "Body":
            initial[JOINTS.index(name)] += model.origin[k] - origin[k]
    frames = len(fits)
    position = np.full((frames, len(JOINTS), 3), np.nan)
    bone = np.array([BONES.index(RIDES_ON[name]) for name in JOINTS])
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
    poses = tuple(fit.pose for fit in fits)
    return FittedPoses(
        position, initial, rotation, proximal, quality, doubtful, unsure, poses, model, account
    )


def _check(
    hulls: Sequence[VoxelRuns],
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
    if not 0 <= initial_frame < len(hulls):
        raise ValueError(
            f"initial_frame {initial_frame} is not one of the take's {len(hulls)} frames; give "
            "the frame that the initial model is of"
        )
    if position.shape != (len(JOINTS), 3):
        raise ValueError(
            f"position has shape {position.shape}, but ({len(JOINTS)}, 3) is wanted: give the "
            "joints of the initial model in the order of the archive"
        )
    voxels = int(hulls[initial_frame].length.sum(dtype=np.int64))
    if label.shape != (voxels,):
        raise ValueError(
            f"label has shape {label.shape}, but frame {initial_frame} has {voxels} voxels; give "
            "a label for each"
        )
    for name, value, shape in (
        ("cues", cues, (len(hulls), 5, 3)),
        ("cue_weights", cue_weights, (len(hulls), 5)),
    ):
        if value is not None and value.shape != shape:
            raise ValueError(
                f"{name} has shape {value.shape}, but {shape} is wanted; give face, right and left "
                "hand, right and left foot of every frame"
            )
    optional = {"Waist"} | {s + n for s in "RL" for n in ("Wrist", "Ankle", "Heel")}
    known = dict(zip(JOINTS, np.asarray(position, np.float64), strict=True))
    missing = [n for n in JOINTS if n not in optional and not np.isfinite(known[n]).all()]
    if missing:
        raise ValueError(
            f"the initial model has no {', '.join(missing)}; place these joints in initial.json"
        )
    return complete_joints(known)
