"""Which of many views a calibration is made of: spread, tilted, still, tying cameras.

Views a second apart say the same; sixty that differ say all and are adjusted in a few seconds.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tasks.calibration.boards import Board
from tasks.calibration.rigs import View

MOST_MOMENTS = 60
"""How many moments are chosen at most [moments]. Chosen: time grows with their third power, and on
drawn boards thirty more change no focal length by more than its own error."""
_NEW = 0.25
"""How far a view is from all others when it counts as new, as a share of the picture, or of the
change of a tilt by a right angle. Chosen by eye."""
_TIE = 0.5
"""How much the first moment that two cameras share counts, in new views. Chosen: a
camera without a tie is lost, one with a view fewer is not."""
_ENOUGH = 0.1
"""The least that another moment has to bring, in new views. Chosen: less is a view that is
there already."""
_CELLS = (8, 6)
"""Parts of a picture, side by side and one below the other, that corners should be in. Chosen:
square in most pictures, and as fine as a board held far away."""


def choose_moments(
    views: Sequence[View],
    board: Board,
    sizes: Sequence[tuple[int, int]],
    *,
    always: Sequence[int] = (),
) -> list[int]:
    """Return the moments whose views say most, in the order in which they were chosen.

    Each next one is that whose views are farthest from those chosen already, most of all where it
    ties cameras that little ties; the more the board moves, the later.

    Parameters
    ----------
    views
        What all cameras see.
    board
        The board that they see.
    sizes
        Width and height of each camera's picture.
    always
        Moments that are chosen in any case.
    """
    features = {id(view): _features(view, board, sizes[view.camera]) for view in views}
    of_moment: dict[int, list[View]] = {}
    for view in views:
        of_moment.setdefault(view.moment, []).append(view)
    distance = {id(view): 4 * _NEW for view in views}
    ties: dict[tuple[int, int], int] = {}
    chosen: list[int] = []
    left = dict(of_moment)

    def worth(moment: int) -> float:
        seen = left[moment]
        new = sum(min(distance[id(view)] / _NEW, 1.0) for view in seen)
        cameras = sorted(view.camera for view in seen)
        return new + sum(_TIE / (1 + ties.get(pair, 0)) for pair in combinations(cameras, 2))

    def still(moment: int) -> float:
        return worth(moment) / (1 + max(view.motion_px for view in left[moment]))

    while left and len(chosen) < MOST_MOMENTS:
        asked = [moment for moment in always if moment in left]
        telling = asked or [moment for moment in left if worth(moment) >= _ENOUGH]
        if not telling:
            break
        best = max(telling, key=still)
        seen = left.pop(best)
        chosen.append(best)
        for pair in combinations(sorted(view.camera for view in seen), 2):
            ties[pair] = ties.get(pair, 0) + 1
        for view in views:
            for other in seen:
                if other.camera == view.camera:
                    apart = float(np.linalg.norm(features[id(view)] - features[id(other)]))
                    distance[id(view)] = min(distance[id(view)], apart)
    return chosen


def covered_cells(views: Sequence[View], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return (6, 8) which parts of a camera's picture corners were seen in, from the top left."""
    covered = np.zeros(_CELLS[::-1], np.bool_)
    for view in views:
        at = (view.pixel + 0.5) / size * _CELLS
        column, row = np.clip(at, 0, np.array(_CELLS) - 1).astype(int).T
        covered[row, column] = True
    return covered


def _features(view: View, board: Board, size: tuple[int, int]) -> NDArray[np.float64]:
    """Return where a view is, how large, and how it is turned and tilted, each of about 0 to 1."""
    flat = board.points_m[view.corners, :2] / board.middle_m[:2].max()
    flat -= flat.mean(axis=0)
    middle = view.pixel.mean(axis=0)
    slope = np.linalg.lstsq(flat, view.pixel - middle, rcond=None)[0].T  # px in half a board
    # what is left of a picture by perspective tells which side is nearer
    curved = view.pixel - middle - flat @ slope.T
    area = np.sqrt(abs(np.linalg.det(slope))) + 1e-9
    near = 4 * (curved * np.sign(flat)).mean(axis=0) / area
    across, down = np.linalg.norm(slope, axis=0)
    squeezed = 1 - min(across, down) / max(across, down)
    leaning = float(slope[:, 0] @ slope[:, 1] / (across * down))
    return np.concatenate([middle / size, [area / size[0] * 2, squeezed, leaning], near])
