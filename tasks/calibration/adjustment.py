"""Lenses, cameras and boards adjusted together, until corners are where they were seen.

Bundle adjustment: the sum of squared distances in pixels, in units of the noise and with a loss
that grows as the distance where a corner is far off, over lenses, poses of cameras and poses of
boards. Weak priors stand for what every lens is like, so that what the pictures do not tell stays
usual.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve
from scipy.sparse import csr_matrix

from tasks.calibration.boards import Board
from tasks.calibration.rigs import (
    LENS_NUMBERS,
    Rig,
    View,
    matrix_of,
    pose_of,
    residuals_of_points,
    vector_of,
)

NOISE_PX = 0.2
"""How far corners are usually off [px]. Measured on drawn boards: 0.05 to 0.15; films have more."""
_FAR = 3.0
"""From how many times the noise on a corner counts by its distance, and not by its square.
Usual."""
_PRIOR_ASPECT = 0.02
"""How much the focal lengths of a lens differ, as a share. Chosen: pixels are square or as the file
says, so that this only holds what nothing else does."""
_PRIOR_MIDDLE = 0.03
"""How far the middle of a lens is from that of its picture, as a share of the width. Usual for
cameras whose picture was not cut."""
_PRIOR_FOCAL = 1.0
"""How far a focal length may be from the first guess, as a share of it. Holds it where a board is
seen from the front only."""
_PRIOR_BENT = np.array([0.5, 0.5, 0.005, 0.005, 0.2])
"""How large k1, k2, p1, p2, k3 usually are. Chosen: the lenses of `bini` (-.36, .20, -.07) and of
usual action cameras are within."""
_STEPS = 60
"""How often lenses and poses are moved at most [steps]. Usual are five to fifteen."""
_FIRST_DAMPING, _LARGEST_DAMPING, _SMALLEST = 1e-4, 1e8, 1e-12
"""Damping of the first step, the one at which no step gains any more, and what keeps a matrix from
being singular, as shares of its diagonal. Usual; the outcome hardly depends on them."""
_ENOUGH = 1e-5
"""Share of the cost that a step has to gain for another one to be made. Chosen: less
moves no camera by a tenth of a millimetre."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A rig that fits the views best, and how well that fixes it."""

    rig: Rig
    focal_error: NDArray[np.float64]
    """(camera,) standard error of the focal length, as a share of it."""
    bend_m: float
    """How far the middle of the board stands out of the plane of its rim, m."""
    bend_error_m: float
    """Its standard error."""


@dataclass(frozen=True)
class _Layout:
    """Where each number of a rig is among those that are adjusted; -1 for what stays."""

    lens: NDArray[np.intp]
    camera: NDArray[np.intp]
    board: dict[int, int]
    size: int


def adjust_rig(
    rig: Rig,
    views: Sequence[View],
    board: Board,
    sizes: Sequence[tuple[int, int]],
    *,
    still: int,
    lenses_stay: bool = False,
    aspects: Sequence[float] | None = None,
) -> Adjusted:
    """Return the rig that fits the views best.

    Parameters
    ----------
    rig
        Where to begin; it has every camera and every moment of the views.
    views
        What the cameras see.
    board
        The board that they see.
    sizes
        Width and height of each camera's picture.
    still
        The camera that stays where it is.
    lenses_stay
        Whether the lenses are known.
    aspects
        How many times as wide as high each camera's pixels are shown; 1 if not given.
    """
    layout = _lay_out(rig, views, still, lenses_stay=lenses_stay)
    start = _numbers_of(rig, layout)
    prior = _Prior(rig.lenses, sizes, aspects or [1.0] * len(sizes), layout)
    points = board.points_m

    def off(parts: Rig) -> NDArray[np.float64]:
        return np.concatenate([_errors(parts, views, points), prior.off(parts.lenses)])

    def slope(parts: Rig) -> csr_matrix:
        blocks, rows = _slopes(parts, views, points, layout, bends=False)
        return _stacked(blocks, prior, rows, layout.size)

    found = _minimize(start, lambda numbers: _rig_of(numbers, layout, rig), off, slope)
    return _judged(_rig_of(found, layout, rig), views, points, layout, prior)


def _minimize(
    numbers: NDArray[np.float64],
    rig_of: Callable[[NDArray[np.float64]], Rig],
    off: Callable[[Rig], NDArray[np.float64]],
    slope: Callable[[Rig], csr_matrix],
) -> NDArray[np.float64]:
    """Return the numbers whose errors are least (Levenberg and Marquardt).

    The normal equations of some hundred numbers are solved as they are: scipy's `least_squares`
    with sparse slopes solves them by LSMR, which on eight cameras and forty boards stood still with
    focal lengths two to five percent off, where this errs by 0.2 % or less.
    """
    damping = _FIRST_DAMPING
    rig = rig_of(numbers)
    errors = off(rig)
    for _ in range(_STEPS):
        weights = 1 / np.sqrt(1 + (errors / _FAR) ** 2)
        now = slope(rig)
        weighted = now.multiply(weights[:, None]).tocsr()
        normal, gradient = (weighted.T @ now).toarray(), weighted.T @ errors
        cost = _cost(errors)
        while damping < _LARGEST_DAMPING:
            damped = normal + np.diag(damping * np.diag(normal) + _SMALLEST)
            tried = numbers - solve(damped, gradient, assume_a="pos")
            rig_tried = rig_of(tried)
            errors_tried = off(rig_tried)
            if _cost(errors_tried) < cost:  # never for NaN
                break
            damping *= 10
        else:
            return numbers
        numbers, rig, errors = tried, rig_tried, errors_tried
        damping = max(damping / 10, _SMALLEST)
        if cost - _cost(errors) < _ENOUGH * cost:
            break
    return numbers


