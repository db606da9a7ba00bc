"""What a camera films: a lit performer, the shadow on the floor, a curved wall behind.

Distances in metres; the floor is y = 0. Brightness 0-255, linear enough for a test.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.engine.settings import NotNegative, Share, check_ranges
from tasks.studio.dancing.limbs import unit
from tasks.studio.stage.bodies import BodySurface
from tasks.studio.stage.rasterization import draw_triangles, lay_over, project_bent

_LIGHT = np.array([0.28, -1.0, 0.22])
"""Direction in which light falls [of any length]. Chosen by eye; not measured."""
_CELL_M = 0.02
"""Edge of a cell of the shadow. Chosen by eye; not measured."""
_MARGIN_M = 1.5
"""How far the shadow's cells reach beyond the performer. Chosen; not measured."""
_BACKDROPS = {"green": (62.0, 140.0, 76.0), "grey": (128.0, 128.0, 130.0)}
"""Color of floor and wall [RGB]. Chosen by eye; not measured."""


@dataclass(frozen=True)
class Spoilers:
    """What keeps a camera's images from being clean."""

    noise: NotNegative = 2.5
    """Standard deviation of a sensor's pixel [0-255]. Chosen by eye; not measured."""
    flicker: NotNegative = 0.01
    """Standard deviation of a camera's gain from frame to frame [share]. Chosen by eye; not
    measured."""
    drift: NotNegative = 0.02
    """Largest change of a camera's gain over a take [share]. Chosen by eye; not measured."""
    shadow: Share = 0.35
    """Light that the performer takes from the floor at most. Chosen by eye; not measured."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class Scene:
    """A performer in the light."""

    surface: BodySurface
    lit: NDArray[np.uint8]
    """(time, triangle, 3) RGB."""
    shade: NDArray[np.uint8]
    """(time, z, x) share of light taken from a cell of the floor, 255 for all."""
    corner: NDArray[np.float64]
    """(x, z) of the middle of the floor's first cell."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A camera in its place, with what it sees when nobody is there."""

    camera_from_world: NDArray[np.float64]
    """(3, 4) rotation and translation."""
    intrinsics: NDArray[np.float64]
    """(3, 3) pixels."""
    distortion: NDArray[np.float64]
    """(0, 4 or 5,) OpenCV's k1, k2, p1, p2, k3."""
    empty: NDArray[np.float32]
    """(row, column, 3) RGB without noise."""
    floor: NDArray[np.float32]
    """(row, column, 2) cell of the scene's floor, x and z; far outside where there is none."""
    seed: tuple[int, int]
    """Of what spoils this camera's images."""


def light_scene(surface: BodySurface) -> Scene:
    """Return a performer lit from above, by a lamp and by the room."""
    vertex = surface.vertex
    flat = [0, 2]
    corner = vertex[..., flat].min(axis=(0, 1)).astype(np.float64) - _MARGIN_M
    far = vertex[..., flat].max(axis=(0, 1)) + _MARGIN_M
    columns, rows = np.ceil((far - corner) / _CELL_M).astype(int)
    lamp = -unit(_LIGHT).astype(np.float32)
    lit = np.empty((len(vertex), *surface.color.shape), np.uint8)
    shade = np.empty((len(vertex), rows, columns), np.uint8)
    level = np.ones(vertex.shape[1], np.float32)
    for frame, points in enumerate(vertex):
        a, b, c = (points[surface.triangle[:, side]] for side in range(3))
        normal = np.cross(b - a, c - a)
        length = np.maximum(np.linalg.norm(normal, axis=1), 1e-9)
        bright = 0.62 + 0.38 * (normal @ lamp) / length
        lit[frame] = np.clip(surface.color * bright[:, None], 0.0, 255.0)
        fallen = points[:, flat] - points[:, [1]] * (_LIGHT[flat] / _LIGHT[1])
        cell = ((fallen - corner) / _CELL_M).astype(np.float32)
        nearest = np.zeros((rows, columns), np.float32)
        seen = np.full((rows, columns), -1, np.int32)
        draw_triangles(cell, level, surface.triangle, nearest, seen)
        sharp = cv2.GaussianBlur(nearest, (0, 0), 0.05 / _CELL_M)
        soft = cv2.GaussianBlur(nearest, (0, 0), 0.20 / _CELL_M)
        shade[frame] = np.clip(255.0 * (0.6 * sharp + 0.4 * soft), 0.0, 255.0)
    return Scene(surface, lit, shade, corner)


