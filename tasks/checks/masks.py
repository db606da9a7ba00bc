"""Whether masks that were made elsewhere say where the performer is."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from storage.formats.reading import listed

_MOST_GRAY = 0.15
"""Of how much of a picture a mask is neither black nor white [share]. Soft edges of a performer are
some hundredths; a film has more than half. Chosen, not measured."""
_MOST_WHITE = 0.5
"""Of how much of a picture, and of its border, a mask is white where it is inverted [share]."""
_DARK = 25.0
"""Largest value of a mask that is wholly black [levels of 0 to 255]. What codecs change."""
_HALF = 128.0
"""Smallest value that is of a silhouette [levels of 0 to 255]."""


def judge_masks(facts: NDArray[np.float64], names: Sequence[str]) -> list[str]:
    """Return what is wrong with masks, a sentence each.

    Parameters
    ----------
    facts : (time, camera, 4) float64
        Of `tasks.reconstruction.regions.masks.mask_facts`, of some frames.
    names
        What the cameras are called.
    """
    white, border, gray = np.median(facts[..., :3], axis=0).T
    brightest = facts[..., 3].max(axis=0)
    pictures = gray > _MOST_GRAY
    inverted = ~pictures & (white > _MOST_WHITE) & (border > _MOST_WHITE)
    faint = ~pictures & (brightest > _DARK) & (brightest < _HALF)
    faults = []
    if pictures.any():
        faults.append(
            f"the masks of camera {_of(names, pictures)} are pictures, not masks: "
            f"{gray[pictures].max():.0%} of them is neither black nor white; make the performer "
            "white and all else black, or all else transparent (a film on black says nothing)"
        )
    if inverted.any():
        faults.append(
            f"the masks of camera {_of(names, inverted)} are inverted: {white[inverted].min():.0%} "
            "of the picture, and its border, are white, as the performer should be; invert them"
        )
    if faint.any():
        faults.append(
            f"the masks of camera {_of(names, faint)} are too dark: their largest value is "
            f"{brightest[faint].max():.0f} of 255, and from {_HALF:.0f} on a pixel is the "
            "performer; write 255 for one performer"
        )
    return faults


def _of(names: Sequence[str], chosen: NDArray[np.bool_]) -> str:
    return listed([name for name, each in zip(names, chosen, strict=True) if each])
