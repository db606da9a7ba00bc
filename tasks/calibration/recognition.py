"""Which board is in some pictures: a checkerboard or a ChArUco board, of how many corners.

Markers of a ChArUco board (Garrido-Jurado et al. 2014) are numbered row by row, so that where they
are tells how many stand in a row; of a checkerboard the largest grid counts that is seen more than
once.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.calibration.boards import Board

DICTIONARIES = (
    "DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h11", "DICT_ARUCO_MIP_36h12",
)  # fmt: skip
"""The markers that are tried. Those of 1000 begin with the 50, 100 and 250 of their kind."""
_FEWEST_MARKERS = 4
"""How many markers of a kind are believed [markers]. Fewer are seen in any pattern of squares."""
_SAME = 3
"""After how many pictures of one board no more are looked at [pictures]. Chosen: two agree by
chance where a board is half outside, three hardly."""
_MOST_SQUARES = 20
"""How many squares a row of a ChArUco board has at most [squares]. Chosen: usual are 5 to 14."""
_FITS = 0.12
"""How far the middle of a marker may be from where a board of so many squares has it [squares].
Half of a square's row is 1; a bent lens moves it by some hundredths."""
_LONGEST_SIDE_PX = 1000
"""Pictures are looked at in this size at most [px]. As the corners are searched."""
_SMALLEST = (3, 3)
"""The smallest grid of corners that is looked for, side by side and one below the other. OpenCV
looks for no smaller one."""


@dataclass(frozen=True)
class Recognized:
    """What board there is, and what speaks for it."""

    board: Board | None
    """None where no board was found; its squares are 1 m where the size is not known."""
    sizes: tuple[tuple[int, int], ...] = ()
    """The sizes of all grids that were seen, the larger number first."""
    mirrored: bool = False
    """Whether markers are read in mirrored pictures only."""


def recognize_board(
    pictures: Iterable[NDArray[np.uint8]],
    *,
    square_m: float = 1.0,
    charuco: bool = False,
    size: tuple[int, int] | None = None,
) -> Recognized:
    """Return the board in some gray pictures.

    Parameters
    ----------
    pictures : iterable of (row, column) uint8
        No more of them are taken than are needed.
    square_m
        Side of a square.
    charuco
        Whether it is known to be a ChArUco board.
    size
        Corners side by side and one below the other, where they are known.
    """
    seen: dict[tuple[str, bool], list[_Markers]] = {}
    grids: Counter[tuple[int, int]] = Counter()
    for picture in pictures:
        small = _small(picture)
        found = None if grids else _markers(small)
        if found is not None:
            seen.setdefault(found[0], []).append(found[1])
        elif not charuco and not seen:
            grid = _grid(small)
            grids.update([grid] if grid else [])
        if max([*map(len, seen.values()), *grids.values()], default=0) >= _SAME:
            break
    sizes = tuple(sorted(grids, key=lambda grid: -grid[0] * grid[1]))
    if seen:
        kind = max(seen, key=lambda kind: sum(len(each.numbers) for each in seen[kind]))
        return Recognized(_charuco(kind[0], seen[kind], square_m, size), mirrored=kind[1])
    if not sizes:
        return Recognized(None)
    often = [grid for grid in sizes if grids[grid] > 1] or sizes
    return Recognized(Board(*(size or often[0]), square_m), sizes)


@dataclass(frozen=True, eq=False)
class _Markers:
    """The markers of a picture."""

    numbers: NDArray[np.intp]
    outline: NDArray[np.float64]
    """(marker, 4, 2) px, clockwise from the top left."""


