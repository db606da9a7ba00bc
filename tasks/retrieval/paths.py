"""Where a dancer goes: what the normalization of the retrieval paper takes away.

Turned and moved into the frame of the body, turning left looks like turning right (retrieval
paper, section 4.4). The path channel says how the hips move, seen from the body, so that it
stays the same when the take is moved, turned or scaled. It goes beyond the paper, which names
it as work to come (section 5).
"""

import numpy as np
from numpy.typing import NDArray

WINDOW_S = 0.2
"""Time over which velocities are differences. Steps survive it, a marker's trembling does not."""

TURN_LEVER = 0.25
"""Distance from the axis at which turning is made a velocity, to be weighed against going
[statures]. About the elbow of a stretched arm, whose tip reaches half a stature."""


def path_channel(
    middle: NDArray[np.float64], left: NDArray[np.float64], rate_hz: float
) -> NDArray[np.float64]:
    """Return how the hips move, in the frame of the body.

    Parameters
    ----------
    middle : (sample, 2) float64, statures
        The middle of the hips on the floor (x, z).
    left : (sample, 2) float64
        The unit vector from right hip to left on the floor (x, z).
    rate_hz
        Samples a second.

    Returns
    -------
    (3, sample) float64, statures/s
        Velocity forward and to the left, and the turning rate (positive to the left) times
        `TURN_LEVER`. Central differences over `WINDOW_S`, one-sided at the ends; NaN where a
        sample of the difference is missing; zero where there is only one sample.
    """
    samples = len(middle)
    half = max(1, round(WINDOW_S / 2 * rate_hz))
    here = np.arange(samples)
    before = np.maximum(here - half, 0)
    after = np.minimum(here + half, samples - 1)
    seconds = np.maximum(after - before, 1) / rate_hz
    moved_x, moved_z = (middle[after] - middle[before]).T
    left_x, left_z = left.T
    (x0, z0), (x1, z1) = left[before].T, left[after].T
    turned = np.arctan2(x1 * z0 - z1 * x0, x1 * x0 + z1 * z0)
    return (
        np.stack(
            [
                moved_z * left_x - moved_x * left_z,
                moved_x * left_x + moved_z * left_z,
                turned * TURN_LEVER,
            ]
        )
        / seconds
    )
