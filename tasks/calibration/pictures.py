"""A picture a camera of where in its image corners were seen, and how far each is off."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.calibration.choosing import covered_cells
from tasks.calibration.rigs import View
from tasks.rendering.drawing.canvas import INK, PAPER, RED, draw_text

_SMALLEST_WIDTH_PX = 720
"""Pictures narrower than this are enlarged [px]. Chosen by eye: words can be read."""
_FAR_PX = 1.0
"""From which error a corner is drawn red [px]; green are those without. Chosen: usual are 0.2."""
_PALE = 0.55
"""How much white is laid over the picture. Chosen by eye: dots stand out."""
_UNSEEN = RED
_BAND_PX = 34
"""Height of the band with the title [px]. Chosen by eye."""


def draw_coverage(
    picture: NDArray[np.uint8],
    views: Sequence[View],
    off_px: Sequence[NDArray[np.float64]],
    title: str,
) -> NDArray[np.uint8]:
    """Return a picture of the corners that a camera saw, over one of its pictures.

    Parts without any corner are red and hatched; corners are green where they are where the
    calibration says, and red from a pixel on.

    Parameters
    ----------
    picture : (row, column) uint8
        Gray.
    views
        Of this camera.
    off_px : sequence of (corner,) float64
        By how many pixels each corner of each view is off; empty where there is no calibration.
    title
        Written above.

    Returns
    -------
    (row, column, 3) uint8
        RGB, with a band for the title.
    """
    rows, columns = picture.shape
    scale = max(1, -(-_SMALLEST_WIDTH_PX // columns))
    pale = 255 - (255 - picture.astype(float)) * (1 - _PALE)
    image = np.repeat(pale[..., None], 3, axis=2)
    cells = covered_cells(views, (columns, rows))
    # a cell of each pixel, as `covered_cells` cuts the picture
    row = (np.arange(rows) + 0.5) / rows * cells.shape[0]
    column = (np.arange(columns) + 0.5) / columns * cells.shape[1]
    unseen = ~cells[row.astype(int)[:, None], column.astype(int)]
    hatched = (np.add.outer(np.arange(rows), np.arange(columns)) * scale // 8) % 4 == 0
    image[unseen] = 0.88 * image[unseen] + 0.12 * np.array(_UNSEEN)
    image[unseen & hatched] = 0.75 * image[unseen & hatched] + 0.25 * np.array(_UNSEEN)
    drawn = np.repeat(np.repeat(image.astype(np.uint8), scale, axis=0), scale, axis=1)
    for view in views:
        at = np.rint((view.pixel + 0.5) * scale).astype(int)
        hull = cv2.convexHull(at.astype(np.int32))
        cv2.polylines(drawn, [hull], True, (150, 150, 150), 1, cv2.LINE_AA)
    for n, view in enumerate(views):
        at = np.rint((view.pixel + 0.5) * scale).astype(int)
        errors = off_px[n] if len(off_px) else np.zeros(len(at))
        for (x, y), error in zip(at.tolist(), errors, strict=True):
            cv2.circle(drawn, (x, y), 3, _color_of(error), -1, cv2.LINE_AA)
    band = np.full((_BAND_PX, drawn.shape[1], 3), PAPER, np.uint8)
    draw_text(band, title, (12, 23), 16, INK)
    return np.concatenate([band, drawn])


def _color_of(error_px: float) -> tuple[int, int, int]:
    """Return a color from green by yellow to red."""
    share = min(error_px / _FAR_PX, 1.0)
    return int(230 * min(2 * share, 1)), int(150 * min(2 - 2 * share, 1)), 60
