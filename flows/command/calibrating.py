"""The sub-command `calibrate`: cameras from films or pictures of a board."""

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from flows.command import printing
from flows.command.options import UsageError
from flows.command.terminal import work_bar
from storage.errors import InputError

if TYPE_CHECKING:
    from tasks.calibration.solving import Calibrated

_LARGEST_M = 10.0
"""The largest square of a board [m]."""
_MOST_CORNERS = 100
"""The most corners side by side."""


def add_calibrate_options(command: argparse.ArgumentParser) -> None:
    """Add what `shosa calibrate` understands."""
    command.add_argument(
        "folder", metavar="FOLDER", help="a film (CAMERA.mp4) or a folder of pictures a camera"
    )
    command.add_argument(
        "--square-m", type=float, metavar="M", help="side of a square of the board, in metres"
    )
    command.add_argument(
        "--board", metavar="CxR", help="corners between squares, such as 9x6 (default: recognized)"
    )
    command.add_argument("--charuco", action="store_true", help="it is a ChArUco board")
    command.add_argument(
        "--floor-frame", metavar="CAMERA:FRAME",
        help="the frame, or the name of the picture, in which the board lies on the floor",
    )  # fmt: skip
    command.add_argument("--force", action="store_true", help="replace a calibration that is there")


def calibrate(options: argparse.Namespace) -> bool:
    """Run `shosa calibrate`; return whether there is a calibration.

    Raises
    ------
    UsageError
        If options have values that mean nothing, or the size of the squares is not given.
    UnknownNameError
        If `--floor-frame` names what is not there.
    InputError
        If the folder's films cannot be used, or a calibration is there already.
    """
    size, floor = _size(options.board), _floor(options.floor_frame)
    if options.square_m is not None and not 0 < options.square_m <= _LARGEST_M:
        raise UsageError(
            f"--square-m {options.square_m:g} should be metres, such as 0.03, and {_LARGEST_M:g} "
            "at most"
        )
    from tasks.calibration.calibrating import (
        CALIBRATION,
        calibrate_folder,
        look_for_board,
        write_results,
    )

    folder = Path(options.folder)
    if (folder / CALIBRATION).exists() and not options.force:
        raise InputError(
            f"{folder / CALIBRATION} is there already; move it away, or replace it with --force"
        )
    if options.square_m is None:
        found = look_for_board(folder, charuco=options.charuco, size=size)
        raise UsageError(
            f"the board is a {found.said}; how large are its squares? Measure ten of them, and "
            "give the side of one in metres, such as --square-m 0.03"
        )
    with work_bar("calibration", quiet=options.quiet):
        found = calibrate_folder(
            folder, square_m=options.square_m, size=size, charuco=options.charuco, floor=floor
        )
    write_results(folder, found)
    for line in _lines(folder, found):
        printing.print_line(line)
    return not found.faults


def _lines(folder: Path, found: "Calibrated") -> list[str]:
    """Return what came of a folder: a table of the cameras, notes, faults, where it is."""
    lines = [f"{found.board.said}, squares of {1000 * found.board.square_m:g} mm"]
    if found.results:
        lines.append(
            f"{'camera':16} {'pictures':>8} {'coverage':>8} {'rms px':>7} {'worst px':>8} "
            f"{'focal px':>16}"
        )
    for each in found.results:
        focal = f"{each.focal_px:.1f} ± {each.focal_px * each.focal_error:.1f}"
        lines.append(
            f"{each.name:16} {each.views:8} {each.coverage:8.0%} {each.rms_px:7.2f} "
            f"{each.worst_px:8.2f} {focal:>16}"
        )
    lines += [f"note: {note}" for note in found.notes]
    lines += [f"BAD {fault}" for fault in found.faults]
    if found.pictures:
        lines.append(f"pictures: {folder / 'coverage'}")
    lines.append(
        "no calibration was written" if found.faults else f"ok: {folder / 'calibration.toml'}"
    )
    return lines


def _size(text: str | None) -> tuple[int, int] | None:
    """Return what `--board` says."""
    if text is None:
        return None
    found = re.fullmatch(r"([0-9]{1,3})x([0-9]{1,3})", text)
    if not found or not all(3 <= int(each) <= _MOST_CORNERS for each in found.groups()):
        raise UsageError(
            f"--board {text[:40]} should be corners between squares, such as 9x6, each from 3 to "
            f"{_MOST_CORNERS}"
        )
    return int(found[1]), int(found[2])


def _floor(text: str | None) -> tuple[str, str] | None:
    """Return what `--floor-frame` says."""
    if text is None:
        return None
    camera, colon, frame = text.rpartition(":")
    if not (camera and colon and frame):
        raise UsageError(f"--floor-frame {text[:40]} should be CAMERA:FRAME, such as cam1:120")
    return camera, frame
