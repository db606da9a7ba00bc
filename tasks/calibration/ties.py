"""Cameras tied to each other by moments in which they see the board, along the strongest ties.

A moment that two cameras see gives where the one is before the other. Of all that their moments
give, the one counts under which most moments fit: a board that looks the same after half a turn, or
tilted the other way, fits one moment as well, but not the next. A spanning tree of the pairs that
share most moments then places all cameras, and the adjustment does the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from tasks.calibration.boards import Board, turn_of
from tasks.calibration.rigs import Rig, View, matrix_of, solve_poses

_TILTS = 6.0
"""How many times the error of the likeliest tilt another may have. Chosen: of boards of 60 px the
other tilt has two to four times the error, and is the true one now and then."""
_FITS = 0.008
"""By how much the corners of a pair may be off, as a share of the width of the picture. Chosen:
five pixels of 640; lenses fitted alone are off by one or two, a wrong tie by tens."""
_MOST_MOMENTS = 12
"""How many moments of a pair are looked at [moments]. Chosen: the right one is among what they
give, and twelve that fit are no chance."""
_APART = np.radians(10.0)
"""How much two placements of a camera differ that are no longer the same [rad]. Chosen: the other
tilt of a board is 20 degrees and more away."""


@dataclass(frozen=True, eq=False)
class Tie:
    """Where camera `b` is before camera `a`, as their moments say."""

    a: int
    b: int
    moments: int
    """How many they share."""
    b_from_a: NDArray[np.float64]
    """(4, 4)"""
    off: float
    """By how much the median moment is off, as a share of the picture's width."""
    unsure: bool
    """Whether another placement fits about as well."""
    mirrored: bool = False
    """Whether it only fits where one camera's pictures are mirrored."""

    @property
    def fits(self) -> bool:
        """Whether the cameras see the board where the tie says."""
        return self.off < _FITS


@dataclass(frozen=True, eq=False)
class _Seen:
    """A view as a tie needs it."""

    moment: int
    poses: list[NDArray[np.float64]]
    """(4, 4) camera from board, the likeliest first."""
    flat: NDArray[np.float64]
    """(turn, corner, 2) where corners are at depth 1; NaN where they are not seen."""


def tie_cameras(
    views: Sequence[View], lenses: NDArray[np.float64], board: Board, widths: Sequence[int]
) -> list[Tie]:
    """Return a tie for each two cameras that share a moment.

    Parameters
    ----------
    views
        What the cameras see.
    lenses : (camera, 9) float64
        As each camera's own views say.
    board
        The board that they see.
    widths
        Of the cameras' pictures, px.
    """
    seen = _seen(views, lenses, board, mirror=False)
    mirrored: list[dict[int, _Seen]] | None = None
    ties = []
    for a, b in combinations(range(len(lenses)), 2):
        shared = sorted(seen[a].keys() & seen[b].keys())
        if not shared:
            continue
        scale = lenses[b, 0] / widths[b]
        tie = _tie(a, b, [(seen[a][m], seen[b][m]) for m in shared], board, scale)
        if not tie.fits:
            mirrored = mirrored or _seen(views, lenses, board, mirror=True)
            turned = _tie(a, b, [(seen[a][m], mirrored[b][m]) for m in shared], board, scale)
            if turned.fits and len(shared) > 1:
                tie = Tie(a, b, tie.moments, tie.b_from_a, tie.off, tie.unsure, mirrored=True)
        ties.append(tie)
    return ties


def groups_of(ties: Sequence[Tie], cameras: int) -> list[list[int]]:
    """Return the cameras that ties which fit hold together, the largest group first."""
    group = list(range(cameras))
    for tie in ties:
        if tie.fits:
            old, new = group[tie.b], group[tie.a]
            group = [new if each == old else each for each in group]
    groups = [[c for c in range(cameras) if group[c] == g] for g in dict.fromkeys(group)]
    return sorted(groups, key=lambda members: -len(members))


def spanning_ties(ties: Sequence[Tie], cameras: int) -> list[Tie]:
    """Return the strongest ties that hold all cameras together; sure ones before all others."""
    strength = np.zeros((cameras, cameras))
    for tie in ties:
        if tie.fits:
            # the least weight is taken, and 0 means none
            strength[tie.a, tie.b] = 1 / (1 + tie.moments) + 10 * tie.unsure
    tree = minimum_spanning_tree(csr_matrix(strength)).toarray()
    return [tie for tie in ties if tree[tie.a, tie.b]]


def place_cameras(tree: Sequence[Tie], cameras: int, still: int) -> NDArray[np.float64]:
    """Return (camera, 4, 4) camera from world, in the world of the camera that stays still."""
    links = np.zeros((cameras, cameras))
    step = {}
    for tie in tree:
        links[tie.a, tie.b] = 1
        step[tie.a, tie.b] = tie.b_from_a
        step[tie.b, tie.a] = np.linalg.inv(tie.b_from_a)
    order, before = breadth_first_order(csr_matrix(links), still, directed=False)
    placed = np.tile(np.eye(4), (cameras, 1, 1))
    for camera in order[1:]:
        previous = before[camera]
        placed[camera] = step[previous, camera] @ placed[previous]
    return placed


