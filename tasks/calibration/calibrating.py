"""Calibrate the cameras of a folder: from films and pictures of a board to a file and a report."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from storage.errors import InputError
from storage.formats.calibration.board_footage import (
    COVERAGE,
    BoardFootage,
    find_board_footage,
)
from storage.formats.calibration.toml import write_calibration
from storage.formats.pictures.pictures import write_png
from tasks.calibration.boards import Board
from tasks.calibration.feet import stand_on_floor, walkers_of
from tasks.calibration.finding import Source, find_views, plan_moments, sample_pictures
from tasks.calibration.judging import wrong_size
from tasks.calibration.recognition import recognize_board
from tasks.calibration.solving import Calibrated, calibrate_views
from tasks.engine.progress import within

CALIBRATION = "calibration.toml"


def look_for_board(
    folder: Path, *, charuco: bool = False, size: tuple[int, int] | None = None
) -> Board:
    """Return the board that the cameras of a folder filmed, with squares of 1 m.

    Raises
    ------
    InputError
        As `calibrate_folder`.
    """
    footage, _ = find_board_footage(folder)
    return _recognized(footage, plan_moments(footage)[0], 1.0, charuco=charuco, size=size)


def _recognized(
    footage: Sequence[BoardFootage], plan: Sequence[Sequence[Source]], square_m: float,
    *, charuco: bool, size: tuple[int, int] | None,
) -> Board:  # fmt: skip
    """Return the board in some of the pictures, or say why none can be used."""
    pictures = sample_pictures(footage, plan)
    found = recognize_board(pictures, square_m=square_m, charuco=charuco, size=size)
    if found.mirrored:
        raise InputError(
            "the markers of the ChArUco board are read in mirror images only: the pictures are "
            "mirrored; film without mirroring"
        )
    if found.board is None:
        raise InputError(
            f"no {'' if charuco else 'checkerboard or '}ChArUco board is found: film it large, "
            "whole, in focus and evenly lit, with a white margin as wide as a square"
        )
    wanted = None if size is None else tuple(sorted(size, reverse=True))
    larger = [s for s in found.sizes if size is not None and s[0] * s[1] > size[0] * size[1]]
    # a board that is cut off shows another size in each picture
    sure = len(found.sizes) == 1 or larger
    if wanted is not None and sure and wanted not in found.sizes:
        raise InputError(wrong_size(found.board, found.sizes))
    return found.board


def calibrate_folder(
    folder: Path,
    *,
    square_m: float,
    size: tuple[int, int] | None = None,
    charuco: bool = False,
    floor: tuple[str, str] | None = None,
) -> Calibrated:
    """Calibrate the cameras of a folder.

    Parameters
    ----------
    folder
        With a film or a folder of pictures a camera: see `find_board_footage`.
    square_m
        Side of a square of the board.
    size
        Corners side by side and one below the other; recognized where not given.
    charuco
        Whether it is known to be a ChArUco board.
    floor
        The camera and its frame, or the name of its picture, in which the board lies on the floor.

    Raises
    ------
    InputError
        With all that is wrong with the files, or no board is in them.
    UnknownNameError
        There is no such camera or frame as `floor` says.
    """
    footage, notes = find_board_footage(folder)
    walkers, more_notes = walkers_of(folder, [each.name for each in footage])
    plan, labels, on_floor = plan_moments(footage, floor)
    board = _recognized(footage, plan, square_m, charuco=charuco, size=size)
    with within(0.0, 0.7):
        sightings = find_views(footage, plan, board)
    unseen = (
        f"the board on the floor ({labels[on_floor]}) is found in no camera's picture: film it "
        "larger, whole and evenly lit"
        if on_floor is not None
        and not any(view.moment == on_floor for seen in sightings for view in seen.views)
        else ""
    )
    with within(0.7, 0.9 if walkers else 1.0):
        found = calibrate_views(
            [each.name for each in footage], sightings, board,
            on_floor=None if unseen else on_floor,
            aspects=[1 / each.video.pixel_aspect if each.video else 1.0 for each in footage],
        )  # fmt: skip
    faults = found.faults + [unseen] * bool(unseen)
    notes += more_notes + found.notes
    if found.guessed and walkers and not faults:
        with within(0.9, 1.0):
            try:
                cameras, said = stand_on_floor(found.cameras, walkers)
                return replace(found, cameras=cameras, notes=[*notes, said])
            except InputError as error:
                faults.append(str(error))
    elif found.guessed:
        notes.append(found.guessed)
    return replace(found, faults=faults, notes=notes)


def write_results(folder: Path, found: Calibrated) -> None:
    """Write coverage/<camera>.png and, where there is no fault, calibration.toml into a folder.

    Raises
    ------
    InputError
        They cannot be written.
    """
    try:
        (folder / COVERAGE).mkdir(exist_ok=True)
        for name, picture in found.pictures.items():
            write_png(folder / COVERAGE / f"{name}.png", picture)
        if not found.faults:
            rms = float(np.mean([each.rms_px for each in found.results]))
            write_calibration(folder / CALIBRATION, found.cameras, error_px=rms)
    except OSError as error:
        raise InputError(
            f"the calibration cannot be written into {folder} ({error.strerror or error}); allow "
            "it, or make room"
        ) from error
