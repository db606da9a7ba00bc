"""Show a performer from where no camera stood (digitization paper, 4.3).

Each surface voxel is a ball in soft light; balls reach across the gaps of any surface of voxels,
seen from any side and distance. They stand on a floor with a grid and a shadow, so that one sees
where a step goes.
"""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tasks.engine.settings import Count, Finite, Positive, Share, check_ranges
from tasks.rendering.drawing.canvas import PAPER, Color, Image
from tasks.rendering.drawing.floors import cast_shadow, paint_floor
from tasks.rendering.drawing.point_rendering import (
    BALL,
    draw_balls,
    project_balls,
    smooth_surface,
)


@dataclass(frozen=True)
class ViewSettings:
    """How the picture looks."""

    fine: Count = 2
    """The performer is drawn so much larger, then reduced, for smooth edges [times]. Chosen by eye;
    not measured."""
    background: Color = PAPER
    """Color behind the performer [RGB]. That of all pictures."""
    line: Color = (205, 203, 196)
    """Color of the floor's grid [RGB]. Chosen by eye; not measured."""
    floor_m: Finite | None = 0.0
    """Height of the floor; None draws no floor. The archive's floor is at y = 0."""
    grid_m: Positive = 0.5
    """Distance of the lines on the floor. Chosen by eye; not measured."""
    floor_radius_m: Positive = 3.0
    """Distance from below the performer toward which the grid fades out. Chosen by eye; not
    measured."""
    shadow: Share = 0.5
    """Light that a touching performer takes from the floor. Chosen by eye; not measured."""
    light: tuple[float, float, float] = (-0.45, -0.65, -0.6)
    """Direction to the light, from the camera: right, down, ahead [of any length]. Chosen by eye;
    not measured."""
    ambient: Share = 0.58
    """Light that comes from everywhere. Chosen by eye; not measured."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


def render_view(
    center: NDArray[np.floating],
    color: NDArray[np.uint8],
    voxel_m: float,
    matrix: ArrayLike,
    rotation: ArrayLike,
    translation: ArrayLike,
    size: tuple[int, int],
    *,
    settings: ViewSettings = ViewSettings(),
) -> Image:
    """Return colored voxels as a camera without distortion would see them.

    Parameters
    ----------
    center : (voxel, 3) float
        Centers of the surface voxels on a grid along the axes, metres; what they enclose counts
        as occupied. Without voxels the floor is drawn.
    color : (voxel, 3) uint8
        RGB.
    voxel_m : float
        Edge of a voxel.
    matrix, rotation, translation : (3, 3), (3, 3), (3,) float
        The camera: x = K (R X + t), pixel centers at integers.
    size : (int, int)
        Columns and rows of the picture.

    Returns
    -------
    (row, column, 3) uint8
        RGB.

    Raises
    ------
    ValueError
        If the arrays do not fit each other, or the picture or the voxels have no size.
    """
    _check_voxels(center, color, voxel_m, size)
    camera = np.column_stack([np.asarray(rotation, np.float64), translation])
    lens = np.asarray(matrix, np.float64)
    columns, rows = size
    image = _draw_floor(center, voxel_m, lens, camera, size, settings)
    if len(center):
        place, normal, openness = smooth_surface(center, voxel_m)
        place = place @ camera[:, :3].T + camera[:, 3]
        normal = normal @ camera[:, :3].T
        away = (normal * place).sum(axis=1) > 0.5 * np.linalg.norm(place, axis=1)
        shaded = _shade(color, normal, openness, camera[:, 1], settings)
        fine = settings.fine
        ball = project_balls(place[~away], lens, BALL * voxel_m, fine)
        drawn = draw_balls(ball, shaded[~away], (rows * fine, columns * fine), voxel_m, fine)
        if drawn is not None:
            _lay_over(image, *drawn, fine)
    return image


def aim_camera(
    target_m: ArrayLike,
    azimuth: float,
    elevation: float,
    distance_m: float,
    size: tuple[int, int],
    *,
    view_angle: float = math.radians(40.0),
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the camera that looks at a point from a direction, upright.

    Parameters
    ----------
    target_m : (3,) float
        Seen in the middle of the picture.
    azimuth : float
        Radians about Y: 0 looks from +Z, a quarter turn from +X.
    elevation : float
        Radians above the horizon.
    distance_m : float
        From the target.
    size : (int, int)
        Columns and rows of the picture.
    view_angle : float
        Radians from the upper to the lower edge.

    Returns
    -------
    matrix, rotation, translation : (3, 3), (3, 3), (3,) float64
        x = K (R X + t).

    Raises
    ------
    ValueError
        If there is no such camera.
    """
    if not (distance_m > 0 and 0 < view_angle < math.pi and min(size) > 0):
        raise ValueError(
            f"no camera sees {size} pixels in {view_angle} radians from {distance_m} m; "
            "pass sizes and a distance larger than 0, and an angle below pi"
        )
    columns, rows = size
    focal = rows / 2.0 / math.tan(view_angle / 2.0)
    matrix = np.array(
        [[focal, 0.0, (columns - 1) / 2.0], [0.0, focal, (rows - 1) / 2.0], [0.0, 0.0, 1.0]]
    )
    c, s = math.cos(azimuth), math.sin(azimuth)
    toward = np.array([s * math.cos(elevation), math.sin(elevation), c * math.cos(elevation)])
    right = np.array([c, 0.0, -s])
    rotation = np.stack([right, np.cross(right, toward), -toward])
    return matrix, rotation, -rotation @ (np.asarray(target_m, np.float64) + distance_m * toward)