def place_shot(
    camera_from_world: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    distortion: NDArray[np.float64],
    size: tuple[int, int],
    scene: Scene,
    *,
    backdrop: str = "green",
    seed: tuple[int, int] = (0, 0),
) -> Shot:
    """Return a camera with its image of the empty stage.

    Parameters
    ----------
    camera_from_world, intrinsics, distortion
        See `Shot`.
    size : (columns, rows)
        Of the image.
    scene : Scene
        What will be filmed.
    backdrop : str
        "green" or "grey": the color of floor and wall.
    seed : (take, camera)
        The texture of the stage follows from the first, noise and gain from both.
    """
    columns, rows = size
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    flat = cv2.undistortPoints(grid.reshape(-1, 1, 2).astype(np.float64), intrinsics, distortion)
    ray = np.concatenate([flat[:, 0], np.ones((len(flat), 1))], axis=1) @ camera_from_world[:, :3]
    place = -camera_from_world[:, :3].T @ camera_from_world[:, 3]
    middle = scene.corner + _CELL_M * np.array(scene.shade.shape[:0:-1]) / 2.0
    start = place[[0, 2]] - middle
    wall_m = max(6.0, 1.5 * float(np.linalg.norm(start)))
    to_floor = np.where(ray[:, 1] < -1e-6, -place[1] / np.minimum(ray[:, 1], -1e-6), np.inf)
    square = np.maximum((ray[:, [0, 2]] ** 2).sum(axis=1), 1e-12)
    along = ray[:, [0, 2]] @ start
    to_wall = (np.sqrt(along**2 + square * (wall_m**2 - start @ start)) - along) / square
    hit = place + np.minimum(to_floor, to_wall)[:, None] * ray
    on_floor = to_floor < to_wall
    round_wall = wall_m * np.arctan2(hit[:, 0] - middle[0], hit[:, 2] - middle[1])
    pattern = np.where(
        on_floor,
        1.0 + _weave(hit[:, 0], hit[:, 2], seed[0]),
        0.86 + 0.6 * _weave(round_wall, hit[:, 1], seed[0] + 1),
    )
    empty = pattern[:, None] * np.array(_BACKDROPS[backdrop])
    cell = np.where(on_floor[:, None], (hit[:, [0, 2]] - scene.corner) / _CELL_M, -1e4)
    return Shot(
        camera_from_world,
        intrinsics,
        distortion,
        empty.reshape(rows, columns, 3).astype(np.float32),
        cell.reshape(rows, columns, 2).astype(np.float32),
        seed,
    )


def _weave(x: NDArray[np.float64], y: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Return the texture of a surface: waves in every direction, about 0."""
    rng = np.random.default_rng([seed, 2])
    woven = np.zeros_like(x)
    for wave_m in (0.25, 0.4, 0.7, 1.2, 2.0):
        angle, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        woven += np.sin(2.0 * np.pi * (np.cos(angle) * x + np.sin(angle) * y) / wave_m + phase)
    return 0.025 * woven


def film_empty(shot: Shot, spoilers: Spoilers, *, frames: int = 8) -> NDArray[np.uint8]:
    """Return the background image (row, column, 3) RGB, the mean of some noisy frames."""
    rng = np.random.default_rng([*shot.seed, 3])
    noise = rng.standard_normal(shot.empty.shape, np.float32) * spoilers.noise / np.sqrt(frames)
    return _developed(shot.empty + noise)


def film_scene(
    shot: Shot, scene: Scene, spoilers: Spoilers, *, samples: int = 3
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.bool_]]]:
    """Yield the images of a camera, frame by frame, with the true silhouettes.

    Parameters
    ----------
    shot, scene
        Camera and performer.
    spoilers : Spoilers
        Noise, gain and shadow.
    samples : int
        Along each side of a pixel; odd, so that the middle one is the pixel's center.

    Yields
    ------
    image : (row, column, 3) uint8
        RGB.
    silhouette : (row, column) bool
        True where a pixel's center shows the performer, clothes included.
    """
    gains = _gains(len(scene.lit), shot.seed, spoilers)
    for frame, (points, lit) in enumerate(zip(scene.surface.vertex, scene.lit, strict=True)):
        light = 1.0 - spoilers.shadow / 255.0 * cv2.remap(
            scene.shade[frame].astype(np.float32),
            shot.floor[..., 0],
            shot.floor[..., 1],
            cv2.INTER_LINEAR,
        )
        image = shot.empty * light[..., None]
        pixel, depth = project_bent(
            points, shot.camera_from_world, shot.intrinsics, shot.distortion
        )
        silhouette = np.zeros(light.shape, bool)
        part = _filmed_part(pixel, depth, light.shape)
        if part is not None:
            rows, columns = part
            shape = (samples * (rows.stop - rows.start), samples * (columns.stop - columns.start))
            seen = np.full(shape, -1, np.int32)
            nearest = np.zeros(shape, np.float32)
            offset = np.array([columns.start, rows.start], np.float32)
            triangle = scene.surface.triangle
            draw_triangles(pixel - offset, depth, triangle, nearest, seen, samples=samples)
            cut = np.ascontiguousarray(image[part], np.float32)
            lay_over(cut, seen, lit.astype(np.float32), samples=samples)
            image[part] = cut
            silhouette[part] = seen[samples // 2 :: samples, samples // 2 :: samples] >= 0
        rng = np.random.default_rng([*shot.seed, 4, frame])
        noise = rng.standard_normal(image.shape, np.float32)
        yield _developed(gains[frame] * image + np.float32(spoilers.noise) * noise), silhouette


def _filmed_part(
    pixel: NDArray[np.float32], depth: NDArray[np.float32], shape: tuple[int, int]
) -> tuple[slice, slice] | None:
    """Return the rows and columns of an image that a performer may touch."""
    inside = pixel[depth > 0]
    if not len(inside):
        return None
    least = np.maximum(np.floor(inside.min(axis=0)).astype(int) - 1, 0)
    most = np.minimum(np.ceil(inside.max(axis=0)).astype(int) + 2, [shape[1], shape[0]])
    if (least >= most).any():
        return None
    return slice(least[1], most[1]), slice(least[0], most[0])


def _gains(frames: int, seed: tuple[int, int], spoilers: Spoilers) -> NDArray[np.float32]:
    """Return a camera's gain in every frame; the background was filmed at 1."""
    rng = np.random.default_rng([*seed, 5])
    waves, phase = rng.uniform(0.3, 1.5), rng.uniform(0.0, 2.0 * np.pi)
    drift = np.sin(2.0 * np.pi * waves * np.arange(frames) / max(frames, 2) + phase)
    gains = 1.0 + spoilers.drift * drift + spoilers.flicker * rng.standard_normal(frames)
    return gains.astype(np.float32)


def _developed(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return an image as bytes."""
    return np.clip(np.rint(image), 0.0, 255.0).astype(np.uint8)