def _small(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    scale = min(1.0, _LONGEST_SIDE_PX / max(picture.shape))
    if scale == 1.0:
        return picture
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def _markers(picture: NDArray[np.uint8]) -> tuple[tuple[str, bool], _Markers] | None:
    """Return the kind with most markers, whether they are read in a mirror, and the markers."""
    words = [cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)) for name in DICTIONARIES]
    detector = cv2.aruco.ArucoDetector(words)
    for mirrored in (False, True):
        image = np.ascontiguousarray(picture[:, ::-1]) if mirrored else picture
        outlines, numbers, _, kinds = detector.detectMarkersMultiDict(image)
        if numbers is None:
            continue
        of_kind = np.bincount(np.ravel(kinds), minlength=len(DICTIONARIES))
        kind = int(np.argmax(of_kind))
        if of_kind[kind] < _FEWEST_MARKERS:
            continue
        mine = np.ravel(kinds) == kind
        outline = np.asarray(outlines, np.float64).reshape(-1, 4, 2)[mine]
        found = _Markers(np.ravel(numbers)[mine].astype(np.intp), outline)
        return (DICTIONARIES[kind], mirrored), found
    return None


def _grid(picture: NDArray[np.uint8]) -> tuple[int, int] | None:
    """Return how many corners the largest grid in a picture has, the larger number first."""
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(
        picture, _SMALLEST, flags=cv2.CALIB_CB_LARGER
    )
    if not found or meta is None or corners is None:
        return None
    rows, columns = sorted(meta.shape[:2])
    return columns, rows


def _charuco(
    name: str, seen: Sequence[_Markers], square_m: float, size: tuple[int, int] | None
) -> Board | None:
    """Return the board on which markers stand as they do in the pictures."""
    last = max(int(markers.numbers.max()) for markers in seen)
    richest = sorted(seen, key=lambda markers: -len(markers.numbers))[:_SAME]
    best: tuple[float, Board] | None = None
    wanted = range(3, _MOST_SQUARES + 1) if size is None else [size[0] + 1]
    for squares, legacy in product(wanted, (False, True)):
        rows = _rows_for(last, squares, legacy=legacy) if size is None else size[1] + 1
        if legacy and rows % 2:
            continue  # then the first square is dark in either way of drawing
        fits = [_fit(markers, squares, rows, legacy=legacy) for markers in richest]
        off, share = (float(np.median(each)) for each in zip(*fits, strict=True))
        if (best is None or off < best[0]) and 0 < share < 1:
            best = off, Board(squares - 1, rows - 1, square_m, name, share, legacy)
    return best[1] if best is not None and best[0] < _FITS else None


def _places(squares: int, rows: int, *, legacy: bool) -> NDArray[np.float64]:
    """Return (marker, 2) the middles of the white squares in the order of their markers."""
    row, column = np.divmod(np.arange(rows * squares), squares)
    white = (row + column) % 2 == (0 if legacy else 1)
    return np.column_stack([column, row])[white] + 0.5


def _rows_for(last: int, squares: int, *, legacy: bool) -> int:
    """Return how many rows of squares a board has whose last marker is this."""
    rows = 1
    while len(_places(squares, rows, legacy=legacy)) <= last:
        rows += 1
    return rows


def _fit(markers: _Markers, squares: int, rows: int, *, legacy: bool) -> tuple[float, float]:
    """Return how far markers are from their places on a board, and their size, in squares."""
    known = _places(squares, rows, legacy=legacy)
    inside = markers.numbers < len(known)
    places, seen = known[markers.numbers[inside]], markers.outline[inside]
    if len(places) < _FEWEST_MARKERS:
        return np.inf, 0.0
    found, _ = cv2.findHomography(seen.mean(axis=1), places, 0)
    if found is None:
        return np.inf, 0.0
    outline = cv2.perspectiveTransform(seen.reshape(1, -1, 2), found).reshape(-1, 4, 2)
    share = float(np.median(np.linalg.norm(outline - np.roll(outline, 1, axis=1), axis=2)))
    # which of its corners is the first tells a board from its mirror image, and from a turned one
    wanted = places[:, None] + share * (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5)
    return float(np.sqrt(((outline - wanted) ** 2).sum(axis=2).mean())), share