def _cost(errors: NDArray[np.float64]) -> float:
    """Return the sum of squares, in which far ones count by their distance (pseudo-Huber)."""
    return float((2 * _FAR**2 * (np.sqrt(1 + (errors / _FAR) ** 2) - 1)).sum())


def _lay_out(rig: Rig, views: Sequence[View], still: int, *, lenses_stay: bool) -> _Layout:
    """Return which numbers are adjusted: lenses, then cameras, then boards."""
    count = len(rig.lenses)
    lens = np.full(count, -1) if lenses_stay else np.arange(count) * LENS_NUMBERS
    at = 0 if lenses_stay else count * LENS_NUMBERS
    moved = np.arange(count) != still
    camera = np.where(moved, at + 6 * (np.cumsum(moved) - 1), -1)
    at += 6 * int(moved.sum())
    moments = sorted({view.moment for view in views})
    board = {moment: at + 6 * n for n, moment in enumerate(moments)}
    return _Layout(lens, camera, board, at + 6 * len(moments))


def _numbers_of(rig: Rig, layout: _Layout) -> NDArray[np.float64]:
    numbers = np.empty(layout.size)
    for camera, at in enumerate(layout.lens):
        if at >= 0:
            numbers[at : at + LENS_NUMBERS] = rig.lenses[camera]
    for camera, at in enumerate(layout.camera):
        if at >= 0:
            numbers[at : at + 6] = vector_of(rig.camera_from_world[camera])
    for moment, at in layout.board.items():
        numbers[at : at + 6] = vector_of(rig.world_from_board[moment])
    return numbers


def _rig_of(numbers: NDArray[np.float64], layout: _Layout, start: Rig) -> Rig:
    lenses, cameras = start.lenses.copy(), start.camera_from_world.copy()
    for camera, at in enumerate(layout.lens):
        if at >= 0:
            lenses[camera] = numbers[at : at + LENS_NUMBERS]
    for camera, at in enumerate(layout.camera):
        if at >= 0:
            cameras[camera] = pose_of(numbers[at : at + 6])
    boards = {moment: pose_of(numbers[at : at + 6]) for moment, at in layout.board.items()}
    return Rig(lenses, cameras, boards)


