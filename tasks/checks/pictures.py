"""Show, camera by camera, whether a capture's calibration fits what was filmed.

Nothing in the numbers of a calibration says that a camera was matched to the wrong video, or that
the floor is not at y = 0; a drawing of the floor and the volume over the background does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.formats.calibration.camera import Camera
from storage.formats.capture.capture import Capture
from storage.formats.capture.capture_toml import Volume
from storage.formats.capture.footage import read_picture
from tasks.capture.films import projection_of
from tasks.engine.settings import Count, Positive, Share, check_ranges
from tasks.geometry.projection import Projection, project_points
from tasks.rendering.drawing.canvas import (
    BLUE,
    FINE,
    GREEN,
    INK,
    ORANGE,
    PAPER,
    RED,
    Color,
    Image,
    draw_line,
    draw_text,
    finish,
)


@dataclass(frozen=True)
class CheckSettings:
    """How a camera's check is drawn."""

    smallest_width_px: Count = 640
    """A background narrower than this is enlarged by a whole number. Chosen by eye: lines and title
    can be read."""
    grid_m: Positive = 0.5
    """Distance of two lines of the floor. Chosen by eye on the shared captures; not measured."""
    arrow_m: Positive = 0.5
    """Length of the axes that stand on the floor: x red, y green, z blue. Chosen by eye on the
    shared captures; not measured."""
    pale: Share = 0.25
    """White that is laid over the background, so that lines stand out. Chosen by eye on the shared
    captures; not measured."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


def draw_capture_checks(
    capture: Capture,
    settings: CheckSettings = CheckSettings(),
    *,
    behind: Sequence[NDArray[np.uint8]] | None = None,
) -> dict[str, Image]:
    """Return the picture of `draw_camera_check` for each camera of a capture, by name.

    Parameters
    ----------
    capture
        Whose cameras are drawn.
    settings
        How.
    behind : sequence of (row, column, 3) uint8, optional
        What is drawn over, a picture a camera; by default the backgrounds that were brought.

    Raises
    ------
    InputError
        Where a background cannot be read any more.
    """
    pictures = {}
    if behind is None:
        behind = [read_picture(path) for path in capture.backgrounds]
    for camera, picture, share in zip(capture.cameras, behind, capture.seen_share, strict=True):
        title = f"{camera.name}: sees {share:.0%} of the volume"
        pictures[camera.name] = draw_camera_check(
            picture, camera, capture.volume, title=title, settings=settings
        )
    return pictures


def draw_camera_check(
    background: NDArray[np.uint8],
    camera: Camera,
    volume: Volume,
    *,
    title: str = "",
    settings: CheckSettings = CheckSettings(),
) -> Image:
    """Draw the edges of the volume and a grid on the floor over what a camera filmed.

    The grid lies at y = 0 below the volume, with the axes in its middle: if it does not lie on
    the floor of the picture, the calibration is not of this camera, or its axes are others.

    Parameters
    ----------
    background : (row, column, 3) uint8
        RGB, in the size of the camera's image.
    camera
        Metres, y up.
    volume
        What is observed.
    title : str
        Written above the picture.

    Returns
    -------
    (row, column, 3) uint8
        RGB, larger than the background.

    Raises
    ------
    ValueError
        Where the background is not of the camera's size.
    """
    rows, columns = background.shape[:2]
    if background.dtype != np.uint8 or background.shape != (camera.height, camera.width, 3):
        raise ValueError(
            f"the background is {background.dtype} of shape {background.shape}, but camera "
            f"{camera.name!r} films uint8 of shape {(camera.height, camera.width, 3)}"
        )
    larger = -(-settings.smallest_width_px // columns)
    pale = (1 - settings.pale) * background + settings.pale * 255.0
    size = (columns * larger * FINE, rows * larger * FINE)
    image = np.asarray(cv2.resize(pale, size, interpolation=cv2.INTER_CUBIC)).clip(0, 255)
    image = image.astype(np.uint8)
    for start, end in _floor_lines(volume, settings.grid_m):
        _draw(image, camera, larger, start, end, ORANGE, 1.0)
    for start, end in _edges(volume):
        _draw(image, camera, larger, start, end, INK, 2.0)
    middle = np.array([volume.center_m[0], 0.0, volume.center_m[2]])
    for axis, color in enumerate((RED, GREEN, BLUE)):
        tip = middle + settings.arrow_m * np.eye(3)[axis]
        _draw(image, camera, larger, middle, tip, color, 3.0)
    picture = finish(image)
    _write_title(picture, title)
    return picture


def draw_silhouette(
    frame: NDArray[np.uint8],
    silhouette: NDArray[np.bool_],
    *,
    title: str = "",
    settings: CheckSettings = CheckSettings(),
) -> Image:
    """Draw the outline of a silhouette over the frame that it was found in.

    Parameters
    ----------
    frame : (row, column, 3) uint8
        RGB, as filmed.
    silhouette : (row, column) bool
        Of the same frame.
    title : str
        Written above the picture.

    Returns
    -------
    (row, column, 3) uint8
        RGB, larger than the frame where that is small.

    Raises
    ------
    ValueError
        Where the silhouette is not of the frame's size.
    """
    if silhouette.shape != frame.shape[:2]:
        raise ValueError(
            f"the silhouette has shape {silhouette.shape}, but the frame {frame.shape[:2]}; bring "
            "those of one camera"
        )
    larger = -(-settings.smallest_width_px // frame.shape[1])
    size = (frame.shape[1] * larger, frame.shape[0] * larger)
    picture = np.array(cv2.resize(frame, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    inside = cv2.resize(silhouette.view(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    lines, _ = cv2.findContours(inside, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, lines, -1, RED, 2, cv2.LINE_AA)
    _write_title(picture, title)
    return picture


def _write_title(picture: Image, title: str) -> None:
    """Write a line above a picture."""
    if title:
        cv2.rectangle(picture, (0, 0), (picture.shape[1], 24), PAPER, cv2.FILLED)
        draw_text(picture, title, (8, 18), 15, INK)


def _floor_lines(volume: Volume, grid_m: float) -> list[tuple[NDArray, NDArray]]:
    """Return the ends of the lines of a grid at y = 0 below the volume."""
    low, high = (np.array(volume.center_m) + side * np.array(volume.size_m) for side in (-0.5, 0.5))
    lines = []
    for along, across in ((0, 2), (2, 0)):
        first, last = np.ceil(low[across] / grid_m), np.floor(high[across] / grid_m)
        for place in np.arange(first, last + 1) * grid_m:
            ends = np.zeros((2, 3))
            ends[:, across] = place
            ends[:, along] = low[along], high[along]
            lines.append((ends[0], ends[1]))
    return lines


def _edges(volume: Volume) -> list[tuple[NDArray, NDArray]]:
    """Return the ends of the twelve edges."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    places = corners * volume.size_m + volume.center_m
    return [
        (places[i], places[j])
        for i in range(8)
        for j in range(i + 1, 8)
        if (corners[i] != corners[j]).sum() == 1
    ]


def _draw(
    image: Image,
    camera: Camera,
    larger: int,
    start: NDArray,
    end: NDArray,
    color: Color,
    thickness: float,
) -> None:
    """Draw a line of the world as the lens bends it, where the camera sees it."""
    steps = np.linspace(0.0, 1.0, 65)[:, None]
    [pixel], _ = project_points(start + steps * (end - start), _widened(camera))
    place = (pixel - _beyond(camera) + 0.5) * larger - 0.5
    near = np.isfinite(pixel[:, 0])
    for i in np.flatnonzero(near[:-1] & near[1:]):
        draw_line(image, place[i], place[i + 1], color, thickness)


def _beyond(camera: Camera) -> int:
    """Return how far beside the image lines are drawn, px: farther, fixed point overflows."""
    return 8 * max(camera.width, camera.height)


def _widened(camera: Camera) -> Projection:
    """Return a camera that also sees what is beside its image; pixels are moved by `_beyond`."""
    seen, more = projection_of([camera]), _beyond(camera)
    intrinsics = seen.intrinsics.copy()
    intrinsics[:, :2, 2] += more
    return replace(seen, intrinsics=intrinsics, image_size=seen.image_size + 2 * more)
