"""Stage: the fitted pose as the 21-joint track that search uses.

Every joint is fixed to the segment that carries it. Fingers close and bend, so that a length
measured once is too long: the finger tips are moved along the forearm to the end of its voxels. On
rendered captures that takes 5 to 18 mm from their error; head and toes, moved likewise, gain
nothing. Wrists, ankles and heels are nowhere to be seen in a hull; where the segment that carries
them fits badly they are flagged as filled. The paper has no such track; the joints are the
retrieval paper's.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Block, Written, read_block, write_block
from storage.formats.capture.capture import capture_of
from storage.schema import JOINTS
from tasks.body.anatomy.segments import CARRIERS
from tasks.capture.films import grid_of
from tasks.engine.kernels import njit
from tasks.engine.progress import within
from tasks.engine.settings import Count, NotNegative, Share, check_ranges
from tasks.engine.threads import side_by_side
from tasks.geometry.voxel_lines import labeled_centers, lines_of
from tasks.reconstruction.voxel_frames import VoxelFrames

_BONES = {"RFin": "RElbow", "LFin": "LElbow"}
"""The joints that are moved to their segment's end, and where the bone to each begins."""

ARM_LABELS = tuple(CARRIERS[JOINTS.index(name)] + 1 for name in _BONES)
"""The labels of the voxels that `move_to_ends` looks at."""

_INFERRED = tuple(k for k, name in enumerate(JOINTS) if name[1:] in ("Wrist", "Ankle", "Heel"))
"""The joints that are nowhere to be seen in a hull."""


@dataclass(frozen=True)
class JointTrackSettings:
    """Everything that changes a joint track.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    radius: NotNegative = 0.055
    """How far from the bone a voxel may be to be its end [statures]. 9 cm of 1.7 m, half a head or
    a hand's length across; a sleeve hangs lower."""

    most_change: NotNegative = 0.04
    """How far along the bone an end is moved at most [statures]. 7 cm of 1.7 m, as much as fingers
    that are bent."""

    end_share: Share = 0.98
    """How many of the voxels along the bone are before its end. The rest are stray; chosen by eye
    on the shared captures, not measured."""

    least_voxels: Count = 30
    """Voxels along a bone with which its end is measured at all. Chosen by eye on the shared
    captures; not measured."""

    least_quality: Share = 0.4
    """How many of a segment's voxels must fit, else what it carries unseen is inferred. An
    ellipsoid of its own voxels holds 0.75 of them."""

    def __post_init__(self) -> None:
        check_ranges(self)


def move_to_ends(
    joint: NDArray[np.floating],
    center: NDArray[np.floating],
    label: NDArray[np.integer],
    settings: JointTrackSettings,
    *,
    stature_m: float,
) -> NDArray[np.float64]:
    """Return one frame's joints with the finger tips at the ends of their voxels.

    Parameters
    ----------
    joint : (21, 3) float
        In the world, metres; NaN where missing.
    center : (voxel, 3) float
        Metres.
    label : (voxel,) int
        Final labels, 1 to 11; no more than those of `ARM_LABELS` are looked at.
    settings
        How ends are measured.
    stature_m
        Of the performer.
    """
    moved = np.array(joint, np.float64)
    for name, base in _BONES.items():
        tip, root = JOINTS.index(name), JOINTS.index(base)
        bone = moved[tip] - moved[root]
        length = float(np.linalg.norm(bone))
        if not length > 0:  # NaN, too
            continue
        bone = bone / length
        limits = (CARRIERS[tip] + 1, settings.radius * stature_m)
        along = _ways(np.asarray(center), np.asarray(label), moved[root], bone, limits)
        if len(along) >= settings.least_voxels:
            most = settings.most_change * stature_m
            change = float(np.quantile(along, settings.end_share)) - length
            moved[tip] += bone * min(max(change, -most), most)
    return moved


