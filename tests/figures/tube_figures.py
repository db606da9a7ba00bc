"""A figure of tubes with stretched arms, its joints, voxels and labels."""

import numpy as np

from tasks.body.anatomy.nearest_bones import bones_of_voxels
from tasks.body.blobs.model import make_model
from tasks.geometry.voxels import VoxelGrid, voxel_centers, voxel_index

GRID = VoxelGrid((-1.0, 0.01, -0.5), 0.02, (100, 92, 50))

JOINT_PLACES = {
    "Head": (0, 1.7, 0), "Neck": (0, 1.44, 0), "Waist": (0, 1.0, 0),
    "RShoulder": (-0.18, 1.4, 0), "RElbow": (-0.45, 1.4, 0), "RWrist": (-0.68, 1.4, 0),
    "RFin": (-0.85, 1.4, 0), "RHip": (-0.1, 0.9, 0), "RKnee": (-0.11, 0.5, 0),
    "RAnkle": (-0.12, 0.09, 0), "RHeel": (-0.12, 0.03, -0.06), "RFoot": (-0.12, 0.03, 0.16),
}  # fmt: skip
TUBES = (
    (0, "Head", "Neck", 0.09, 0), (1, "Neck", "Waist", 0.13, 1), (2, "Waist", "Hips", 0.13, 2),
    (3, "Shoulder", "Elbow", 0.05, 3), (4, "Elbow", "Fin", 0.04, 4),
    (7, "Hip", "Knee", 0.08, 7), (8, "Knee", "Ankle", 0.05, 8), (8, "Heel", "Foot", 0.04, 8),
)  # fmt: skip


def _joints(bend):
    """Return the joints of a figure whose forearms are bent up by an angle."""
    at = {name: np.array(place, float) for name, place in JOINT_PLACES.items()}
    for name in list(at):
        if name[0] == "R":
            at["L" + name[1:]] = at[name] * (-1, 1, 1)
    for side, sign in (("R", -1), ("L", 1)):
        for name in ("Wrist", "Fin"):
            length = abs(at[side + name][0] - at[side + "Elbow"][0])
            way = np.array([sign * np.cos(bend), np.sin(bend), 0.0])
            at[side + name] = at[side + "Elbow"] + length * way
    at["Hips"] = (at["RHip"] + at["LHip"]) / 2
    return at


def figure_of_tubes(bend):
    """Return the joints, occupied voxels and labels of a figure of tubes."""
    at = _joints(bend)
    index = np.argwhere(np.ones(GRID.shape, bool))
    points = np.asarray(GRID.origin_m) + index * GRID.voxel_m
    best, label = np.full(len(points), np.inf), np.zeros(len(points), np.uint8)
    for number, first, last, radius, _ in TUBES:
        for shift, side in ((0, "R"), (2, "L")) if first not in at else ((0, ""),):
            a, b = at[side + first], at[side + last]
            share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            away = np.linalg.norm(points - a - share[:, None] * (b - a), axis=1) / radius
            label[away < best] = number + 1 + shift
            best = np.minimum(best, away)
    occupied = best < 1
    return at, occupied.reshape(GRID.shape), label[occupied]


def model_of(figure, runs):
    joints, _, label = figure
    points = voxel_centers(GRID, voxel_index(runs, 0))
    forward = np.array([0.0, 0.0, 1.0])
    return make_model(points, bones_of_voxels(points, label, joints, forward), joints, forward)
