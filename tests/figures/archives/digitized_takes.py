"""A small take with all that a digitization leaves, written straight into an archive."""

from itertools import pairwise

import numpy as np

from storage.arrays.cameras import write_cameras
from storage.arrays.groups import write_motion
from storage.arrays.poses import write_body, write_pose
from storage.arrays.silhouettes import write_silhouettes
from storage.arrays.voxels import write_voxels
from storage.formats.calibration.camera import Camera
from storage.provenance import Provenance
from storage.publication import describe_files, publish_record, version_folder
from storage.records import Record
from storage.schema import JOINTS
from tasks.geometry.voxels import encode_runs, surface_voxels
from tests.conftest import swaying_body

FRAMES, RATE_HZ, VOXEL_M, SHAPE = 12, 10.0, 0.05, (20, 36, 14)
ORIGIN_M = (-0.475, 0.025, -0.325)
STATURE_M, CONFIDENCE, EMPTY = 1.6, 0.75, (11,)
CAMERAS = ("front", "_side_", "left")
_LIMB_M = 0.09
"""How thick the body is around the lines between its joints [m]."""


def write_digitized(place, take, *, metadata=None, doubtful=(), notes=(), posed=True):
    """Write and publish a take of a body that stands and sways; return its record.

    The last frame is empty. The quality of segment `n` in frame `t` is 1 - 0.01 * (n + t).
    """
    version = "000001-a"
    folder, about = version_folder(take, version), Provenance("carving", {}, {})
    body = swaying_body(3, FRAMES)
    occupied = np.stack([_figure(joints) for joints in body])
    occupied[list(EMPTY)] = False
    focal = np.array([[200.0, 0.0, 59.5], [0.0, 200.0, 39.5], [0.0, 0.0, 1.0]])
    level = np.diag([1.0, -1.0, -1.0])
    cameras = [Camera(n, (120, 80), focal, np.zeros(0), level, np.zeros(3)) for n in CAMERAS]
    write_cameras(place, folder, cameras, about)
    seen = np.zeros((FRAMES, len(CAMERAS), 80, 120), np.bool_)
    for n in range(len(CAMERAS)):
        seen[:-1, n, 20:70, 30 * n + 10 : 30 * n + 30] = True
    write_silhouettes(
        place, folder, iter([seen]), seen.shape, cameras=CAMERAS, rate_hz=RATE_HZ, provenance=about
    )
    _write_voxels(place, folder, occupied, about, labeled=posed)
    stages = ["cameras", "silhouettes", "voxels"]
    if posed:
        stages += ["labels", "body", "pose", "motion"]
        _write_pose(place, folder, body, doubtful, about)
    record = Record(
        take, version, 1,
        {"kind": "capture", "name": take, "path": f"/captures/{take}", "digest": "d" * 64},
        metadata or {}, FRAMES, RATE_HZ, list(JOINTS) if posed else [], stages,
        describe_files(place, take, version), list(notes),
    )  # fmt: skip
    publish_record(place, record)
    return record


def _figure(joints):
    """Return (x, y, z) bool: the voxels near the lines between a body's joints."""
    at = dict(zip(JOINTS, joints, strict=True))
    lines = [("Head", "Neck"), ("Neck", "Waist")]
    for side in "RL":
        chain = ("Neck", "Shoulder", "Elbow", "Wrist", "Fin")
        lines += [(a if a == "Neck" else side + a, side + b) for a, b in pairwise(chain)]
        chain = ("Waist", "Hip", "Knee", "Ankle", "Foot")
        lines += [(a if a == "Waist" else side + a, side + b) for a, b in pairwise(chain)]
    center = np.stack(np.indices(SHAPE), axis=-1) * VOXEL_M + ORIGIN_M
    near = np.zeros(SHAPE, np.bool_)
    for first, last in lines:
        for share in np.linspace(0.0, 1.0, 9):
            point = (1 - share) * at[first] + share * at[last]
            near |= np.linalg.norm(center - point, axis=-1) < _LIMB_M
    return near


def _write_voxels(place, folder, occupied, about, *, labeled):
    runs = encode_runs(occupied)
    surface = [surface_voxels(runs, frame) for frame in range(FRAMES)]
    height = [np.argwhere(each)[:, 1] for each in occupied]
    label = np.concatenate([np.where(h > SHAPE[1] // 2, 2, 8) for h in height]).astype(np.uint8)
    labels = {"label": [label], "provisional_label": [label]} if labeled else {}
    write_voxels(
        place, folder,
        {
            "run": runs.offset,
            "voxel": np.cumsum([0, *map(len, surface)]),
            "surface": np.cumsum([0, *(int(each.sum()) for each in surface)]),
        },
        {
            "run_start": [runs.start], "run_length": [runs.length], "is_surface": surface,
            "color": [np.full((int(s.sum()), 3), (200, 60, 50), np.uint8) for s in surface],
            "camera": [np.zeros(int(s.sum()), np.uint8) for s in surface],
            **labels,
        },
        attributes={
            "origin_m": list(ORIGIN_M), "voxel_m": VOXEL_M, "shape": list(SHAPE),
            "provenance": about.attributes(),
        },
        array_attributes={}, rate_hz=RATE_HZ,
    )  # fmt: skip


def _write_pose(place, folder, body, doubtful, about):
    place_m, turn = np.zeros((FRAMES, 11, 3)), np.broadcast_to(np.eye(3), (FRAMES, 11, 3, 3))
    quality = 1.0 - 0.01 * (np.arange(11) + np.arange(FRAMES)[:, None])
    pose = {
        "position": place_m, "rotation": turn, "local_position": place_m, "local_rotation": turn,
        "quality": quality, "doubtful": np.isin(np.arange(FRAMES), doubtful),
    }  # fmt: skip
    write_pose(place, folder, pose, rate_hz=RATE_HZ, attributes={}, provenance=about)
    shape = {
        "centroid": (11, 3), "axes": (11, 3, 3), "variance": (11, 3), "offset": (11, 3),
        "joint_offset": (21, 3), "volume_share": (11,),
    }  # fmt: skip
    write_body(
        place, folder, {**{n: np.zeros(s) for n, s in shape.items()}, "initial_joint": body[0]},
        attributes={"initial_frame": 0, "confidence": CONFIDENCE}, provenance=about,
    )  # fmt: skip
    write_motion(
        place, folder, position=body.astype(np.float32), filled=np.zeros(body.shape[:2], bool),
        rate_hz=RATE_HZ, provenance=about,
        attributes={"stature_m": STATURE_M, "stature_source": "given in capture.toml"},
    )  # fmt: skip