def build_joint_track(
    joint: NDArray[np.floating], quality: NDArray[np.floating], settings: JointTrackSettings
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the track of a take, and which of its joints are inferred.

    Parameters
    ----------
    joint : (time, 21, 3) float
        Of the fitted pose, metres.
    quality : (time, 11) float
        How well each segment fits, 0 to 1; all 0 where a frame has no voxels.
    settings
        What is evidence.

    Returns
    -------
    track : (time, 21, 3) float32
        Metres; NaN in frames without voxels.
    filled : (time, 21) bool
        True for wrists, ankles and heels where the segment that carries them fits badly: they
        are where the body's proportions put them.

    Raises
    ------
    ValueError
        If joints and qualities do not fit each other.
    """
    joint, quality = np.asarray(joint), np.asarray(quality)
    if joint.shape[1:] != (21, 3) or quality.shape != (len(joint), 11):
        raise ValueError(
            f"joints of shape {joint.shape} and qualities of shape {quality.shape} do not fit; "
            "pass (time, 21, 3) and (time, 11)"
        )
    track = np.array(joint, np.float32)
    track[(quality == 0).all(axis=1)] = np.nan
    filled = np.zeros(track.shape[:2], np.bool_)
    for k in _INFERRED:
        filled[:, k] = quality[:, CARRIERS[k]] < settings.least_quality
    return track, filled & np.isfinite(track).all(axis=2)


def track_take(
    archive: str, capture: str, digest: str, hulls: Sequence[Block], initial: Block,
    fitted: Block, labels: Sequence[Block], into: str, settings: JointTrackSettings,
) -> Written:  # fmt: skip
    """Write the joint track of a take as a block.

    Parameters
    ----------
    archive, capture, digest, into
        As for `model_take`.
    hulls, labels
        What `carve_block` and `label_block` wrote, in the order of the frames.
    initial, fitted
        What `model_take` and `fit_take` wrote.
    settings
        How ends are measured, and what is evidence.

    Returns
    -------
    Written
        The arrays are `position` (time, 21, 3) float32, m, and `filled` (time, 21) bool, as of
        `build_joint_track`.
    """
    begun = time.monotonic()
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(capture_of(capture, digest)), hulls)
    fit = read_block(place, fitted, ["joint", "quality"])
    stature_m = float(read_block(place, initial, ["stature_m"])["stature_m"])
    moved = []
    for block in labels:
        read = read_block(place, block)

        def move(frame: int, block: Block = block, read: Any = read) -> NDArray[np.float64]:
            label = read["label"][slice(*read["offset"][frame - block.start :][:2])]
            lines = lines_of(frames.hull(frame))
            center, ends = labeled_centers(frames.grid, lines, label, ARM_LABELS)
            return move_to_ends(fit["joint"][frame], center, ends, settings, stature_m=stature_m)

        with within(block.start / len(frames), block.end / len(frames)):
            moved += side_by_side(move, range(block.start, block.end))
    position, filled = build_joint_track(np.stack(moved), fit["quality"], settings)
    arrays = {"position": position, "filled": filled}
    return write_block(place, into, (0, len(moved)), arrays, begun)


@njit(cache=True, nogil=True)
def _ways(center: Any, label: Any, root: Any, bone: Any, limits: Any) -> Any:
    """Return how far along a bone the voxels of a label are that are near it, beyond its root."""
    own, radius = limits
    along = np.empty(len(center))
    found = 0
    for n in range(len(center)):
        if label[n] != own:
            continue
        x, y, z = center[n, 0] - root[0], center[n, 1] - root[1], center[n, 2] - root[2]
        way = x * bone[0] + y * bone[1] + z * bone[2]
        if way <= 0:
            continue
        x, y, z = x - way * bone[0], y - way * bone[1], z - way * bone[2]
        if np.sqrt(x * x + y * y + z * z) <= radius:
            along[found] = way
            found += 1
    return along[:found]