def _check_voxels(center: Any, color: Any, voxel_m: float, size: tuple[int, int]) -> None:
    """Refuse what cannot be drawn."""
    faults = []
    if center.ndim != 2 or center.shape[1] != 3 or not np.isfinite(center).all():
        faults.append(f"center {center.shape} must be finite (voxel, 3)")
    if color.shape != center.shape or color.dtype != np.uint8:
        faults.append(f"color {color.shape} {color.dtype} must be uint8 {center.shape}")
    if not (math.isfinite(voxel_m) and voxel_m > 0):
        faults.append(f"voxel_m {voxel_m} must be larger than 0")
    if min(size) < 1:
        faults.append(f"size {size} must be at least one pixel")
    if faults:
        raise ValueError(f"these voxels cannot be drawn: {'; '.join(faults)}")


def _shade(
    color: NDArray[np.uint8],
    normal: NDArray[np.float64],
    openness: NDArray[np.float64],
    up: NDArray[np.float64],
    settings: ViewSettings,
) -> NDArray[np.float32]:
    """Return (voxel, 3) colors in soft light from one side and from above; camera's axes."""
    light = np.asarray(settings.light) / np.linalg.norm(settings.light)
    beam = 0.5 + 0.5 * (normal @ light)  # wraps around: cloth and skin let light through
    sky = 0.5 + 0.5 * (normal @ up)
    hollow = np.clip(0.5 + 1.2 * openness, 0.0, 1.0)
    share = hollow * (settings.ambient * (0.8 + 0.3 * sky) + 1.5 * (1 - settings.ambient) * beam)
    return (color * share[:, None]).astype(np.float32)


def _lay_over(image: Image, mixed: NDArray[np.float32], begin: tuple[int, int], fine: int) -> None:
    """Lay reduced fine pixels over the picture, in place."""
    rows, columns = mixed.shape[0] // fine, mixed.shape[1] // fine
    small = cv2.resize(mixed, (columns, rows), interpolation=cv2.INTER_AREA)
    row, column = begin[0] // fine, begin[1] // fine
    part = image[row : row + rows, column : column + columns]
    covered = np.minimum(small[..., :3] + (1.0 - small[..., 3:]) * part, 255.0)
    part[:] = (covered + 0.5).astype(np.uint8)


def _draw_floor(
    center: NDArray[np.floating],
    voxel_m: float,
    lens: NDArray[np.float64],
    camera: NDArray[np.float64],
    size: tuple[int, int],
    settings: ViewSettings,
) -> Image:
    """Return the background with the floor's grid and the performer's shadow."""
    columns, rows = size
    image = np.full((rows, columns, 3), settings.background, np.uint8)
    if settings.floor_m is None:
        return image
    middle = center[:, [0, 2]].mean(axis=0) if len(center) else np.zeros(2)
    paint_floor(
        image,
        (lens, camera[:, :3], camera[:, 3]),
        settings.shadow * cast_shadow(center, voxel_m, middle, settings.floor_m),
        middle,
        settings.floor_m,
        line=settings.line,
        grid_m=settings.grid_m,
        radius_m=settings.floor_radius_m,
    )
    return image
