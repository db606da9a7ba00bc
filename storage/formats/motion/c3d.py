"""Read the markers of C3D files, and write joints as such a file.

After "The C3D File Format" (Motion Lab Systems, 2008): Intel, DEC and MIPS numbers, real and
integer positions. Events and analog samples are passed over. What the header and the parameters
say differently is decided by the length of the file, or the file is refused.
"""

import itertools
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import write_beside
from storage.formats import reading
from storage.formats.encodings import normalized
from storage.formats.motion import writing
from storage.formats.motion.c3d_parameters import BLOCK, C3DHead, floats, read_head
from storage.formats.motion.motion_file import MotionFile

_MOST_COUNTED = 65535
"""The greatest number of frames that the header can say."""
_MODELED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "REACTIONS", "SCALARS")


@dataclass(frozen=True)
class _Layout:
    """How the data of a file lie in it."""

    real: bool
    start: int
    points: int
    analog: int
    frames: int

    @property
    def frame_bytes(self) -> int:
        return (4 * self.points + self.analog) * (4 if self.real else 2)

    @property
    def end(self) -> int:
        return self.start + self.frames * self.frame_bytes


def read_c3d(path: Path) -> MotionFile:
    """Read the markers of a C3D file.

    Markers without a name (or named `*0`, `*1`, ...) and modelled angles, forces, moments and
    powers are left out; a subject's prefix is taken off where all markers share it.

    Parameters
    ----------
    path : Path
        A C3D file of any processor, real or integer.

    Returns
    -------
    MotionFile
        Positions in the unit of POINT:UNITS; up is what POINT:Y_SCREEN says, which is the axis
        that points up on a screen. None where it says nothing.

    Raises
    ------
    InputError
        No C3D file, no markers, no frames, or damaged.
    """
    path = Path(path)
    data = reading.read_bytes(path, "a C3D file")
    head = read_head(path, data)
    rate_hz, notes = _rate(path, head)
    layout, more = _find_layout(path, head, data, rate_hz)
    notes = more + notes
    kept, names, more = _markers(path, head, layout.points)
    notes += more
    position, more = reading.without_absurd(_positions(path, data, head, layout)[:, kept])
    notes += more
    position, more = reading.without_zeros(position, names)
    notes += more
    units = head.words("POINT:UNITS")[:1]
    unit_m, more = reading.meters_in(units[0].decode("latin-1") if units else None)
    return MotionFile("c3d", names, position, rate_hz, unit_m, _up(head), (*notes, *more))


def _up(head: C3DHead) -> str | None:
    """Return the axis that points up on the screen for which the file was made."""
    said = b"".join(head.words("POINT:Y_SCREEN")[:1]).strip().lower().removeprefix(b"+")
    return said.decode() if said in (b"x", b"y", b"z", b"-x", b"-y", b"-z") else None


def _find_layout(
    path: Path, head: C3DHead, data: bytes, rate_hz: float
) -> tuple[_Layout, list[str]]:
    """Return how the data lie, from all that the file says about it and from its length."""
    length = len(data)
    scales = _first(head.floats("POINT:SCALE"), 1) or [head.float_at(7)]
    reals = _said([scale < 0 for scale in scales], [head.float_at(7) < 0])
    starts = _said(_first(head.integers("POINT:DATA_START"), 1), [head.word(9)])
    starts = [(block - 1) * BLOCK for block in starts if block > head.header[0]]
    points = _said(_first(head.integers("POINT:USED"), 1), [head.word(2)])
    frames = [count for count in _frames_said(head) if count > 0]
    analog = _said([head.word(3)], [])
    if not max(points, default=0):
        raise InputError(f"{path} holds no markers; export it with its markers")
    if not frames:
        raise InputError(f"{path} holds no frames; export it with its frames")
    layouts = [
        _Layout(*choice)
        for choice in itertools.product(reals, starts, filter(None, points), analog, frames)
    ]
    if not layouts:
        raise InputError(f"{path} says that its data begin where they cannot; export it again")
    if long := [more for each in layouts if (more := _beyond_count(each, data))]:
        return long[0], [
            f"The file counts its frames only to {_MOST_COUNTED:,}; it holds "
            f"{long[0].frames:,}, which were read."
        ]
    # Whole frames to the end, or filled up to a whole block: all else has lost or won bytes.
    whole = [each for each in layouts if length == each.end or length % BLOCK == 0]
    exact = [each for each in whole if 0 <= length - each.end < BLOCK]
    if len(layouts) == 1 and whole and layouts[0].end <= length:
        return layouts[0], [] if exact else [_left_out(layouts[0], length, rate_hz)]
    if exact:
        return exact[0], [
            "The header and the parameters disagree; the length of the file fits "
            f"{exact[0].frames} frames of {exact[0].points} markers, which were read."
        ]
    raise _unfitting(path, layouts, length)


