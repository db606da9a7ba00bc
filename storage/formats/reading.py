"""What every reader of motion files checks in the same way, and the words it says it with."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import NotRegularError, open_regular
from storage.formats.encodings import find_encoding, normalized

METERS = {
    "mm": 0.001,
    "millimeter": 0.001,
    "millimeters": 0.001,
    "millimetre": 0.001,
    "millimetres": 0.001,
    "cm": 0.01,
    "centimeter": 0.01,
    "centimeters": 0.01,
    "centimetre": 0.01,
    "centimetres": 0.01,
    "dm": 0.1,
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "in": 0.0254,
    "inch": 0.0254,
    "inches": 0.0254,
    "ft": 0.3048,
    "feet": 0.3048,
}
"""Metres in one unit, by the words that files use for it."""

SLOWEST_HZ, FASTEST_HZ = 0.1, 100_000.0
FARTHEST = 1e8  # in any unit of the table: farther away is damage, not motion
_FOREIGN = {"utf-16": "UTF-16", "cp932": "cp932 (Japanese Windows)", "latin-1": "Latin-1"}
"""The encodings other than UTF-8, as a message names them."""
_MOST_SAID = 8
"""How many markers a note counts the gaps of. Chosen: they fit a line."""
_FEWEST_AROUND = 5
"""Other markers that tell whether the origin lies amid them. Chosen: fewer are no body."""
_MOST_FRAMES = 0.95
"""The share of frames in which it does. Chosen: a body that only passes the origin does not."""


def read_bytes(path: Path, wanted: str, *, most: int | None = None) -> bytes:
    """Return what a regular file of at most so many bytes holds, or say why it cannot be read."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            if most is not None and size > most:
                raise InputError(f"{path} is longer than {most:,} bytes; bring {wanted}")
            data = file.read()
    except InputError:
        raise
    except NotRegularError as error:
        raise InputError(f"{path} is no regular file, but {error.kind}; bring {wanted}") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path} cannot be read ({reason}); bring {wanted}") from error
    if not data.strip(b"\0 \t\r\n"):
        raise InputError(f"{path} is empty; bring {wanted}")
    return data


def decode_text(path: Path, data: bytes, wanted: str) -> tuple[str, list[str]]:
    """Return the text of a file, with plain line ends and composed letters, and notes."""
    encoding = find_encoding(data)
    text = data.decode(encoding or "latin-1")
    if "\0" in text:
        raise InputError(f"{path} holds binary data, not text; bring {wanted}")
    notes = encoding_notes(encoding or "latin-1")
    text = normalized(text.replace("\r\n", "\n").replace("\r", "\n"))
    if not text.endswith("\n"):
        notes.append("The file does not end with a line end; its last number may be cut.")
    return text, notes


def checked_encoding(path: Path, data: bytes) -> str:
    """Return the encoding of a file whose names count, or say that it cannot be told."""
    encoding = find_encoding(data)
    if encoding is None:
        raise InputError(
            f"{path} holds names in an encoding that cannot be told: it is not UTF-8, nor UTF-16, "
            "cp932 (Japanese Windows) or Latin-1; save it as UTF-8"
        )
    return encoding


def encoding_notes(encoding: str) -> list[str]:
    """Return what is to be said of an encoding that a file does not tell itself."""
    if encoding == "utf-16":  # its mark tells it
        return []
    said = _FOREIGN.get(encoding)
    return [f"The file is not in UTF-8; its names were read as {said}."] if said else []


