"""Stage: the pose of every frame (digitization paper, section 3.4.2).

The paper goes from frame to frame: provisional labels, pose, final labels. So does `paper`.
`joint`, the default, fits the poses of a whole take first, from the voxels themselves; what
labels the voxels of a frame is then known for every frame.
"""

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Block, Written, read_block, write_block
from storage.formats.capture.capture import capture_of
from storage.formats.capture.initial import read_initial
from storage.schema import JOINTS
from tasks.body.anatomy.bones import place_bones
from tasks.body.anatomy.nearest_bones import label_points
from tasks.body.anatomy.proportions import complete_joints
from tasks.body.anatomy.segments import ORIGINS, local_systems
from tasks.body.anatomy.skin import SurfaceFrame
from tasks.body.doubt.reasons import DoubtSettings, find_doubts, settle_doubt
from tasks.body.doubt.repair import doubt_and_repair
from tasks.body.extremities.places import Extremities, find_extremities
from tasks.body.extremities.settings import ExtremitySettings
from tasks.body.initial.joints import exchange_feet
from tasks.body.labels.fields import carry_back
from tasks.body.labels.final import make_body_fields
from tasks.body.labels.provisional import ProvisionalSettings
from tasks.body.labels.things import find_staying
from tasks.body.paper_method import Start, fit_as_paper
from tasks.body.poses.joint import FittedPoses, fit_poses, fitted_blobs
from tasks.body.poses.paper import PaperMethodSettings
from tasks.body.poses.settings import JointMethodSettings
from tasks.capture.films import frames_all_over, grid_of
from tasks.engine.progress import within
from tasks.engine.settings import check_ranges
from tasks.geometry.voxel_lines import marked_centers
from tasks.geometry.voxels import voxel_centers
from tasks.reconstruction.voxel_frames import HullFrames, VoxelFrames

_logger = logging.getLogger(__name__)

_ORIGIN = [JOINTS.index(name) for name in ORIGINS]

_SEEN, _FITTED = 0.27, 0.9
"""How much of the stage's time is over when face, hands and feet are found, and when the poses are
fitted [share]. Measured as those of `tasks.body.poses.joint`."""

_LOOKED_AT = 48
"""In how many frames all over a take what stays far from the body is looked for [frames]. Chosen,
not measured."""

_LONG_S = 4.0
"""How long a take is at least in which it is asked what stays in its place [s]. In a shorter one
cloth may. Chosen, not measured."""

Blobs = list[tuple[NDArray[np.float64], NDArray[np.float64]]]  # mean and inverse, a frame each


@dataclass(frozen=True)
class PoseFittingSettings:
    """Everything that changes a pose."""

    method: Literal["joint", "paper"] = "joint"
    """How the pose is fitted: all segments at once, or from the head outwards. The first loses no
    limb for good: 17 to 29 mm off in four rendered captures, where the paper's is 80 to 300."""
    joint: JointMethodSettings = field(default_factory=JointMethodSettings)
    paper: PaperMethodSettings = field(default_factory=PaperMethodSettings)
    extremities: ExtremitySettings = field(default_factory=ExtremitySettings)
    doubts: DoubtSettings = field(default_factory=DoubtSettings)

    def __post_init__(self) -> None:
        check_ranges(self)

    def read_by_method(self) -> "PoseFittingSettings":
        """Return the settings with the other method's at their defaults: they are not read."""
        if self.method == "joint":
            return replace(self, paper=PaperMethodSettings())
        return replace(self, joint=JointMethodSettings())


def fit_take(
    archive: str, capture: str, digest: str, hulls: Sequence[Block], colors: Sequence[Block],
    initial: Block, into: str, settings: PoseFittingSettings,
    provisional: ProvisionalSettings | None = None, still: Block | None = None,
) -> Written:  # fmt: skip
    """Fit the pose of every frame of a take.

    Parameters
    ----------
    archive, capture, digest, hulls, colors, into
        As for `model_take`.
    initial
        What `model_take` wrote.
    settings
        The method and its numbers.
    provisional
        How frames are labeled that the method `paper` fits; `joint` reads no such labels.
    still
        As for `model_take`.

    Returns
    -------
    Written
        The arrays are `joint` (time, 21, 3) and `position` (time, 11, 3), m, `rotation`
        (time, 11, 3, 3), `quality` (time, 11), `doubtful` (time,), why it is so as of
        `find_doubts` (`unexplained` where `find_still_take` told so, too), of the method `joint`
        also `doubt` (time, 11) as of `settle_doubt`, `hands_unsure` and `feet_unsure` (time,) bool,
        what labels voxels (of `joint` the body's fields, `turn` and `shift` a frame, and `staying`,
        the numbers of voxels in which something stays off a body that was measured with
        confidence; of
        `paper` `blob_mean` and `blob_inverse` a frame), the joints that the body was measured
        with (`initial_joint`) and the labels of its voxels (`initial_label`), and where face and
        hands were seen (`seen`), with the colors of skin.
    """
    begun = time.monotonic()
    source = capture_of(capture, digest)
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(source), hulls, colors, still)
    first = read_block(place, initial)
    taken = Start(
        initial.start, first["position"], first["label"], float(first["stature_m"]), source.fps
    )
    with within(0.0, _SEEN):
        placed = settings.method == "paper" or source.initial
        exchange = cache(lambda: _with_feet_exchanged(frames, taken))
        seen = find_extremities(
            _Surfaces(frames), source.fps, taken.stature_m,
            dict(zip(JOINTS, taken.position, strict=True)), initial_frame=taken.frame,
            exchange_cost=None if placed else lambda: exchange()[1], settings=settings.extremities,
        )  # fmt: skip
        start = exchange()[0] if seen.feet_exchanged else taken
    with within(_SEEN, _FITTED):
        if settings.method == "joint":
            measured = float(first["confidence"]) >= settings.doubts.least_confidence
            measured &= len(frames) >= _LONG_S * source.fps
            arrays, blobs = _fit_jointly(
                frames, start, seen, source.initial, settings.joint, measured=measured
            )
        else:
            rule = provisional or ProvisionalSettings()
            arrays = fit_as_paper(frames, start, seen, settings.paper, rule)
            blobs = list(zip(arrays["blob_mean"], arrays["blob_inverse"], strict=True))
    with within(_FITTED, 1.0):
        arrays |= find_doubts(
            frames, arrays["doubtful"], blobs, seen.position[:, 1:], source.fps,
            initial_frame=start.frame, confidence=float(first["confidence"]),
            settings=settings.doubts,
        )  # fmt: skip
        if still:
            told = read_block(place, still)["unexplained"]
            arrays["unexplained"] = arrays["unexplained"] | told
            arrays["doubtful"] = arrays["doubtful"] | told
        if "doubt" in arrays:
            arrays |= settle_doubt(arrays["doubt"], arrays["quality"], arrays, settings.doubts)
    _logger.info("fitted %d frames, %d doubtful", len(frames), int(arrays["doubtful"].sum()))
    arrays["initial_label"] = start.label
    arrays["seen"] = seen.position
    arrays["skin_hand"], arrays["skin_face"] = seen.model.hand, seen.model.face
    return write_block(place, into, (0, len(frames)), arrays, begun)


