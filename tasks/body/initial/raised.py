"""Find a foot that is off the floor, by the colors of the foot that stands.

Near the floor one foot is seen where the other one is raised, and legs in a skirt show nothing else
of themselves. But both feet wear the same: what is colored as the standing foot, and about as
large, is the other one.
"""

import cc3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tasks.body.anatomy.colors import color_cells, count_colors, log_ratio
from tasks.body.anatomy.proportions import FOOT_HEIGHT, Points

HIGHEST = 0.4
"""How far above the floor a raised foot is looked for [statures]. As in the frames of a take
(`FootSettings.highest`): higher, what is like it is a hand."""

LIKE_A_FOOT = 0.7
"""A color that is so much likelier on the standing foot than on what else is low is a foot's
[logarithm]. Twice as likely; chosen, not measured."""

AS_LARGE = (0.4, 1.8)
"""How large a raised foot is, in voxels of a foot's color [shares of the standing one]. It was 0.94
in two rendered captures; a skirt hides half of a foot, and the standing one is seen only so high as
`FOOT_HEIGHT`."""

NEXT_LARGEST = 0.5
"""How large the next piece of a foot's color may be [shares of the raised foot]. Where it is
larger, the color tells no foot. Chosen, not measured."""

WITHIN = 0.02
"""How far inside the surface voxels are the foot's [statures]. Half as thick as a foot; chosen."""


def standing_part(foot: Points, voxel_m: float) -> Points:
    """Return the largest connected piece of what is near the floor (voxel, 3), m.

    The toes of a raised foot may be near the floor, too.
    """
    return _pieces(foot, foot[:0], voxel_m)[0]


def find_raised_foot(
    point: Points, foot: Points, colored: tuple[Points, NDArray[np.uint8]], stature_m: float,
    voxel_m: float,
) -> Points | None:  # fmt: skip
    """Return the voxels (voxel, 3) of a foot off the floor; None where none can be told.

    Parameters
    ----------
    point : (voxel, 3) float64
        The person's voxels, m.
    foot : (voxel, 3) float64
        Those of the foot that was found near the floor, m.
    colored : ((surface voxel, 3), (surface voxel, 3))
        Centers in metres and RGB of the surface.
    stature_m, voxel_m
        The person's height, and the edge of a voxel.
    """
    surface, color = colored
    floor = point[:, 1].min()
    low = surface[:, 1] < floor + HIGHEST * stature_m
    surface, cell = surface[low], color_cells(color[low])
    stands = surface[:, 1] < floor + FOOT_HEIGHT * stature_m
    stands &= KDTree(foot).query(surface)[0] < voxel_m
    if not stands.any() or stands.all():
        return None
    ratio = log_ratio(count_colors(cell[stands]), count_colors(cell[~stands]))
    alike = ratio[cell] > LIKE_A_FOOT
    pieces = _pieces(surface[alike & ~stands], surface[alike & stands], voxel_m)
    least, most = (share * float((alike & stands).sum()) for share in AS_LARGE)
    if not pieces or not least <= len(pieces[0]) <= most:
        return None
    if len(pieces) > 1 and len(pieces[1]) > NEXT_LARGEST * len(pieces[0]):
        return None
    near = KDTree(pieces[0]).query(point)[0] < max(WITHIN * stature_m, 1.5 * voxel_m)
    return point[near]


def _pieces(point: Points, foot: Points, voxel_m: float) -> list[Points]:
    """Return the connected pieces of points that do not touch a foot, the largest first."""
    whole = np.concatenate([foot, point])
    if not len(whole):
        return []
    index = np.rint((whole - whole.min(axis=0)) / voxel_m).astype(np.int64)
    crop = np.zeros(index.max(axis=0) + 1, np.uint8)
    crop[tuple(index.T)] = 1
    piece = np.asarray(cc3d.connected_components(crop, connectivity=26))[tuple(index.T)]
    own = piece[len(foot) :]
    free = np.setdiff1d(own, piece[: len(foot)])
    return sorted((point[own == number] for number in free), key=len, reverse=True)
