"""A body of balls that moves as a performer does, and its silhouettes in a ring of cameras."""

import cv2
import numpy as np

from tasks.geometry.projection import Projection, project_points

SIZE, CAMERAS = (160, 120), 5
BALLS_M = (0.12, 0.10, 0.15, 0.08, 0.08, 0.09)


def cameras(*, bent=True):
    """A ring around (0, 1, 0), lenses a little bent."""
    poses = []
    for n in range(CAMERAS):
        angle = 2.1 * n
        center = np.array([3.2 * np.cos(angle), 0.9 + 0.35 * (n % 3), 3.2 * np.sin(angle)])
        ahead = np.array([0.0, 1.0, 0.0]) - center
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        turn = np.stack([right, np.cross(ahead, right), ahead])
        poses.append(np.column_stack([turn, -turn @ center]))
    inner = np.array([[150.0, 0.0, 79.5], [0.0, 150.0, 59.5], [0.0, 0.0, 1.0]])
    lens = np.tile([-0.1 * bent, 0.02 * bent, 0, 0], (CAMERAS, 1))
    return Projection(
        np.stack(poses), np.stack([inner] * CAMERAS), lens, np.array([SIZE] * CAMERAS)
    )


CAMERA = cameras()


def body_at(time, *, slow=1.0):
    """Middles (ball, 3) of balls at a time, in frames: a body that jumps and throws its limbs."""
    t = np.asarray(time, float) / 30.0 / slow
    sway = 0.25 * np.sin(2.3 * t + 0.7) + 0.15 * np.sin(5.1 * t)
    bend = 0.2 * np.sin(3.7 * t) ** 2
    return np.array(
        [
            [sway, 1.55 - bend, 0.2 * np.cos(1.9 * t)],
            [sway, 1.2 - bend, 0.2 * np.cos(1.9 * t)],
            [0.8 * sway, 0.9 - 0.7 * bend, 0.2 * np.cos(1.9 * t)],
            [0.5 * np.cos(4.3 * t), 1.2 + 0.5 * np.sin(4.9 * t), 0.5 * np.sin(4.3 * t)],
            [-0.4, 1.1 + 0.4 * np.sin(6.1 * t + 1), 0.4 * np.sin(3.1 * t)],
            [0.3 * np.sin(2.9 * t), 0.2 + 0.15 * np.sin(4.1 * t), -0.3 * np.sin(2.9 * t)],
        ]
    )


def draw(times):
    """Packed silhouettes (time, camera, row, column / 8) of the body at each camera's times."""
    packed = np.zeros((len(times[0]), CAMERAS, SIZE[1], SIZE[0] // 8), np.uint8)
    for c in range(CAMERAS):
        for n, time in enumerate(times[c]):
            pixel, depth = project_points(body_at(time), CAMERA)
            picture = np.zeros((SIZE[1], SIZE[0]), np.uint8)
            for (column, row), far, radius in zip(pixel[c], depth[c], BALLS_M, strict=True):
                if np.isfinite(column):
                    at = (round(column * 16), round(row * 16))
                    cv2.circle(picture, at, round(150 * radius / far * 16), 1, -1, shift=4)
            packed[n, c] = np.packbits(picture, axis=-1)
    return packed
