"""Store functions from colored voxels to a moving, segmented body (digitization paper, 3.2-3.4).

The paper goes from frame to frame: provisional labels, pose, final labels. So does `paper` here.
`joint`, the default, fits the poses of a whole take first, from the voxels themselves; what
labels the voxels of a frame is then known for every frame, so labels are made block by block.
"""

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import read_block, write_block
from storage.errors import InputError
from storage.formats.capture.capture import Capture, read_capture
from storage.formats.capture.initial import read_initial
from storage.schema import JOINTS
from tasks.body.anatomy.bones import place_bones
from tasks.body.anatomy.nearest_bones import label_points
from tasks.body.anatomy.proportions import complete_joints
from tasks.body.anatomy.segments import ORIGINS, local_systems, place_ellipsoids
from tasks.body.anatomy.shape import measure_body
from tasks.body.anatomy.skin import SurfaceFrame
from tasks.body.doubts import DoubtSettings, find_doubts
from tasks.body.extremities.places import Extremities, find_extremities, hand_ends
from tasks.body.initial.search import InitialModel, find_initial_model, model_from_joints
from tasks.body.joint_tracks import JointTrackSettings, track_stature
from tasks.body.labels.fields import carry_back
from tasks.body.labels.final import label_frame, make_body_fields
from tasks.body.labels.provisional import ProvisionalSettings, label_provisionally
from tasks.body.labels.skin import label_skin, skin_table
from tasks.body.poses.joint import PoseSettings, fit_poses, fitted_blobs
from tasks.body.poses.paper import PaperFitSettings, fit_frame, join_poses
from tasks.capture.films import grid_of
from tasks.geometry.voxel_lines import lines_of, marked_centers
from tasks.geometry.voxels import VoxelRuns, join_runs, voxel_centers
from tasks.reconstruction.voxel_frames import VoxelFrames

logger = logging.getLogger(__name__)

_ORIGIN = [JOINTS.index(name) for name in ORIGINS]
_STARVED = 0.5  # of its voxels are outside its own ellipsoid


@dataclass(frozen=True)
class PosingSettings:
    """Everything that changes a pose or a label."""

    method: Literal["joint", "paper"] = "joint"
    """How the pose is fitted: all segments at once, or from the head outwards as in the paper."""
    joint: PoseSettings = field(default_factory=PoseSettings)
    paper: PaperFitSettings = field(default_factory=PaperFitSettings)
    provisional: ProvisionalSettings = field(
        default_factory=lambda: ProvisionalSettings(most_rings=20)
    )
    """With few rings: under cloth the more there are the more labels are wrong (of a kimono 4 %
    after none, 8 % after 20, 18 % after 100). `paper` takes its own number."""
    ends: JointTrackSettings = field(default_factory=JointTrackSettings)
    doubts: DoubtSettings = field(default_factory=DoubtSettings)


Refs = list[dict[str, Any]]
Blobs = list[tuple[NDArray[np.float64], NDArray[np.float64]]]  # mean and inverse, a frame each


def model_take(
    archive: str, capture: str, digest: str, hulls: Refs, colors: Refs, into: str
) -> dict[str, Any]:
    """Find the joints and labels that a take begins with, or take them from `initial.json`.

    Parameters
    ----------
    archive
        Where the blocks are.
    capture, digest
        The folder, and the digest of what is in it.
    hulls, colors
        As `carve_block` and `color_block` returned them, in the order of the frames.
    into
        Path of the block in the archive.

    Returns
    -------
    dict
        As `storage.blocks.write_block`, and `frame`, `confidence` and `notes`; the arrays are
        `position` (21, 3), m, `label` of the frame's voxels, and `confidence`.

    Raises
    ------
    InputError
        If no frame of the first second shows one performer with stretched arms, or
        `initial.json` cannot be used.
    """
    begun = time.monotonic()
    source = read_capture(Path(capture))
    frames = VoxelFrames(open_archive(archive).place, grid_of(source), hulls, colors)
    first = range(min(len(frames), max(1, round(1.5 * source.fps))))
    if source.initial:
        found = _given_model(source.initial, frames)
    else:
        surfaces = [_surface(frames, n) for n in first]
        found = find_initial_model(
            join_runs([frames.hull(n) for n in first]),
            frames.grid,
            source.fps,
            surfaces=surfaces,
            stature_m=source.stature_m,
        )
    _check_measurable(found, frames, source.initial)
    arrays = {
        "position": found.position, "label": found.label, "confidence": np.array(found.confidence),
    }  # fmt: skip
    place = open_archive(archive).place
    block = write_block(place, into, (found.frame, found.frame + 1), arrays, begun)
    about = {"confidence": round(found.confidence, 3), "notes": list(found.notes)}
    return {**block, "frame": found.frame, **about}


