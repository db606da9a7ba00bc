"""Read the markers of TRC files (tab-separated tracks), and write joints as such a file.

The layout is Motion Analysis' "track row column": a line that says what it is, names and values
of the header, the names of the markers, X1 Y1 Z1 ... below them, and a line a frame.
"""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import write_beside
from storage.formats import reading
from storage.formats.motion import writing
from storage.formats.motion.motion_file import MotionFile

_WANTED = "a TRC file"


def read_trc(path: Path) -> MotionFile:
    """Read the markers of a TRC file.

    Cells may stand between tabs, commas or spaces; an empty one is a gap, and so
    is 0, 0, 0. Where the names and
    the header disagree about the number of markers, the names win, and that is noted.

    Parameters
    ----------
    path : Path
        A TRC file with five or six lines of header.

    Returns
    -------
    MotionFile
        Positions in the unit of the column Units; `up` is None, TRC does not say it.

    Raises
    ------
    InputError
        No TRC file, no markers, no frames, cut short, or damaged.
    """
    path = Path(path)
    data = reading.read_bytes(path, _WANTED)
    reading.checked_encoding(path, data)
    text, notes = reading.decode_text(path, data, _WANTED)
    lines = text.split("\n")
    separator, at = _names_line(path, lines)
    header = _header(path, lines[:at], separator)
    rate_hz = reading.checked_rate(path, _number(header.get("datarate", "")), "DataRate")
    unit_m, more = reading.meters_in(header.get("units"))
    notes += more
    columns, names, contiguous = _names(path, lines[at], separator)
    rows, first = _rows(path, lines, at, separator)
    told = _number(header.get("numframes", ""))
    _check_complete(path, rows, told, 2 + 3 * (max(columns) + 1), text)
    if math.isfinite(told) and told != len(rows):
        notes.append(f"NumFrames says {told:g}; all of the {len(rows)} frames were read.")
    if _number(header.get("nummarkers", "")) != len(names):
        said = header.get("nummarkers", "nothing")
        notes.append(f"NumMarkers says {said}; there are {len(names)} names, which were read.")
    table = _table(path, rows, first, len(data), contiguous=contiguous)
    notes += _check_times(path, table, rate_hz)
    position, kept, more = _markers(path, table, columns, names)
    position, absurd = reading.without_absurd(position)
    position, zeros = reading.without_zeros(position, kept)
    notes += [*more, *absurd, *zeros]
    return MotionFile("trc", kept, position, rate_hz, unit_m, None, tuple(notes))


def _names_line(path: Path, lines: Sequence[str]) -> tuple[str | None, int]:
    """Return what separates the cells (None: spaces) and the line of the markers' names."""
    for at, line in enumerate(lines[:50]):
        if line.strip().strip('"').lower().startswith("frame#"):
            separator = "\t" if "\t" in line else "," if "," in line else None
            cells = _cells(line, separator)
            if len(cells) > 1 and cells[1].lower() == "time":
                return separator, at
    raise InputError(
        f"{path} is not a TRC file: none of its lines begins with Frame# and Time; bring {_WANTED}"
    )


