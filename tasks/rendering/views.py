"""Write what a take's voxels look like from where no camera stood (digitization paper, 4.3)."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import xarray
from numpy.typing import NDArray

from storage import open_archive
from storage.archive import Take
from storage.errors import InputError, UnknownNameError
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.video_writing import write_video
from tasks.engine.threads import THREADS
from tasks.rendering.drawing import segment_colors
from tasks.rendering.novel_views import aim_camera, render_view

SEGMENT_COLORS = np.array(segment_colors.SEGMENT_COLORS, np.uint8)
"""RGB of the labels 0 to 11."""

_FILLS = 0.8
"""How much of the picture's height or width is filled by all that the take occupies [share]. Chosen
by eye; not measured."""
_LOOKED_AT = 24
"""How many frames say what the take occupies. Chosen, not measured."""
_VIEW_ANGLE = math.radians(40.0)
"""Angle from the upper to the lower edge of the picture [rad]. Chosen by eye; not measured."""


@dataclass(frozen=True)
class CameraPath:
    """Where the camera is that is not there; it looks at the middle of the take."""

    azimuth: float = math.radians(30.0)
    """Radians about Y: 0 looks from +Z, a quarter turn from +X."""
    elevation: float = math.radians(12.0)
    """Radians above the horizon."""
    turns: float = 0.0
    """Times around the performer, over the frames of a film."""
    camera: str | None = None
    """The name of a real camera to look from instead, without its lens' distortion."""


