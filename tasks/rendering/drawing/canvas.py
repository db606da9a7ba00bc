"""Lines, text and colors of a picture that is drawn large and then reduced.

Points are (column, row) of the finished picture.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

PAPER: Color = (250, 249, 246)  # The background, RGB. Chosen by eye; not measured.
INK: Color = (32, 36, 44)  # Text and outlines, RGB. Chosen by eye; not measured.
GRAY: Color = (112, 116, 124)  # What is less important, RGB. Chosen by eye; not measured.
GRID: Color = (222, 220, 212)  # Lines of the floor, RGB. Chosen by eye; not measured.
BLUE: Color = (43, 95, 208)  # A query, RGB. Chosen by eye; not measured.
ORANGE: Color = (217, 107, 28)  # A match, RGB. Chosen by eye; not measured.
RED: Color = (190, 52, 48)  # The right side, or what is wrong, RGB. Chosen by eye; not measured.
GREEN: Color = (38, 140, 72)  # An axis, RGB. Chosen by eye; not measured.

FINE = 2
"""How much larger pictures are drawn before they are reduced, for smooth edges [times]. Chosen by
eye; not measured."""


def blank(height: int, width: int) -> Image:
    """Return an empty picture, still large."""
    return np.full((height * FINE, width * FINE, 3), PAPER, np.uint8)


def blend(color: Color, share: float) -> Color:
    """Return the color thinned with the paper's."""
    r, g, b = (round(share * c + (1.0 - share) * p) for c, p in zip(color, PAPER, strict=True))
    return r, g, b


def draw_line(
    image: Image, start: ArrayLike, end: ArrayLike, color: Color, thickness: float
) -> None:
    """Draw a line between two points (column, row) of the finished picture."""
    a, b = (tuple(int(v) for v in np.rint(np.asarray(p) * FINE * 16)) for p in (start, end))
    cv2.line(image, a, b, color, max(round(thickness * FINE), 1), cv2.LINE_AA, 4)


def finish(image: Image) -> Image:
    """Return the finished picture."""
    rows, columns = image.shape[0] // FINE, image.shape[1] // FINE
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)


def draw_legend(image: Image, entries: Sequence[tuple[str, Color]], row: int) -> None:
    """Write names with their colors at the upper right."""
    column = image.shape[1] - 24
    for name, color in reversed(entries):
        column -= draw_text(image, name, (column, row), 15, INK, "right")
        cv2.circle(image, (column - 12, row - 5), 5, color, cv2.FILLED, cv2.LINE_AA)
        column -= 34


def draw_text(
    image: Image,
    text: str,
    at: tuple[float, float],
    size: int,
    color: Color,
    align: str = "left",
    *,
    weight: int = 400,
) -> int:
    """Write text with its base line at (column, row); return its width in pixels."""
    face = cv2.FontFace("sans")
    _, _, width, _ = cv2.getTextSize((0, 0), text, (0, 0), face, size, weight)
    left = at[0] - {"left": 0.0, "center": 0.5, "right": 1.0}[align] * width
    cv2.putText(image, text, (round(left), round(at[1])), color, face, size, weight)
    return width
