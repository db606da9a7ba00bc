"""Move cameras to where the silhouettes say that they stand: a calibration that is a little off.

A plane through two camera centers that touches the silhouette of one touches that of the other
(`tasks.capture.tangency`). How far the two planes are apart, over all pairs of cameras and some
frames, is made least by turning and moving the cameras a little: "Camera network calibration and
synchronization from silhouettes in archived video" (Sinha and Pollefeys, 2010), from a start value
that is nearly right, so that neither points nor a search are needed. Where all cameras together
stand, and how large the stage is, silhouettes cannot tell; that stays as it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.capture.tangency import WIDTH_PX, Outline, find_touches, usable_touches
from tasks.engine.progress import within
from tasks.geometry.projection import Projection, camera_centers

_MOST_FRAMES = 24
"""How many frames are compared at most [frames]. Measured: from eight on, two seconds of dance tell
where eight cameras are to some 15 mm and 0.3 degrees, and more frames tell little more."""
_TURNED = np.radians(0.2)
"""How far cameras are turned, more or less [radians]. Measured on cameras that are where they
should be: eight around a rendered dance are turned by 0.12 degrees, five around somebody who stands
still by 0.10; with a degree here by 0.21 and 1.04. One that was turned by a degree comes back."""
_MOVED = 0.003
"""How far they are moved, more or less [share of their distance from the middle]. As much in pixels
as they are turned."""
_RARE = 2.0
"""From how many times as much on it counts less that a camera is moved still farther [times].
Chosen: so the one that was touched is moved, and not all others a little."""
_CLEAR_PX = 1.0
"""From which distance on two planes count less and less [px of a picture `WIDTH_PX` wide]. They are
0.2 apart where nothing is wrong, and many where a sleeve is missing in a silhouette."""
_STEPS, _SETTLED = 15, 1e-3
"""After how many steps it ends, or when no camera moves by more than this share of the above."""
_STEP = 1e-4
"""By how much a camera is turned and moved to see what that changes [radians, m]."""
_FEWEST = 8
"""With so few planes for each of the numbers that are sought nothing is told [planes]."""


@dataclass(frozen=True, eq=False)
class Refined:
    """Cameras that were moved; arrays are in their order."""

    projection: Projection
    before_px: NDArray[np.float64]
    """(camera,) how far apart planes of a camera and of the others are, the median, in its own
    pixels, as the cameras were."""
    after_px: NDArray[np.float64]
    """(camera,) as they are now."""
    moved_m: NDArray[np.float64]
    """(camera,) by how much it was moved."""
    turned_deg: NDArray[np.float64]
    """(camera,) by how much it was turned."""


def refine_cameras(outlines: Sequence[Outline], projection: Projection) -> Refined | None:
    """Turn and move cameras so that their silhouettes touch the same planes.

    Parameters
    ----------
    outlines
        Of each camera, of the same moments: `tasks.capture.tangency.find_outline`.
    projection
        The cameras, in the same order, as they were calibrated.

    Returns
    -------
    Refined or None
        None where too little is seen to tell.
    """
    frames = len(outlines[0].begin) - 1
    chosen = np.unique(np.linspace(0, frames - 1, min(frames, _MOST_FRAMES)).round().astype(int))
    seen = [_part(outline, chosen) for outline in outlines]
    own = [
        each.ray @ pose[:, :3].T
        for each, pose in zip(seen, projection.camera_from_world, strict=True)
    ]
    pairs = usable_touches(find_touches(seen, projection), projection).pairs
    case = _Case(seen, own, [(int(a), int(b)) for a, b in pairs])
    apart = case.apart(projection)
    count = 6 * projection.cameras
    involved = {camera for pair in case.pairs for camera in pair}
    if len(involved) < projection.cameras or np.isfinite(apart).sum() < _FEWEST * count:
        return None
    away = camera_centers(projection)
    away = np.linalg.norm(away - away.mean(axis=0), axis=1).mean()
    usual = np.tile(np.repeat([_TURNED, _MOVED * away], 3), projection.cameras)
    change = np.zeros(count)
    for step in range(_STEPS):
        with within(step / _STEPS, (step + 1) / _STEPS):
            by = _best_step(case, projection, change, usual)
        change += by
        if np.abs(by / usual).max() < _SETTLED:
            break
    there = _moved(projection, change)
    own_px = projection.image_size[:, 0] / WIDTH_PX
    turned, shifted = change.reshape(-1, 2, 3).swapaxes(0, 1)
    return Refined(
        there,
        own_px * case.apart_of(apart),
        own_px * case.apart_of(case.apart(there)),
        np.linalg.norm(shifted, axis=1),
        np.degrees(np.linalg.norm(turned, axis=1)),
    )


@dataclass(frozen=True, eq=False)
class _Case:
    """What is compared."""

    outlines: Sequence[Outline]
    own: Sequence[NDArray[np.float64]]
    """Of each camera (corner, 3), the directions of its outline in its own axes."""
    pairs: Sequence[tuple[int, int]]

    def apart(self, projection: Projection, camera: int | None = None) -> NDArray[np.float64]:
        """Return (pair, 2 time) how far planes are apart [px]; of one camera's pairs, or NaN."""
        frames = len(self.outlines[0].begin) - 1
        found = np.full((len(self.pairs), 2 * frames), np.nan)
        rays = [
            ray @ pose[:, :3]
            for ray, pose in zip(self.own, projection.camera_from_world, strict=True)
        ]
        scale = projection.intrinsics[:, 0, 0] * WIDTH_PX / projection.image_size[:, 0]
        for row, pair in zip(found, self.pairs, strict=True):
            if camera is not None and camera not in pair:
                continue
            both = [replace(self.outlines[c], ray=rays[c]) for c in pair]
            [planes] = find_touches(both, _only(projection, pair)).planes
            first, second = planes / scale[list(pair), None, None]  # each in pixels of its own
            row[:] = (first - second).ravel() * scale[list(pair)].mean()
        return found

    def apart_of(self, apart: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (camera,) the median distance of each camera's planes from the others'."""
        cameras = range(len(self.outlines))
        of = [[n for n, pair in enumerate(self.pairs) if c in pair] for c in cameras]
        return np.array([np.nanmedian(np.abs(apart[rows])) for rows in of])


def _best_step(
    case: _Case, projection: Projection, change: NDArray[np.float64], usual: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return by how much to go on from a change: Gauss and Newton's step, with a robust loss."""
    apart = case.apart(_moved(projection, change))
    slope = np.zeros((*apart.shape, len(change)))
    for n in range(len(change)):
        beside = change.copy()
        beside[n] += _STEP
        found = case.apart(_moved(projection, beside), n // 6)
        slope[..., n] = np.where(np.isnan(found), 0.0, (found - apart) / _STEP)
    known = np.isfinite(apart) & np.isfinite(slope).all(axis=-1)
    apart, slope = apart[known], slope[known]
    weight = 1.0 / (1.0 + (apart / _CLEAR_PX) ** 2)
    by = (change / usual).reshape(-1, 6)
    rarely = 1.0 / (1.0 + (by**2).sum(axis=1) / _RARE**2)
    stay = np.repeat(rarely, 6) * usual**-2.0
    square = (slope * weight[:, None]).T @ slope + np.diag(stay)
    pull = slope.T @ (weight * apart) + change * stay
    return np.asarray(-np.linalg.solve(square, pull), np.float64)


def _moved(projection: Projection, change: NDArray[np.float64]) -> Projection:
    """Return cameras turned about their centers, (camera, 3) radians, and moved, (camera, 3) m."""
    pose = projection.camera_from_world.copy()
    centers = camera_centers(projection)
    for each, center, (turn, shift) in zip(pose, centers, change.reshape(-1, 2, 3), strict=True):
        each[:, :3] = cv2.Rodrigues(turn)[0] @ each[:, :3]
        each[:, 3] = -each[:, :3] @ (center + shift)
    return replace(projection, camera_from_world=pose)


def _only(projection: Projection, cameras: Sequence[int]) -> Projection:
    """Return some of the cameras."""
    chosen = list(cameras)
    return Projection(
        projection.camera_from_world[chosen],
        projection.intrinsics[chosen],
        projection.distortion[chosen],
        projection.image_size[chosen],
    )


def _part(outline: Outline, frames: NDArray[np.integer]) -> Outline:
    """Return the corners of some of the frames."""
    ranges = [np.arange(*outline.begin[n : n + 2].tolist()) for n in frames]
    kept = np.concatenate(ranges).astype(int)
    begin = np.concatenate([[0], np.cumsum([len(each) for each in ranges])])
    return Outline(outline.ray[kept], outline.is_cut_off[kept], begin)
