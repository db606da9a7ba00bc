"""Write joints as a table of comma-separated values."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.files import write_beside
from storage.formats.motion import writing


def write_joint_csv(
    path: Path, position: NDArray[np.floating], names: Sequence[str], rate_hz: float
) -> None:
    """Write joints as a CSV file: `time` in seconds, then `<joint>_x`, `_y`, `_z` in metres.

    Parameters
    ----------
    path : Path
        Replaced when the whole file has been written.
    position : (time, joint, 3) float
        Metres, y up; NaN where missing, which leaves its cells empty.
    names : sequence of str
        A name a joint.
    rate_hz : float
        Frames a second.

    Raises
    ------
    ValueError
        The arguments do not fit each other or the format.
    OSError
        The file cannot be written; what was there before is still there.
    """
    position = writing.checked_track(position, names, rate_hz, '\r\n",;')
    frames, joints = position.shape[:2]
    head = ["time", *(f"{name}_{axis}" for name in names for axis in "xyz")]
    time_s = np.arange(frames)[:, None] / rate_hz
    table = np.concatenate([time_s, position.reshape(frames, -1)], axis=1)
    formats = ["%.9g", *["%.8f"] * (3 * joints)]
    body = writing.number_lines(table, formats, ",")
    write_beside(Path(path), (",".join(head) + "\n" + body).encode())