def _beyond_count(layout: _Layout, data: bytes) -> _Layout | None:
    """Return the layout of a file that has more frames than its 16-bit counts can say.

    Some writers stop at 65,535, others begin again at 0.
    """
    most, rest = divmod(len(data) - layout.start, layout.frame_bytes)
    if most <= _MOST_COUNTED or rest >= BLOCK:
        return None
    stopped = layout.frames == _MOST_COUNTED
    # What fills the last block is no frame.
    for frames in range(most, most - (BLOCK - 1 - rest) // layout.frame_bytes - 1, -1):
        whole = replace(layout, frames=frames)
        if frames > _MOST_COUNTED and (stopped or frames % 65536 == layout.frames):
            last = whole.end - layout.frame_bytes
            if not any(data[whole.end :]) and (not stopped or any(data[last : whole.end])):
                return whole
    return None


def _left_out(layout: _Layout, length: int, rate_hz: float) -> str:
    """Return the note on what stands behind the last frame that the file tells."""
    over = length - layout.end
    return (
        f"{over} bytes after the last frame that the file tells, which would be "
        f"{over // layout.frame_bytes} frames more ({over / layout.frame_bytes / rate_hz:.3g} s): "
        "left out."
    )


def _unfitting(path: Path, layouts: Sequence[_Layout], length: int) -> InputError:
    """Return the error of a file whose length fits nothing that it says."""
    first = layouts[0]
    if all(layout.end > length for layout in layouts):
        there = max(length - first.start, 0) // first.frame_bytes
        return InputError(
            f"{path} is cut short: it holds {there} of the {first.frames} frames that it "
            "tells; bring the whole file"
        )
    if len(layouts) == 1:
        return InputError(
            f"{path} has {length - first.end} bytes more than its {first.frames} frames take: "
            "bytes came in on its way; transfer it again, as binary"
        )
    return InputError(
        f"{path} tells different numbers of markers or frames in its header and in its "
        "parameters, and its length fits none of them; export it again"
    )


def _frames_said(head: C3DHead) -> list[int]:
    """Return the numbers of frames that the file tells, the most trusted first."""
    said = []
    ends = [head.integers(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END")]
    if all(ends):
        first, last = (sum(w << 16 * n for n, w in enumerate(end[:2])) for end in ends)
        said.append(last - first + 1)
    said += _first(head.integers("POINT:LONG_FRAMES"), 1)
    # 65535 stands in both for "that many or more"
    short = _first(head.integers("POINT:FRAMES"), 1)
    if head.word(5) < 65535 or not (said or short):
        short.append(head.word(5) - head.word(4) + 1)
    said += [count for count in short if count != 65535 or not said]
    return list(dict.fromkeys(said))


def _said(parameter: list, header: list) -> list:
    """Return the different values that parameter and header give, the parameter's first."""
    return list(dict.fromkeys([*parameter, *header]))


def _first(values: list, count: int) -> list:
    return values[:count]


def _rate(path: Path, head: C3DHead) -> tuple[float, list[str]]:
    """Return the frames a second, the parameter's before the header's."""
    header = head.float_at(11)
    said = [rate for rate in head.floats("POINT:RATE")[:1] if rate != 0] or [header]
    rate_hz = reading.checked_rate(path, said[0], "POINT:RATE")
    if math.isclose(rate_hz, header, rel_tol=1e-3):
        return rate_hz, []
    return rate_hz, [f"POINT:RATE says {rate_hz:g} Hz, the header {header:g}: the first is used."]


def _scale(path: Path, head: C3DHead) -> float:
    """Return the unit of integer positions, which must be told without doubt."""
    header = abs(head.float_at(7))
    told = [abs(scale) for scale in head.floats("POINT:SCALE")[:1]]
    scale = (told or [header])[0]
    if not (math.isfinite(scale) and 1e-9 < scale < 1e6):
        raise InputError(f"{path} scales its positions by {scale:g}; export it again")
    if not math.isclose(scale, header, rel_tol=1e-4):
        raise InputError(
            f"{path} scales its positions by {scale:g} in its parameters and by {header:g} in "
            "its header; export it again"
        )
    return scale


def _positions(path: Path, data: bytes, head: C3DHead, layout: _Layout) -> NDArray[np.float64]:
    """Return the position of every point, NaN where its residual is negative."""
    words = 4 * layout.points + layout.analog
    size, shape = layout.frames * words, (layout.frames, words)
    if layout.real:
        content = data[layout.start : layout.end]
        quads = floats(content, head.processor).reshape(shape)
    else:
        dtype = ">i2" if head.processor == 86 else "<i2"
        quads = np.frombuffer(data, dtype, size, layout.start).reshape(shape).astype(float)
    quads = quads[:, : 4 * layout.points].reshape(layout.frames, layout.points, 4)
    position = quads[..., :3] * (1.0 if layout.real else _scale(path, head))
    position[~(quads[..., 3] >= 0)] = np.nan
    return position


def _markers(
    path: Path, head: C3DHead, points: int
) -> tuple[list[int], tuple[str, ...], list[str]]:
    """Return the indices and names of the points that are markers, and notes on the others."""
    words = head.words("POINT:LABELS")[:points]
    labels, notes = _decoded(path, words)
    modeled = {word for group in _MODELED for word in head.words(f"POINT:{group}")}
    named = [n for n, label in enumerate(labels) if label and not label.startswith("*")]
    kept = [n for n in named if words[n] not in modeled]
    if len(named) < points:
        notes.append(f"{points - len(named)} of {points} points have no name: left out.")
    if len(kept) < len(named):
        notes.append(f"{len(named) - len(kept)} modelled angles, forces or the like: left out.")
    if not kept:
        raise InputError(f"{path} holds no marker that has a name; label its markers")
    firsts, more = reading.first_of_each([labels[n] for n in kept])
    kept = [kept[n] for n in firsts]
    names, prefix_notes = _without_subject([labels[n] for n in kept])
    return kept, tuple(names), notes + more + prefix_notes


def _without_subject(labels: list[str]) -> tuple[list[str], list[str]]:
    """Return the labels without the subject's name where all of them have the same."""
    subjects = {label.partition(":")[0] if ":" in label else "" for label in labels}
    if subjects == {""}:
        return labels, []
    if len(subjects) == 1:
        return [label.partition(":")[2] for label in labels], []
    named = sorted(subjects - {""})
    return labels, [f"There is more than one subject ({reading.listed(named)}): names kept."]


def _decoded(path: Path, words: Sequence[bytes]) -> tuple[list[str], list[str]]:
    """Return the words as text with composed letters, and a note on their encoding."""
    encoding = reading.checked_encoding(path, b"\n".join(words))
    said = reading.encoding_notes(encoding)
    notes = [
        note.replace("The file is", "The names are").replace("its names", "they") for note in said
    ]
    return [normalized(word.decode(encoding)) for word in words], notes


def write_c3d(
    path: Path, position: NDArray[np.floating], names: Sequence[str], rate_hz: float
) -> None:
    """Write joints as a real C3D file (Intel) in millimetres; a gap has the residual -1.

    Parameters
    ----------
    path : Path
        Replaced when the whole file has been written.
    position : (time, joint, 3) float
        Metres, y up; NaN where missing.
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
    position = writing.checked_track(position, names, rate_hz, "\0:*")
    labels = [name.encode() for name in names]
    width = max(len(label) for label in labels)
    if width > 127 or len(names) > 65535:
        raise ValueError("a C3D file holds 65,535 names of 127 bytes each at most")
    frames = len(position)
    length = 4 + len(_parameter_section(labels, width, frames, rate_hz, 0))
    blocks = -(-length // BLOCK)
    section = _parameter_section(labels, width, frames, rate_hz, 2 + blocks)
    section = bytes((1, 0x50, min(blocks, 255), 84)) + section
    header = struct.pack(
        "<BBHHHHHfHHf", 2, 0x50, len(names), 0, 1, min(frames, 65535), 0, -1.0, 2 + blocks, 0,
        rate_hz,
    )  # fmt: skip
    missing = np.isnan(position[..., :1])
    quads = np.concatenate([position * 1000.0, np.zeros(missing.shape)], axis=-1)
    quads = np.where(missing, [0.0, 0.0, 0.0, -1.0], quads).astype("<f4").tobytes()
    whole = header.ljust(BLOCK, b"\0") + section.ljust(blocks * BLOCK, b"\0") + quads
    # With that many frames ezc3d reads to the end, and would take the filling for frames.
    filling = b"\0" * (-len(whole) % BLOCK) if frames < 65535 else b""
    write_beside(Path(path), whole + filling)


def _parameter_section(
    labels: Sequence[bytes], width: int, frames: int, rate_hz: float, data_block: int
) -> bytes:
    """Return the records of the parameter section."""
    entries = [
        _record(1, "USED", "H", [len(labels)]),
        _record(1, "SCALE", "f", [-1.0]),
        _record(1, "RATE", "f", [rate_hz]),
        _record(1, "DATA_START", "H", [data_block]),
        _record(1, "FRAMES", "H", [min(frames, 65535)]),
        _record(1, "UNITS", "s", [b"mm"], 2),
        _record(1, "X_SCREEN", "s", [b"+X"], 2),
        _record(1, "Y_SCREEN", "s", [b"+Y"], 2),
    ]
    for part, first in enumerate(range(0, len(labels), 255)):
        name = f"LABELS{part + 1 if part else ''}"
        entries.append(_record(1, name, "s", labels[first : first + 255], width))
    entries += [
        _record(2, "USED", "H", [0]),
        _record(3, "ACTUAL_START_FIELD", "H", [1, 0]),
        _record(3, "ACTUAL_END_FIELD", "H", [frames & 0xFFFF, frames >> 16]),
    ]
    groups = [_group(n, name) for n, name in enumerate(("POINT", "ANALOG", "TRIAL"), 1)]
    return b"".join(groups + entries) + b"\0\0"


def _group(group: int, name: str) -> bytes:
    return struct.pack("bb", len(name), -group) + name.encode() + struct.pack("<HB", 3, 0)


def _record(group: int, name: str, kind: str, values: Sequence, width: int = 0) -> bytes:
    """Return one parameter: a list of strings of a width, a scalar or a list of numbers."""
    if kind == "s":
        code, shape = -1, bytes((width, len(values)))
        content = b"".join(value.ljust(width) for value in values)
    else:
        code, shape = {"H": 2, "f": 4}[kind], b"" if len(values) == 1 else bytes((len(values),))
        content = struct.pack(f"<{len(values)}{kind}", *values)
    body = struct.pack("bB", code, len(shape)) + shape + content + b"\0"
    step = struct.pack("<H", len(body) + 2)
    return struct.pack("bb", len(name), group) + name.encode() + step + body
