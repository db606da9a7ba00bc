"""Calibrations of the University of Surrey's studios: `calibration.txt`, lines of numbers.

The number of cameras and the order of the distortion, then for each camera its first and last row
and column, fx, fy, cx, cy, the distortion, and rotation and translation from world to camera.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.formats.calibration.parts import Calibration, Parts, build_cameras, numbers_in

_WITHOUT_LENS = 20
"""How many numbers a camera has besides its distortion: 4 + 4 + 9 + 3."""
_MOST_ORDERS = 3
"""How many coefficients of radial distortion our model of lenses has: k1, k2, k3."""


def is_surrey(text: str) -> bool:
    """Return whether a text has as many numbers as its first two ask for."""
    return _table(text) is not None


def read_surrey(path: Path, text: str) -> Calibration:
    """Read the cameras, which are called cam1, cam2, ...: metres, distortion in normalized units.

    Raises
    ------
    InputError
        A camera's numbers cannot be used.
    """
    table = _table(text)
    cameras = () if table is None else enumerate(table, start=1)
    return Calibration(build_cameras(path, (_parts(n, row) for n, row in cameras)), 1.0, None, "y")


def _table(text: str) -> NDArray[np.float64] | None:
    """Return a row of numbers a camera, None where they are no such calibration."""
    head = numbers_in(text[:200])[:2]
    if len(head) < 2 or not all(number.is_integer() for number in head):
        return None
    count, orders = map(int, head)
    if count < 1 or not 0 <= orders <= _MOST_ORDERS:
        return None
    numbers = np.array(numbers_in(text)[2:])
    if numbers.size != count * (_WITHOUT_LENS + orders) or np.isnan(numbers).any():
        return None
    return numbers.reshape(count, -1)


def _parts(number: int, row: NDArray[np.float64]) -> Parts:
    ranges, (fx, fy, cx, cy), bent = row[:4].reshape(2, 2), row[4:8], row[8:-12]
    # some writers put columns first: the center of the lens tells
    across, down = min(
        ((ranges[1], ranges[0]), (ranges[0], ranges[1])),
        key=lambda pair: _off_middle(cx, pair[0]) + _off_middle(cy, pair[1]),
    )
    size = (across[1] - across[0] + 1, down[1] - down[0] + 1)
    k1, k2, k3 = (*bent, 0.0, 0.0, 0.0)[:3]
    matrix = [[fx, 0.0, cx - across[0]], [0.0, fy, cy - down[0]], [0.0, 0.0, 1.0]]
    return Parts(
        f"cam{number}", size, matrix, (k1, k2, 0.0, 0.0, k3), row[-12:-3].reshape(3, 3), row[-3:]
    )


def _off_middle(center: float, ends: NDArray[np.float64]) -> float:
    """Return how far from the middle of a range a center is, in shares of the range."""
    return abs(center - ends.mean()) / max(float(np.ptp(ends)), 1.0)
