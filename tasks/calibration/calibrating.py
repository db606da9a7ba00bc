"""Calibrate the cameras of a folder: from films and pictures of a board to cameras and a report.

After Zhang (2000): each camera's lens from its own views of a flat board, then all cameras in one
world by the moments that they share, then everything at once (Triggs et al. 2000).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.calibration.board_footage import (
    COVERAGE,
    BoardFootage,
    find_board_footage,
)
from storage.formats.calibration.camera import Camera, nearest_rotation
from storage.formats.calibration.toml import write_calibration
from storage.formats.pictures.pictures import write_png
from tasks.calibration.adjustment import Adjusted, adjust_rig
from tasks.calibration.boards import Board
from tasks.calibration.choosing import choose_moments, covered_cells
from tasks.calibration.finding import (
    Sighting,
    Source,
    find_views,
    plan_moments,
    sample_pictures,
)
from tasks.calibration.floors import floor_guessed, floor_on
from tasks.calibration.judging import (
    FEWEST_VIEWS,
    advice,
    result_faults,
    tie_faults,
    why_unseen,
    wrong_size,
)
from tasks.calibration.lenses import fit_lens
from tasks.calibration.pictures import draw_coverage
from tasks.calibration.recognition import recognize_board
from tasks.calibration.rigs import Rig, View, residuals, view_rms_px
from tasks.calibration.ties import (
    groups_of,
    place_boards,
    place_cameras,
    spanning_ties,
    tie_cameras,
)
from tasks.engine.progress import within
from tasks.geometry.projection import Projection, one_to_one_radius

CALIBRATION = "calibration.toml"
_ASTRAY = 4.0
"""From how many times the median a view is left out."""
_LEAST_ASTRAY_PX = 1.0
"""From how many pixels a view is left out at least [px]. Below it the adjustment copes."""


@dataclass(frozen=True)
class CameraResult:
    """What came of a camera."""

    name: str
    views: int
    """Views that were used."""
    coverage: float
    """Share of the picture's parts in which corners were seen."""
    rms_px: float
    worst_px: float
    focal_px: float
    focal_error: float
    """Standard error of the focal length, as a share of it."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """What came of a folder; there are no cameras where there are faults."""

    board: Board
    cameras: list[Camera] = field(default_factory=list)
    results: list[CameraResult] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    """What of each camera's image was covered, by its name."""


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
    return _recognized(footage, plan_moments(footage)[0], 1.0, charuco, size)


def _recognized(
    footage: Sequence[BoardFootage], plan: Sequence[Sequence[Source]], square_m: float,
    charuco: bool, size: tuple[int, int] | None,
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
            f"no {'' if charuco else 'checkerboard or '}ChArUco board is found: film it large, whole, "
            "in focus and evenly lit, with a white margin as wide as a square"
        )
    larger = [s for s in found.sizes if size is not None and s[0] * s[1] > size[0] * size[1]]
    if larger and tuple(sorted(size or (), reverse=True)) not in found.sizes:
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
    plan, labels, on_floor = plan_moments(footage, floor)
    board = _recognized(footage, plan, square_m, charuco, size)
    with within(0.0, 0.7):
        sightings = find_views(footage, plan, board)
    names = [each.name for each in footage]
    faults = _sighting_faults(names, sightings, board)
    if on_floor is not None and not any(v.moment == on_floor for s in sightings for v in s.views):
        faults.append(
            f"the board on the floor ({labels[on_floor]}) is found in no camera's picture: film it "
            "larger, whole and evenly lit"
        )
    if faults:
        pictures = _pictures(names, sightings, [s.views for s in sightings], None)
        return Calibrated(board, faults=faults, notes=notes, pictures=pictures)
    return _calibrate(footage, sightings, board, on_floor, notes)


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
            f"the calibration cannot be written into {folder} ({error.strerror or error}); allow it, "
            "or make room"
        ) from error


