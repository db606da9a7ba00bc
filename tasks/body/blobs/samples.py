"""Draw samples of a take's voxels with their colors, and learn which bones the colors are on."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.bones import BONES
from tasks.body.anatomy.colors import COLORS, color_cells, learn_likeness
from tasks.engine.threads import side_by_side
from tasks.geometry.voxels import VoxelRuns, voxel_index

Surfaces = Callable[[int], tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.uint8]]]
"""Gives of a frame which voxels (voxel,) are on the surface, and the colors (surface voxel, 3) and
cameras (surface voxel,) of the voxels there."""

Drawn = tuple[NDArray[np.int16], NDArray[np.int32]]
"""Voxels (voxel, 3) by their index, and the cell (voxel,) of each one's color, -1 if not known."""

_PAIRED = np.array([0, 1, 2, 3, 4, 3, 4, 7, 8, 7, 8, 11, 11, 13, 13, -1])
"""(bone + 1,) the bone that shares its colors with each bone [bone]. A left bone shares them with
the right one, for both sides wear the same and light from one side is no mark of it; -1 is none."""

_SPREAD = (
    (np.uint64(32), np.uint64(0x001F00000000FFFF)),
    (np.uint64(16), np.uint64(0x001F0000FF0000FF)),
    (np.uint64(8), np.uint64(0x100F00F00F00F00F)),
    (np.uint64(4), np.uint64(0x10C30C30C30C30C3)),
    (np.uint64(2), np.uint64(0x1249249249249249)),
)
"""Shifts and masks that put two empty bits after each of 21 bits, step by step [bits]. They follow
from the definition of the Z-order curve."""


def learn_looks(
    bone: NDArray[np.integer], surfaces: Surfaces | None, frame: int, most: float
) -> NDArray[np.float32]:
    """Return how many times likelier each color is on each bone than anywhere.

    Parameters
    ----------
    bone : (voxel,) int
        The bone of each voxel of a frame, -1 for none.
    surfaces
        The colored surfaces of the take. Without them, no color says anything.
    frame
        The number of the frame.
    most
        All ratios are between 1 / most and most.

    Returns
    -------
    (cell + 1, bone + 1) float32
        1 in the last row, of voxels without a color, and in the last column, of voxels that are on
        no bone.
    """
    looks = np.ones((COLORS + 1, len(BONES) + 1), np.float32)
    if surfaces is not None:
        is_surface, color, camera = surfaces(frame)
        own = camera != NO_CAMERA
        group = _PAIRED[bone[is_surface][own]]
        likeness = learn_likeness(color[own], group, len(BONES), most=most)
        looks[:-1, :-1] = likeness[:, _PAIRED[:-1]]
    return looks


def draw_samples(hulls: Sequence[VoxelRuns], surfaces: Surfaces | None, most: int) -> list[Drawn]:
    """Return an even sample of the voxels of every frame.

    The voxels follow a Z-order curve, so that voxels near in the sample are near in space.

    Parameters
    ----------
    hulls
        The hulls of a take, a single frame each. Each is asked for once, so that it may be made
        when it is asked for.
    surfaces
        The colored surfaces of the take. Without them, no color is known.
    most
        How many voxels a frame is thinned to, about.
    """

    def draw(frame: int) -> Drawn:
        hull = hulls[frame]
        step = max(1, int(hull.length.sum(dtype=np.int64)) // most)
        chosen = slice(step // 2, None, step)
        some = voxel_index(hull, 0, first=step // 2, step=step).astype(np.int16)
        cell = np.full(len(some), -1, np.int32)
        if surfaces is not None and len(some):
            is_surface, color, camera = surfaces(frame)
            number = np.cumsum(is_surface)[chosen] - 1
            own = is_surface[chosen] & (camera[np.maximum(number, 0)] != NO_CAMERA)
            cell[own] = color_cells(color[number[own]])
        order = np.argsort(_along_curve(some), kind="stable")
        return some[order], cell[order]

    return side_by_side(draw, range(len(hulls)))


def _along_curve(index: NDArray[np.integer]) -> NDArray[np.uint64]:
    """Return (voxel,) how far along the Z-order curve (Morton 1966) voxels (voxel, 3) are."""
    far = np.zeros(len(index), np.uint64)
    for axis, bits in enumerate(index.T.astype(np.uint64)):
        for shift, mask in _SPREAD:
            bits = (bits | (bits << shift)) & mask
        far |= bits << np.uint64(axis)
    return far
