"""Tell another body that moves in the volume from the performer: a second dancer, a stagehand.

Two bodies that are apart in every frame of a take can be followed, each by itself; then one of them
is the performer. Two that touch, if only in one frame, may have exchanged places there, and are
left as they are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cc3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tasks.engine.threads import side_by_side
from tasks.geometry.left_out import leave_out
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, join_runs, voxel_centers, voxel_index

_CELL_M = 0.03
"""Edge of the cells by which pieces are told apart [m]. What is nearer than that is one."""

_SECOND = 0.35
"""How large a second body is at least [share of the first]. As for an initial model."""

_BODY_M3 = 0.006
"""How large a body is at least [m³]. As for `doctor`."""

_BODY_M = 0.6
"""How high a body is at least [m]. Somebody who sits on the floor; as for `doctor`."""

_NEAR_M = 0.3
"""How far two bodies are apart, from above, at least [m]. Less are the halves of one, which bad
silhouettes have torn apart. Chosen, not measured."""

_JUMP_M = 0.5
"""How far a body moves from frame to frame at most [m]. Chosen: 15 m/s at 30 Hz."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of one frame."""

    of: NDArray[np.int8]
    """(voxel,) the number of the body that a voxel is of, or is nearest to."""

    middle: NDArray[np.float64]
    """(body, 2) middle of each from above, x and z, m."""


def find_bodies(hull: VoxelRuns, grid: VoxelGrid) -> Bodies:
    """Return the bodies of a frame, the largest first; there is none where the frame is empty.

    Parameters
    ----------
    hull
        Of a single frame.
    grid
        Its grid.
    """
    index = voxel_index(hull, 0)
    if not len(index):
        return Bodies(np.zeros(0, np.int8), np.zeros((0, 2)))
    cell = index // max(1, round(_CELL_M / grid.voxel_m))
    cell -= cell.min(axis=0)
    crop = np.zeros(cell.max(axis=0) + 1, np.uint8)
    crop[tuple(cell.T)] = 1
    piece = np.asarray(cc3d.connected_components(crop, connectivity=26))[tuple(cell.T)]
    point = voxel_centers(grid, index)
    size = np.bincount(piece)
    bodies = [
        number
        for number in np.argsort(-size)
        if size[number] * grid.voxel_m**3 >= _BODY_M3
        and size[number] >= _SECOND * size.max()
        and np.ptp(point[piece == number, 1]) >= _BODY_M
    ]
    middle = np.array([point[piece == n][:, [0, 2]].mean(axis=0) for n in bodies]).reshape(-1, 2)
    of = np.zeros(len(index), np.int8)
    if len(bodies) > 1:
        trees = [KDTree(point[piece == n][::20]) for n in bodies]
        away = np.stack([tree.query(point[~np.isin(piece, bodies)])[0] for tree in trees])
        of[~np.isin(piece, bodies)] = away.argmin(axis=0)
        for n, number in enumerate(bodies):
            of[piece == number] = n
    return Bodies(of, middle)


def are_two(bodies: Bodies) -> bool:
    """Return whether there are two bodies, and no halves of one."""
    if len(bodies.middle) != 2:
        return False
    return float(np.linalg.norm(bodies.middle[0] - bodies.middle[1])) >= _NEAR_M


def find_others(
    hull_of: Callable[[int], VoxelRuns],
    frames: int,
    grid: VoxelGrid,
    some: Sequence[int],
    given: tuple[int, NDArray[np.floating]] | None = None,
) -> tuple[VoxelRuns | None, tuple[str, ...]]:
    """Return the voxels of another body in each frame, and a sentence; None where all stay.

    Parameters
    ----------
    hull_of
        Gives the hull of a frame, a single frame.
    frames
        How many there are.
    grid
        Their grid. Of two bodies the one that is nearer to its middle is the performer.
    some
        Frames all over the take, in which it is asked whether there are two.
    given : (frame, (joint, 3) m), optional
        Joints of the performer, if they are known; NaN where they are not.
    """
    looked_at = side_by_side(lambda frame: find_bodies(hull_of(frame), grid), some)
    seen = [are_two(each) for each in looked_at]
    if not any(seen):
        return None, ()
    if not all(seen):
        return None, _say_unsure(seen)
    known = dict(zip(some, looked_at, strict=True))
    bodies = side_by_side(
        lambda frame: known.get(frame) or find_bodies(hull_of(frame), grid), range(frames)
    )
    order = _follow(bodies)
    if order is None:
        return None, _say_unsure([are_two(each) for each in bodies])
    middle = np.stack([each.middle[list(own)] for each, own in zip(bodies, order, strict=True)])
    if given is None:
        center = np.array(grid.origin_m) + grid.voxel_m * (np.array(grid.shape) - 1) / 2.0
        away = np.linalg.norm(middle - center[[0, 2]], axis=2).mean(axis=0)
        why = "the one nearer to the middle of the volume"
    else:
        frame, joints = given
        away = np.linalg.norm(middle[frame] - np.nanmean(joints, axis=0)[[0, 2]], axis=1)
        why = "the one with the joints of initial.json"
    own = int(away.argmin())
    rest = [
        leave_out(hull_of(frame), each.of == numbers[1 - own])
        for frame, (each, numbers) in enumerate(zip(bodies, order, strict=True))
    ]
    x, z = middle[0, own]
    far = "" if given else " (if it is the other, place its joints in initial.json)"
    return join_runs(rest), (
        "Two bodies move in the volume, apart in all frames: the performer is taken to be "
        f"{why}, at x = {x:.2f}, z = {z:.2f} m in the first frame{far}. The other one's voxels "
        "belong to no segment.",
    )


def _follow(bodies: Sequence[Bodies]) -> list[tuple[int, int]] | None:
    """Return the numbers of two bodies in each frame, each followed; None where that is unsure."""
    if not all(map(are_two, bodies)):
        return None
    order, last = [(0, 1)], bodies[0].middle
    for each in bodies[1:]:
        straight = np.linalg.norm(each.middle - last, axis=1)
        across = np.linalg.norm(each.middle[::-1] - last, axis=1)
        chosen, moved = ((0, 1), straight) if straight.sum() <= across.sum() else ((1, 0), across)
        if moved.max() > _JUMP_M:
            return None
        order.append(chosen)
        last = each.middle[list(chosen)]
    return order


def _say_unsure(seen: Sequence[bool]) -> tuple[str, ...]:
    """Say that there are two bodies in some frames, if they are no flaw of single frames."""
    if sum(seen) < 2:
        return ()
    return (
        f"Two bodies are seen apart in {sum(seen)} of {len(seen)} frames looked at, and touch, or "
        "one is away, in the others: they cannot be followed each by itself, and the pose may be "
        "of both. Look at it, make the volume smaller, or bring masks of one performer.",
    )