def decode_toml(path: Path, data: bytes) -> str:
    """Return the text of a TOML file, which is in UTF-8 and may begin with a byte order mark."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        like = _FOREIGN.get(find_encoding(data) or "")
        looks = f" but looks like {like}" if like else ""
        raise InputError(f"{path} is not in UTF-8{looks}; save it as UTF-8") from None


def meters_in(unit: str | None) -> tuple[float | None, list[str]]:
    """Return the metres in one unit, None where it is not said or not known, and a note."""
    word = (unit or "").strip().strip("\"'()[]").lower()
    if not word:
        return None, ["The file does not say its unit."]
    if word not in METERS:
        return None, [f"The file's unit {word!r} is not known."]
    return METERS[word], []


def checked_rate(path: Path, rate_hz: float, field: str) -> float:
    """Return the rate, or say that it cannot be one."""
    if not (math.isfinite(rate_hz) and SLOWEST_HZ <= rate_hz <= FASTEST_HZ):
        raise InputError(
            f"{path} gives a rate of {rate_hz:g} frames a second ({field}), where one from "
            f"{SLOWEST_HZ:g} to {FASTEST_HZ:,.0f} is wanted; correct it in the file"
        )
    return rate_hz


def check_size(path: Path, frames: int, markers: int, read: int) -> None:
    """Refuse a file whose few bytes ask for far more memory than a motion of their size."""
    if frames * markers * 24 > 100 * read + 2**26:
        raise InputError(
            f"{path} has {markers:,} names for {frames:,} frames but too few numbers for "
            "them; it is damaged, export it again"
        )


def without_absurd(position: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[str]]:
    """Return the positions with NaN in all three where one is no number, and a note."""
    # Both are NaN where any is. A long file must not be copied where nothing is wrong.
    if position.size and position.max() <= FARTHEST and position.min() >= -FARTHEST:
        return position, []
    absurd = np.any(np.abs(position) > FARTHEST, axis=-1, keepdims=True)
    missing = absurd | np.any(np.isnan(position), axis=-1, keepdims=True)
    count = int(absurd.sum())
    cleaned = np.where(missing, np.nan, position)
    if not count:
        return cleaned, []
    return cleaned, [f"{count} positions are infinite or absurdly far away: taken as missing."]


def without_zeros(
    position: NDArray[np.float64], names: Sequence[str]
) -> tuple[NDArray[np.float64], list[str]]:
    """Return the positions with NaN where a gap was written as 0, 0, 0, and notes.

    No measured marker is ever at exactly 0, 0, 0. One that is there in every frame was never
    seen, unless it is the only one and lies amid the others: the origin of a body-centered file.
    """
    zero = (position == 0).all(axis=-1)
    if not zero.any():
        return position, []
    always = zero.all(axis=0)
    if always.sum() == 1 and _is_center(np.where(zero[..., None], np.nan, position)):
        zero[:, always] = False
        always[:] = False
    some = zero.any(axis=0) & ~always
    notes = []
    if some.any():
        said = [f"{names[n]} {zero[:, n].sum()}" for n in np.flatnonzero(some).tolist()]
        more = f" and {len(said) - _MOST_SAID} more" if len(said) > _MOST_SAID else ""
        notes.append(
            f"{zero[:, some].sum()} positions are exactly 0, 0, 0 and were taken as missing "
            f"(frames of {', '.join(said[:_MOST_SAID])}{more})."
        )
    if always.any():
        never = listed([names[n] for n in np.flatnonzero(always).tolist()])
        notes.append(f"{never} are at 0, 0, 0 in every frame: taken as never seen.")
    return np.where(zero[..., None], np.nan, position), notes


def _is_center(others: NDArray[np.float64]) -> bool:
    """Tell whether the origin lies amid the markers, nearer to their middle than most of them."""
    seen = others[np.isfinite(others[..., 0]).sum(axis=1) >= _FEWEST_AROUND]
    if not len(seen):
        return False
    middle = np.nanmean(seen, axis=1, keepdims=True)
    spread = np.sqrt(np.nanmean(((seen - middle) ** 2).sum(axis=-1), axis=1))
    return bool(np.mean(np.linalg.norm(middle[:, 0], axis=-1) < spread) > _MOST_FRAMES)


def first_of_each(names: Sequence[str]) -> tuple[list[int], list[str]]:
    """Return the indices of the names that did not come before, and a note on the others."""
    first: dict[str, int] = {}
    for index, name in enumerate(names):
        first.setdefault(name, index)
    if len(first) == len(names):
        return list(range(len(names))), []
    keep = set(first.values())
    again = [name for index, name in enumerate(names) if index not in keep]
    return sorted(keep), [
        f"{listed(again)} came more than once: the first is kept, the others are left out."
    ]


def listed(names: Sequence[str], most: int = 8) -> str:
    """Return the names in one line, the number of the rest where there are many."""
    shown = ", ".join(repr(name) for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