class _Prior:
    """What lenses usually are like: errors in units of the usual spread, and their slopes."""

    def __init__(
        self,
        first: NDArray[np.float64],
        sizes: Sequence[tuple[int, int]],
        aspects: Sequence[float],
        layout: _Layout,
    ) -> None:
        self._first, self._aspects = first, np.asarray(aspects)
        self._middle = (np.asarray(sizes, float) - 1) / 2
        self._width = np.asarray(sizes, float)[:, :1]
        self._free = layout.lens >= 0
        rows = [self._rows(camera) for camera in np.flatnonzero(self._free).tolist()]
        columns = np.concatenate(
            [np.arange(LENS_NUMBERS) + at for at in layout.lens if at >= 0] or [[]]
        )
        self.slope = (
            np.concatenate(rows).reshape(-1, LENS_NUMBERS, LENS_NUMBERS)
            if rows
            else np.empty((0, LENS_NUMBERS, LENS_NUMBERS))
        )
        self.columns = columns.astype(int)

    def off(self, lenses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the errors of the lenses, nine each."""
        focal = self._first[:, :1]
        errors = np.column_stack(
            [
                (lenses[:, :1] - focal) / (_PRIOR_FOCAL * focal),
                (lenses[:, 1:2] - lenses[:, :1] * self._aspects[:, None]) / (_PRIOR_ASPECT * focal),
                (lenses[:, 2:4] - self._middle) / (_PRIOR_MIDDLE * self._width),
                lenses[:, 4:] / _PRIOR_BENT,
            ]
        )
        return errors[self._free].ravel()

    def _rows(self, camera: int) -> NDArray[np.float64]:
        focal, width = self._first[camera, 0], self._width[camera, 0]
        slope = np.diag(
            np.concatenate([
                [1 / (_PRIOR_FOCAL * focal), 1 / (_PRIOR_ASPECT * focal)],
                np.full(2, 1 / (_PRIOR_MIDDLE * width)), 1 / _PRIOR_BENT,
            ])
        )  # fmt: skip
        slope[1, 0] = -self._aspects[camera] / (_PRIOR_ASPECT * focal)
        return slope


def _errors(rig: Rig, views: Sequence[View], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how many times the noise each corner is off, column and row in turn."""
    off = residuals_of_points(rig, views, points)
    return np.concatenate([each.ravel() / NOISE_PX for each in off])


def _slopes(
    rig: Rig, views: Sequence[View], points: NDArray[np.float64], layout: _Layout, *, bends: bool
) -> tuple[list[tuple[int, int, NDArray[np.float64]]], int]:
    """Return the blocks (row, column, slope) of the errors' derivative, and how many rows it has.

    With `bends`, three more columns say what a bent board changes.
    """
    blocks: list[tuple[int, int, NDArray[np.float64]]] = []
    row = 0
    for view in views:
        lens = rig.lenses[view.camera]
        board = vector_of(rig.world_from_board[view.moment])
        camera = vector_of(rig.camera_from_world[view.camera])
        turn, shift, *parts = cv2.composeRT(board[:3], board[3:], camera[:3], camera[3:])
        by_board = _side_by_side(parts[0], parts[1], parts[4], parts[5])
        by_camera = _side_by_side(parts[2], parts[3], parts[6], parts[7])
        _, slope = cv2.projectPoints(points[view.corners], turn, shift, matrix_of(lens), lens[4:])
        slope = np.asarray(slope, np.float64) / NOISE_PX
        for at, block in (
            (layout.lens[view.camera], slope[:, 6:]),
            (layout.camera[view.camera], slope[:, :6] @ by_camera),
            (layout.board[view.moment], slope[:, :6] @ by_board),
        ):
            if at >= 0:
                blocks.append((row, int(at), block))
        if bends:
            # out of the board is along its z axis, as it stands before the camera
            out = cv2.Rodrigues(turn)[0][:, 2]
            along = (slope[:, 3:6] @ out).reshape(-1, 2, 1)
            shapes = _bend_shapes(points)[view.corners]
            blocks.append((row, layout.size, (along * shapes[:, None]).reshape(len(slope), 3)))
        row += len(slope)
    return blocks, row


def _side_by_side(*parts: Any) -> NDArray[np.float64]:
    """Return four (3, 3) slopes as one of six numbers by six."""
    whole = np.empty((6, 6))
    whole[:3, :3], whole[:3, 3:], whole[3:, :3], whole[3:, 3:] = parts
    return whole


def _bend_shapes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (corner, 3) how far corners stand out of a board bent along, across or twisted."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    x, y = (flat / abs(flat).max(axis=0)).T
    return np.column_stack([x * x, y * y, x * y])


def _stacked(
    blocks: Sequence[tuple[int, int, NDArray[np.float64]]], prior: _Prior, rows: int, columns: int
) -> csr_matrix:
    """Return the blocks, and the prior's below them, as one sparse matrix."""
    everything = list(blocks)
    for n, block in enumerate(prior.slope):
        everything.append((rows + n * LENS_NUMBERS, int(prior.columns[n * LENS_NUMBERS]), block))
    total = rows + len(prior.slope) * LENS_NUMBERS
    row = np.concatenate([(r + np.indices(b.shape)[0]).ravel() for r, _, b in everything])
    column = np.concatenate([(c + np.indices(b.shape)[1]).ravel() for _, c, b in everything])
    value = np.concatenate([b.ravel() for _, _, b in everything])
    return csr_matrix((value, (row, column)), shape=(total, columns))


def _judged(
    rig: Rig, views: Sequence[View], points: NDArray[np.float64], layout: _Layout, prior: _Prior
) -> Adjusted:
    """Return the rig with how well its focal lengths are known, and how bent the board is."""
    off = _errors(rig, views, points)
    blocks, rows = _slopes(rig, views, points, layout, bends=True)
    slope = _stacked(blocks, prior, rows, layout.size + 3)
    noise = 1.4826 * float(np.median(abs(off)))
    weights = np.ones(len(off) + prior.slope.shape[0] * LENS_NUMBERS)
    weights[:rows] = 1 / np.sqrt(1 + (off / _FAR) ** 2)
    errors = np.concatenate([off, prior.off(rig.lenses)])
    weighted = slope.multiply(weights[:, None]).tocsr()
    normal = (weighted.T @ slope).toarray()
    focal_error = np.zeros(len(rig.lenses))
    inner = np.linalg.pinv(normal[:-3, :-3], hermitian=True)
    for camera, at in enumerate(layout.lens):
        if at >= 0:
            focal_error[camera] = noise * np.sqrt(max(inner[at, at], 0)) / rig.lenses[camera, 0]
    spread = np.linalg.pinv(normal, hermitian=True)
    bend = (spread @ -(weighted.T @ errors))[-3:]
    bend_m = float(np.ptp(_bend_shapes(points) @ bend))
    sure = float(bend @ np.linalg.solve(spread[-3:, -3:], bend)) / 3
    bend_error_m = bend_m * noise / np.sqrt(sure) if sure > 0 else np.inf
    return Adjusted(rig, focal_error, bend_m, float(bend_error_m))
