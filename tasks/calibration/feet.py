"""Find the floor and which way is up from the feet of somebody who walks about.

Somebody who walks has one foot on the floor at any time. The visual hulls of some moments, carved
with the cameras as they are, are lowest there; the plane nearest to these places is the floor.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.calibration.board_footage import FEET, BoardFootage, find_board_footage
from storage.formats.calibration.camera import Camera
from storage.formats.reading import listed
from tasks.calibration.finding import Source, pictures_of, plan_moments
from tasks.calibration.floors import SteppedFloor, floor_of_steps, upright_axes
from tasks.capture.estimating import estimate_background
from tasks.capture.films import projection_of
from tasks.engine.progress import within
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection, camera_centers, viewing_rays
from tasks.geometry.voxels import VoxelGrid, run_index, volume_grid, voxel_centers
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tasks.reconstruction.regions.pieces import pieces_of_runs
from tasks.reconstruction.silhouettes import extract_silhouettes

_CARVING = CarvingSettings()
"""As captures are carved."""
_MOST_MOMENTS = 48
"""How many moments are looked at [moments]. As many tell what a stage without a performer looks
like (`tasks.capture.estimating`), and one step in each is enough."""
_FEWEST_STEPS = 10
"""From how few steps no floor is told [steps]. Chosen: as many weigh up some that are astray."""
_AROUND_M = (2.4, 3.0, 2.4)
"""The box in which a walker is looked for, around the middle of what the cameras see of him [m]. It
holds a tall man in mid step, though up is only guessed."""
_VOXEL_M = 0.02
"""Edge of a voxel [m]. Lowest places of 48 hulls of these agree to 2 to 9 mm."""
_CELL = 2
"""Edge of the cells that tell the walker from what else is carved [voxels]."""
_LEAST_HEIGHT_M = 0.6
"""A hull that is lower is no walker [m]. Of a child that walks; chosen."""
_TURNS = 3
"""How often up is found anew, from the places that are lowest by it [rounds]. The third changes
nothing where up was guessed eleven degrees astray."""
_MOST_ERROR = np.radians(0.5)
"""With a larger standard error of up the floor is not told [radians]. Two rendered walks over 1.5
and 3 m have 0.1 degrees and are 0.0 to 0.3 off; over a line, or on the spot, it is 2 and more."""


def walkers_of(folder: Path, cameras: Sequence[str]) -> tuple[list[BoardFootage], list[str]]:
    """Return what cameras filmed of somebody who walks about, none where there is no such folder.

    Parameters
    ----------
    folder
        Of the calibration; the films, or pictures, are in its folder `feet`.
    cameras
        The names that there may be.

    Raises
    ------
    InputError
        All that is wrong with the films, a line each.
    """
    if not (folder / FEET).exists():
        return [], []
    footage, notes = find_board_footage(folder / FEET)
    strange = [each.name for each in footage if each.name not in cameras]
    if strange:
        raise InputError(
            f"{folder / FEET} holds films of {listed(strange)}, and the cameras are "
            f"{listed([*cameras])}; rename them"
        )
    if len(footage) < _CARVING.min_cameras:
        raise InputError(
            f"{folder / FEET} holds films of {len(footage)} cameras; {_CARVING.min_cameras} that "
            "see the same place tell where feet are, bring those of more"
        )
    return footage, notes


def stand_on_floor(
    cameras: Sequence[Camera], footage: Sequence[BoardFootage]
) -> tuple[list[Camera], str]:
    """Return cameras in the world of the floor that somebody walked on, and what is said of it.

    The origin is in the middle of where he walked, y is up, x is as near as it can be to where it
    was.

    Parameters
    ----------
    cameras
        Calibrated, with y about upward.
    footage
        Of the one who walks, as `walkers_of` found it.

    Raises
    ------
    InputError
        The films cannot be read, or do not tell the floor.
    """
    filmed = [next(camera for camera in cameras if camera.name == each.name) for each in footage]
    projection = projection_of(filmed)
    silhouettes = _silhouettes(filmed, footage)
    hulls = [
        hull
        for hull in side_by_side(lambda each: _walker(each, projection), silhouettes)
        if len(hull)
    ]
    if len(hulls) < _FEWEST_STEPS:
        raise InputError(
            f"in the folder {FEET!r} somebody who walks is found in {len(hulls)} of "
            f"{len(silhouettes)} moments, and {_FEWEST_STEPS} are needed: film one person who "
            "walks all over the stage, whole in the pictures, with films that begin together"
        )
    floor = _floor(hulls)
    degrees = np.degrees(floor.error)
    spread = " x ".join(f"{each:.1f}" for each in floor.spread_m)
    if floor.error > _MOST_ERROR:
        raise InputError(
            f"the walk in the folder {FEET!r} does not tell the floor: steps are spread over "
            f"{spread} m (standard deviations), from which up is known to {degrees:.1f} degrees "
            "only; film somebody who walks all over the stage, or take the folder away"
        )
    turned = np.degrees(np.arccos(np.clip(floor.up[1], -1.0, 1.0)))
    said = (
        f"The floor is where somebody walked in {len(hulls)} moments: steps are spread over "
        f"{spread} m (standard deviations), half of them are within {1000 * floor.off_m:.0f} mm of "
        f"it, and up is {turned:.1f} degrees from how the cameras stand (standard error "
        f"{degrees:.1f})."
    )
    return [_stood(camera, floor) for camera in cameras], said


def _silhouettes(
    cameras: Sequence[Camera], footage: Sequence[BoardFootage]
) -> list[NDArray[np.bool_]]:
    """Return (camera, row, column) of moments all over the films that all cameras show."""
    plan, _, _ = plan_moments(footage)
    shared = set.intersection(*({moment for moment, _ in sources} for sources in plan))
    moments = sorted(shared)[:: -(-len(shared) // _MOST_MOMENTS) or 1]
    rows, columns = (max(getattr(each, side) for each in cameras) for side in ("height", "width"))
    found = np.zeros((len(moments), len(cameras), rows, columns), np.bool_)
    for n, (camera, filmed, sources) in enumerate(zip(cameras, footage, plan, strict=True)):
        with within(n / len(cameras), (n + 1) / len(cameras)):
            chosen = [source for source in sources if source[0] in moments]
            pictures = _pictures(camera, filmed, chosen)
            if len(pictures):
                shown = extract_silhouettes(pictures, estimate_background(pictures.copy()))
                found[:, n, : camera.height, : camera.width] = shown
    return list(found)


def _pictures(
    camera: Camera, footage: BoardFootage, sources: Sequence[Source]
) -> NDArray[np.uint8]:
    """Return (moment, row, column, 3) what a camera shows."""
    try:
        shown = dict(pictures_of(footage, sources))
    except InputError as error:
        raise InputError(f"{FEET}: camera {camera.name!r}: {error}") from error
    sizes = {each.shape[1::-1] for each in shown.values()} - {camera.size}
    if sizes:
        columns, rows = sizes.pop()
        raise InputError(
            f"{FEET}: the pictures of camera {camera.name!r} are {columns}x{rows}, and those of "
            f"the board {camera.width}x{camera.height}; bring those of one size"
        )
    return np.array([shown[moment] for moment in sorted(shown)], np.uint8)


def _walker(silhouettes: NDArray[np.bool_], projection: Projection) -> NDArray[np.float64]:
    """Return (voxel, 3) the largest piece of a hull, metres; nothing where it is no walker."""
    nothing = np.zeros((0, 3))
    middle = _middle(silhouettes, projection)
    if middle is None:
        return nothing
    grid = volume_grid(tuple(middle.tolist()), _AROUND_M, _VOXEL_M)
    hull = carve_visual_hull(silhouettes, projection, grid, _CARVING)
    if not len(hull.start):
        return nothing
    piece = pieces_of_runs(hull, _CELL)
    largest = piece == np.bincount(piece, weights=hull.length).argmax()
    place = _ends(run_index(hull)[largest], hull.length[largest], grid)
    return place if np.ptp(place[:, 1]) >= _LEAST_HEIGHT_M else nothing


def _ends(
    index: NDArray[np.integer], length: NDArray[np.uint16], grid: VoxelGrid
) -> NDArray[np.float64]:
    """Return (voxel, 3) the first and the last voxel of each run, metres: no other is lowest."""
    last = index.copy()
    last[:, 2] += length.astype(index.dtype) - 1
    return voxel_centers(grid, np.concatenate([index, last]))


def _middle(silhouettes: NDArray[np.bool_], projection: Projection) -> NDArray[np.float64] | None:
    """Return (3,) the place nearest to the rays through the middles of silhouettes, metres."""
    across, sums, seen = np.zeros((3, 3)), np.zeros(3), 0
    for n, center in enumerate(camera_centers(projection)):
        moments: Any = cv2.moments(silhouettes[n].view(np.uint8), binaryImage=True)
        if not moments["m00"]:
            continue
        pixel = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
        [ray] = viewing_rays(pixel[None], projection, n)
        ray /= np.linalg.norm(ray)
        off_ray = np.eye(3) - np.outer(ray, ray)
        across, sums, seen = across + off_ray, sums + off_ray @ center, seen + 1
    if seen < _CARVING.min_cameras:
        return None
    return np.asarray(np.linalg.solve(across, sums), np.float64)


def _floor(hulls: Sequence[NDArray[np.float64]]) -> SteppedFloor:
    """Return the floor on which all hulls stand."""
    up = np.array([0.0, 1.0, 0.0])
    for _ in range(_TURNS):
        up = _floor_by(hulls, up).up
    return _floor_by(hulls, up)


def _floor_by(hulls: Sequence[NDArray[np.float64]], up: NDArray[np.float64]) -> SteppedFloor:
    """Return the floor of what is lowest by an up that is about right."""
    return floor_of_steps(np.array([_lowest(hull, up) for hull in hulls]), up)


def _lowest(hull: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3,) the middle of what is lowest of a hull, within a voxel."""
    height = hull @ up
    return np.asarray(hull[height < height.min() + _VOXEL_M].mean(axis=0))


def _stood(camera: Camera, floor: SteppedFloor) -> Camera:
    """Return a camera in the world of a floor."""
    axes = upright_axes(floor.up, (1.0, 0.0, 0.0))
    translation = camera.translation + camera.rotation @ floor.middle
    return replace(camera, rotation=camera.rotation @ axes.T, translation=translation)
