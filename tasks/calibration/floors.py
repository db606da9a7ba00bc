"""The world that a rig is given in: y up, the floor at y = 0, from a board laid down or a guess."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.calibration.boards import Board
from tasks.calibration.rigs import Rig

_LEAST_SPREAD = 0.05
"""How much the sideways axes of cameras differ that tell up, as the mean square of their sine. Less
have cameras that all look one way, whose own upright is taken then."""


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
    return _in_world(rig, _axes(up, world_from_board[:3, 0]), middle)


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
    return _in_world(rig, _axes(up, turns[0, 0]), middle), leaning


def camera_centers(rig: Rig) -> NDArray[np.float64]:
    """Return (camera, 3) where the cameras stand."""
    poses = np.asarray(rig.camera_from_world)
    return -np.einsum("cji,cj->ci", poses[:, :3, :3], poses[:, :3, 3])


def _axes(
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
