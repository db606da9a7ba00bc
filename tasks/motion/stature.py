"""The stature of a take, measured on its joints, and which joints it has."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS

DEFAULT_STATURE_M = 1.6
"""The stature of a take that neither says nor shows one. Chosen, not measured; the contract says
it."""


def take_stature(track: NDArray[np.floating]) -> float:
    """Return the stature of a take, metres: as `measure_stature`, or the default.

    Parameters
    ----------
    track : (time, 21, 3) float, m
        The joints of `storage.schema.JOINTS`; NaN where one is missing.
    """
    stature = measure_stature(track, JOINTS)
    return stature if math.isfinite(stature) else DEFAULT_STATURE_M


def measure_stature(position: NDArray[np.floating], joints: Sequence[str]) -> float:
    """Return a dancer's stature: head to hips, and the legs along their bones.

    Parameters
    ----------
    position : (time, joint, 3) float, m
        NaN where a joint is missing.
    joints
        The names of the joint axis.

    Returns
    -------
    float
        Metres: the median over frames of |Head-Neck| + |Neck-hip middle| + |Hip-Knee| +
        |Knee-Ankle|, the leg being the mean of the legs seen in that frame. NaN where no
        frame has all of it.
    """
    place = {name: position[:, index].astype(np.float64) for index, name in enumerate(joints)}
    missing = np.full((len(position), 3), np.nan)

    def length(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(((a - b) ** 2).sum(axis=1))

    def joint(name: str) -> NDArray[np.float64]:
        return place.get(name, missing)

    legs = np.stack(
        [
            length(joint(f"{side}Hip"), joint(f"{side}Knee"))
            + length(joint(f"{side}Knee"), joint(f"{side}Ankle"))
            for side in "RL"
        ]
    )
    seen = np.isfinite(legs)
    leg = np.where(seen, legs, 0).sum(axis=0) / np.where(seen.any(axis=0), seen.sum(axis=0), np.nan)
    middle = (joint("RHip") + joint("LHip")) / 2
    stature = length(joint("Head"), joint("Neck")) + length(joint("Neck"), middle) + leg
    stature = stature[np.isfinite(stature)]
    return float(np.median(stature)) if len(stature) and np.median(stature) > 0 else float("nan")


def joints_present(position: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which joints a take has: those present in at least half of its frames.

    Parameters
    ----------
    position : (time, joint, 3) float
        NaN where a joint is missing.
    """
    present = np.isfinite(position).all(axis=2)
    return 2 * present.sum(axis=0) >= max(len(position), 1)
