"""What is wrong with views of a board, in words that say what to film again.

A fault is what makes a calibration impossible or wrong; advice is what would make it better.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.formats.reading import listed
from tasks.calibration.adjustment import Adjusted
from tasks.calibration.boards import Board, find_corners, spacing_px
from tasks.calibration.choosing import covered_cells
from tasks.calibration.rigs import View
from tasks.calibration.ties import Tie, groups_of

SMALLEST_PX = 8.0
"""Side of a square below which a board is small [px]. Measured on drawn boards: of five the quick
search finds all at 8 px and two at 5; the slow one finds all down to 3."""
FEWEST_VIEWS = 3
"""How many views a camera needs whose lens is to be found [views]. Two fix a focal length where
nothing is wrong."""
_GOOD_VIEWS = 10
"""How many views a camera should have [views]. Usual advice; more changed little on drawn
boards."""
_GOOD_COVER = 0.6
"""Share of a picture in which corners should have been. Chosen: what is outside is guessed."""
_GOOD_FOCAL, _BAD_FOCAL = 0.01, 0.1
"""Standard errors of a focal length, as a share, that are said, and with which no calibration is
given. Chosen: of 3 m, a hundredth is 3 cm."""
_GOOD_RMS_PX, _BAD_RMS_PX = 0.7, 3.0
"""Reprojection errors that are said, and with which no calibration is given [px of a picture 1000
wide]. Corners of a still board are off by 0.1 to 0.3."""
_BEND = 0.004
"""Bend of a board that is a fault, as a share of its diagonal. Chosen: 2 mm of half a metre."""
_SURE = 5.0
"""How many times its standard error a bend has to be. Usual for what must not be said
wrongly."""
_FEW_TIES = 3
"""With fewer moments that it shares a camera is said to be tied loosely [moments]. Chosen: one
fixes its place, three show that it is right."""
_SIDES = ("upper left", "top", "upper right", "left", "middle", "right", "lower left", "bottom",
          "lower right")  # fmt: skip


def why_unseen(
    name: str, pictures: Sequence[NDArray[np.uint8]], board: Board, looked_at: int
) -> str:
    """Return why no board was found in a camera's pictures, and what to do.

    Parameters
    ----------
    name
        The camera's.
    pictures
        Some of its pictures, (row, column) gray.
    board
        What was looked for.
    looked_at
        In how many pictures.
    """
    head = f"camera {name!r}: the {board.said} is found in none of {looked_at} pictures"
    if any(
        find_corners(np.ascontiguousarray(p[:, ::-1]), board) for p in pictures if board.dictionary
    ):
        return f"{head}, but in their mirror images: film without mirroring"
    grids = [grid for picture in pictures if (grid := _largest_grid(picture)) is not None]
    if not grids or board.dictionary:
        return (
            f"{head}: film it nearer, whole and in focus, with even light and a white margin as "
            "wide as a square"
        )
    (rows, columns), side = max(grids, key=lambda grid: grid[0][0] * grid[0][1])
    if side < SMALLEST_PX:
        return (
            f"{head}: it is too small, its squares have {side:.0f} px from side to side; hold it "
            "nearer, or take a board with larger squares"
        )
    return (
        f"{head}: it is never whole, at most {columns}x{rows} corners are seen; film all of it "
        "with a white margin as wide as a square, take a ChArUco board, or correct --board"
    )


def wrong_size(board: Board, sizes: Sequence[tuple[int, int]]) -> str:
    """Return what to say where the board in the pictures is not of the size that was given."""
    seen = sizes[0]
    hint = ""
    if (board.columns, board.rows) in ((seen[0] + 1, seen[1] + 1), (seen[1] + 1, seen[0] + 1)):
        hint = " (corners between squares are counted, not squares)"
    return (
        f"the board in the pictures has {seen[0]}x{seen[1]} corners, and "
        f"{board.columns}x{board.rows} were given{hint}: give --board {seen[0]}x{seen[1]}, or film "
        "all of it"
    )


def tie_faults(
    ties: Sequence[Tie], tree: Sequence[Tie], names: Sequence[str], board: Board
) -> list[str]:
    """Return which cameras are not tied to the others, and why."""
    groups = groups_of(ties, len(names))
    faults = []
    for group in groups[1:]:
        crossing = [t for t in ties if (t.a in group) != (t.b in group)]
        who = listed([names[c] for c in group])
        others = listed([names[c] for c in range(len(names)) if c not in group])
        verb = "are" if len(group) > 1 else "is"
        if not crossing:
            faults.append(
                f"{who} {verb} not tied to {others}: no moment shows the board in both; hold it "
                "where cameras of both see it"
            )
        elif any(tie.mirrored for tie in crossing):
            faults.append(
                f"{who} and {others} fit each other only where the pictures of one are mirrored: "
                "film without mirroring"
            )
        else:
            shared = sum(tie.moments for tie in crossing)
            faults.append(
                f"{who} {verb} at odds with {others}: the {shared} moments that they share do not "
                "show the board in one place; give offset_s in capture.toml, name pictures of one "
                "moment alike, or look whether a camera was moved or its pictures mirrored"
            )
    faults += [
        f"{names[tie.a]!r} and {names[tie.b]!r} share {_moments(tie.moments)}, from which it "
        "cannot be told on which side of the board they stand: hold it in other places and tilted"
        + (
            ", or take one whose corners are odd one way and even the other"
            if _turns(board)
            else ""
        )
        for tie in tree
        if tie.unsure
    ]
    return faults


def result_faults(
    adjusted: Adjusted, views: Sequence[View], names: Sequence[str], rms_px: Sequence[float],
    sizes: Sequence[tuple[int, int]], board: Board,
) -> list[str]:  # fmt: skip
    """Return why the outcome of an adjustment cannot be used."""
    faults = []
    for n, name in enumerate(names):
        count = sum(view.camera == n for view in views)
        if count < FEWEST_VIEWS:
            faults.append(
                f"camera {name!r} sees the board in {_moments(count)}, where {FEWEST_VIEWS} are "
                f"needed and {_GOOD_VIEWS} are good: film it in more places"
            )
        elif adjusted.focal_error[n] > _BAD_FOCAL:
            faults.append(
                f"camera {name!r}: its focal length is not determined (within "
                f"{adjusted.focal_error[n]:.0%}); {_TILT}"
            )
        if rms_px[n] > _BAD_RMS_PX * max(sizes[n][0] / 1000, 0.3):
            faults.append(
                f"camera {name!r}: corners are {rms_px[n]:.1f} px off; hold the board still, look "
                "whether all its squares are alike and whether the lens zoomed or a camera moved"
            )
    return faults + bend_faults([adjusted], board)


def bend_faults(adjusted: Sequence[Adjusted], board: Board) -> list[str]:
    """Return that the board is bent, where most of some adjustments say so."""
    diagonal = float(np.linalg.norm(2 * board.middle_m))
    bends = [
        each.bend_m
        for each in adjusted
        if each.bend_m > max(_BEND * diagonal, _SURE * each.bend_error_m)
    ]
    if 2 * len(bends) <= len(adjusted):
        return []
    return [
        "the board is bent: it stands out of its plane by about "
        f"{1000 * float(np.median(bends)):.0f} mm; fix it on a stiff, flat plate and film again"
    ]


_TILT = (
    "hold the board tilted by 30 to 45 degrees, to each side, upwards and downwards, and not only "
    "facing the camera"
)


def advice(
    adjusted: Adjusted,
    views: Sequence[View],
    names: Sequence[str],
    rms_px: Sequence[float],
    sizes: Sequence[tuple[int, int]],
    board: Board,
) -> list[str]:
    """Return what to film again for a better calibration, a sentence each."""
    said = []
    for n, name in enumerate(names):
        mine = [view for view in views if view.camera == n]
        if len(mine) < _GOOD_VIEWS:
            said.append(
                f"Camera {name!r} has {len(mine)} views of the board; {_GOOD_VIEWS} or more that "
                "differ make it surer."
            )
        cells = covered_cells(mine, sizes[n])
        if cells.mean() < _GOOD_COVER:
            said.append(
                f"Camera {name!r}: corners were seen in {cells.mean():.0%} of the picture, none "
                f"{_where(cells)}: hold the board there too."
            )
        if _GOOD_FOCAL < adjusted.focal_error[n] <= _BAD_FOCAL:
            said.append(
                f"Camera {name!r}: its focal length is known within {adjusted.focal_error[n]:.1%} "
                f"only: {_TILT}."
            )
        side = np.median([_side(view, board) for view in mine])
        if side < 1.5 * SMALLEST_PX:
            said.append(
                f"Camera {name!r}: squares have {side:.0f} px; hold the board nearer, or take a "
                "larger one."
            )
        if rms_px[n] > _GOOD_RMS_PX * max(sizes[n][0] / 1000, 0.3):
            said.append(
                f"Camera {name!r}: corners are {rms_px[n]:.2f} px off, more than a sharp, still "
                "board gives: stop the board for a moment in each place, with a short exposure."
            )
    return said + _tie_advice(views, names)


def _tie_advice(views: Sequence[View], names: Sequence[str]) -> list[str]:
    """Say which cameras share few moments with all others."""
    said = []
    moments = [{view.moment for view in views if view.camera == n} for n in range(len(names))]
    for n, name in enumerate(names):
        others = [m for k, m in enumerate(moments) if k != n]
        shared = sum(any(moment in other for other in others) for moment in moments[n])
        if others and shared < _FEW_TIES:
            said.append(
                f"Camera {name!r} shares {_moments(shared)} with the others: hold the board where "
                "two or more cameras see it."
            )
    return said


def _where(cells: NDArray[np.bool_]) -> str:
    """Return in which ninths of the picture nothing was seen, in words."""
    rows, columns = cells.shape
    ninths = cells.reshape(3, rows // 3, columns)
    parts = [part for band in ninths for part in np.array_split(band, 3, axis=1)]
    empty = [side for side, part in zip(_SIDES, parts, strict=True) if not part.any()]
    if not empty:
        return "along its rim"
    return f"{'at' if empty[0] in ('top', 'bottom') else 'in'} the {', '.join(empty)}"


def _largest_grid(picture: NDArray[np.uint8]) -> tuple[tuple[int, int], float] | None:
    """Return rows and columns of the largest grid of corners, and its least side of a square."""
    best: tuple[tuple[int, int], float] | None = None
    for scale in (1.0, 2.0):
        image = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        found, corners, meta = cv2.findChessboardCornersSBWithMeta(
            image, (3, 3), flags=cv2.CALIB_CB_LARGER
        )
        if not found or meta is None or corners is None:
            continue
        rows, columns = meta.shape[:2]
        side = spacing_px(corners.reshape(-1, 2).astype(np.float64) / scale, columns)
        if best is None or rows * columns > best[0][0] * best[0][1]:
            best = (min(rows, columns), max(rows, columns)), side
    return best


def _side(view: View, board: Board) -> float:
    """Return the side of a square in a view, as that of a square as large as its share [px]."""
    flat = board.points_m[view.corners, :2] / board.square_m
    middle = view.pixel - view.pixel.mean(axis=0)
    slope = np.linalg.lstsq(flat - flat.mean(axis=0), middle, rcond=None)[0]
    return float(np.linalg.svd(slope, compute_uv=False)[-1])


def _turns(board: Board) -> bool:
    return len(board.turns()) > 1


def _moments(count: int) -> str:
    return f"{count} moment{'' if count == 1 else 's'}"
