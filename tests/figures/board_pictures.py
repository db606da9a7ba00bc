"""Boards as cameras of known truth film them: drawn, bent by the lens, blurred, noisy."""

from functools import lru_cache

import cv2
import numpy as np

from storage.formats.calibration.camera import Camera
from tests.figures.calibration_files import looking_at

_FINE = 2
_SQUARE_PX = 24


def ring(
    count,
    *,
    size=(320, 240),
    focal=330.0,
    radius=3.0,
    height=1.6,
    target=(0.0, 0.9, 0.0),
    spread=0.8,
):
    """Cameras in a half ring around a stage, y up, each with its own lens."""
    cameras = []
    for n in range(count):
        angle = np.pi * (n / max(count - 1, 1) - 0.5) * spread
        place = np.array([radius * np.sin(angle), height + 0.2 * (n % 3), radius * np.cos(angle)])
        like = looking_at(f"cam{n + 1}", place, target)
        f = focal * (1 + 0.03 * (n % 3))
        center = (size[0] - 1) / 2 + 3 * (n % 2), (size[1] - 1) / 2 - 2 * (n % 3)
        matrix = np.array([[f, 0, center[0]], [0, f * 1.002, center[1]], [0, 0, 1]])
        bent = np.array([-0.18 + 0.02 * n, 0.05, 0.001, -0.0005])
        cameras.append(Camera(like.name, size, matrix, bent, like.rotation, like.translation))
    return cameras


def board_poses(count, *, seed=0, spread=0.5, middle=(0.0, 1.0, 0.3), tilt=0.7):
    """(count, 4, 4) world from board: held up before the cameras, front to +z, x right, y down."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        turn = cv2.Rodrigues(rng.uniform(-tilt, tilt, 3))[0]
        pose = np.eye(4)
        pose[:3, :3] = turn @ np.diag([1.0, -1.0, -1.0])
        pose[:3, 3] = np.array(middle) + rng.uniform(-spread, spread, 3)
        poses.append(pose)
    return np.array(poses)


def lying(board, place=(0.1, 0.0, -0.2), turned=0.3):
    """(4, 4) world from board: on the floor, its middle at a place, the front up."""
    pose = np.eye(4)
    spin = cv2.Rodrigues(np.array([0.0, turned, 0.0]))[0]
    pose[:3, :3] = spin @ np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    pose[:3, 3] = np.array(place) - pose[:3, :3] @ board.middle_m
    return pose


def pixels(camera, pose, points):
    """(point, 2) where a camera films points of a board; NaN outside its picture or behind it."""
    seen = camera.rotation @ pose[:3, :3]
    shift = camera.rotation @ pose[:3, 3] + camera.translation
    turn = cv2.Rodrigues(seen)[0]
    pixel = cv2.projectPoints(points, turn, shift, camera.intrinsics, camera.distortion)[0][:, 0]
    depth = points @ seen[2] + shift[2]
    facing = seen[:, 2] @ (seen @ points.mean(axis=0) + shift) > 0
    inside = (pixel >= 0).all(axis=1) & (pixel <= np.subtract(camera.size, 1)).all(axis=1)
    pixel[~(inside & (depth > 0) & facing)] = np.nan
    return pixel


def drawing(board):
    """The board as printed, with a white margin of a square, and its pixels in a square."""
    squares = board.columns + 1, board.rows + 1
    if board.dictionary:
        words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        drawn = cv2.aruco.CharucoBoard(squares, 1.0, board.marker_share, words)
        inner = drawn.generateImage((squares[0] * _SQUARE_PX, squares[1] * _SQUARE_PX))
    else:
        dark = np.indices(squares[::-1]).sum(axis=0) % 2 == 0
        inner = np.kron(np.where(dark, 25, 245), np.ones((_SQUARE_PX, _SQUARE_PX))).astype(np.uint8)
    return cv2.copyMakeBorder(inner, *[_SQUARE_PX] * 4, cv2.BORDER_CONSTANT, value=245)


def film_board(board, camera, pose, *, rng, blur=0.6, noise=2.0, bend_m=0.0):
    """What a camera films of a board: (row, column, 3) uint8.

    `bend_m` is how far the middle of a board that is bent about its short side stands out.
    """
    columns, rows = camera.size
    rays = _rays(camera)
    seen = np.linalg.inv(camera_from_world(camera) @ pose)
    start, along = seen[:3, 3], rays @ seen[:3, :3].T
    depth = -start[2] / along[:, 2]
    half = board.middle_m[0] + board.square_m
    for _ in range(4 * bool(bend_m)):
        x = (start + depth[:, None] * along)[:, 0] - board.middle_m[0]
        depth = (bend_m * ((x / half) ** 2 - 1) - start[2]) / along[:, 2]
    flat = (start + depth[:, None] * along)[:, :2] / board.square_m
    ahead = (depth > 0) & (along[:, 2] > 0)
    # the first corner is two squares from the margin's edge
    at = np.where(ahead[:, None], (flat + 2) * _SQUARE_PX - 0.5, -1e4).astype(np.float32)
    where = at.reshape(rows * _FINE, columns * _FINE, 2)
    picture = cv2.remap(drawing(board), where, None, cv2.INTER_LINEAR, borderValue=110)
    picture = cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA).astype(float)
    picture = cv2.GaussianBlur(picture, (0, 0), blur) if blur else picture
    picture = np.repeat(picture[..., None], 3, axis=2) + rng.normal(0, noise, (rows, columns, 3))
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def camera_from_world(camera):
    """(4, 4) where a camera is."""
    return np.vstack([np.column_stack([camera.rotation, camera.translation]), [0, 0, 0, 1]])


@lru_cache(maxsize=16)
def _rays(camera):
    """(pixel, 3) what the fine pixels of a camera show; by a fixed point, as lenses bend little."""
    (fx, _, cx), (_, fy, cy), _ = camera.intrinsics
    k1, k2, p1, p2 = (*camera.distortion, 0, 0, 0, 0)[:4]
    row, column = np.mgrid[: camera.height * _FINE, : camera.width * _FINE]
    a0 = ((column.ravel() + 0.5) / _FINE - 0.5 - cx) / fx
    b0 = ((row.ravel() + 0.5) / _FINE - 0.5 - cy) / fy
    a, b = a0.copy(), b0.copy()
    for _ in range(12):
        s = a * a + b * b
        f = 1 + k1 * s + k2 * s * s
        a, b = (
            (a0 - (2 * p1 * a * b + p2 * (s + 2 * a * a))) / f,
            (b0 - (p1 * (s + 2 * b * b) + 2 * p2 * a * b)) / f,
        )
    return np.column_stack([a, b, np.ones_like(a)])
