"""When the film of each camera began: `offset_s` of capture.toml, and the moments that all film.

`offset_s = { cam3 = 0.1 }` under [video] says that cam3 began 0.1 s later than the cameras of which
nothing is said: its frame 0 shows what theirs show 0.1 s after their beginning. A negative number
is a film that began earlier. Only differences count. The frames of the take are the moments that
all cameras filmed, and of each camera the nearest frame shows them.
"""

import json
import math
import unicodedata
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from storage.formats.calibration.parts import as_shown
from storage.formats.reading import listed

COUNT_TOLERANCE_S = 0.1
"""Videos whose lengths differ by at most so much are cut to the shortest; others are refused,
unless capture.toml says when each began."""

_TOLD = 0.05
"""From how far a nearest frame may be from its moment without a word [frames]."""

_DIGITS = 6
"""Decimals of a frame that count [digits]: 0.1 s at 30 Hz are 3 frames, not a little more."""


@dataclass(frozen=True)
class Alignment:
    """Which frames of the films are those of the take."""

    first_frames: tuple[int, ...] = ()
    """The frame of each film that is frame 0 of the take."""
    frames: int = 0
    """Of the take."""
    unequal: str = ""
    """What is wrong with the lengths of films of which nobody says when they began."""


def read_offsets(
    video: Mapping[str, Any], known: Collection[str], where: str, faults: list[str]
) -> dict[str, float] | None:
    """Return how late each film began, in seconds; None where nothing is said.

    Parameters
    ----------
    video
        The table [video] of a capture.toml.
    known
        The cameras that there are.
    where
        What a message calls the file.
    faults
        Gets what is wrong, a sentence each.
    """
    if "offset_s" not in video:
        return None
    said = video["offset_s"]
    if not isinstance(said, Mapping):
        faults.append(
            f"offset_s = {as_shown(said)} under [video] of {where} is no table; write seconds a "
            "camera, such as { cam3 = 0.1 }"
        )
        return None
    wrong = [name for name, value in said.items() if not _is_number(value)]
    faults += [
        f"offset_s of camera {name!r} in {where} is {as_shown(said[name])}, and should be seconds, "
        "such as 0.1 where its film began 0.1 s later than the others"
        for name in wrong
    ]
    composed = {unicodedata.normalize("NFC", name): name for name in said}
    unknown = sorted(composed.keys() - {unicodedata.normalize("NFC", name) for name in known})
    if unknown and known:
        faults.append(
            f"{where} has an offset_s of {listed(unknown)}, of which there is no film: there are "
            f"{listed(sorted(known))}"
        )
    return {name: float(said[own]) for name, own in composed.items() if own not in wrong}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def align_films(
    counts: Mapping[str, int],
    offsets_s: Mapping[str, float] | None,
    fps: float,
    faults: list[str],
    notes: list[str],
) -> Alignment:
    """Return which frames of the films are those of the take.

    Parameters
    ----------
    counts
        Frames of the film of each camera.
    offsets_s
        Of the cameras that began later or earlier; None where nobody says.
    fps
        Frames a second.
    faults, notes
        Get what is wrong, and what a user should know; unequal lengths are told by the alignment.
    """
    if not counts:
        return Alignment()
    if offsets_s is None:
        return _together(counts, fps, notes)
    names = list(counts)
    late = np.round([offsets_s.get(name, 0.0) * fps for name in names], _DIGITS)
    whole, beside = _nearest_frames(late)
    first = {name: int(n) for name, n in zip(names, whole.max() - whole, strict=True)}
    after = {name: counts[name] - n for name, n in first.items()}
    frames = min(after.values())
    if frames < 1:
        latest = names[int(whole.argmax())]
        ended = min(names, key=lambda name: after[name])
        later_s = (late.max() - late[names.index(ended)]) / fps
        faults.append(
            f"by offset_s, camera {latest!r} began {later_s:g} s later than camera {ended!r}, "
            f"whose film had ended after {counts[ended] / fps:g} s: no moment is in all films; "
            "correct offset_s, or leave a camera out"
        )
        return Alignment()
    notes.append(_said(first, dict(zip(names, beside, strict=True)), fps))
    cut = {name: n - frames for name, n in after.items() if n > frames}
    if cut:
        said = ", ".join(f"{n} of {name!r}" for name, n in cut.items())
        notes.append(f"Frames at the end that not all cameras filmed are left out: {said}.")
    return Alignment(tuple(first.values()), frames)


def _nearest_frames(late: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lateness in whole frames, and how far the moments of each film are then beside.

    The moments are those that lie nearest to the frames of all films together.
    """
    parts = np.unique(late % 1.0)
    parts = parts[np.argsort(np.minimum(parts, 1.0 - parts), kind="stable")]
    beside = late[None] - parts[:, None]
    whole = np.floor(beside + 0.5 - 10.0**-_DIGITS)
    best = int(np.round(np.abs(beside - whole).sum(axis=1), _DIGITS).argmin())
    return whole[best].astype(int), (beside - whole)[best]


def _said(first: Mapping[str, int], beside: Mapping[str, float], fps: float) -> str:
    """Say with which frames of the films the take begins."""
    groups: dict[int, list[str]] = {}
    for name, n in first.items():
        groups.setdefault(n, []).append(name)
    begins = "; ".join(f"frame {n} of {listed(names)}" for n, names in sorted(groups.items()))
    note = f"By offset_s the take begins with {begins}"
    off = {name: part for name, part in beside.items() if abs(part) >= _TOLD}
    if not off:
        return f"{note}."
    said = ", ".join(
        f"{name!r} {abs(part) / fps:.4f} s {'later' if part > 0 else 'earlier'}"
        for name, part in off.items()
    )
    return (
        f"{note}. Each camera's nearest frame is used: {said} than the moment of the take "
        f"({max(abs(part) for part in off.values()):.2f} frames at most)."
    )


def _together(counts: Mapping[str, int], fps: float, notes: list[str]) -> Alignment:
    """Return the frames of films that are taken to have begun together."""
    shortest, longest = min(counts.values()), max(counts.values())
    alike = Alignment((0,) * len(counts), shortest)
    if shortest == longest:
        return alike
    usual = int(np.median(list(counts.values())))
    odd = {name: count for name, count in counts.items() if count != usual}
    said = ", ".join(f"{name!r} {count}" for name, count in odd.items())
    tolerance = max(1, math.ceil(COUNT_TOLERANCE_S * fps))
    if longest - shortest > tolerance:
        unequal = (
            f"the videos are of unequal length: {said}, the others {usual} frames; at most "
            f"{tolerance} ({COUNT_TOLERANCE_S:g} s) may be missing at the end, so cut them to the "
            "same moments, or say by offset_s under [video] when each began, which `shosa doctor` "
            "estimates"
        )
        return Alignment(alike.first_frames, shortest, unequal)
    notes.append(
        f"The videos have unequal numbers of frames ({said}, the others {usual}): the first "
        f"{shortest} of each are used, as if they had started together."
    )
    return alike


def offset_line(offsets_s: Mapping[str, float]) -> str:
    """Return the line of capture.toml that says when the films began.

    Parameters
    ----------
    offsets_s
        Seconds, of the cameras that are to be named.
    """
    said = ", ".join(f"{_key(name)} = {value:.4f}" for name, value in offsets_s.items())
    return f"offset_s = {{ {said} }}"


def _key(name: str) -> str:
    """Return the name of a camera as TOML writes a key."""
    bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if bare else json.dumps(name, ensure_ascii=False)
