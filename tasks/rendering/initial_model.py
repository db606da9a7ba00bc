"""Draw labelled voxels with their joints, from two sides.

Points are metres with y up.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.body.initial.search import InitialModel
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_index
from tasks.rendering.drawing.canvas import (
    FINE,
    INK,
    PAPER,
    Image,
    blank,
    draw_line,
    draw_text,
    finish,
)
from tasks.rendering.drawing.segment_colors import SEGMENT_COLORS

Points = NDArray[np.float64]

_JOINT_LINES = (
    *(("Head", "Neck"), ("Neck", "Waist")),
    *((a, s + b) for s in "RL" for a, b in (("Neck", "Shoulder"), ("Waist", "Hip"))),
    *(
        (s + a, s + b)
        for s in "RL"
        for a, b in (
            *(("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Wrist", "Fin"), ("Hip", "Knee")),
            *(("Knee", "Ankle"), ("Ankle", "Heel"), ("Heel", "Foot")),
        )
    ),
)
"""Lines between joints, for the eye."""


def draw_from(
    point: Points, label: NDArray[np.uint8], joints: Mapping[str, Points], left: Points, name: str
) -> Image:
    """Return a picture (row, column, 3) RGB, 480 x 480, seen with `left` to the right.

    Parameters
    ----------
    point : (voxel, 3) float64
    label : (voxel,) uint8
    joints
        (3,) each; what is not finite is left out.
    left : (3,) float64
        Horizontal unit vector across the picture.
    name
        Written above.
    """
    side = 480
    image = blank(side, side)
    toward = np.cross(left, [0.0, 1.0, 0.0])
    middle = (point.min(axis=0) + point.max(axis=0)) / 2.0
    scale = 0.84 * side / max(float(np.ptp(point, axis=0).max()), 1e-6)

    def place(p: Points) -> Points:
        off = p - middle
        return np.stack([side / 2 + scale * off @ left, side * 0.52 - scale * off[..., 1]], axis=-1)

    depth = point @ toward
    order = np.argsort(depth, kind="stable")
    shade = 0.62 + 0.38 * (depth - depth.min()) / max(float(np.ptp(depth)), 1e-6)
    color = np.array(SEGMENT_COLORS)[label] * shade[:, None]
    spot = np.rint(place(point) * FINE).astype(np.int64)[order]
    reach = max(1, round(scale * FINE * _spacing(point) / 2))
    for row in range(-reach, reach + 1):
        for column in range(-reach, reach + 1):
            at = np.clip(spot + np.array([column, row]), 0, side * FINE - 1)
            image[at[:, 1], at[:, 0]] = color[order].astype(np.uint8)
    for first, last in _JOINT_LINES:
        ends = np.array([joints[first], joints[last]])
        if np.isfinite(ends).all():
            start, end = place(ends)
            draw_line(image, start, end, PAPER, 3.2)
            draw_line(image, start, end, INK, 1.4)
    for joint in joints.values():
        if np.isfinite(joint).all():
            draw_line(image, place(joint), place(joint), INK, 6)
            draw_line(image, place(joint), place(joint), PAPER, 3)
    picture = finish(image)
    draw_text(picture, name, (12, 24), 15, INK)
    return picture


def _spacing(point: Points) -> float:
    """Return the least distance between two heights of points: a voxel's edge."""
    step = np.diff(np.unique(point[:, 1].round(6)))
    return float(step.min()) if len(step) else 0.01


def draw_initial_model(model: InitialModel, runs: VoxelRuns, grid: VoxelGrid) -> NDArray[np.uint8]:
    """Return a picture of the labelled voxels with the joints, from the front and the left.

    Returns
    -------
    (480, 960, 3) uint8
        RGB. Seen from the front the performer's left is on the right.

    Raises
    ------
    ValueError
        The model's labels are not those of its frame's voxels.
    """
    point = voxel_centers(grid, voxel_index(runs, model.frame))
    if len(point) != len(model.label) or not len(point):
        raise ValueError(
            f"a model of {len(model.label)} labels was given with {len(point)} voxels of frame "
            f"{model.frame}; pass the hulls it was made of, with somebody in that frame"
        )
    joints = dict(zip(JOINTS, model.position, strict=True))
    across = (joints["LShoulder"] - joints["RShoulder"]) * [1.0, 0.0, 1.0]
    left = across / max(float(np.linalg.norm(across)), 1e-9)
    back = -np.cross(left, [0.0, 1.0, 0.0])
    label = np.asarray(model.label, np.uint8)
    title = f"frame {model.frame}, confidence {model.confidence:.2f}"
    front = draw_from(point, label, joints, left, title)
    return np.concatenate([front, draw_from(point, label, joints, back, "from the left")], axis=1)
