"""Generated takes for the benchmarks: smooth motion with planted, warped copies of a query."""

import numpy as np
from numpy.typing import NDArray

from tasks.motion.stature import measure_stature
from tasks.retrieval.normalization import PARTS, ROWS
from tasks.retrieval.searching import Query, SearchSettings, clip_motion
from tasks.retrieval.segments import PackedTake

JOINTS = PARTS["whole"]
LEFT_OUT = ("Waist", "RHeel", "LHeel")
SETTINGS = SearchSettings(weights=tuple((name, 0.0) for name in LEFT_OUT))
"""The 18 joints of the benchmark."""

_BUILD_M = {
    "Head": (0.0, 0.75, 0.0),
    "Neck": (0.0, 0.5, 0.0),
    "Waist": (0.0, 0.1, 0.0),
    "Shoulder": (0.0, 0.45, 0.2),
    "Elbow": (0.0, 0.2, 0.3),
    "Wrist": (-0.1, 0.0, 0.35),
    "Fin": (-0.1, -0.1, 0.35),
    "Hip": (0.0, 0.0, 0.15),
    "Knee": (0.0, -0.42, 0.15),
    "Ankle": (0.0, -0.8, 0.15),
    "Heel": (0.05, -0.85, 0.15),
    "Foot": (-0.15, -0.85, 0.15),
}


def make_query(frames: int, seed: int = 1) -> tuple[NDArray[np.float64], float]:
    """Return positions (time, 21, 3) in metres at the index rate, and the dancer's stature."""
    build = np.array(
        [
            np.array(_BUILD_M.get(name) or _BUILD_M[name[1:]]) * (1, 1, -1 if name[0] == "R" else 1)
            for name in JOINTS
        ]
    )
    sway = _smooth(np.random.default_rng(seed), frames, 63, 0.12).T.reshape(frames, 21, 3)
    position = build + sway
    return position, measure_stature(position, JOINTS)


def pack_query(position: NDArray[np.float64], stature_m: float) -> Query:
    """Return the benchmark's query: its packing is part of the work."""
    return clip_motion(position, 30.0, stature_m)


def make_take(
    frames: int, query: Query, *, copies: int = 10, seed: int = 2
) -> tuple[PackedTake, list[int]]:
    """Return a take at the index rate, and the ends of the copies of the query in it."""
    rng = np.random.default_rng(seed)
    still = query.rows.mean(axis=1)
    rows = np.empty((ROWS, frames), np.float32)
    for row in range(ROWS):
        rows[row] = still[row] + _smooth(rng, frames, 1, 0.12)[0]
    length = query.rows.shape[1]
    ends = []
    for first in np.linspace(length, frames - 3 * length, copies).astype(int):
        stretched = int(length * rng.uniform(0.75, 1.3))
        at = np.linspace(0, length - 1, stretched)
        for row in range(ROWS):
            noise = _smooth(rng, stretched, 1, 0.004)[0]
            warped = np.interp(at, np.arange(length), query.rows[row])
            rows[row, first : first + stretched] = warped + noise
        ends.append(int(first + stretched - 1))
    return PackedTake("generated", rows, 30.0, frames, np.ones(21, bool)), ends


def compared_rows() -> NDArray[np.int64]:
    """Return the packed rows of the 18 joints."""
    kept = [index for index, name in enumerate(JOINTS) if name not in LEFT_OUT]
    return (3 * np.array(kept)[:, None] + np.arange(3)).ravel()


def _smooth(
    rng: np.random.Generator, frames: int, count: int, amplitude: float
) -> NDArray[np.float64]:
    """Return curves (curve, frame) that turn about three times a second."""
    step = 10
    knots = rng.normal(size=(count, frames // step + 5)) * amplitude
    fine = np.array(
        [np.interp(np.arange(frames + 2 * step) / step, range(k.size), k) for k in knots]
    )
    kernel = np.hanning(step + 2)[1:-1]
    kernel /= kernel.sum()
    return np.array([np.convolve(curve, kernel, "same")[step : step + frames] for curve in fine])
