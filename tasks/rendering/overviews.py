"""Draw a digitized take at a glance: what every camera sees of it, and how well its pose fits."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.geometry.runs import runs
from tasks.rendering.drawing.canvas import (
    BLUE,
    FINE,
    GRAY,
    GRID,
    INK,
    RED,
    Color,
    Image,
    blank,
    blend,
    draw_legend,
    draw_line,
    draw_text,
    finish,
)

_CELL_PX = 112
"""Width of the picture of a camera on the sheet [px]. Chosen by eye: hands can be made out."""
_CELLS_A_ROW = 4
"""How many pictures stand in a row. Chosen by eye: eight cameras, the usual ring, fill two."""
_GAP_PX = 8
"""Between the pictures on the sheet [px]. Chosen by eye."""
_NAME_PX = 20
"""Height of the line with the name of a camera [px]. Chosen by eye."""
_PLOT = (480, 160)
"""Width and height of the plot of quality [px]. Chosen by eye."""
_MARGIN = (44, 34, 16, 28)
"""Of the plot: left, above, right, below [px]. Chosen by eye."""
_DOUBTFUL = 0.22
"""How strongly doubtful frames are shaded [share]. Chosen by eye: lines show through."""
_TICKS = 5
"""About how many numbers of frames stand below the plot. Chosen by eye."""


def draw_contact_sheet(silhouettes: NDArray[np.bool_], names: Sequence[str]) -> Image:
    """Return the silhouettes of all cameras in one frame, side by side with their names.

    Parameters
    ----------
    silhouettes : (camera, row, column) bool
        True where a pixel shows the performer.
    names
        Of the cameras.

    Returns
    -------
    (row, column, 3) uint8
        RGB.

    Raises
    ------
    ValueError
        If there is no camera, or not a name for each.
    """
    count = len(silhouettes)
    if silhouettes.ndim != 3 or not silhouettes.size or len(names) != count:
        raise ValueError(
            f"silhouettes of shape {silhouettes.shape} and {len(names)} names make no sheet; pass "
            "(camera, row, column) with at least one camera, and a name for each"
        )
    columns = min(count, _CELLS_A_ROW)
    height = max(1, round(_CELL_PX * silhouettes.shape[1] / silhouettes.shape[2]))
    step = height + _NAME_PX + _GAP_PX
    image = finish(
        blank(-(-count // columns) * step + _GAP_PX, columns * (_CELL_PX + _GAP_PX) + _GAP_PX)
    )
    light, dark = np.array(GRID, np.float32), np.array(INK, np.float32)
    for n, (silhouette, name) in enumerate(zip(silhouettes, names, strict=True)):
        share = cv2.resize(
            silhouette.astype(np.float32), (_CELL_PX, height), interpolation=cv2.INTER_AREA
        )[..., None]
        top = _GAP_PX + n // columns * step
        left = _GAP_PX + n % columns * (_CELL_PX + _GAP_PX)
        shown = (share * dark + (1.0 - share) * light).round().astype(np.uint8)
        image[top : top + height, left : left + _CELL_PX] = shown
        draw_text(image, name, (left, top + height + 15), 13, GRAY)
    return image


def draw_quality(
    quality: NDArray[np.floating], doubtful: NDArray[np.bool_], rate_hz: float
) -> Image:
    """Return a plot of how well the pose fits over time, with the doubtful frames shaded.

    Parameters
    ----------
    quality : (time, segment) float
        Share of its voxels that a segment has, 0 to 1.
    doubtful : (time,) bool
        The frames that a person should look at.
    rate_hz
        Frames a second, for the seconds below the frames.

    Returns
    -------
    (row, column, 3) uint8
        RGB. Where several frames share a column of pixels, the worst of them counts.

    Raises
    ------
    ValueError
        If there is no frame, or qualities and doubts do not fit each other.
    """
    frames = len(quality)
    if quality.ndim != 2 or not quality.size or doubtful.shape != (frames,):
        raise ValueError(
            f"qualities of shape {quality.shape} and doubts of shape {doubtful.shape} make no "
            "plot; pass (time, segment) and (time,) with at least one frame"
        )
    width, height = _PLOT
    left, top, right, below = _MARGIN
    across, up = width - left - right, height - top - below
    image = blank(height, width)

    def at(frame: float, value: float) -> tuple[float, float]:
        return left + across * (frame + 0.5) / frames, top + up * (1.0 - value)

    for first, end in runs(doubtful):
        corner, opposite = at(first - 0.5, 1.0), at(end - 0.5, 0.0)
        wide = max(opposite[0], corner[0] + 1.0)
        _fill(image, corner, (wide, opposite[1]), blend(RED, _DOUBTFUL))
    for value in (0.0, 0.5, 1.0):
        draw_line(image, at(-0.5, value), at(frames - 0.5, value), GRID, 1.0)
    for values, color, thickness in (
        (quality.mean(axis=1), blend(BLUE, 0.45), 1.2),
        (quality.min(axis=1), BLUE, 1.4),
    ):
        spots = [at(frame, value) for frame, value in _worst(np.clip(values, 0.0, 1.0), across)]
        for start, end in zip(spots, spots[1:] or spots, strict=False):
            draw_line(image, start, end, color, thickness)
    image = finish(image)
    for value in (0.0, 0.5, 1.0):
        draw_text(image, f"{value:g}", (left - 8, at(0, value)[1] + 5), 13, GRAY, "right")
    for frame in _ticks(frames):
        place = (at(frame, 0.0)[0], height - below + 18)
        draw_text(image, f"{frame} ({frame / rate_hz:.1f} s)", place, 12, GRAY, "center")
    entries = (
        ("worst segment", BLUE),
        ("mean", blend(BLUE, 0.45)),
        ("doubtful", blend(RED, 2 * _DOUBTFUL)),
    )
    draw_legend(image, entries, row=20)
    return image


def _fill(
    image: Image, corner: tuple[float, float], opposite: tuple[float, float], color: Color
) -> None:
    """Fill a rectangle between two points (column, row) of the finished picture."""
    (a, b), (c, d) = (np.rint(np.array(p) * FINE).astype(int) for p in (corner, opposite))
    image[b:d, a:c] = color


def _worst(values: NDArray[np.floating], most: int) -> list[tuple[float, float]]:
    """Return frame and value of a curve, the least of several where there are more than `most`."""
    step = max(1, -(-len(values) // most))
    starts = range(0, len(values), step)
    return [(float(n + np.argmin(part := values[n : n + step])), float(part.min())) for n in starts]


def _ticks(frames: int) -> range:
    """Return the frames whose numbers are written: round ones."""
    least = frames / _TICKS
    power = 10.0 ** np.floor(np.log10(max(least, 1.0)))
    step = next(round(k * power) for k in (1, 2, 5, 10) if k * power >= least)
    return range(0, frames, max(1, step))
