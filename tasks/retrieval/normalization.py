"""Make motions comparable, and pack them for the search (retrieval paper, section 3.3).

A frame's origin becomes the middle of the hips; the frame is turned about Y until the
horizontal RHip->LHip points to +Z, so that the dancer faces -X and left is +Z; lengths become
statures. Samples are taken at the first time + n / 30 Hz, between frames by linear
interpolation.

A packed take is one float32 array (row, sample):

    0-62    x, y, z of each joint, origin at the hips
    63-65   the middle of the shoulders in that frame; the paper's other origin (3.3, for the
            arms) is joint minus these rows, so the joints are stored once
    66-68   the path channel: forward, side and turning velocity (`tasks.retrieval.paths`)

What is missing is NaN; a frame without hips has no frame of the body and is NaN in every row.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.retrieval.paths import path_channel

INDEX_RATE_HZ = 30.0
"""The rate at which motions are compared."""


_ARM = ("Shoulder", "Elbow", "Wrist", "Fin")
_LEG = ("Hip", "Knee", "Ankle", "Heel", "Foot")


def _both(names: Sequence[str]) -> tuple[str, ...]:
    """Return the joints of the right side, then of the left."""
    return tuple(side + name for side in "RL" for name in names)


PARTS: dict[str, tuple[str, ...]] = {
    "whole": JOINTS,
    "upper": ("Head", "Neck", "Waist", *_both(_ARM)),
    "lower": _both(_LEG),
    "arms": _both(_ARM),
    "right-arm": tuple("R" + name for name in _ARM),
    "left-arm": tuple("L" + name for name in _ARM),
    "legs": _both(_LEG),
    "right-leg": tuple("R" + name for name in _LEG),
    "left-leg": tuple("L" + name for name in _LEG),
    "feet": _both(("Heel", "Foot")),
    "hands": _both(("Wrist", "Fin")),
    "head": ("Head", "Neck"),
}
"""The sets of joints to search with; "whole" is every joint in the order of the packed rows."""

SHOULDER_ROWS = slice(63, 66)
"""The packed rows that hold the middle of the shoulders."""

PATH_ROWS = slice(66, 69)
"""The packed rows that hold the path channel."""

ROWS = 69
"""How many rows a packed take has. 21 joints, the shoulders' middle and the path, 3 each."""

OTHER_SIDE: NDArray[np.int64] = np.array(
    [JOINTS.index({"R": "L", "L": "R"}.get(name[0], name[0]) + name[1:]) for name in JOINTS]
)
"""(21,) The joint that a mirror puts in a joint's place."""

_ON_FRAME = 1e-6
"""How near to a frame a sample is the frame [frames]. Far above rounding, far below a frame."""
_HIPS_APART_MIN = 1e-3
"""Distance over the floor below which the hips point nowhere [statures]. 2 mm; chosen, not
measured."""
_BLOCK = 1 << 15
"""How many samples are normalized at a time. An hour of motion needs no gigabytes then."""


def sample_count(frames: int, rate_hz: float) -> int:
    """Return how many samples at the index rate a take of that many frames has."""
    return int(np.floor((frames - 1) * INDEX_RATE_HZ / rate_hz + _ON_FRAME)) + 1


def frame_of_sample(sample: int, rate_hz: float) -> int:
    """Return the frame nearest in time to a sample; of two equally near, the later."""
    return int(np.floor(sample * rate_hz / INDEX_RATE_HZ + 0.5))


def sample_of_frame(frame: int, rate_hz: float, frames: int) -> int:
    """Return the sample nearest in time to a frame of a take of `frames` frames."""
    nearest = int(np.floor(frame * INDEX_RATE_HZ / rate_hz + 0.5))
    return min(nearest, sample_count(frames, rate_hz) - 1)


def clip_samples(start: int, end: int, rate_hz: float, frames: int) -> tuple[int, int]:
    """Return the first and last sample of the clip of frames `start` to `end`, inclusive.

    Raises
    ------
    ValueError
        If the clip is empty or reaches beyond the take.
    """
    if not 0 <= start <= end < frames:
        raise ValueError(
            f"the clip {start}-{end} is not within the take; "
            f"give START-END with 0 <= START <= END <= {frames - 1}"
        )
    return sample_of_frame(start, rate_hz, frames), sample_of_frame(end, rate_hz, frames)


