"""What every writer of motion files does in the same way."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def checked_track(
    position: NDArray[np.floating], names: Sequence[str], rate_hz: float, forbidden: str
) -> NDArray[np.float64]:
    """Return the positions with whole gaps, or say all that is wrong with the arguments."""
    position = np.asarray(position, np.float64)
    faults = []
    if position.ndim != 3 or position.shape[1:] != (len(names), 3):
        faults.append(f"position is {position.shape}, (time, {len(names)}, 3) is wanted")
    elif not position.size:
        faults.append("there is no frame or no joint to write")
    elif np.isinf(position).any():
        faults.append("a position is infinite; write NaN where one is missing")
    faults += names_faults(names, forbidden)
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        faults.append(f"rate_hz is {rate_hz}, a positive number is wanted")
    if faults:
        raise ValueError("; ".join(faults))
    gaps = np.isnan(position).any(axis=-1, keepdims=True)
    return np.where(gaps, np.nan, position)


def names_faults(names: Sequence[str], forbidden: str) -> list[str]:
    """Return what is wrong with names that are to stand in a file."""
    faults = []
    if len(set(names)) != len(names):
        faults.append("a name comes more than once")
    for name in names:
        if name != name.strip() or not name or any(letter in forbidden for letter in name):
            faults.append(f"the name {name!r} cannot stand in such a file; use plain letters")
    return faults


def number_lines(columns: NDArray[np.float64], formats: Sequence[str], separator: str) -> str:
    """Return a line a row, with nothing between the separators where a number is NaN."""
    form = separator.join(formats)
    return "".join(f"{form % tuple(row)}\n" for row in columns.tolist()).replace("nan", "")
