"""The numbers below MOTION in a BVH file, read line by line.

A long take is hundreds of megabytes of digits: no list of all its words is ever made.
"""

import io
import math
import re
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats import reading

_HEAD = re.compile(rb"\s*Frames\s*:[ \t]*(\S*)\s+Frame\s*Time\s*:[ \t]*(\S*)", re.I)


def read_numbers(
    path: Path, data: bytes, at: int, channels: int
) -> tuple[NDArray[np.float64], float, list[str]]:
    """Return the channels of all frames, the frames a second, and notes.

    Parameters
    ----------
    data : bytes
        The whole file.
    at : int
        Where the line MOTION ends.
    channels : int
        How many numbers make a frame.

    Returns
    -------
    (frame, channel) float64
        NaN where a channel holds no number.
    """
    head = _HEAD.match(data, at)
    if not head:
        raise InputError(
            f"{path} has no lines 'Frames:' and 'Frame Time:' after MOTION: it is cut short or "
            "damaged; bring the whole file"
        )
    told = head[1].decode("latin-1")
    frames = int(told) if re.fullmatch(r"[0-9]{1,12}", told) else 0
    if frames < 1:
        raise InputError(
            f"{path} says that it has {told!r} frames, where 1 or more are wanted; export it "
            "with its frames"
        )
    rate_hz = _rate(path, head[2].decode("latin-1"))
    numbers, lines, wrong = _parse(path, data, head.end(), channels)
    there, rest = divmod(len(numbers), channels)
    notes = []
    if rest or there < frames or (there > frames and lines != there):
        raise InputError(
            f"{path} holds {len(numbers) / channels:.6g} frames of {channels} numbers where it "
            f"tells {frames}: it is cut short or damaged; bring the whole file, or correct "
            "'Frames:' if this is all"
        )
    if lines == there and wrong:
        raise InputError(
            f"{path} has {wrong[1]} numbers in frame {wrong[0]} where {channels} are "
            "wanted; export it again"
        )
    if there > frames:
        notes.append(f"'Frames:' says {frames}; all of the {there} frames were read.")
    values = np.frombuffer(numbers, np.float64)
    # Neither copies, and both are no number where any is none.
    if not (math.isfinite(values.max()) and math.isfinite(values.min())):
        unreal = ~np.isfinite(values)
        values[unreal] = np.nan
        notes.append(f"{unreal.sum()} channels hold no number: what hangs on them is missing.")
    return values.reshape(there, channels), rate_hz, notes


def _parse(
    path: Path, data: bytes, at: int, channels: int
) -> tuple[array, int, tuple[int, int] | None]:
    """Return all numbers, how many lines hold some, and the first line of another length."""
    numbers = array("d")
    lines, wrong = 0, None
    for line in _lines(data, at):
        words = line.split()
        if not words:
            continue
        lines += 1
        try:
            if "_" in line:  # a number of Python, not of a file
                raise ValueError
            numbers.extend(map(float, words))
        except ValueError:
            raise _bad_word(path, words, lines) from None
        if len(words) != channels and wrong is None:
            wrong = lines, len(words)
    return numbers, lines, wrong


def _lines(data: bytes, at: int) -> Iterator[str]:
    """Return the lines from a place on, whatever ends them."""
    file = io.BytesIO(data)
    file.seek(at)
    return io.TextIOWrapper(file, "latin-1", newline=None)


def _bad_word(path: Path, words: list[str], line: int) -> InputError:
    for word in words:
        if not re.fullmatch(r"[-+.0-9eE]+|[-+]?(nan|inf(inity)?)", word, re.I):
            return InputError(
                f"{path} has {word[:40]!r} in frame {line} where a number is wanted; "
                "export it again"
            )
    return InputError(f"{path} has a malformed number; export it again")


def _rate(path: Path, word: str) -> float:
    """Return the frames a second, whole where the frame time is that of a whole number."""
    try:
        frame_s = float(word)
    except ValueError:
        frame_s = math.nan
    if not frame_s > 0:
        raise InputError(
            f"{path} has the frame time {word!r} where seconds above 0 are wanted; write its "
            "own there, as in 'Frame Time: 0.0083333' for 120 frames a second"
        )
    rate_hz = reading.checked_rate(path, 1 / frame_s, "1 / Frame Time")
    # 0.0083333 means 120 Hz, not 120.00048
    whole = round(rate_hz)
    return float(whole) if math.isclose(rate_hz, whole, rel_tol=1e-4) else rate_hz
