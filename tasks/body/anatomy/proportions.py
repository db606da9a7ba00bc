"""The proportions of a body: what the joints that nobody sees are placed by.

Points are metres with y up.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def complete_joints(joints: Mapping[str, Points]) -> dict[str, Points]:
    """Return (3,) joints with the waist, wrists, ankles and heels put in where missing."""
    whole = {name: np.asarray(place, np.float64) for name, place in joints.items()}
    whole = {name: place for name, place in whole.items() if np.isfinite(place).all()}
    hips = (whole["RHip"] + whole["LHip"]) / 2.0
    front = np.cross(whole["LHip"] - whole["RHip"], [0.0, 1.0, 0.0])
    whole.setdefault("Waist", whole["Neck"] + 0.56 * (hips - whole["Neck"]))
    for side in "RL":
        elbow, tip = whole[f"{side}Elbow"], whole[f"{side}Fin"]
        knee, toe = whole[f"{side}Knee"], whole[f"{side}Foot"]
        shank = float(np.linalg.norm(knee - whole[f"{side}Hip"]))
        whole.setdefault(f"{side}Wrist", elbow + 0.62 * (tip - elbow))
        ahead = toe - whole[f"{side}Ankle"] if f"{side}Ankle" in whole else front
        whole.setdefault(f"{side}Heel", toe - 0.62 * shank * unit(ahead * [1.0, 0.0, 1.0]))
        above = np.array([0.0, 0.10 * shank, 0.0])
        ankle = whole[f"{side}Heel"] + 0.25 * (toe - whole[f"{side}Heel"]) + above
        whole.setdefault(f"{side}Ankle", ankle)
    return whole


def body_size(joints: Mapping[str, Points]) -> float:
    """Return the stature that the bones of the joints belong to, metres."""

    def length(a: str, b: str) -> float:
        return float(np.linalg.norm(joints[a] - joints[b]))

    hips = (joints["RHip"] + joints["LHip"]) / 2.0
    trunk = length("Head", "Neck") + float(np.linalg.norm(joints["Neck"] - hips))
    legs = [length(f"{s}Hip", f"{s}Knee") + length(f"{s}Knee", f"{s}Ankle") for s in "RL"]
    return (trunk + sum(legs) / 2.0) / 0.961


def unit(vector: Points) -> Points:
    """Return a vector of length 1; 0 where it has none."""
    return vector / max(float(np.linalg.norm(vector)), 1e-9)
