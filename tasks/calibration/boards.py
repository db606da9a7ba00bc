"""Boards that cameras are calibrated with, and their corners in a picture.

A checkerboard has to be whole in the picture; a ChArUco board, whose white squares hold numbered
markers, does not. Corners are those between four squares, counted by row; a board of 9x6 has nine
of them side by side, and ten squares.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Found = tuple[NDArray[np.intp], NDArray[np.float64]]
"""Which corners were found, and (corner, 2) column and row of each, pixel centers at integers."""

FEWEST_CORNERS = 6
"""How many corners of a ChArUco board make a view [corners]. Four fix a plane; two more show that
one of them is wrong."""
_LONGEST_SIDE_PX = 1000
"""Pictures are searched at this size at most [px]. Chosen: squares of a usual board have 10 px
there if they have 20 in a film of 1080p, and the search takes a fourth of the time."""
_ENLARGED_PX = 700
"""Pictures smaller than this are searched enlarged, too [px]. Chosen: below it squares of 8 px are
usual, in which the detector finds nothing; on rig `bini` it finds two boards of four so, else
one."""
_WINDOW = 0.4
"""Share of the distance of two corners in which one is looked for more exactly. Less than a half,
so that no neighbor is in it."""
_LARGEST_WINDOW_PX = 11
"""Half a side of the window in which a corner is looked for, at most [px]. Usual; larger ones reach
into what a bent lens no longer shows straight."""
_SEARCH = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
_EXACT = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)


@dataclass(frozen=True)
class Board:
    """A flat pattern of squares."""

    columns: int
    """Corners side by side."""
    rows: int
    """Corners one below the other."""
    square_m: float
    """Side of a square, m."""
    dictionary: str = ""
    """OpenCV's name of the markers of a ChArUco board; empty for a checkerboard."""
    marker_share: float = 0.75
    """Side of a marker, in squares."""
    legacy: bool = False
    """Whether the first square is white although the rows of squares are even, as OpenCV drew it
    before 4.6."""

    @property
    def corners(self) -> int:
        """How many corners there are."""
        return self.columns * self.rows

    @property
    def said(self) -> str:
        """What it is, in words."""
        if self.dictionary:
            return f"ChArUco board of {self.columns}x{self.rows} corners, {self.dictionary}"
        return f"checkerboard of {self.columns}x{self.rows} corners"

    @property
    def points_m(self) -> NDArray[np.float64]:
        """(corner, 3): x along a row, y down the rows, and z, which is 0, into the board."""
        row, column = np.divmod(np.arange(self.corners), self.columns)
        flat = np.column_stack([column, row, np.zeros(self.corners)])
        return flat * self.square_m

    @property
    def middle_m(self) -> NDArray[np.float64]:
        """(3,) the middle of the corners."""
        return np.array([self.columns - 1, self.rows - 1, 0.0]) / 2 * self.square_m

    def turns(self) -> list[NDArray[np.intp]]:
        """Return the orders of the corners that look alike, each as (corner,) indices.

        The first is the order itself. A ChArUco board has no other; a checkerboard has the half
        turn where both numbers of corners are even or both odd.
        """
        order = np.arange(self.corners).reshape(self.rows, self.columns)
        turns = [order]
        if not self.dictionary:
            for quarters in range(1, 4):
                turned = np.rot90(order, quarters)
                if turned.shape == order.shape and self._keeps_colors(turned):
                    turns.append(turned)
        return [turn.ravel() for turn in turns]

    def _keeps_colors(self, turned: NDArray[np.intp]) -> bool:
        """Tell whether a turn puts dark squares on dark ones."""
        squares = np.indices((self.rows + 1, self.columns + 1)).sum(axis=0) % 2
        row, column = (each.min() for each in np.divmod(turned[:2, :2], self.columns))
        return bool(squares[row + 1, column + 1] == squares[1, 1])


