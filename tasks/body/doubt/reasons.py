"""Tell why frames of a take are doubtful, as far as a reason can be named.

What is no matter of a limb is found here: a body that was badly measured, another person, something
held, a performer who leaves the volume. How likely a limb is in the wrong place is asked elsewhere
(`evidence`, `probability`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.engine.settings import Positive, Share, check_ranges
from tasks.engine.threads import side_by_side
from tasks.geometry.runs import runs
from tasks.geometry.sides import is_cut_off
from tasks.geometry.voxel_lines import lines_of
from tasks.geometry.voxels import voxel_centers, voxel_index
from tasks.reconstruction.voxel_frames import VoxelFrames

_LOOKED_AT = 3000
"""How many voxels of a frame are looked at, about [voxels]. They tell a share of 0.03 to 0.003."""

_OF_THE_WHOLE = ("unmeasured", "unexplained", "cut_off")
"""The reasons that are no matter of one limb."""


@dataclass(frozen=True)
class DoubtSettings:
    """Everything that makes a pose doubtful.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    doubtful: Share = 0.06
    """A frame is doubtful where some segment is in the wrong place with a greater probability. Of
    dances left out of the learning it found 0.95 of the wrong frames, and 0.39 of the frames that
    it named were wrong; 0.05 has 0.97 and 0.37, 0.08 has 0.91 and 0.42, 0.14 has 0.85 and 0.49. It
    is lower than 0.8 asks for: of fifteen other captures it found 0.84, and 0.08 only 0.75."""

    other_cause: Share = 0.15
    """How doubtful each segment is at least where the body was measured with little confidence,
    voxels belong to nothing, or the performer touches a side of the volume. In rendered captures of
    one performer .07 to .28 of the segments of such frames were in the wrong place; it is more than
    `doubtful`, for what two people or an umbrella do is worse than what was learned from."""

    far: Positive = 4.0
    """How far from every blob a voxel belongs to nothing that was fitted [standard deviations].
    Chosen by eye on the shared captures; not measured."""

    unexplained: Share = 0.03
    """How much more of a frame's voxels than of the initial frame's may be so far. More is a limb
    that the pose has lost, another person, or something held: it was at most 0.007 more in four
    captures, 0.06 where the lower legs were lost, 0.19 with an umbrella, 0.5 with another person.
    """

    hidden_s: Positive = 0.3
    """How long a hand may be unseen. Its place is a guess then: of 78 such frames of eighteen
    captures that nothing else made doubtful, a joint was more than 15 cm off in 45."""

    least_confidence: Share = 0.6
    """A body that was measured with less confidence makes every frame doubtful. It was 0.69 and
    more in eighteen captures that were followed, 0.33 and 0.44 in two whose legs were taken for
    each other or that lacked limbs."""

    def __post_init__(self) -> None:
        check_ranges(self)


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
        Which frames the method itself doubts.
    blobs : sequence of ((blob, 3), (blob, 3, 3))
        Mean, m, and inverse covariance, 1 / m**2, of the fitted body in each frame.
    hands : (time, 2, 3)
        Where right and left hand were seen, NaN where they were not.
    rate_hz
        Frames a second.
    initial_frame, confidence
        The frame in which the body was measured, and the confidence of that.
    settings
        What makes a pose doubtful.

    Returns
    -------
    dict of (time,) bool
        `unmeasured`: the body was measured with little confidence; `unexplained`: voxels belong to
        no blob; `cut_off`: the performer touches a side of the volume; `hidden`: a hand was not
        seen for long; `doubtful`: any of these, or the method itself doubts the frame.
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


def settle_doubt(
    doubt: NDArray[np.floating],
    quality: NDArray[np.floating],
    found: Mapping[str, NDArray[np.bool_]],
    settings: DoubtSettings,
) -> dict[str, NDArray]:
    """Return how doubtful segments are when all reasons are heard, and which frames are doubtful.

    Parameters
    ----------
    doubt : (time, 11) float
        How likely each segment is in the wrong place, by what speaks against its limb.
    quality : (time, 11) float
        How much of each segment is where it should be; 0 throughout where nobody was seen.
    found
        The reasons of `find_doubts`.
    settings
        What makes a pose doubtful.

    Returns
    -------
    dict
        `doubt` (time, 11) float32, 1 where nobody was seen; `doubtful` (time,) bool.
    """
    other = np.logical_or.reduce([found[name] for name in _OF_THE_WHOLE])
    least = np.where(quality.any(axis=1), settings.other_cause * other, 1.0)
    settled = np.maximum(doubt, least[:, None]).astype(np.float32)
    return {"doubt": settled, "doubtful": settled.max(axis=1) > settings.doubtful}


def unexplained_share(
    center: NDArray[np.floating],
    mean: NDArray[np.floating],
    inverse: NDArray[np.floating],
    *,
    beyond: float,
) -> float:
    """Return the share of voxels that are far from all blobs.

    Parameters
    ----------
    center : (voxel, 3) float
        An even sample of a frame's voxels, metres.
    mean : (blob, 3) float
        Middle of each blob, metres.
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
    """Return how many points are farther from every blob than `beyond`, in variances."""
    far, b = 0, 0
    for point in points:
        for _ in range(len(mean)):  # the blob that the point before was near to comes first
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
