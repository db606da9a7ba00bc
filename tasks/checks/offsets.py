"""Whether the films of a capture began together, in words: who is how late, and what to write.

`tasks.capture.offsets` measures it on all frames that were looked at, and on parts of them each by
itself: where the parts of a film disagree, it lost frames between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from storage.formats.capture.capture import Capture
from storage.formats.capture.offsets import offset_line
from storage.formats.reading import listed
from tasks.capture.offsets import (
    LEAST_FRAMES,
    LIKELY_PX,
    SURE_PX,
    Lateness,
    find_loss,
    measure_lateness,
    reach_of,
)
from tasks.capture.standing import find_standing
from tasks.capture.tangency import Touches, join_touches, usable_touches
from tasks.geometry.projection import Projection

_REACH_S = 2.0
"""How late a film is looked for [s]. Started by hand they are within; and the more lags, the more
often a movement that is repeated leaves it open."""

_PART_FRAMES = 72
"""How long a part is that is judged by itself, at least [frames]."""

_MOST_PARTS = 8
"""Into how many parts frames are cut at most."""

_RATE_HZ = 30.0
"""At what rate frames are compared, at least [Hz]. What growth means was measured at 30 Hz: of
faster films each second frame or fewer is looked at."""

_ANOTHER = 3.0
"""How many times what is left of the others a film leaves that shows another movement [times].
Played backwards it leaves 3.6 to 4.2 times as much; with 3 frames lost twice."""

_USUAL_LEFT_PX = 2.0
"""What may be left of any film [px]. Measured 0.5 to 0.9 where nothing is wrong, 1.5 to 1.9 with 3
frames lost, 5.6 to 6.8 played backwards."""

_STANDING_S = 1.0
"""For how long a film stands still that is said to [s]. Less is as frames that are lost."""

_CORRECTED = 0.5
"""From how much lateness another frame is the nearest [frames]."""


@dataclass(frozen=True)
class Passage:
    """Frames of a take after each other that were looked at."""

    start: int
    """The first of them."""
    touches: Touches
    """Of each `step`-th frame from there."""


@dataclass(frozen=True)
class Timing:
    """When films are to have begun."""

    names: Sequence[str]
    """Of the cameras."""
    fps: float
    step: int
    """How many frames of the take are between frames that are looked at."""
    offsets_s: Sequence[float]
    """What capture.toml says, and what was done."""
    late_frames: float
    """From how much lateness it is a fault [frames]."""


@dataclass(frozen=True)
class Beginnings:
    """What was found of when the films began; tuples in the order of the cameras."""

    faults: tuple[str, ...]
    """A sentence each."""
    notes: tuple[str, ...]
    """A sentence each."""
    late_frames: tuple[float, ...]
    """How many frames later than the others a film is, once it is read as capture.toml says; NaN
    where that cannot be known."""
    loses: tuple[bool, ...]
    """Whether frames are lacking in a film, or it stands still."""
    line: str = ""
    """What is to stand in capture.toml, where something else stands there now."""


def timing_of(capture: Capture, late_frames: float) -> Timing:
    """Return what a capture says of when its films began."""
    return Timing(
        [camera.name for camera in capture.cameras], capture.fps,
        max(1, round(capture.fps / _RATE_HZ)), capture.offsets_s, late_frames,
    )  # fmt: skip


def judge_beginnings(
    passages: Sequence[Passage], projection: Projection, timing: Timing, *, unequal: str = ""
) -> Beginnings:
    """Say which films began late, by the planes that touch their silhouettes.

    Parameters
    ----------
    passages
        What was looked at, in the order of the frames.
    projection
        The cameras.
    timing
        What is known.
    unequal
        What is wrong with the lengths of the films, where nobody said when they began.
    """
    reach_s = _REACH_S * timing.fps / timing.step
    gap = 2 * round(reach_s)
    touches = usable_touches(join_touches([each.touches for each in passages], gap), projection)
    looked_at = sum(each.touches.frames for each in passages)
    found = _in_frames(measure_lateness(touches, reach_of(looked_at, round(reach_s))), timing.step)
    sure = _tells(found, SURE_PX)
    parts = _parts(passages, touches, gap, timing, round(reach_s))
    stands = _standing(passages, timing)
    lost = [
        stands.get(camera) or _lost(camera, parts, touches, timing)
        for camera in range(len(timing.names))
    ]
    loses = np.array([bool(each) for each in lost])
    late = np.where(sure & ~loses, found.late, np.nan)
    faults = [*filter(None, lost)]
    moved, line = _corrected(late, timing)
    if unequal and not line and sure.all():  # who says that one began at 0 says it of all
        line = offset_line({timing.names[0]: 0.0})
    is_late = np.abs(late) >= timing.late_frames
    said = f"by the silhouettes {_said(moved, late, timing) or 'all films began together'}"
    advice = f"write `{line}` under [video] of capture.toml"
    if unequal and line:
        faults.append(
            f"{unequal.split(';')[0]}; {said}: {advice}, and the take is cut to the moments that "
            "all films show"
        )
    elif unequal:
        faults.append(unequal)
    elif is_late.any():
        faults.append(f"{said}: {advice}")
    notes = _notes(found, sure | loses, timing, looked_at)
    return Beginnings(
        tuple(faults), tuple(notes), tuple(late.tolist()), tuple(loses.tolist()),
        line if unequal or is_late.any() else "",
    )  # fmt: skip


def _tells(found: Lateness, growth_px: float) -> NDArray[np.bool_]:
    """Return (camera,) whether the lateness of a film is told with so much growth."""
    left = np.nan_to_num(found.left, nan=np.inf)
    usual = max(_ANOTHER * float(np.median(left)), _USUAL_LEFT_PX)
    return (found.growth >= growth_px) & (left <= usual)


def _in_frames(found: Lateness, step: int) -> Lateness:
    """Return lateness in frames of the take, which was measured on each `step`-th."""
    return replace(found, late=found.late * step)


@dataclass(frozen=True)
class _Part:
    """A part of what was looked at, by itself."""

    start: int
    end: int
    """The frame after its last one."""
    at: tuple[int, int]
    """Where its frames are among all that were looked at."""
    found: Lateness


def _parts(
    passages: Sequence[Passage], touches: Touches, gap: int, timing: Timing, reach: int
) -> list[_Part]:
    """Return the lateness in parts of what was looked at."""
    most = max(1, _MOST_PARTS // len(passages))
    parts, at = [], 0
    for passage in passages:
        count = passage.touches.frames
        ends = np.linspace(0, count, min(most, max(1, count // _PART_FRAMES)) + 1).astype(int)
        for a, b in pairwise(ends.tolist()):
            own = measure_lateness(touches.part(at + a, at + b), reach_of(b - a, reach))
            frames = passage.start + timing.step * np.array([a, b])
            start, end = frames.tolist()
            parts.append(_Part(start, end, (at + a, at + b), _in_frames(own, timing.step)))
        at += count + gap
    return parts


def _standing(passages: Sequence[Passage], timing: Timing) -> dict[int, str]:
    """Return a sentence of each camera whose film stands still while the others go on."""
    least = max(2, round(_STANDING_S * timing.fps / timing.step))
    ranges: dict[int, list[str]] = {}
    for passage in passages:
        for camera, first, end in find_standing(passage.touches, least):
            a, b = (passage.start + timing.step * n for n in (first, end - 1))
            ranges.setdefault(camera, []).append(f"{a}-{b}")
    return {
        camera: f"the film of camera {timing.names[camera]!r} stands still in frames "
        f"{', '.join(stretches)} of the take, while the others go on: bring it as the camera has "
        "it, cut these frames off, or leave the camera out"
        for camera, stretches in ranges.items()
    }


def _lost(camera: int, parts: Sequence[_Part], touches: Touches, timing: Timing) -> str:
    """Return the sentence on a film that lacks frames, or has some twice; empty where none is."""
    sure = [part for part in parts if _tells(part.found, SURE_PX)[camera]]
    for before, after in pairwise(sure):
        a, b = (float(part.found.late[camera]) for part in (before, after))
        if abs(b - a) < timing.late_frames:
            continue
        both = touches.part(before.at[0], after.at[1])
        at = find_loss(both, before.found.late / timing.step, camera, b / timing.step)
        # between passages nothing was looked at
        frame = before.start + timing.step * at if before.at[1] == after.at[0] else after.start
        what = "lost" if b > a else "has twice"
        return (
            f"the film of camera {timing.names[camera]!r} {what} {_frames(abs(b - a))} at about "
            f"frame {frame} of the take: it is {_by(a, timing)} before and {_by(b, timing)} after "
            "it; make two captures of it, each with its own offset_s, or leave the camera out"
        )
    return ""


def _corrected(late: NDArray[np.float64], timing: Timing) -> tuple[list[int], str]:
    """Return the cameras for which another frame is nearer, and the line that says all offsets."""
    moved = [int(c) for c in np.flatnonzero(np.abs(late) >= _CORRECTED)]
    offsets_s = {
        name: offset_s + (late[c] / timing.fps if c in moved else 0.0)
        for c, (name, offset_s) in enumerate(zip(timing.names, timing.offsets_s, strict=True))
        if c in moved or offset_s
    }
    return moved, offset_line(offsets_s) if offsets_s else ""


def _said(moved: Sequence[int], late: NDArray[np.float64], timing: Timing) -> str:
    """Say of cameras how late they began."""
    parts = [f"{timing.names[c]!r} is {_by(late[c], timing)}" for c in moved]
    return f"the film of camera {', '.join(parts)}" if parts else ""


def _by(late: float, timing: Timing) -> str:
    """Return a lateness in words."""
    if abs(late) < _CORRECTED:
        return "in step"
    side = "late" if late > 0 else "early"
    return f"{_frames(abs(late))} ({abs(late) / timing.fps:.3f} s) {side}"


def _frames(count: float) -> str:
    return f"{count:.1f} frames"


def _notes(found: Lateness, known: NDArray[np.bool_], timing: Timing, looked_at: int) -> list[str]:
    """Say what is likely, and what cannot be known."""
    if looked_at < LEAST_FRAMES:
        return [f"Whether the films began together cannot be known from {looked_at} frames."]
    notes = []
    told = _tells(found, LIKELY_PX)
    most_tell = 2 * told.sum() > len(told)  # else it is not known either who is the majority
    likely = ~known & told & most_tell
    for c in np.flatnonzero(likely & (np.abs(found.late) >= timing.late_frames)).tolist():
        notes.append(
            f"The film of camera {timing.names[c]!r} seems to be {_by(found.late[c], timing)}, "
            "which is not sure, as the performer moves little: clap or jump at the beginning of a "
            "take."
        )
    unknown = [timing.names[c] for c in np.flatnonzero(~known & ~likely).tolist()]
    if len(unknown) == len(timing.names):
        notes.append(
            "Whether the films began together cannot be known, as the performer moves too little, "
            "or does the same again and again: clap or jump at the beginning of a take."
        )
    elif unknown:
        notes.append(
            f"When the film of camera {listed(unknown)} began cannot be known: it shows too little "
            "movement, or another than the others. Clap or jump at the beginning of a take."
        )
    return notes
