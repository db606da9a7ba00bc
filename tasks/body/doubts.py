"""In which frames of a take a pose is doubtful that its method is content with, and why."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.engine.threads import side_by_side
from tasks.geometry.doubts import is_cut_off, unexplained_share
from tasks.geometry.voxel_lines import lines_of
from tasks.geometry.voxels import voxel_centers, voxel_index
from tasks.motion.gaps import runs
from tasks.reconstruction.voxel_frames import VoxelFrames

_LOOKED_AT = 3000  # voxels of a frame: a share of 0.03 is known to 0.003


@dataclass(frozen=True)
class DoubtSettings:
    """When a pose is doubtful that its method is content with."""

    far: float = 4.0
    """Standard deviations from every blob at which a voxel belongs to nothing that was fitted."""
    unexplained: float = 0.03
    """A larger share of such voxels than in the initial frame is a limb that the pose has lost,
    another person, or something held: at most 0.007 more in four captures, 0.06 where the lower
    legs were lost, 0.19 with an umbrella, 0.5 with another person."""
    hidden_s: float = 0.3
    """Where a hand is that was not seen for so long is a guess: of eighteen captures' 78 such
    frames that nothing else made doubtful, a joint was more than 15 cm off in 45."""
    least_confidence: float = 0.6
    """A body that was measured with less confidence makes every frame doubtful: 0.69 and more in
    eighteen captures that were followed, 0.33 and 0.44 in two whose legs were taken for each
    other or that lacked limbs."""


def find_doubts(
    frames: VoxelFrames,
    doubtful: NDArray[np.bool_],
    blobs: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
    hands: NDArray[np.float64],
    rate_hz: float,
    *,
    initial_frame: int,
    confidence: float,
    settings: DoubtSettings,
) -> dict[str, NDArray[np.bool_]]:
    """Return in which frames of a take a pose is doubtful, and why.

    Parameters
    ----------
    frames
        The take's voxels.
    doubtful : (time,) bool
        What the method itself doubts.
    blobs : sequence of ((blob, 3), (blob, 3, 3))
        Mean, m, and inverse covariance, 1 / m**2, of the fitted body in each frame.
    hands : (time, 2, 3)
        Where they were seen, NaN where they were not.
    rate_hz
        Frames a second.
    initial_frame, confidence
        Where the body was measured, and with what confidence.

    Returns
    -------
    dict of (time,) bool
        `unmeasured`: the body was measured with little confidence; `unexplained`: voxels belong to
        no blob; `cut_off`: the performer touches a side of the volume; `hidden`: a hand was not
        seen for long; `doubtful`: any of these, or what was given.
    """

    def look(frame: int) -> tuple[float, bool]:
        hull = frames.hull(frame)
        lines = lines_of(hull)
        some = voxel_index(hull, 0, step=max(1, lines.voxels // _LOOKED_AT))
        share = unexplained_share(
            voxel_centers(frames.grid, some), *blobs[frame], beyond=settings.far
        )
        return share, is_cut_off(lines, frames.grid.shape)

    share, cut_off = map(np.array, zip(*side_by_side(look, range(len(frames))), strict=True))
    hidden, long = np.zeros(len(frames), np.bool_), max(1, round(settings.hidden_s * rate_hz))
    for hand in np.isnan(hands[..., 0]).T:
        for first, end in runs(hand):
            hidden[first:end] |= end - first >= long
    found = {
        "unmeasured": np.full(len(frames), confidence < settings.least_confidence),
        "unexplained": share > share[initial_frame] + settings.unexplained,
        "cut_off": cut_off,
        "hidden": hidden,
    }
    return {**found, "doubtful": np.logical_or.reduce([doubtful, *found.values()])}
