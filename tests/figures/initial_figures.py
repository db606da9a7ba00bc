"""Generated performers with stretched arms as voxels, and how far what is found is from them."""

import dataclasses

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from storage.schema import JOINTS
from tasks.geometry.voxels import VoxelGrid, encode_runs, voxel_centers, voxel_index
from tasks.studio.dancing.choreography import okuri48
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.performances import SH, generate_performance
from tasks.studio.stage.bodies import pose_surface

VOXEL = 0.02
GRID = VoxelGrid((-1.39, 0.01, -1.49), VOXEL, (140, 100, 150))
LIMBS = ("Shoulder", "Elbow", "Fin", "Hip", "Knee", "Foot")
SCORED = ("Head", "Neck", *(side + limb for side in "RL" for limb in LIMBS))


@dataclasses.dataclass
class Figure:
    """A generated performer: its voxels, the colors of its surface, and what is true."""

    occupied: np.ndarray
    surfaces: list
    joints: np.ndarray
    vertex: np.ndarray
    segment: np.ndarray


def figure_of(position, clothes):
    """Return one frame (21, 3) as voxels, by sampling the triangles and filling what they hold."""
    surface = pose_surface(dict(zip(JOINTS, position[:, None], strict=True)), clothes=clothes)
    corners = surface.vertex[0, surface.triangle].astype(float)
    steps = [(a, b) for a in np.linspace(0, 1, 9) for b in np.linspace(0, 1, 9) if a + b <= 1]
    weight = np.array([(a, b, 1 - a - b) for a, b in steps])
    sample = np.einsum("wk,tkx->twx", weight, corners).reshape(-1, 3)
    color = np.repeat(surface.color, len(weight), axis=0)
    index = np.rint((sample - GRID.origin_m) / VOXEL).astype(int)
    inside = ((index >= 0) & (index < GRID.shape)).all(axis=1)
    shell = np.zeros(GRID.shape, bool)
    shell[tuple(index[inside].T)] = True
    occupied = np.stack([ndimage.binary_fill_holes(layer) for layer in np.moveaxis(shell, 1, 0)], 1)
    body = ~surface.is_cloth
    return Figure(
        occupied,
        [(index[inside][::7], color[inside][::7])],
        position,
        surface.vertex[0, body].astype(float),
        surface.segment[body],
    )


def stretched_body():
    """Return the joints (21, 3) of a dancer who stretches the arms."""
    danced = generate_performance([okuri48()], SH, rate_hz=3.0, heading=0.7).position
    return stretch_arms_first(danced, 3.0, still_s=0.4, blend_s=0.0)[0]


def runs_of(*frames):
    return encode_runs(np.stack(frames))


def errors_mm(model, joints):
    off = np.linalg.norm(model.position - joints, axis=1) * 1000
    return np.array([off[JOINTS.index(name)] for name in SCORED])


def label_accuracy(model, grid, runs, vertex, segment):
    center = voxel_centers(grid, voxel_index(runs, model.frame))
    distance, nearest = KDTree(vertex).query(center)
    near = distance < 0.06
    return np.mean(model.label[near] == segment[nearest[near]])


def with_arms(position, turn):
    """Return joints whose arms are turned about the shoulders, each by its own (3, 3) matrix."""
    moved = position.copy()
    for side in "RL":
        shoulder = JOINTS.index(f"{side}Shoulder")
        for name in ("Elbow", "Wrist", "Fin"):
            number = JOINTS.index(side + name)
            moved[number] = position[shoulder] + turn[side] @ (
                position[number] - position[shoulder]
            )
    return moved


def about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