def render_take(
    archive: str,
    take: str,
    file: str,
    *,
    frames: tuple[int, int] | None = None,
    path: CameraPath = CameraPath(),
    size: tuple[int, int] = (960, 720),
    color: Literal["video", "segments"] = "video",
    tell: Callable[[int, int], None] = lambda _done, _total: None,
) -> str:
    """Write a still (PNG) or a film (MP4) of a take's voxels; return what was written.

    Parameters
    ----------
    frames
        The first and the last frame, both inclusive. By default the whole take; a still is of
        the first frame given, by default the middle of the take.
    path
        From where.
    size
        Columns and rows; even numbers for a film.
    color
        "video": as filmed; "segments": by the final labels.
    tell
        Called with how many frames are done, and of how many.

    Raises
    ------
    UnknownNameError, ArchiveError, InputError
        If the take or the camera is not there, has no voxels or no labels, the frames are not
        within it, or the file is neither PNG nor MP4 or cannot be written.
    """
    opened = open_archive(archive).take(take)
    suffix = Path(file).suffix.lower()
    if suffix not in (".png", ".mp4"):
        raise InputError(f"{file} should end in .png for a still or .mp4 for a film")
    count = opened.record.frames
    first, last = frames or ((count // 2, count // 2) if suffix == ".png" else (0, count - 1))
    if last >= count:
        raise InputError(f"take {take!r} has the frames 0-{count - 1}; {first}-{last} goes beyond")
    if color == "segments" and "labels" not in opened.record.stages:
        raise InputError(
            f"take {take!r} has no labels; its pose was not fitted: choose the color video"
        )
    if suffix == ".mp4" and (size[0] % 2 or size[1] % 2):
        raise InputError(f"a film of {size[0]}x{size[1]} needs an even number of columns and rows")
    chosen = range(first, first + 1) if suffix == ".png" else range(first, last + 1)
    middle, distance_m = _view_of_all(opened, chosen, size)
    cameras = {}
    for frame in chosen:
        turned = path.azimuth + 2 * math.pi * path.turns * (frame - first) / len(chosen)
        cameras[frame] = (
            _real_camera(opened, path.camera, size)
            if path.camera
            else aim_camera(
                middle, turned, path.elevation, distance_m, size, view_angle=_VIEW_ANGLE
            )
        )

    def draw(frame: int) -> NDArray[np.uint8]:
        return _draw_voxels(opened.voxels(frame), cameras[frame], size, color)

    if suffix == ".png":
        write_png(file, draw(first))
        return f"{file}: frame {first} of {take}"
    write_video(file, _drawn(draw, chosen, tell), opened.record.rate_hz)
    return f"{file}: {len(chosen)} frames of {take} at {opened.record.rate_hz:g} Hz"


def picture_frame(
    take: Take,
    frame: int,
    *,
    path: CameraPath = CameraPath(),
    size: tuple[int, int],
    color: Literal["video", "segments"] = "video",
) -> NDArray[np.uint8]:
    """Return a view (row, column, 3) RGB of the voxels of one frame, which fill it.

    Parameters
    ----------
    frame, path, size, color
        As of `render_take`; `path.camera` and `path.turns` are not read.

    Raises
    ------
    ArchiveError
        If the take has no voxels.
    IndexError
        If there is no such frame.
    """
    middle, distance_m = _view_of_all(take, range(frame, frame + 1), size)
    camera = aim_camera(
        middle, path.azimuth, path.elevation, distance_m, size, view_angle=_VIEW_ANGLE
    )
    return _draw_voxels(take.voxels(frame), camera, size, color)


def _draw_voxels(
    voxels: xarray.Dataset,
    camera: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    size: tuple[int, int],
    color: str,
) -> NDArray[np.uint8]:
    """Return what a camera would see of the voxels of a frame."""
    is_surface = voxels["is_surface"].values
    shown = voxels["color"].values[is_surface]
    if color == "segments":
        shown = SEGMENT_COLORS[voxels["label"].values[is_surface]]
    center = voxels["center"].values[is_surface]
    return render_view(center, shown, voxels.attrs["voxel_m"], *camera, size)


def _drawn(
    draw: Callable[[int], NDArray[np.uint8]], frames: range, tell: Callable[[int, int], None]
) -> Iterator[NDArray[np.uint8]]:
    """Yield the pictures in order, some drawn ahead side by side."""
    with ThreadPoolExecutor(THREADS) as pool:
        ahead: deque[Future[NDArray[np.uint8]]] = deque()
        for done, frame in enumerate(frames):
            ahead.append(pool.submit(draw, frame))
            if len(ahead) > 2 * THREADS:
                yield ahead.popleft().result()
                tell(done + 1 - len(ahead), len(frames))
        while ahead:
            yield ahead.popleft().result()
            tell(len(frames) - len(ahead), len(frames))


def _view_of_all(
    take: Take, frames: range, size: tuple[int, int]
) -> tuple[NDArray[np.float64], float]:
    """Return the middle of what is occupied in some frames, m, and how far off it is all seen."""
    chosen = np.unique(np.linspace(frames[0], frames[-1], _LOOKED_AT).round().astype(int))
    bounds = [
        (center.min(axis=0), center.max(axis=0))
        for frame in chosen
        if len(center := _surface(take.voxels(int(frame))))
    ]
    if not bounds:
        return np.array([0.0, 1.0, 0.0]), 4.0
    low = np.min([each for each, _ in bounds], axis=0)
    high = np.max([each for _, each in bounds], axis=0)
    wide = float(np.linalg.norm((high - low)[[0, 2]]))
    needed = max(float(high[1] - low[1]), wide * size[1] / size[0]) / _FILLS
    return (low + high) / 2, needed / 2 / math.tan(_VIEW_ANGLE / 2) + wide / 2


def _surface(voxels: xarray.Dataset) -> NDArray[np.float64]:
    return voxels["center"].values[voxels["is_surface"].values]


def _real_camera(
    take: Take, name: str, size: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return a camera of the capture, its picture scaled into one of `size`."""
    cameras = take.cameras
    names = list(cameras.attrs["cameras"])
    if name not in names:
        raise UnknownNameError(
            f"take {take.name!r} has no camera {name!r}; it has {', '.join(names)}"
        )
    camera = cameras.isel(camera=names.index(name))
    columns, rows = camera["image_size"].values
    scale = min(size[0] / columns, size[1] / rows)
    matrix = camera["intrinsics"].values.copy()
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    matrix[:2] *= scale
    matrix[:2, 2] += (np.array(size) - 1) / 2 - scale * middle
    return matrix, camera["rotation"].values, camera["translation"].values