def _cells(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, without quotes and spaces."""
    return [cell.strip().strip('"').strip() for cell in line.split(separator)]


def _header(path: Path, lines: Sequence[str], separator: str | None) -> dict[str, str]:
    """Return the values of the header by their names in small letters."""
    filled = [_cells(line, separator) for line in lines if line.strip()]
    for names, values in itertools.pairwise(filled):
        if "datarate" in (lowered := [name.lower() for name in names]):
            return dict(zip(lowered, values, strict=False))
    raise InputError(
        f"{path} has no line with DataRate and a line of values below it; add them, as in "
        "DataRate, CameraRate, NumFrames, NumMarkers, Units"
    )


def _number(cell: str) -> float:
    """Return the number in a cell, NaN where there is none."""
    try:
        return float(cell) if "_" not in cell else math.nan
    except ValueError:
        return math.nan


def _names(path: Path, line: str, separator: str | None) -> tuple[list[int], list[str], bool]:
    """Return which triple of columns each name stands over, the names, and if spaces split."""
    cells = _cells(line, separator)[2:]
    spread = separator is not None and not any(cell for at, cell in enumerate(cells) if at % 3)
    triples = cells[::3] if spread else [cell for cell in cells if cell]
    columns = [at for at, name in enumerate(triples) if name]
    if not columns:
        raise InputError(f"{path} holds no markers; export it with its markers")
    return columns, [triples[at] for at in columns], separator is None


def _rows(
    path: Path, lines: Sequence[str], at: int, separator: str | None
) -> tuple[list[list[str]], int]:
    """Return the cells of each frame, and the number of the first one's line."""
    first = at + 1
    while first < len(lines) and not math.isfinite(_number(_leading(lines[first], separator))):
        axes = [cell[0].upper() for cell in _cells(lines[first], separator) if cell]
        if axes and (first > at + 2 or axes[:3] != ["X", "Y", "Z"]):
            raise InputError(
                f"{path} has the line {lines[first][:40]!r} where X1 Y1 Z1 or the first frame "
                "is wanted; export it again"
            )
        first += 1
    rows = [line.split(separator) for line in lines[first:] if line.strip()]
    if not rows:
        raise InputError(f"{path} holds no frames; export it with its frames")
    return rows, first + 1


def _leading(line: str, separator: str | None) -> str:
    cells = _cells(line, separator)
    return cells[0] if cells else ""


def _check_complete(
    path: Path, rows: Sequence[Sequence[str]], told: float, width: int, text: str
) -> None:
    """Refuse a file of which the end is missing."""
    whole = max(map(len, rows))
    cut = not text.endswith("\n") and len(rows[-1]) < min(whole, width)
    there = len(rows) - cut
    if cut or there < told:
        of = f"{told:g}" if math.isfinite(told) and told > there else "more"
        raise InputError(
            f"{path} is cut short: it holds {there} whole frames of {of} that it tells; bring "
            "the whole file, or correct NumFrames if this is all"
        )


def _table(
    path: Path, rows: Sequence[Sequence[str]], first: int, read: int, *, contiguous: bool
) -> NDArray[np.float64]:
    """Return the numbers of all cells, NaN where one is empty, a frame a row."""
    width = max(map(len, rows))
    reading.check_size(path, len(rows), width // 3, read)
    table = np.full((len(rows), width), np.nan)
    for at, cells in enumerate(rows):
        if contiguous and len(cells) != width:
            raise InputError(
                f"{path}: frame {at + 1} has {len(cells)} numbers where others have {width}, "
                "and spaces cannot tell which are missing; export it with tabs"
            )
        if _shifted(cells, width):
            raise InputError(
                f"{path} has {len(cells) - 2} cells in frame {at + 1} (about line {first + at}), "
                "not three for each marker: one was lost or came in; correct it there"
            )
        try:
            table[at, : len(cells)] = [
                float(cell) if cell and not cell.isspace() else math.nan for cell in cells
            ]
            if any("_" in cell for cell in cells):
                raise ValueError
        except ValueError:
            wrong = next(c for c in cells if c.strip() and _bad(c))
            raise InputError(
                f"{path} has {wrong.strip()[:40]!r} in frame {at + 1} (about line "
                f"{first + at}) where a number or nothing is wanted; correct it there"
            ) from None
    return table


def _shifted(cells: Sequence[str], width: int) -> bool:
    """Tell whether a frame has lost a cell, rather than left out gaps at its end."""
    filled = len(cells)
    while filled and not cells[filled - 1].strip():
        filled -= 1
    return len(cells) != width and (filled - 2) % 3 != 0


def _bad(cell: str) -> bool:
    """Tell whether a cell holds something that is no number."""
    try:
        float(cell)
    except ValueError:
        return True
    return "_" in cell


def _check_times(path: Path, table: NDArray[np.float64], rate_hz: float) -> list[str]:
    """Refuse frames that are left out; note a time column that disagrees with DataRate."""
    if len(table) < 2:
        return []
    with np.errstate(invalid="ignore"):  # infinite cells
        steps, seconds = np.diff(table[:, :2], axis=0).T
        period = float(np.median(seconds))
        even = bool(period > 0 and np.all(np.abs(seconds - period) < 0.5 * period))
        counted = bool(steps[0] > 0 and np.all(steps == steps[0]))
    if not (even or counted):
        wrong = int(np.argmax(steps != np.median(steps)))
        raise InputError(
            f"{path} counts its frames evenly neither in Frame# nor in Time (after frame "
            f"{wrong + 1}): frames are missing or damaged; export it with all of them"
        )
    if not even:
        return [f"The column Time does not run evenly; DataRate {rate_hz:g} is used."]
    if not math.isclose(1 / period, rate_hz, rel_tol=0.02):
        return [
            f"The column Time runs at {1 / period:.4g} frames a second; DataRate {rate_hz:g} "
            "is used."
        ]
    return []


def _markers(
    path: Path,
    table: NDArray[np.float64],
    columns: Sequence[int],
    names: Sequence[str],
) -> tuple[NDArray[np.float64], tuple[str, ...], list[str]]:
    """Return the positions and names of the markers that have columns, and notes."""
    there = [n for n, at in enumerate(columns) if 5 + 3 * at <= table.shape[1]]
    notes = []
    if len(there) < len(names):
        without = [name for n, name in enumerate(names) if n not in set(there)]
        notes.append(f"There are no columns for {reading.listed(without)}: left out.")
    if not there:
        raise InputError(f"{path} has no columns below its names; export it again")
    more = table[:, 2 + 3 * (columns[there[-1]] + 1) :]
    if np.isfinite(more).any() or columns[-1] + 1 > len(columns):
        notes.append("There are columns without a name: left out.")
    kept, again = reading.first_of_each([names[n] for n in there])
    kept = [there[n] for n in kept]
    firsts = np.array([2 + 3 * columns[n] for n in kept])
    position = table[:, firsts[:, None] + np.arange(3)]
    return position, tuple(names[n] for n in kept), notes + again


def write_trc(
    path: Path, position: NDArray[np.floating], names: Sequence[str], rate_hz: float
) -> None:
    """Write joints as a TRC file in millimetres, to 10 nm; the cells of a gap are empty.

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
    path = Path(path)
    position = writing.checked_track(position, names, rate_hz, '\t\r\n",')
    frames, joints = position.shape[:2]
    triples = "\t".join(f"X{n}\tY{n}\tZ{n}" for n in range(1, joints + 1))
    head = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
        "\tOrigNumFrames",
        f"{rate_hz!r}\t{rate_hz!r}\t{frames}\t{joints}\tmm\t{rate_hz!r}\t1\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        f"\t\t{triples}",
        "",
    ]
    counted = np.arange(frames, dtype=float)[:, None]
    table = np.concatenate(
        [counted + 1, counted / rate_hz, position.reshape(frames, -1) * 1000.0], axis=1
    )
    formats = ["%d", "%.9g", *["%.5f"] * (3 * joints)]
    body = writing.number_lines(table, formats, "\t")
    write_beside(path, ("\n".join(head) + "\n" + body).encode())