def _sighting_faults(
    names: Sequence[str], sightings: Sequence[Sighting], board: Board
) -> list[str]:
    """Return which cameras' pictures cannot be used, and why."""
    faults = []
    for name, seen in zip(names, sightings, strict=True):
        if seen.fault:
            faults.append(seen.fault)
        elif not seen.views:
            faults.append(why_unseen(name, seen.missed, board, seen.looked_at))
    return faults


def _calibrate(
    footage: Sequence[BoardFootage], sightings: Sequence[Sighting], board: Board,
    on_floor: int | None, notes: list[str],
) -> Calibrated:  # fmt: skip
    """Return the cameras of what was seen."""
    names = [each.name for each in footage]
    sizes = [seen.size for seen in sightings]
    aspects = [1 / each.video.pixel_aspect if each.video else 1.0 for each in footage]
    everything = [view for seen in sightings for view in seen.views]
    chosen = choose_moments(everything, board, sizes, always=[] if on_floor is None else [on_floor])
    rank = {moment: n for n, moment in enumerate(chosen)}
    views = sorted((v for v in everything if v.moment in rank), key=lambda v: rank[v.moment])
    with within(0.7, 0.8):
        fitted = [
            fit_lens([v for v in views if v.camera == n], board, size, aspect=aspect)
            for n, (size, aspect) in enumerate(zip(sizes, aspects, strict=True))
        ]
    lenses = np.array([lens for lens, _ in fitted])
    ties = tie_cameras(views, lenses, board, [size[0] for size in sizes])
    tree = spanning_ties(ties, len(names))
    faults = tie_faults(ties, tree, names, board)
    if len(groups_of(ties, len(names))) > 1:
        pictures = _pictures(names, sightings, _by_camera(views, len(names)), None)
        return Calibrated(board, faults=faults, notes=notes, pictures=pictures)
    still = int(np.argmax([sum(v.camera == n for v in views) for n in range(len(names))]))
    rig, called = place_boards(views, lenses, place_cameras(tree, len(names), still), board)
    with within(0.8, 1.0):
        adjusted, used = _adjust(rig, called, board, sizes, aspects, still, on_floor)
    if len(used) < len(called):
        notes.append(
            f"{len(called) - len(used)} of {len(called)} views do not fit the others (blurred, not of "
            "one moment, or taken for the board): left out."
        )
    rig = _in_world(adjusted.rig, board, on_floor, notes)
    results, off = _results(names, rig, adjusted, used, board, sizes)
    rms = [each.rms_px for each in results]
    faults += result_faults(adjusted, board, names, rms, sizes)
    notes += advice(adjusted, used, names, rms, sizes, board)
    cameras = [
        _camera(name, size, rig, n) for n, (name, size) in enumerate(zip(names, sizes, strict=True))
    ]
    notes += _folding(cameras)
    pictures = _pictures(names, sightings, _by_camera(used, len(names)), off)
    return Calibrated(board, [] if faults else cameras, results, faults, notes, pictures)


def _adjust(
    rig: Rig, views: list[View], board: Board, sizes: Sequence[tuple[int, int]],
    aspects: Sequence[float], still: int, on_floor: int | None,
) -> tuple[Adjusted, list[View]]:  # fmt: skip
    """Return the rig that fits the views best, and the views that fit it."""
    while True:
        adjusted = adjust_rig(rig, views, board, sizes, still=still, aspects=aspects)
        rms = view_rms_px(adjusted.rig, views, board)
        limit = max(_ASTRAY * float(np.median(rms)), _LEAST_ASTRAY_PX)
        kept = [v for v, off in zip(views, rms, strict=True) if off < limit or v.moment == on_floor]
        left = {n: sum(v.camera == n for v in kept) for n in range(len(sizes))}
        if len(kept) == len(views) or min(left.values()) < FEWEST_VIEWS:
            return adjusted, views
        rig, views = adjusted.rig, kept