def pack_motion(
    position: NDArray[np.floating], rate_hz: float, stature_m: float
) -> NDArray[np.float32]:
    """Return a take normalized, resampled and packed for the search.

    Parameters
    ----------
    position : (time, 21, 3) float, m
        The joints in the order of `PARTS["whole"]`; NaN where one is missing.
    rate_hz
        Frames a second of `position`.
    stature_m
        The stature of the dancer: of the whole take, also when a clip of it is packed.

    Returns
    -------
    (69, sample) float32
        See the head of this module. A sample on a frame is that frame; between two frames it
        is missing where either is.

    Raises
    ------
    ValueError
        If the shape is another, or the rate or stature is not a positive number.
    """
    if position.ndim != 3 or position.shape[1:] != (len(JOINTS), 3) or not len(position):
        raise ValueError(
            f"positions have shape {position.shape}, but "
            f"(time, {len(JOINTS)}, 3) with at least one frame is wanted"
        )
    for name, value in (("rate_hz", rate_hz), ("stature_m", stature_m)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} is {value}; give a positive number")
    samples = sample_count(len(position), rate_hz)
    rows = np.empty((ROWS, samples), np.float32)
    middle, left = np.empty((2, samples, 2))
    for first in range(0, samples, _BLOCK):
        block = slice(first, min(first + _BLOCK, samples))
        raw = _resample(position, rate_hz, np.arange(block.start, block.stop)) / stature_m
        origin, left[block] = _frame_of_body(raw)
        middle[block] = origin[:, ::2]
        rows[: SHOULDER_ROWS.stop, block] = _normalize(raw, origin, left[block])
    rows[PATH_ROWS] = path_channel(middle, left, INDEX_RATE_HZ)
    return rows


def mirror_rows(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return packed rows (row, sample) with left and right exchanged.

    The sides of the joints change places and Z, the path's side velocity and its turning
    change sign.
    """
    mirrored = rows.copy()
    mirrored[: SHOULDER_ROWS.start] = (
        rows[: SHOULDER_ROWS.start].reshape(len(JOINTS), 3, -1)[OTHER_SIDE].reshape(63, -1)
    )
    mirrored[2 : SHOULDER_ROWS.stop : 3] *= -1
    mirrored[PATH_ROWS.start + 1 : PATH_ROWS.stop] *= -1
    return mirrored


def _resample(
    position: NDArray[np.floating], rate_hz: float, sample: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return raw positions (sample, joint, 3) at the samples, NaN where not finite."""
    at = sample * rate_hz / INDEX_RATE_HZ
    nearest = np.rint(at)
    at = np.where(np.abs(at - nearest) < _ON_FRAME, nearest, at)
    before = at.astype(np.int64)
    share = (at - before)[:, None, None]
    # a take in the archive is float32, so a file that is asked with is compared as float32 too
    with np.errstate(over="ignore", invalid="ignore"):
        first = position[before].astype(np.float32).astype(np.float64)
        after = position[np.minimum(before + 1, len(position) - 1)].astype(np.float32)
        between = np.where(share > 0, first + share * (after - first), first)
    return np.where(np.isfinite(between).all(axis=2, keepdims=True), between, np.nan)


def _frame_of_body(raw: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the hips' middle (sample, 3) and the unit (x, z) from right hip to left."""
    right, left = raw[:, JOINTS.index("RHip")], raw[:, JOINTS.index("LHip")]
    across = (left - right)[:, ::2]
    apart = np.hypot(across[:, 0], across[:, 1])
    apart[~(apart >= _HIPS_APART_MIN)] = np.nan
    return (left + right) / 2, across / apart[:, None]


def _normalize(
    raw: NDArray[np.float64], origin: NDArray[np.float64], left: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the rows of the joints and of the shoulders' middle in the body's frame."""
    x, y, z = np.moveaxis(raw - origin[:, None], 2, 0)
    left_x, left_z = left.T[:, :, None]
    turned = np.stack(
        [x * left_z - z * left_x, np.where(np.isnan(left_x), np.nan, y), x * left_x + z * left_z],
        axis=2,
    )
    shoulders = [JOINTS.index(f"{side}Shoulder") for side in "RL"]
    middle = turned[:, shoulders].mean(axis=1, keepdims=True)
    return np.concatenate([turned, middle], axis=1).reshape(len(raw), -1).T
