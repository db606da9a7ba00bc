"""Write films."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.pictures.film_facts import LARGEST_RATE_HZ
from storage.formats.pictures.video import quiet_cv2


def write_video(path: str | Path, frames: Iterable[NDArray[np.uint8]], rate_hz: float) -> None:
    """Write a film as MP4 (MPEG-4 part 2): beside its place, then renamed, so never half of one.

    Parameters
    ----------
    path : str or Path
        A file that ends in ".mp4"; one that is there is replaced.
    frames : iterable of (row, column, 3) uint8
        RGB, all of one size, with an even number of rows and of columns.
    rate_hz
        Frames a second.

    Raises
    ------
    InputError
        The name does not end in ".mp4", or the place cannot be written.
    ValueError
        The frames are no pictures, differ in size, or there is none; or the rate is no rate.
    """
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise InputError(f"{path} does not end in .mp4; films are written as MP4")
    if not 0.0 < rate_hz <= LARGEST_RATE_HZ:
        raise ValueError(f"rate_hz is {rate_hz}, a number above 0 to {LARGEST_RATE_HZ:g} is wanted")
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.stem}.", dir=path.parent) as beside:
            part = Path(beside) / "part.mp4"
            _write_frames(part, frames, rate_hz)
            os.replace(part, path)
    except OSError as error:
        raise InputError(
            f"the film {path} cannot be written ({error.strerror}); "
            "choose a folder that exists, has room and may be written"
        ) from error


def _write_frames(path: Path, frames: Iterable[NDArray[np.uint8]], rate_hz: float) -> None:
    cv2 = quiet_cv2()
    writer, shape = None, None
    for frame in frames:
        shape = shape or frame.shape
        even = frame.ndim == 3 and frame.shape[2] == 3 and not any(n % 2 for n in frame.shape[:2])
        if frame.dtype != np.uint8 or not even or not frame.size or frame.shape != shape:
            raise ValueError(
                f"a {frame.dtype} array of shape {frame.shape} is no frame of this film; "
                "(row, column, 3) uint8 with even sides, all of one size, is wanted"
            )
        if writer is None:
            code = cv2.VideoWriter.fourcc(*"mp4v")
            size = (shape[1], shape[0])
            writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, rate_hz, size)
            if not writer.isOpened():
                raise OSError(0, "the encoder did not start")
        writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    if writer is None:
        raise ValueError("there is no frame to write; give one at least")
    writer.release()