def turn_of(board: Board, turn: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return (4, 4) how the board lies in itself after a turn of its corners.

    The corner that is called n after the turn is `turn[n]` of the board.
    """
    points = board.points_m
    moved = points[turn]
    across, down = moved[1] - moved[0], moved[board.columns] - moved[0]
    rotation = np.column_stack([across, down, np.cross(across, down) / board.square_m])
    result = np.eye(4)
    result[:3, :3] = rotation / board.square_m
    result[:3, 3] = moved[0]
    return result


def find_corners(gray: NDArray[np.uint8], board: Board) -> Found | None:
    """Return the corners of a board in a picture, None where it is not there or not whole.

    The order is that of the board seen from its front, and so that its first square is dark where
    that tells two orders apart.
    """
    if board.dictionary:
        return _find_charuco(gray, board)
    found = find_checkers(gray, board.columns, board.rows)
    if found is None:
        return None
    return np.arange(board.corners), _ordered(gray, found, board)


def find_checkers_slowly(gray: NDArray[np.uint8], board: Board) -> Found | None:
    """Return the corners of a checkerboard as `find_corners`, which finds fewer and is faster."""
    for scale in (1.0, 2.0) if max(gray.shape) < _ENLARGED_PX else (1.0,):
        searched = gray if scale == 1.0 else _scaled(gray, scale)
        found, corners = cv2.findChessboardCornersSB(searched, (board.columns, board.rows), flags=0)
        if found and corners is not None:
            exact = (corners.reshape(-1, 2).astype(np.float64) + 0.5) / scale - 0.5
            return np.arange(board.corners), _ordered(gray, exact, board)
    return None


def find_checkers(gray: NDArray[np.uint8], columns: int, rows: int) -> NDArray[np.float64] | None:
    """Return (corner, 2) the corners of a checkerboard of this size, in any of its orders."""
    longest = max(gray.shape)
    scales = [min(1.0, _LONGEST_SIDE_PX / longest)] + [2.0] * (longest < _ENLARGED_PX)
    for scale in scales:
        searched = gray if scale == 1.0 else _scaled(gray, scale)
        found, corners = cv2.findChessboardCorners(searched, (columns, rows), flags=_SEARCH)
        if found and corners is not None:
            # pixel centers are at integers in both pictures
            rough = (corners.reshape(-1, 2).astype(np.float64) + 0.5) / scale - 0.5
            return _refined(gray, rough, columns)
    return None


def spacing_px(pixel: NDArray[np.float64], columns: int) -> float:
    """Return the least distance of two corners side by side or one below the other."""
    grid = pixel.reshape(-1, columns, 2)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    return float(min(across.min(), down.min()))


def detector_of(board: Board) -> Any:
    """Return OpenCV's detector of a ChArUco board."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    drawn = cv2.aruco.CharucoBoard(
        (board.columns + 1, board.rows + 1), board.square_m, board.square_m * board.marker_share,
        dictionary,
    )  # fmt: skip
    drawn.setLegacyPattern(board.legacy)
    return cv2.aruco.CharucoDetector(drawn)


def _find_charuco(gray: NDArray[np.uint8], board: Board) -> Found | None:
    """Return the corners between markers that are read, of small pictures enlarged if need be."""
    for scale in (1.0, 2.0) if max(gray.shape) < _ENLARGED_PX else (1.0,):
        searched = gray if scale == 1.0 else _scaled(gray, scale)
        corners, ids, _, _ = detector_of(board).detectBoard(searched)
        if corners is None or ids is None or len(ids) < FEWEST_CORNERS:
            continue
        numbers = np.asarray(ids).ravel().astype(np.intp)
        rows, columns = np.divmod(numbers, board.columns)
        if len(set(rows.tolist())) < 2 or len(set(columns.tolist())) < 2:
            continue  # on a line, where no plane is fixed
        pixel = np.asarray(corners, np.float64).reshape(-1, 2)
        return numbers, (pixel + 0.5) / scale - 0.5
    return None


def _scaled(gray: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(gray, None, fx=scale, fy=scale, interpolation=how), np.uint8)


def _refined(
    gray: NDArray[np.uint8], rough: NDArray[np.float64], columns: int
) -> NDArray[np.float64]:
    """Return the corners to a part of a pixel."""
    half = int(np.clip(_WINDOW * spacing_px(rough, columns), 1, _LARGEST_WINDOW_PX))
    start = np.ascontiguousarray(rough[:, None], np.float32)
    exact = cv2.cornerSubPix(gray, start, (half, half), (-1, -1), _EXACT)
    return np.asarray(exact, np.float64).reshape(-1, 2)


def _ordered(
    gray: NDArray[np.uint8], pixel: NDArray[np.float64], board: Board
) -> NDArray[np.float64]:
    """Return the corners as seen from the front, the first square dark where that tells a side."""
    grid = pixel.reshape(board.rows, board.columns, 2)
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0:
        grid = grid[:, ::-1]
    same_shape = [q for q in range(4) if np.rot90(grid, q).shape == grid.shape]
    orders = [np.rot90(grid, quarters) for quarters in same_shape]
    # rot90 of both axes turns and never mirrors
    dark = [_dark_first(gray, order) for order in orders]
    chosen = orders[int(np.argmin(dark))] if len(orders) > len(board.turns()) else orders[0]
    return chosen.reshape(-1, 2)


def _dark_first(gray: NDArray[np.uint8], grid: NDArray[np.float64]) -> float:
    """Return how bright the squares are that should be dark, against the others."""
    middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    rows, columns = middles.shape[:2]
    at = np.rint(middles).astype(int)
    value = gray[
        np.clip(at[..., 1], 0, gray.shape[0] - 1), np.clip(at[..., 0], 0, gray.shape[1] - 1)
    ].astype(float)
    even = np.indices((rows, columns)).sum(axis=0) % 2 == 0
    return float(value[even].mean() - value[~even].mean())
