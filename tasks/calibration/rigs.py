"""What a calibration is made of: views of a board, and a rig that says where everything is.

Poses are (4, 4) matrices named *to_from_from*, and vectors of six numbers (Rodrigues vector,
translation) where they are adjusted. A lens is fx, fy, cx, cy, k1, k2, p1, p2, k3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.calibration.boards import Board

LENS_NUMBERS = 9
"""How many numbers a lens has: two focal lengths, two of its middle, five of its distortion.
Of OpenCV's model."""


@dataclass(frozen=True, eq=False)
class View:
    """The corners of the board that a camera sees at a moment."""

    camera: int
    moment: int
    corners: NDArray[np.intp]
    """(corner,) which of the board's."""
    pixel: NDArray[np.float64]
    """(corner, 2) column and row, pixel centers at integers."""
    motion_px: float = 0.0
    """How far the corners move until the next frame; 0 for a picture."""

    def turned(self, turn: NDArray[np.intp]) -> "View":
        """Return the view with its corners called as after a turn of the board."""
        return replace(self, corners=turn[self.corners])


@dataclass(frozen=True, eq=False)
class Rig:
    """Where cameras and boards are, in a world of its own, and the lenses of the cameras."""

    lenses: NDArray[np.float64]
    """(camera, 9)"""
    camera_from_world: NDArray[np.float64]
    """(camera, 4, 4)"""
    world_from_board: dict[int, NDArray[np.float64]]
    """(4, 4) by moment."""


def matrix_of(lens: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) intrinsic matrix of a lens."""
    fx, fy, cx, cy = lens[:4]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def pose_of(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (4, 4) pose of six numbers."""
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.asarray(vector[:3], np.float64))[0]
    pose[:3, 3] = vector[3:]
    return pose


def vector_of(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the six numbers of a (4, 4) pose."""
    turn = np.asarray(cv2.Rodrigues(pose[:3, :3])[0], np.float64)
    return np.concatenate([turn.ravel(), pose[:3, 3]])


def residuals(rig: Rig, views: Sequence[View], board: Board) -> list[NDArray[np.float64]]:
    """Return (corner, 2) how many pixels the rig puts corners beside each view, view by view."""
    return residuals_of_points(rig, views, board.points_m)


def residuals_of_points(
    rig: Rig, views: Sequence[View], points: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return the same of a board whose corners are at points (corner, 3), metres."""
    off = []
    for view in views:
        lens = rig.lenses[view.camera]
        seen = vector_of(rig.camera_from_world[view.camera] @ rig.world_from_board[view.moment])
        pixel = cv2.projectPoints(
            points[view.corners], seen[:3], seen[3:], matrix_of(lens), lens[4:]
        )[0]
        off.append(pixel[:, 0] - view.pixel)
    return off


def view_rms_px(rig: Rig, views: Sequence[View], board: Board) -> NDArray[np.float64]:
    """Return (view,) the root mean square distance of a view's corners from what the rig says."""
    return np.array([np.sqrt((off**2).sum(axis=1).mean()) for off in residuals(rig, views, board)])


def solve_poses(
    view: View, lens: NDArray[np.float64], board: Board, *, within: float
) -> list[NDArray[np.float64]]:
    """Return camera from board, (4, 4), the likeliest first.

    A flat board that is small in the picture looks nearly the same tilted one way and the other:
    the second is returned where its error is at most `within` times that of the first
    (Collins and Bartoli 2014).
    """
    points = board.points_m[view.corners]
    flat = cv2.undistortPoints(view.pixel[:, None], matrix_of(lens), lens[4:])
    found, turns, shifts, errors = cv2.solvePnPGeneric(
        points, flat, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
    )
    poses = [
        pose_of(np.concatenate([turn.ravel(), shift.ravel()]).astype(np.float64))
        for turn, shift in zip(turns, shifts, strict=True)
    ][:found]
    sure = [
        pose
        for pose, error in zip(poses, np.ravel(errors), strict=False)
        if error <= within * max(float(np.ravel(errors)[0]), 1e-9)
    ]
    # corners on a line, where something else was taken for the board: a view to be left out
    return [pose for pose in sure if np.isfinite(pose).all()] or [pose_of(np.eye(6)[5])]
