"""Say what a distance means: named levels, measured on dance whose truth is known.

    same   as near as the same dancer in another performance of the same movement
    like   as near as another dancer's same movement

Beyond `like` is nothing like it. The paper leaves its threshold open (section 5); docs/retrieval.md
has how these were measured, and what share of true and of false matches lies within each. They hold
for clips of about two seconds and more, compared with the steps `slope`: a shorter clip is near to
something everywhere. `tasks.retrieval.chance` tells that, on the archive itself.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.weighting import SearchSettings, joint_weights

LEVELS = ("same", "like")
"""The names of the levels, the nearer first."""

PART_LEVELS: Mapping[str, tuple[float, float]] = {
    **{p: (0.05, 0.07) for p in PARTS},
}
"""The distance up to which a match of a part is `same`, and `like` [statures]."""

JOINT_LEVELS: Mapping[str, tuple[float, float]] = {j: (0.05, 0.07) for j in JOINTS}
"""The same of each joint, compared from the hips, for weights that are no part's."""

_SHOWN = 40
"""How much of what is no threshold is shown [characters]. Chosen: half a line."""
_PATH_LEVELS = (0.1, 0.2)
"""What the path channel may add of a difference in velocity, each level [statures/s]."""


def level_thresholds(settings: SearchSettings) -> dict[str, float]:
    """Return the distance up to which a match is of each level, the nearer first.

    Weights that are no part's have the mean of the levels of their joints, weighted so. Where the
    path counts, what it adds to matches of that level is allowed for.

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
    reach = np.array(PART_LEVELS[_one_side(part)]) if part else _weighted(weights)
    reach = reach + settings.path_weight * np.array(_PATH_LEVELS)
    return {name: round(float(value), 4) for name, value in zip(LEVELS, reach, strict=True)}


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


def _one_side(name: str) -> str:
    """Return the name of the right one of what both sides have."""
    if name.startswith("left-"):
        return name.replace("left-", "right-")
    return "R" + name[1:] if "R" + name[1:] in JOINTS else name


def _weighted(weights: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the mean of the joints' levels, by their weights."""
    reach = np.array([JOINT_LEVELS[_one_side(joint)] for joint in JOINTS])
    return np.average(reach, axis=0, weights=weights.astype(np.float64))
