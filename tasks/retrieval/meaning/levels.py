"""Say what a distance means: named levels, measured on dance whose truth is known.

    same   as near as the same dancer in another performance of the same movement
    like   as near as another dancer's same movement

Beyond `like` is nothing like it. The paper leaves its threshold open (section 5); docs/retrieval.md
has how these were measured, and what share of true and of false matches lies within each. They hold
for clips of about two seconds and more, compared with the steps `slope`: a shorter clip is near to
something everywhere. `tasks.retrieval.meaning.chance` tells that, on the archive itself.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.retrieval.meaning.explaining import compared_about_shoulders
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.weighting import SearchSettings, joint_weights

LEVELS = ("same", "like")
"""The names of the levels, the nearer first."""

PART_LIKE: Mapping[str, float] = {
    "whole": 0.065,
    "upper": 0.055,
    "lower": 0.045,
    "arms": 0.045,
    "right-arm": 0.045,
    "legs": 0.045,
    "right-leg": 0.035,
    "feet": 0.065,
    "hands": 0.06,
    "head": 0.005,
}
"""The distance below which a match of a part is `like` [statures]. So near come three in a thousand
clips of another dance, by other dancers; nearly all of the same movement by other performers."""

JOINT_LIKE: Mapping[str, tuple[float, float]] = {
    "Head": (0.016, 0.008),
    "Neck": (0.01, 0.001),
    "Waist": (0.005, 0.005),
    "Shoulder": (0.011, 0.003),
    "Elbow": (0.034, 0.042),
    "Wrist": (0.045, 0.047),
    "Fin": (0.052, 0.052),
    "Hip": (0.001, 0.001),
    "Knee": (0.023, 0.023),
    "Ankle": (0.049, 0.049),
    "Heel": (0.046, 0.046),
    "Foot": (0.044, 0.044),
}
"""The same of a joint alone, compared from the hips and from the shoulders [statures]. The waist,
which the recorded dance lacks, and the heel are chosen between their neighbors."""

SAME_SHARE = 0.75
"""The distance below which a match is `same`, over that of `like`. Of salsas by the same dancer,
two in three matches of the whole body below it are repeats; of generated performers, the farthest
true matches of one have 0.8 of the distance of those of two."""

_SHOWN = 40
"""How much of what is no threshold is shown [characters]. Chosen: half a line."""
_PATH_LIKE = 0.12
"""What a unit of path weight adds to the distance of `like` [statures/s]. Measured with the weights
0.2 and 0.5 of the path."""

_LIMBS = ("RArm", "LArm", "RLeg", "LLeg", "Trunk")


def level_thresholds(settings: SearchSettings) -> dict[str, float]:
    """Return the distance up to which a match is of each level, the nearer first.

    Weights that are no part's have the weighted mean of what is `like` of their joints alone, times
    the square root of the number of limbs that they count: several limbs are seldom near at once.
    For the parts this comes within a quarter of what was measured. Where the path counts, what it
    adds is allowed for.

    Parameters
    ----------
    settings
        Of the search. Its threshold plays no role.

    Returns
    -------
    dict
        By the names in `LEVELS`, statures; empty for the steps `paper`, whose matches collapse to
        poses, so that their distances mean no movement.

    Raises
    ------
    ValueError
        If a setting has no meaning.
    """
    weights = joint_weights(settings)
    if settings.steps != "slope":
        return {}
    part = next((p for p in PARTS if _is_part(weights, p)), None)
    like = PART_LIKE[part.replace("left-", "right-")] if part else _like_of(weights)
    like += settings.path_weight * _PATH_LIKE
    return {"same": round(SAME_SHARE * like, 4), "like": round(like, 4)}


def level_of(distance: float, settings: SearchSettings) -> str | None:
    """Return the level of a match at this distance, or None for nothing like it."""
    levels = level_thresholds(settings)
    return next((name for name, reach in levels.items() if distance < reach), None)


def threshold_of(threshold: float | str | None, settings: SearchSettings) -> float | None:
    """Return a threshold as a distance, statures: a number, the name of a level, or None.

    Raises
    ------
    ValueError
        If a text is neither a number above 0 nor a level, or a setting has no meaning.
    """
    if threshold is None:
        return None
    if threshold in LEVELS:
        levels = level_thresholds(settings)
        if not levels:
            raise ValueError(
                f"the threshold {threshold!r} has no meaning with the steps {settings.steps!r}; "
                "give a distance above 0"
            )
        return levels[str(threshold)]
    try:
        value = float(threshold)
    except ValueError:
        value = math.nan
    if not value > 0:
        shown = str(threshold)[:_SHOWN]
        raise ValueError(f"the threshold is {shown}; give a distance above 0, same or like")
    return value


def _is_part(weights: NDArray[np.float32], part: str) -> bool:
    """Say whether these are the weights of a part, whatever their scale."""
    inside = np.isin(JOINTS, PARTS[part])
    return not weights[~inside].any() and weights.min(where=inside, initial=np.inf) == weights.max()


def _like_of(weights: NDArray[np.float32]) -> float:
    """Return the distance of `like` for weights that are no part's."""
    about = int(compared_about_shoulders(weights))
    limbs: dict[str, float] = {limb: 0.0 for limb in _LIMBS}
    for joint, weight in zip(JOINTS, weights.astype(np.float64), strict=True):
        name = joint.removeprefix(joint[0]) if joint not in JOINT_LIKE else joint
        limbs[_limb_of(joint)] += float(weight) * JOINT_LIKE[name][about]
    count = np.array(list(limbs.values()))
    # of limbs that count alike their number, of one that counts most little more than 1
    alike = count.sum() ** 2 / (count**2).sum()
    return float(count.sum() / weights.sum(dtype=np.float64) * math.sqrt(alike))


def _limb_of(joint: str) -> str:
    """Return the limb that a joint moves with."""
    if joint in PARTS["arms"]:
        return f"{joint[0]}Arm"
    return f"{joint[0]}Leg" if joint in PARTS["legs"] else "Trunk"
