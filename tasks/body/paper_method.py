"""The paper's way from frame to frame: provisional labels, pose, final labels (3.4).

Each frame is labeled by the frame before, its pose is fitted to those provisional labels from
the head outwards, and the pose gives the final labels that the next frame is labeled by.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.segments import place_ellipsoids
from tasks.body.anatomy.shape import measure_body
from tasks.body.extremities.places import Extremities
from tasks.body.labels.final import label_frame
from tasks.body.labels.provisional import ProvisionalSettings, label_provisionally
from tasks.body.labels.skin import label_skin, skin_table
from tasks.body.poses.paper import PaperMethodSettings, fit_frame_as_paper, join_poses
from tasks.engine.progress import report
from tasks.geometry.voxel_lines import lines_of
from tasks.geometry.voxels import voxel_centers
from tasks.reconstruction.voxel_frames import VoxelFrames

_STARVED = 0.5
"""A pose is doubtful when a smaller share of a segment's voxels is inside its own ellipsoid. An
ellipsoid of two standard deviations holds some 0.75 of the voxels that it was made from."""


@dataclass(frozen=True, eq=False)
class Start:
    """What a take begins with, and how fast it goes on."""

    frame: int
    position: NDArray[np.float64]
    """(21, 3) joints of that frame, m."""
    label: NDArray[np.uint8]
    """(voxel,) its segments, 1 to 11; 0 is none."""
    stature_m: float
    rate_hz: float


def fit_as_paper(
    frames: VoxelFrames,
    start: Start,
    seen: Extremities,
    settings: PaperMethodSettings,
    provisional: ProvisionalSettings,
) -> dict[str, NDArray]:
    """Fit the pose of every frame of a take, as the digitization paper does.

    Frames before the initial one keep its pose, and frames without voxels that of the frame
    before.

    Parameters
    ----------
    frames
        The take's hulls and colors.
    start
        The initial model.
    seen
        Where face and hands were seen: the skin there keeps its label.
    settings, provisional
        How poses are searched for, and how frames are labeled for that.

    Returns
    -------
    dict
        The arrays of `fit_take` that tell the pose, and `blob_mean` (time, 11, 3), m, and
        `blob_inverse` (time, 11, 3, 3), 1 / m**2, of the segments' distributions.
    """
    center = voxel_centers(frames.grid, frames.index(start.frame))
    body = measure_body(center, start.label, start.position)
    is_skin = skin_table({"skin_hand": seen.model.hand, "skin_face": seen.model.face})
    reach_m = provisional.reach_m(start.stature_m, start.rate_hz)
    pose, label, previous = (body.position, body.rotation), start.label, start.frame
    found = [(*pose, np.ones(11))]
    means, inverses = [], []
    for frame in range(len(frames)):
        report(frame, len(frames))
        index, lines = frames.index(frame), lines_of(frames.hull(frame))
        if frame > start.frame and len(index):
            skin = label_skin(
                frames, frame, lines, seen.position[frame], is_skin,
                reach_m=reach_m, least_m2=provisional.least_skin_m2,
            )  # fmt: skip
            labeled = label_provisionally(
                lines, lines_of(frames.hull(previous)), label, body.shape.volume_share,
                provisional, skin_label=skin,
            )  # fmt: skip
            found.append(
                fit_frame_as_paper(
                    voxel_centers(frames.grid, index), labeled, body.shape, pose, settings,
                    rate_hz=start.rate_hz, stature_m=start.stature_m,
                )
            )  # fmt: skip
            pose, previous = found[-1][:2], frame
        elif frame:
            found.append((*pose, np.zeros(11) if frame > start.frame else np.ones(11)))
        mean, inverse = place_ellipsoids(body.shape, *pose)
        means.append(mean)
        inverses.append(inverse)
        if frame > start.frame and previous == frame:
            label = label_frame(voxel_centers(frames.grid, index), lines, mean, inverse)
    track = join_poses(body.shape, found)
    return {
        "initial_joint": start.position,
        "joint": track.joint,
        "position": track.position,
        "rotation": track.rotation,
        "quality": track.quality,
        "doubtful": track.quality.min(axis=1) < _STARVED,
        "blob_mean": np.stack(means),
        "blob_inverse": np.stack(inverses),
    }
