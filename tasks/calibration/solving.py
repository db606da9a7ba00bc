"""Cameras from their views of a board: lenses one by one, ties, everything at once, the floor.

After Zhang (2000): each camera's lens from its own views of a flat board, then all cameras in one
world by the moments that they share, then everything at once (Triggs et al. 2000).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from storage.formats.calibration.camera import Camera, nearest_rotation
from tasks.calibration.adjustment import Adjusted, adjust_rig
from tasks.calibration.boards import Board
from tasks.calibration.choosing import choose_moments, covered_cells
from tasks.calibration.finding import Sighting
from tasks.calibration.floors import floor_guessed, floor_on
from tasks.calibration.judging import (
    FEWEST_VIEWS,
    advice,
    bend_faults,
    result_faults,
    tie_faults,
    why_unseen,
)
from tasks.calibration.lenses import fit_lens
from tasks.calibration.pictures import draw_coverage
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

_ASTRAY = 4.0
"""From how many times the median a view is left out. Chosen: views of one moment that is none are
off by tens of times."""
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
    guessed: str = ""
    """How the floor was guessed, where no board lay on it."""


def calibrate_views(
    names: Sequence[str],
    sightings: Sequence[Sighting],
    board: Board,
    *,
    on_floor: int | None = None,
    aspects: Sequence[float] | None = None,
) -> Calibrated:
    """Return cameras of what they saw of a board.

    Parameters
    ----------
    names
        Of the cameras.
    sightings
        What each of them saw.
    board
        The board that they saw.
    on_floor
        The moment in which the board lies on the floor.
    aspects
        How many times as wide as high each camera's pixels are shown; 1 if not given.
    """
    sizes = [seen.size for seen in sightings]
    aspects = aspects or [1.0] * len(sizes)
    everything = [view for seen in sightings for view in seen.views]
    faults = _sighting_faults(names, sightings, board)
    if faults:
        pictures = _pictures(names, sightings, [seen.views for seen in sightings], None)
        return Calibrated(board, faults=faults, pictures=pictures)
    notes: list[str] = []
    chosen = choose_moments(everything, board, sizes, always=[] if on_floor is None else [on_floor])
    rank = {moment: n for n, moment in enumerate(chosen)}
    views = sorted((v for v in everything if v.moment in rank), key=lambda v: rank[v.moment])
    with within(0.0, 0.4):
        fitted = [
            fit_lens([v for v in views if v.camera == n], board, size, aspect=aspect)
            for n, (size, aspect) in enumerate(zip(sizes, aspects, strict=True))
        ]
    lenses = np.array([each.rig.lenses[0] for each in fitted])
    ties = tie_cameras(views, lenses, board, [size[0] for size in sizes])
    tree = spanning_ties(ties, len(names))
    if len(groups_of(ties, len(names))) > 1:
        # on a bent board no two cameras agree
        faults = bend_faults(fitted, board) or tie_faults(ties, tree, names, board)
        pictures = _pictures(names, sightings, _by_camera(views, len(names)), None)
        return Calibrated(board, faults=faults, pictures=pictures)
    faults = tie_faults(ties, tree, names, board)
    still = int(np.argmax([sum(v.camera == n for v in views) for n in range(len(names))]))
    rig, called = place_boards(views, lenses, place_cameras(tree, len(names), still), board)
    with within(0.4, 1.0):
        adjusted, used = _adjust(rig, called, board, sizes, aspects, still, on_floor)
    if len(used) < len(called):
        notes.append(
            f"{len(called) - len(used)} of {len(called)} views do not fit the others (blurred, not "
            "of one moment, or taken for the board): left out."
        )
    rig, guessed = _in_world(adjusted.rig, board, on_floor)
    results, off = _results(names, rig, adjusted, used, board, sizes)
    rms = [each.rms_px for each in results]
    faults += result_faults(adjusted, used, names, rms, sizes, board)
    notes += advice(adjusted, used, names, rms, sizes, board)
    cameras = [
        _camera(name, size, rig, n) for n, (name, size) in enumerate(zip(names, sizes, strict=True))
    ]
    notes += _folding(cameras)
    pictures = _pictures(names, sightings, _by_camera(used, len(names)), off)
    return Calibrated(board, [] if faults else cameras, results, faults, notes, pictures, guessed)


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


def _in_world(rig: Rig, board: Board, on_floor: int | None) -> tuple[Rig, str]:
    """Return the rig with y up, and how that was guessed where no board lies on the floor."""
    if on_floor is not None:
        return floor_on(rig, board, on_floor), ""
    rig, leaning = floor_guessed(rig, board)
    return rig, (
        "Nothing says where the floor is and which way is up: y was taken as the cameras stand "
        f"upright (they disagree by up to {np.degrees(leaning):.1f} degrees), and the floor at the "
        "lowest corner of the board. Lay the board on the floor and say --floor-frame "
        "CAMERA:FRAME, put a picture of it a camera into the folder `floor`, or films of somebody "
        "who walks about into the folder `feet`."
    )


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
                f"Camera {camera.name!r}: nothing was seen near the corners of the picture, so "
                "that the lens is not known there: hold the board into the corners."
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