def fit_take(
    archive: str, capture: str, digest: str, hulls: Refs, colors: Refs, initial: dict[str, Any],
    into: str, settings: PosingSettings,
) -> dict[str, Any]:  # fmt: skip
    """Fit the pose of every frame of a take.

    Parameters
    ----------
    initial
        As `model_take` returned it.
    settings
        The method and its numbers.
    archive, capture, digest, hulls, colors, into
        As for `model_take`.

    Returns
    -------
    dict
        As `storage.blocks.write_block`; the arrays are `joint` (time, 21, 3) and `position`
        (time, 11, 3), m, `rotation` (time, 11, 3, 3), `quality` (time, 11), `doubtful` (time,),
        why it is so as of `find_doubts`, of the method `joint` also `hands_unsure` and
        `feet_unsure` (time,) bool, what labels voxels (of `joint` the body's fields, and `turn` and
        `shift` a frame; of `paper` `blob_mean` and `blob_inverse` a frame), the joints that the
        body was measured with (`initial_joint`), and
        where face and hands were seen (`seen`), with the colors of skin.
    """
    begun = time.monotonic()
    source = read_capture(Path(capture))
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(source), hulls, colors)
    start = read_block(place, initial)
    joints = dict(zip(JOINTS, start["position"], strict=True))
    stature_m = source.stature_m or track_stature(start["position"][None])
    seen = find_extremities(
        _Surfaces(frames), source.fps, stature_m, joints, initial_frame=initial["frame"]
    )
    fit = _fit_jointly if settings.method == "joint" else _fit_as_paper
    arrays, blobs = fit(source, frames, start, initial["frame"], seen, settings)
    arrays |= find_doubts(
        frames, arrays["doubtful"], blobs, seen.position[:, 1:], source.fps,
        initial_frame=initial["frame"], confidence=float(start["confidence"]),
        settings=settings.doubts,
    )  # fmt: skip
    arrays["seen"] = seen.position
    arrays["skin_hand"], arrays["skin_face"] = seen.model.hand, seen.model.face
    return write_block(place, into, (0, len(frames)), arrays, begun)


def cues_of(seen: Extremities) -> dict[str, Any]:
    """Return what was seen of face, hands and feet as `fit_poses` takes it."""
    return {
        "cues": np.concatenate([seen.position, seen.foot], axis=1),
        "cue_weights": np.concatenate([seen.weight, seen.foot_weight], axis=1),
        "hand_ends": hand_ends(seen.candidates),
    }


def _given_model(path: Path, frames: VoxelFrames) -> InitialModel:
    """Return the model that a person placed, checked against the voxels of its frame."""
    given = read_initial(path)
    frame = given.frame or 0
    if frame >= len(frames):
        raise InputError(f"{path} is of frame {frame}; the take has the frames 0-{len(frames) - 1}")
    hull = frames.hull(frame)
    try:
        found = model_from_joints(hull, frames.grid, given.position, frame=0, label=given.label)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return replace(found, frame=frame)


def _check_measurable(model: InitialModel, frames: VoxelFrames, path: Path | None) -> None:
    """Refuse a model in which a segment has too few voxels, or a joint is missing."""
    center = voxel_centers(frames.grid, frames.index(model.frame))
    try:
        measure_body(center, model.label, model.position)
    except ValueError as error:
        todo = (
            f"correct the joints in {path}"
            if path
            else "take smaller voxels (voxel_m under [volume]), or place the joints in initial.json"
        )
        raise InputError(
            f"the body cannot be measured in frame {model.frame}: {error}; {todo}"
        ) from error


