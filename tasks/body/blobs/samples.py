"""Samples of a take's voxels with their colors, and what colors say of bones."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES
from tasks.body.anatomy.colors import COLORS, color_cells, learn_likeness
from tasks.body.anatomy.skin import NO_CAMERA
from tasks.engine.threads import side_by_side
from tasks.geometry.voxels import VoxelRuns, voxel_index

Surfaces = Callable[[int], tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.uint8]]]
"""Gives for a frame which voxels (voxel,) are on the surface, and the color (surface voxel, 3) and
camera (surface voxel,) of these."""

Drawn = tuple[NDArray[np.int16], NDArray[np.int32]]
"""Voxels (voxel, 3) by their index, and the cell (voxel,) of the color of each, -1: not known."""

# right and left wear the same, and light that falls from one side is no mark of it
_PAIRED = np.array([0, 1, 2, 3, 4, 3, 4, 7, 8, 7, 8, 11, 11, 13, 13, -1])


def learn_looks(
    bone: NDArray[np.integer], surfaces: Surfaces | None, frame: int, most: float
) -> NDArray[np.float32]:
    """Return how much likelier colors are on bones than anywhere.

    Parameters
    ----------
    bone : (voxel,) int
        Of each voxel of a frame, -1 for none.
    surfaces
        The colored surfaces of the take, or None.
    frame
        Which frame that is.
    most
        Ratios are between 1 / most and most.

    Returns
    -------
    (cell + 1, bone + 1) float32
        The last cell is for voxels without a color, the last bone for what is not the body's: 1.
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
    """Return an even sample of the voxels of every frame, along a curve that keeps near ones near.

    Parameters
    ----------
    hulls
        Of a take, a single frame each; each is asked for once, so it may be made then.
    surfaces
        Their colored surfaces; without them no color is known.
    most
        About so many voxels a frame.
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
        for shift, mask in (
            (32, 0x001F00000000FFFF), (16, 0x001F0000FF0000FF), (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249),
        ):  # fmt: skip
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        far |= bits << np.uint64(axis)
    return far
