"""The world that a rig is given in: y up, the floor at y = 0, from a board, a guess, or feet."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.calibration.boards import Board
from tasks.calibration.rigs import Rig

_LEAST_SPREAD = 0.05
"""How much the sideways axes of cameras differ that tell up, as the mean square of their sine. Less
have cameras that all look one way, whose own upright is taken then."""
_CLEAR = 2.0
"""From how many times the usual distance from the floor on a step counts less and less [times].
Chosen: a foot in the air, or one that is hidden, is no matter."""
_LEAST_OFF_M = 0.005
"""The usual distance of a step from the floor, at least [m]. Half a voxel of what is carved; steps
that fit better fit by chance."""
_MEDIAN_OF_NORMAL = 0.6745
"""The median size of normally distributed errors [standard deviations]."""
_ROUNDS = 30
"""How often steps are weighted anew [rounds]. A few are enough."""


@dataclass(frozen=True, eq=False)
class SteppedFloor:
    """The floor that somebody walked on."""

    up: NDArray[np.float64]
    """(3,) unit vector."""
    middle: NDArray[np.float64]
    """(3,) the middle of the steps, on the floor."""
    off_m: float
    """How far steps are from it, the median."""
    spread_m: tuple[float, float]
    """How far steps are apart along the floor and across, as standard deviations."""
    error: float
    """Standard error of the direction of up, rad."""


def floor_on(rig: Rig, board: Board, moment: int) -> Rig:
    """Return the rig in the world of a board that lies on the floor.

    The middle of its corners is the origin, x is along its rows, y is up: the side on which the
    cameras stand.
    """
    world_from_board = rig.world_from_board[moment]
    middle = world_from_board[:3, :3] @ board.middle_m + world_from_board[:3, 3]
    up = world_from_board[:3, 2]
    if np.mean((camera_centers(rig) - middle) @ up) < 0:
        up = -up
    return _in_world(rig, upright_axes(up, world_from_board[:3, 0]), middle)


def floor_guessed(rig: Rig, board: Board) -> tuple[Rig, float]:
    """Return the rig with up as the cameras stand upright, and by how much they disagree [rad].

    The floor is at the lowest corner of any board, which no floor is above.
    """
    turns = np.asarray(rig.camera_from_world)[:, :3, :3]
    upright = -turns[:, 1].mean(axis=0)
    spread = turns[:, 0].T @ turns[:, 0] / len(turns)
    values, axes = np.linalg.eigh(spread)
    up = axes[:, 0] if values[1] > _LEAST_SPREAD else upright
    up = up / np.linalg.norm(up) * np.sign(up @ upright)
    leaning = float(np.arcsin(np.clip(abs(turns[:, 0] @ up), 0, 1)).max())
    points = np.concatenate(
        [board.points_m @ pose[:3, :3].T + pose[:3, 3] for pose in rig.world_from_board.values()]
    )
    middle = points.mean(axis=0)
    middle = middle + up * ((points - middle) @ up).min()
    return _in_world(rig, upright_axes(up, turns[0, 0]), middle), leaning


def floor_of_steps(steps: NDArray[np.float64], up: NDArray[np.float64]) -> SteppedFloor:
    """Return the plane nearest to points on a floor, of which some are astray.

    Parameters
    ----------
    steps : (step, 3) float64
        Where feet were lowest, metres; at least three.
    up : (3,) float64
        About upward.
    """
    weight = np.ones(len(steps))
    for _ in range(_ROUNDS):
        floor, usual = _plane(steps, weight, up)
        off = (steps - floor.middle) @ floor.up
        weight = 1.0 / (1.0 + (off / (_CLEAR * usual)) ** 2)
    return _plane(steps, weight, up)[0]


def _plane(
    steps: NDArray[np.float64], weight: NDArray[np.float64], up: NDArray[np.float64]
) -> tuple[SteppedFloor, float]:
    """Return the plane nearest to weighted points, and how far they usually are from it [m]."""
    middle = weight @ steps / weight.sum()
    _, size, axes = np.linalg.svd((steps - middle) * np.sqrt(weight)[:, None])
    normal = axes[2] * np.sign(axes[2] @ up)
    off_m = float(np.median(np.abs((steps - middle) @ normal)))
    usual = max(off_m / _MEDIAN_OF_NORMAL, _LEAST_OFF_M)
    along, across = (size[:2] / np.sqrt(weight.sum())).tolist()
    error = usual / max(float(size[1]), _LEAST_OFF_M)
    return SteppedFloor(normal, middle, off_m, (along, across), error), usual


def camera_centers(rig: Rig) -> NDArray[np.float64]:
    """Return (camera, 3) where the cameras stand."""
    poses = np.asarray(rig.camera_from_world)
    return -np.einsum("cji,cj->ci", poses[:, :3, :3], poses[:, :3, 3])


def upright_axes(
    up: NDArray[np.float64], along: Sequence[float] | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (3, 3) the new axes, a row each: x as near to `along` as can be, y up."""
    up = up / np.linalg.norm(up)
    x = np.asarray(along) - up * (np.asarray(along) @ up)
    x = x / np.linalg.norm(x)
    return np.array([x, up, np.cross(x, up)])


def _in_world(rig: Rig, axes: NDArray[np.float64], origin: NDArray[np.float64]) -> Rig:
    """Return the rig in a world of these axes about an origin."""
    new_from_old = np.eye(4)
    new_from_old[:3, :3], new_from_old[:3, 3] = axes, -axes @ origin
    old_from_new = np.linalg.inv(new_from_old)
    boards = {moment: new_from_old @ pose for moment, pose in rig.world_from_board.items()}
    return Rig(rig.lenses, rig.camera_from_world @ old_from_new, boards)