def place_boards(
    views: Sequence[View], lenses: NDArray[np.float64], placed: NDArray[np.float64], board: Board
) -> tuple[Rig, list[View]]:
    """Return the rig with a board for each moment, and the views with their corners called alike.

    Of the places that the cameras of a moment give, the board has the one that is least off in
    all of them.
    """
    of_moment: dict[int, list[View]] = {}
    for view in views:
        of_moment.setdefault(view.moment, []).append(view)
    boards: dict[int, NDArray[np.float64]] = {}
    called: list[View] = []
    turns = board.turns()
    for moment, of_this in of_moment.items():
        seen = [_flattened(view, lenses[view.camera], board, mirror=False) for view in of_this]
        least, best = np.inf, [0] * len(of_this)
        for view, each in zip(of_this, seen, strict=True):
            for pose in each.poses:
                world = np.linalg.inv(placed[view.camera]) @ pose
                off = [
                    _off(placed[other.camera] @ world, of_other.flat, board)
                    * lenses[other.camera, 0]
                    for other, of_other in zip(of_this, seen, strict=True)
                ]
                total = sum(each.min() for each in off)
                if total < least or moment not in boards:
                    least, boards[moment] = total, world
                    best = [int(np.argmin(each)) for each in off]
        called += [view.turned(turns[turn]) for view, turn in zip(of_this, best, strict=True)]
    return Rig(lenses, placed, boards), called


def _seen(
    views: Sequence[View], lenses: NDArray[np.float64], board: Board, *, mirror: bool
) -> list[dict[int, _Seen]]:
    """Return what each camera sees, by moment."""
    seen: list[dict[int, _Seen]] = [{} for _ in lenses]
    for view in views:
        seen[view.camera][view.moment] = _flattened(view, lenses[view.camera], board, mirror=mirror)
    return seen


def _flattened(view: View, lens: NDArray[np.float64], board: Board, *, mirror: bool) -> _Seen:
    """Return a view without its lens, in each order in which its corners may be called."""
    if mirror:
        pixel = view.pixel * [-1.0, 1.0] + [2 * lens[2], 0.0]
        row, column = np.divmod(view.corners, board.columns)
        # the mirror image that has its dark squares where the board has them
        if board.columns % 2 == 0:
            column = board.columns - 1 - column
        else:
            row = board.rows - 1 - row
        view = View(view.camera, view.moment, row * board.columns + column, pixel)
    poses = solve_poses(view, lens, board, within=_TILTS)
    flat = np.full((len(board.turns()), board.corners, 2), np.nan)
    plain = _undistorted(view.pixel, lens)
    for n, turn in enumerate(board.turns()):
        flat[n, turn[view.corners]] = plain
    return _Seen(view.moment, poses, flat)


def _undistorted(pixel: NDArray[np.float64], lens: NDArray[np.float64]) -> NDArray[np.float64]:
    flat = cv2.undistortPoints(pixel[:, None], matrix_of(lens), lens[4:])
    return np.asarray(flat, np.float64)[:, 0]


def _off(
    poses: NDArray[np.float64], flat: NDArray[np.float64], board: Board
) -> NDArray[np.float64]:
    """Return (..., turn) the rms distance of corners from where poses (..., 4, 4) put them."""
    before = np.einsum("...ij,nj->...ni", poses[..., :3, :3], board.points_m)
    before = before + poses[..., None, :3, 3]
    depth = np.where(before[..., 2:] > 1e-6, before[..., 2:], np.nan)
    at = before[..., :2] / depth
    squares = ((at[..., None, :, :] - flat) ** 2).sum(axis=-1)
    known = np.isfinite(flat[..., 0])
    count = known.sum(axis=-1)
    behind = np.isnan(squares) & known
    total = np.where(known & ~behind, squares, 0.0).sum(axis=-1)
    return np.where(behind.any(axis=-1), np.inf, np.sqrt(total / count))


def _tie(a: int, b: int, pairs: Sequence[tuple[_Seen, _Seen]], board: Board, scale: float) -> Tie:
    """Return the placement of b before a under which most moments fit."""
    chosen = pairs[:: max(1, len(pairs) // _MOST_MOMENTS)][:_MOST_MOMENTS]
    turns = [turn_of(board, turn) for turn in board.turns()]
    candidates = np.array([
        of_b @ turn @ np.linalg.inv(of_a)
        for one, other in chosen for of_a in one.poses for of_b in other.poses for turn in turns
    ])  # fmt: skip
    off = np.empty((len(candidates), len(chosen)))
    for n, (one, other) in enumerate(chosen):
        each = [_off(candidates @ pose, other.flat, board).min(axis=-1) for pose in one.poses]
        off[:, n] = np.min(each, axis=0) * scale
    middle = np.median(off, axis=1)
    order = np.argsort(middle)
    best = candidates[order[0]]
    rivals = [n for n in order if _angle(candidates[n], best) > _APART]
    least = middle[order[0]]
    unsure = bool(rivals) and middle[rivals[0]] < max(2 * least, _FITS / 4)
    return Tie(a, b, len(pairs), best, float(least), bool(unsure))


def _angle(pose: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the angle between two placements."""
    cosine = (np.trace(pose[:3, :3].T @ other[:3, :3]) - 1) / 2
    return float(np.arccos(np.clip(cosine, -1, 1)))