def _surface(frames: VoxelFrames, frame: int) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Return index and color of the surface voxels of a frame."""
    is_surface, color, _ = frames.surface(frame)
    return frames.index(frame)[is_surface], color


class _Surfaces(Sequence[SurfaceFrame]):
    """The colored surfaces of a take, made when they are asked for."""

    def __init__(self, frames: VoxelFrames) -> None:
        self._frames = frames

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[SurfaceFrame]:
        return (self[n] for n in range(len(self)))

    def __getitem__(self, frame: Any) -> Any:
        is_surface, color, camera = self._frames.surface(frame)
        center = marked_centers(self._frames.grid, self._frames.hull(frame), is_surface)
        return SurfaceFrame(center, color, camera)


class _Hulls(Sequence[VoxelRuns]):
    """The hulls of a take, a single frame each, read when they are asked for."""

    def __init__(self, frames: VoxelFrames) -> None:
        self._frames = frames

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, frame: Any) -> Any:
        return self._frames.hull(frame)


def _fit_jointly(
    source: Capture, frames: VoxelFrames, start: dict[str, NDArray], initial_frame: int,
    seen: Extremities, settings: PosingSettings,
) -> tuple[dict[str, NDArray], Blobs]:  # fmt: skip
    """Fit all segments of all frames at once."""
    fitted = fit_poses(
        _Hulls(frames),
        frames.grid,
        source.fps,
        start["position"],
        start["label"],
        initial_frame=initial_frame,
        surfaces=frames.surface,
        settings=_hold_given_joints(source.initial, settings.joint),
        **cues_of(seen),
    )
    index = frames.index(initial_frame)
    center = voxel_centers(frames.grid, index)
    joints = dict(zip(JOINTS, fitted.initial, strict=True))  # where bones were seen to turn
    label = _labels_to_carry(source.initial, center, start["label"], joints)
    fields = make_body_fields(index, center, label, joints, frames.grid.voxel_m)
    _, axes = local_systems(fitted.initial)
    turn, shift = carry_back(
        np.stack([place_bones(pose, fitted.model.origin) for pose in fitted.poses]),
        np.stack([pose.rotation for pose in fitted.poses]),
        fitted.model.origin,
        np.array(frames.grid.origin_m),
        frames.grid.voxel_m,
    )
    arrays = {
        "initial_joint": fitted.initial,
        "joint": fitted.position,
        "position": fitted.position[:, _ORIGIN],
        "rotation": fitted.rotation @ axes,
        "quality": fitted.quality,
        "doubtful": fitted.doubtful | fitted.unsure_sides.any(axis=1),
        "hands_unsure": fitted.unsure_sides[:, 0],
        "feet_unsure": fitted.unsure_sides[:, 1],
        "turn": turn,
        "shift": shift,
        **{f"field_{name}": np.asarray(value) for name, value in vars(fields).items()},
    }
    return arrays, [fitted_blobs(fitted, frame) for frame in range(len(frames))]


def _hold_given_joints(given: Path | None, settings: PoseSettings) -> PoseSettings:
    """Return the settings with which joints that a person placed stay where they are.

    Placed within 1.5 cm they are better than what the bones' motion tells: moved, the mean error
    was 0.4 to 3 mm larger in the first 90 frames of each of six rendered takes.
    """
    return settings if given is None else replace(settings, joint_rounds=0)


def _labels_to_carry(
    given: Path | None, center: NDArray[np.float64], label: NDArray[np.integer],
    joints: dict[str, NDArray[np.float64]],
) -> NDArray[np.integer]:  # fmt: skip
    """Return the labels that final ones are carried from: arms whole, unless a person labeled."""
    if given and read_initial(given).label is not None:
        return label
    whole = label_points(center, complete_joints(joints), whole_arms=True)
    return np.where(label > 0, whole, 0).astype(np.uint8)


def _fit_as_paper(
    source: Capture, frames: VoxelFrames, start: dict[str, NDArray], initial_frame: int,
    seen: Extremities, settings: PosingSettings,
) -> tuple[dict[str, NDArray], Blobs]:  # fmt: skip
    """Fit frame after frame from the head outwards, with the labels that lead there."""
    center = voxel_centers(frames.grid, frames.index(initial_frame))
    body = measure_body(center, start["label"], start["position"])
    stature_m = source.stature_m or track_stature(start["position"][None])
    is_skin = skin_table({"skin_hand": seen.model.hand, "skin_face": seen.model.face})
    rule = ProvisionalSettings()
    reach_m = rule.reach_m(source.stature_m, source.fps)
    pose, label, previous = (body.position, body.rotation), start["label"], initial_frame
    found = [(*pose, np.ones(11))]
    means, inverses = [], []
    for frame in range(len(frames)):
        index, lines = frames.index(frame), lines_of(frames.hull(frame))
        if frame > initial_frame and len(index):
            skin = label_skin(
                frames, frame, lines, seen.position[frame], is_skin,
                reach_m=reach_m, least_m2=rule.least_skin_m2,
            )  # fmt: skip
            before = lines_of(frames.hull(previous))
            provisional = label_provisionally(
                lines, before, label, body.shape.volume_share, rule, skin_label=skin
            )
            found.append(
                fit_frame(
                    voxel_centers(frames.grid, index), provisional, body.shape, pose,
                    settings.paper, rate_hz=source.fps, stature_m=stature_m,
                )
            )  # fmt: skip
            pose, previous = found[-1][:2], frame
        elif frame:
            found.append((*pose, np.zeros(11) if frame > initial_frame else np.ones(11)))
        mean, inverse = place_ellipsoids(body.shape, *pose)
        means.append(mean)
        inverses.append(inverse)
        if frame > initial_frame and previous == frame:
            label = label_frame(voxel_centers(frames.grid, index), lines, mean, inverse)
    track = join_poses(body.shape, found)
    arrays = {
        "initial_joint": start["position"],
        "joint": track.joint,
        "position": track.position,
        "rotation": track.rotation,
        "quality": track.quality,
        "doubtful": track.quality.min(axis=1) < _STARVED,
        "blob_mean": np.stack(means),
        "blob_inverse": np.stack(inverses),
    }
    return arrays, list(zip(means, inverses, strict=True))