def _in_world(rig: Rig, board: Board, on_floor: int | None, notes: list[str]) -> Rig:
    """Return the rig with y up, and note what was guessed."""
    if on_floor is not None:
        return floor_on(rig, board, on_floor)
    rig, leaning = floor_guessed(rig, board)
    notes.append(
        "Nothing says where the floor is and which way is up: y was taken as the cameras stand upright "
        f"(they disagree by up to {np.degrees(leaning):.1f} degrees), and the floor at the lowest corner "
        "of the board. Lay the board on the floor and say --floor-frame CAMERA:FRAME, or put a picture "
        "of it a camera into the folder `floor`."
    )
    return rig


def _results(
    names: Sequence[str], rig: Rig, adjusted: Adjusted, views: Sequence[View], board: Board,
    sizes: Sequence[tuple[int, int]],
) -> tuple[list[CameraResult], list[list[NDArray[np.float64]]]]:  # fmt: skip
    """Return what came of each camera, and by how many pixels each corner of each view is off."""
    off = [np.linalg.norm(each, axis=1) for each in residuals(rig, views, board)]
    results, by_camera = [], []
    for n, name in enumerate(names):
        mine = [view for view in views if view.camera == n]
        errors = [each for each, view in zip(off, views, strict=True) if view.camera == n]
        together = np.concatenate(errors)
        results.append(
            CameraResult(
                name, len(mine), float(covered_cells(mine, sizes[n]).mean()),
                float(np.sqrt((together**2).mean())), float(together.max()),
                float(rig.lenses[n, 0]), float(adjusted.focal_error[n]),
            )
        )  # fmt: skip
        by_camera.append(errors)
    return results, by_camera


def _camera(name: str, size: tuple[int, int], rig: Rig, number: int) -> Camera:
    fx, fy, cx, cy, *bent = rig.lenses[number]
    pose = rig.camera_from_world[number]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    rotation = nearest_rotation(pose[:3, :3])
    return Camera(name, (int(size[0]), int(size[1])), matrix, np.array(bent), rotation, pose[:3, 3])


def _folding(cameras: Sequence[Camera]) -> list[str]:
    """Say whose lens is not known out to the corners of its picture."""
    said = []
    for camera in cameras:
        pose = np.column_stack([camera.rotation, camera.translation])[None]
        bent = np.zeros((1, 8))
        bent[0, : len(camera.distortion)] = camera.distortion
        lens = Projection(pose, camera.intrinsics[None], bent, np.array([camera.size]))
        widest = float(one_to_one_radius(lens)[0])
        k1, k2, k3 = bent[0, [0, 1, 4]]
        s = widest**2
        reach = widest * (1 + s * (k1 + s * (k2 + s * k3))) if np.isfinite(s) else np.inf
        rim = np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * (np.array(camera.size) - 1)
        far = (rim - camera.intrinsics[:2, 2]) / np.diag(camera.intrinsics)[:2]
        if reach < np.linalg.norm(far, axis=1).max():
            said.append(
                f"Camera {camera.name!r}: nothing was seen near the corners of the picture, so that "
                "the lens is not known there: hold the board into the corners."
            )
    return said


def _by_camera(views: Sequence[View], cameras: int) -> list[list[View]]:
    return [[view for view in views if view.camera == n] for n in range(cameras)]


def _pictures(
    names: Sequence[str], sightings: Sequence[Sighting], views: Sequence[Sequence[View]],
    off: Sequence[Sequence[NDArray[np.float64]]] | None,
) -> dict[str, NDArray[np.uint8]]:  # fmt: skip
    """Return what of each camera's image was covered."""
    drawn = {}
    for n, (name, seen) in enumerate(zip(names, sightings, strict=True)):
        if seen.fault:
            continue
        share = covered_cells(views[n], seen.size).mean()
        title = f"{name}: {len(views[n])} views of the board, corners in {share:.0%} of the picture"
        errors = off[n] if off is not None else []
        if errors:
            rms = np.sqrt((np.concatenate(errors) ** 2).mean())
            title += f", {rms:.2f} px off (green 0, red 1)"
        drawn[name] = draw_coverage(seen.picture, views[n], errors, title)
    return drawn
