"""What a search compares, and how much each joint counts (retrieval paper, section 3.4)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.engine.settings import Count, NotNegative, Positive
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.warping import STEPS

GREATEST_WEIGHT = 1e6
"""The greatest weight of a joint. Beside one of 1 it leaves nothing of all the others; far greater
ones leave the numbers of single precision, and nothing would be found."""
LEAST_WEIGHT = 1e-6
"""The least weight above zero. Chosen, as the inverse of the greatest."""


@dataclass(frozen=True)
class SearchSettings:
    """Everything that changes what a search finds."""

    part: str = "whole"
    """The joints compared, a name in `PARTS`. All of them where nothing is asked."""
    weights: tuple[tuple[str, float], ...] = ()
    """Pairs of joint and weight in place of the part's. A part weighs its joints 1, others 0."""
    steps: str = "slope"
    """The steps of the warping, "slope" or "paper". With the paper's own, 90 % of the ten best
    matches on real dance are shorter than a tenth of the query."""
    mirror: bool = False
    """Whether the left-right mirrored query is looked for too. The paper does not do so."""
    path_weight: NotNegative = 0.0
    """How much a difference of one stature a second in the path channel counts [s]. The paper
    compares without the path."""
    skip_doubtful: bool = False
    """Whether no match may be in frames whose pose is doubtful. All are searched where nothing is
    asked: most such frames are near enough to be found by."""
    threshold: Positive | None = None
    """Only matches nearer than this are found [statures]. None keeps all, up to `top`."""
    top: Count = 10
    """How many matches are found at most. Chosen: they fit a screen."""


def joint_weights(settings: SearchSettings, joints: Sequence[str] = JOINTS) -> NDArray[np.float32]:
    """Return the weight of each joint.

    Returns
    -------
    (joint,) float32

    Raises
    ------
    ValueError
        If a setting has no meaning; every fault is named.
    """
    faults = list(_faults(settings, joints))
    if faults:
        raise ValueError("; ".join(faults))
    weights = {name: 1.0 for name in PARTS[settings.part]} | dict(settings.weights)
    if not any(weights.values()):
        raise ValueError("every weight is zero; give at least one joint a weight above zero")
    return np.array([weights.get(name, 0.0) for name in joints], np.float32)


def _faults(settings: SearchSettings, joints: Sequence[str]) -> Iterable[str]:
    """Yield what is wrong with the settings, a sentence each."""
    if settings.part not in PARTS:
        yield f"there is no part {settings.part!r}; {_nearest(settings.part, list(PARTS))}"
    for name, weight in settings.weights:
        if name not in joints:
            yield f"there is no joint {name!r}; {_nearest(name, joints)}"
        if weight != 0 and not LEAST_WEIGHT <= weight <= GREATEST_WEIGHT:
            yield (
                f"the weight of {name} is {weight}; give a number from 0 up to "
                f"{GREATEST_WEIGHT:,.0f}, and above 0 at least {LEAST_WEIGHT:g}"
            )
    if settings.steps not in STEPS:
        yield f"there are no steps {settings.steps!r}; {_nearest(settings.steps, STEPS)}"
    if not 0 <= settings.path_weight <= GREATEST_WEIGHT:
        yield (
            f"the path weight is {settings.path_weight}; give a number from 0 up to "
            f"{GREATEST_WEIGHT:,.0f}"
        )
    if settings.threshold is not None and not settings.threshold > 0:
        yield f"the threshold is {settings.threshold}; give a distance above 0"
    if settings.top < 1:
        yield f"the {settings.top} nearest matches are asked for; ask for 1 or more"


def _nearest(name: str, names: Sequence[str]) -> str:
    """Return the part of a message that names what was probably meant."""
    folded = {other.casefold(): other for other in names}
    near = [folded[n] for n in get_close_matches(name.casefold(), folded, n=3, cutoff=0.5)]
    return f"did you mean {' or '.join(near)}?" if near else f"choose from {', '.join(names)}"