def cues_of(seen: Extremities) -> dict[str, Any]:
    """Return what was seen of face, hands and feet as `fit_poses` takes it."""
    return {
        "cues": np.concatenate([seen.position, seen.foot], axis=1),
        "cue_weights": np.concatenate([seen.weight, seen.foot_weight], axis=1),
        "hand_ends": seen.hand_ends,
    }


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


def _fit_jointly(
    frames: VoxelFrames, start: Start, seen: Extremities, given: Path | None,
    settings: JointMethodSettings, *, measured: bool,
) -> tuple[dict[str, NDArray], Blobs]:  # fmt: skip
    """Fit all segments of all frames at once; `measured` allows to ask what stays off the body."""
    fitted = fit_poses(
        HullFrames(frames),
        frames.grid,
        start.rate_hz,
        start.position,
        start.label,
        initial_frame=start.frame,
        surfaces=frames.surface,
        settings=_hold_given_joints(given, settings),
        **cues_of(seen),
    )
    fitted, doubt = doubt_and_repair(fitted, seen.candidates)
    index = frames.index(start.frame)
    center = voxel_centers(frames.grid, index)
    joints = dict(zip(JOINTS, fitted.initial, strict=True))  # where bones were seen to turn
    label = _labels_to_carry(given, center, start.label, joints)
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
        "doubt": doubt,
        "doubtful": fitted.doubtful | fitted.unsure_sides.any(axis=1),
        "hands_unsure": fitted.unsure_sides[:, 0],
        "feet_unsure": fitted.unsure_sides[:, 1],
        "turn": turn,
        "shift": shift,
        "staying": _find_staying(frames, fitted) if measured else np.zeros(0, int),
        **{f"field_{name}": np.asarray(value) for name, value in vars(fields).items()},
    }
    return arrays, [fitted_blobs(fitted, frame) for frame in range(len(frames))]


def _find_staying(frames: VoxelFrames, fitted: FittedPoses) -> NDArray[np.int64]:
    """Return the numbers of the voxels where something stays off the body."""
    some = frames_all_over(len(frames), _LOOKED_AT)
    hulls = [frames.hull(frame) for frame in some]
    return find_staying(hulls, fitted.position[some], frames.grid, fitted.model.stature)


def _hold_given_joints(given: Path | None, settings: JointMethodSettings) -> JointMethodSettings:
    """Return the settings with which joints that a person placed stay where they are.

    Placed within 1.5 cm they are better than what the bones' motion tells: moved, the mean error
    was 0.4 to 3 mm larger in the first 90 frames of each of six rendered takes.
    """
    return settings if given is None else replace(settings, joint_rounds=0)


def _with_feet_exchanged(frames: VoxelFrames, start: Start) -> tuple[Start, float]:
    """Return what a take begins with if its feet were taken for each other, and what that costs.

    Legs that stand one before the other, or crossed, show little of which foot is whose.
    """
    index = frames.index(start.frame)
    own = start.label > 0
    joints = complete_joints(dict(zip(JOINTS, start.position, strict=True)))
    joints, worse = exchange_feet(joints, index[own], frames.grid, start.stature_m)
    label = np.zeros_like(start.label)
    label[own] = label_points(voxel_centers(frames.grid, index[own]), joints)
    position = np.array([joints[name] for name in JOINTS])
    return replace(start, position=position, label=label), max(worse, 0.0)


def _labels_to_carry(
    given: Path | None, center: NDArray[np.float64], label: NDArray[np.integer],
    joints: dict[str, NDArray[np.float64]],
) -> NDArray[np.integer]:  # fmt: skip
    """Return the labels that final ones are carried from: arms whole, unless a person labeled."""
    if given and read_initial(given).label is not None:
        return label
    whole = label_points(center, complete_joints(joints), whole_arms=True)
    return np.where(label > 0, whole, 0).astype(np.uint8)
