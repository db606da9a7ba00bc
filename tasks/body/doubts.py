"""In which frames of a take a pose is doubtful that its method is content with, and why."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.engine.threads import side_by_side
from tasks.geometry.runs import runs
from tasks.geometry.sides import is_cut_off
from tasks.geometry.voxel_lines import lines_of
from tasks.geometry.voxels import voxel_centers, voxel_index
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


def unexplained_share(
    center: NDArray[np.floating],
    mean: NDArray[np.floating],
    inverse: NDArray[np.floating],
    *,
    beyond: float = 4.0,
) -> float:
    """Return the share of voxels that are far from everything that was fitted.

    Parameters
    ----------
    center : (voxel, 3) float
        Metres; some thousands, evenly from a frame's, tell a share of 0.03 to 0.003.
    mean : (blob, 3) float
        Of each blob, metres.
    inverse : (blob, 3, 3) float
        Inverse of each blob's covariance, 1 / square metres.
    beyond
        How many standard deviations are far.

    Returns
    -------
    float
        0 to 1; 0 where there is no voxel.
    """
    if not len(center):
        return 0.0
    return _count_far(center, mean, inverse, beyond**2) / len(center)


@njit(cache=True, nogil=True)
def _count_far(points: Any, mean: Any, inverse: Any, beyond: float) -> int:
    """Return how many points are farther from every blob, in squared standard deviations."""
    far, b = 0, 0
    for point in points:
        for _ in range(len(mean)):  # the blob that was near the point before comes first
            x, y, z = point[0] - mean[b, 0], point[1] - mean[b, 1], point[2] - mean[b, 2]
            squared = inverse[b, 0, 0] * x * x + inverse[b, 1, 1] * y * y
            squared += inverse[b, 2, 2] * z * z + 2 * inverse[b, 1, 2] * y * z
            squared += 2 * x * (inverse[b, 0, 1] * y + inverse[b, 0, 2] * z)
            if squared <= beyond:
                break
            b = (b + 1) % len(mean)
        else:
            far += 1
    return far
