"""What a motion file holds, before anything is made of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MotionFile:
    """The markers (C3D, TRC) or bones (BVH) of one file, in the file's own unit and axes."""

    source: str
    """Which reader read it: "c3d", "trc" or "bvh"."""
    names: tuple[str, ...]
    """A name a marker or bone, as the file spells it, with composed letters (NFC); a BVH end site
    is "<bone> End"."""
    position: NDArray[np.float64]
    """(time, marker, space), in the file's unit; NaN in all three where it is missing."""
    rate_hz: float
    """Frames a second."""
    unit_m: float | None
    """Metres in one unit, or None where the file does not say."""
    up: str | None
    """The axis that points up ("x", "y" or "z"), or None where the format does not say."""
    notes: tuple[str, ...] = ()
    """What the reader had to assume or leave out, a sentence each, for the user to read."""
    rest: NDArray[np.float64] | None = None
    """(marker, space): where the bones of a BVH file are while nothing is turned; else None."""
