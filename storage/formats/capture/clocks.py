"""What the clocks of cameras say of when their films began: hints, which are told and not used.

Cameras without a common clock have timecodes that differ by seconds though they film together, and
a file's time of creation is in whole seconds, and on many cameras that of its end.
"""

import re
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

from storage.formats.capture.footage import Footage

_DAY_S = 86_400.0
"""After so long a timecode comes round."""

_SAME_S = 2.0
"""Times of creation that differ by less are taken for one: they are in whole seconds."""

_TIMECODE = re.compile(r"(\d{1,2}):(\d{1,2}):(\d{1,2})([:;.,])(\d{1,4})")

_DROPPED = {30: 2, 60: 4}
"""Numbers that a drop-frame timecode leaves out a minute, but each tenth, by the nominal rate."""


def clock_notes(videos: Mapping[str, Footage], fps: float) -> list[str]:
    """Return what the files say of when the films began, a sentence each.

    Parameters
    ----------
    videos
        Of each camera.
    fps
        Frames a second.
    """
    if len(videos) < 2 or not fps > 0:
        return []
    return [*_timecodes(videos, fps), *_creations(videos)]


def _timecodes(videos: Mapping[str, Footage], fps: float) -> list[str]:
    """Say how the timecodes differ."""
    begun = {name: timecode_s(video.timecode, fps) for name, video in videos.items()}
    if any(second is None for second in begun.values()):
        return []
    longest = max(videos, key=lambda name: videos[name].frames)
    if videos[longest].frames / fps > _DAY_S:
        return [
            f"The film of camera {longest!r} is longer than a day, so that its timecode comes "
            "round: when the films began cannot be told by their timecodes."
        ]
    late = _after_the_first(np.array(list(begun.values()), np.float64))
    if late.max() * fps < 0.5:
        return ["The timecodes of all films say that they began together."]
    return [
        "The timecodes of the files say that films began later than the first: "
        f"{_said(videos, late, fps)}. That is a hint: nothing is moved but by offset_s."
    ]


def _creations(videos: Mapping[str, Footage]) -> list[str]:
    """Say how the times of creation differ."""
    times = {name: _moment(video.created) for name, video in videos.items()}
    known = [each for each in times.values() if each is not None]
    if len(known) < len(videos) or max(known) - min(known) < _SAME_S:
        return []
    late = np.array(known) - min(known)
    return [
        "The files say that they were created later than the first: "
        f"{_said(videos, late, None)}. That is a weak hint: it may be when a film ended."
    ]


def _said(videos: Mapping[str, Footage], late: np.ndarray, fps: float | None) -> str:
    """Say how late films are that are not the first; seconds, and frames where `fps` is given."""
    parts = []
    for name, seconds in zip(videos, late, strict=True):
        if seconds > (0.5 / fps if fps else 0.0):
            frames = f" ({seconds * fps:.0f} frames)" if fps else ""
            parts.append(f"{name!r} by {seconds:.{3 if fps else 0}f} s{frames}")
    return ", ".join(parts)


def timecode_s(timecode: str, fps: float) -> float | None:
    """Return the seconds since midnight of a timecode; None where it is none.

    Parameters
    ----------
    timecode
        HH:MM:SS:FF, or HH:MM:SS;FF where numbers of frames are dropped.
    fps
        Frames a second.
    """
    found = _TIMECODE.fullmatch(timecode.strip())
    if found is None:
        return None
    hours, minutes, seconds, frames = (int(found[n]) for n in (1, 2, 3, 5))
    nominal = max(round(fps), 1)
    if hours >= 24 or minutes >= 60 or seconds >= 60 or frames >= nominal:
        return None
    minutes += 60 * hours
    count = (60 * minutes + seconds) * nominal + frames
    if found[4] != ":":
        count -= _DROPPED.get(nominal, 0) * (minutes - minutes // 10)
    return count / fps


def _after_the_first(seconds: np.ndarray) -> np.ndarray:
    """Return how long after the first each is, though midnight may be between them."""
    trials = [(seconds - first) % _DAY_S for first in seconds]
    return min(trials, key=lambda late: float(late.max()))


def _moment(created: str) -> float | None:
    """Return a time as seconds of one clock; None where it is none."""
    try:
        moment = datetime.fromisoformat(created)
        return moment.replace(tzinfo=moment.tzinfo or UTC).timestamp()
    except (ValueError, OverflowError, OSError):
        return None
