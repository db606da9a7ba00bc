"""Read of a capture what stages need: cameras as arrays, and blocks of films and masks.

No stage and no arithmetic: the part of a store function that several stages share.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.calibration.camera import Camera
from storage.formats.capture.capture import Capture
from storage.formats.pictures.video import Video, open_masks, open_video, read_blocks
from tasks.engine.threads import THREADS
from tasks.geometry.projection import Projection
from tasks.geometry.voxels import VoxelGrid, volume_grid

_Item = TypeVar("_Item")

_BLOCK_FRAMES = 150
"""How many frames a block of a take has at most [frames]. It takes some seconds to compute."""

_LEAST_FRAMES = 8
"""How many frames a block of a take has at least, however large the images are [frames]. Chosen
by eye; not measured."""

_BLOCK_BYTES = 1 << 26
"""How large the silhouettes of all cameras of a block are at most, a bit a pixel [bytes]."""

_HELD_BYTES = 1 << 26
"""How large decoded frames of all cameras are that are worked on at a time, at most [bytes]. Two
such blocks are in memory. Where only one frame is worked on, it is not copied."""

_MOST_AT_ONCE = 16
"""How many frames are decoded at a time at most [frames]. Chosen by eye; not measured."""

_COMPARED_FRAMES = 8
"""How many frames of a take are compared. Chosen, not measured: all poses differ, and a second of
work at most."""

_COEFFICIENTS = 8
"""How many numbers describe a lens [numbers]. They are OpenCV's k1, k2, p1, p2, k3, k4, k5, k6."""


def projection_of(cameras: Sequence[Camera]) -> Projection:
    """Return the cameras of a capture as arrays."""
    distortion = np.zeros((len(cameras), _COEFFICIENTS))
    for row, camera in zip(distortion, cameras, strict=True):
        row[: len(camera.distortion)] = camera.distortion
    pose = [np.column_stack([camera.rotation, camera.translation]) for camera in cameras]
    return Projection(
        np.stack(pose),
        np.stack([camera.intrinsics for camera in cameras]),
        distortion,
        np.array([(camera.width, camera.height) for camera in cameras]),
    )


def grid_of(capture: Capture) -> VoxelGrid:
    """Return the voxels of a capture's volume."""
    volume = capture.volume
    return volume_grid(volume.center_m, volume.size_m, volume.voxel_m)


def largest_image(cameras: Sequence[Camera]) -> tuple[int, int]:
    """Return rows and columns that hold the image of every camera."""
    return max(camera.height for camera in cameras), max(camera.width for camera in cameras)


def block_ranges(capture: Capture) -> list[tuple[int, int]]:
    """Return the first frame of each block of a take, and the frame after its last one."""
    rows, columns = largest_image(capture.cameras)
    frame_bytes = len(capture.cameras) * rows * columns // 8
    length = max(_LEAST_FRAMES, min(_BLOCK_FRAMES, _BLOCK_BYTES // frame_bytes))
    return [(n, min(n + length, capture.frames)) for n in range(0, capture.frames, length)]


def compared_frames(frames: int) -> list[int]:
    """Return the frames of a take in which the cameras' silhouettes are compared."""
    return frames_all_over(frames, _COMPARED_FRAMES)


def frames_all_over(frames: int, most: int) -> list[int]:
    """Return the numbers of at most so many frames all over a film, ascending."""
    return sorted({round(n) for n in np.linspace(0, frames - 1, most).tolist()})


def of_camera(camera: Camera, read: Callable[[], Any]) -> Any:
    """Read something of a camera; what is wrong with it is said with the camera's name."""
    try:
        return read()
    except InputError as error:
        raise InputError(f"camera {camera.name!r}: {error}") from error


def read_films(
    capture: Capture, start: int, end: int
) -> Iterator[tuple[int, list[NDArray[np.uint8]]]]:
    """Yield the frames of the take from `start` to before `end` of all cameras, some at a time.

    How many at a time depends on the size of the images alone, so memory does not grow with the
    length of a take.

    Yields
    ------
    start : int
        The first frame.
    frames : list of (time, row, column, 3) uint8
        RGB, an array a camera.

    Raises
    ------
    InputError
        If a film cannot be read to `end`; its camera is named.
    """
    yield from _read_blocks(capture, capture.videos, open_video, start, end)


def read_films_and_masks(
    capture: Capture, start: int, end: int
) -> Iterator[tuple[int, list[NDArray[np.uint8]], list[NDArray[np.uint8]]]]:
    """Yield what `read_films` does, and the masks of the same frames where there are any.

    Yields
    ------
    start : int
        The first frame.
    frames : list of (time, row, column, 3) uint8
        RGB, an array a camera.
    masks : list of (time, row, column) uint8
        How much each pixel is the performer, 255 wholly, an array a camera; empty where the capture
        has no masks.

    Raises
    ------
    InputError
        If films or masks cannot be read to `end`; their camera is named.
    """
    films = read_films(capture, start, end)
    if not capture.masks:
        yield from ((first, frames, []) for first, frames in films)
        return
    masks = _read_blocks(capture, capture.masks, open_masks, start, end)
    for (first, frames), (_, of_frames) in zip(films, masks, strict=True):
        yield first, frames, of_frames


def _read_blocks(
    capture: Capture, paths: Sequence[Path], look: Callable[[Path], Video], start: int, end: int
) -> Iterator[tuple[int, list[NDArray[np.uint8]]]]:
    """Yield the frames of a film a camera, as many at a time as the cameras' images allow."""
    videos = [
        of_camera(camera, lambda path=path: look(path))
        for camera, path in zip(capture.cameras, paths, strict=True)
    ]
    frame_bytes = sum(3 * camera.width * camera.height for camera in capture.cameras)
    block = max(1, min(_MOST_AT_ONCE, _HELD_BYTES // frame_bytes))
    yield from _one_ahead(
        read_blocks(
            videos, block=block, start=start, end=end, firsts=capture.first_frames, workers=THREADS
        )
    )


def _one_ahead(items: Iterator[_Item]) -> Iterator[_Item]:
    """Yield the items, each next one being made while the one before is worked on."""
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(next, items, None)
        while (item := waiting.result()) is not None:
            waiting = pool.submit(next, items, None)
            yield item
