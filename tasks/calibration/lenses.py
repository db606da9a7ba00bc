"""The lens of one camera from its own views of a board, as a start for all cameras together."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.calibration.adjustment import Adjusted, adjust_rig
from tasks.calibration.boards import Board
from tasks.calibration.rigs import LENS_NUMBERS, Rig, View, solve_poses, view_rms_px

_GUESSES = (0.6, 0.9, 1.3, 2.0)
"""Focal lengths to begin with, in widths of the picture. Wide lenses to telephoto ones."""
_MOST_VIEWS = 15
"""How many views a lens is fitted to [views]. Chosen: the start need not be better."""
_FIRST_VIEWS = 6
"""How many views the first guess is made of [views]. Chosen: it need only be near."""
_MISFIT_PX = 2.0
"""From which error a view is no board as it was taken for [px]. Ten times the usual noise."""
_HELD = cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2
_HELD |= cv2.CALIB_FIX_K3 | cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO


def fit_lens(
    views: Sequence[View], board: Board, size: tuple[int, int], *, aspect: float = 1.0
) -> Adjusted:
    """Return a camera with its lens as its own views say.

    Parameters
    ----------
    views
        Of one camera.
    board
        The board that it sees.
    size
        Width and height of the picture.
    aspect
        How many times as wide as high its pixels are shown.
    """
    used = list(views)
    lens = _first_guess(used[:_FIRST_VIEWS], board, size, aspect)
    while True:
        alone = [View(0, n, v.corners, v.pixel) for n, v in enumerate(used[:_MOST_VIEWS])]
        start = Rig(lens[None], np.eye(4)[None], _boards(alone, lens, board))
        adjusted = adjust_rig(start, alone, board, [size], still=0, aspects=[aspect])
        rms = view_rms_px(adjusted.rig, alone, board)
        good = [n for n, off in enumerate(rms) if off < max(_MISFIT_PX, 3 * np.median(rms))]
        if len(good) == len(alone):
            return adjusted
        lens = adjusted.rig.lenses[0]
        used = [used[n] for n in good] + used[_MOST_VIEWS:]


def _first_guess(
    views: Sequence[View], board: Board, size: tuple[int, int], aspect: float
) -> NDArray[np.float64]:
    """Return the lens that fits best of those found from several focal lengths."""
    points = [board.points_m[view.corners].astype(np.float32) for view in views]
    pixels = [view.pixel.astype(np.float32) for view in views]
    best, least = np.zeros(LENS_NUMBERS), np.inf
    for guess in _GUESSES:
        start = np.diag([guess * size[0], guess * size[0] * aspect, 1.0])
        start[:2, 2] = (np.asarray(size) - 1) / 2
        try:
            rms, matrix, bent, _, _ = cv2.calibrateCamera(
                points, pixels, size, start, np.zeros(5), flags=_HELD
            )
        except cv2.error:
            continue
        focal = matrix[0, 0] / size[0]
        if np.isfinite(rms) and rms < least and 0.2 < focal < 20:
            best = np.array([matrix[0, 0], matrix[1, 1], *start[:2, 2], *np.ravel(bent)[:5]])
            least = rms
    if not np.isfinite(least):
        best = np.array([size[0], size[0] * aspect, *(np.asarray(size) - 1) / 2, *np.zeros(5)])
    return best


def _boards(
    views: Sequence[View], lens: NDArray[np.float64], board: Board
) -> dict[int, NDArray[np.float64]]:
    """Return where the board of each view is before the camera."""
    return {view.moment: solve_poses(view, lens, board, within=1.0)[0] for view in views}
