"""Motion files made by hand, and what tests ask of their tracks."""

import numpy as np
from scipy.spatial.transform import Rotation

from storage.formats.motion.motion_file import MotionFile
from tasks.motion.importing import ImportSettings, make_joint_track

FRAMES, RATE_HZ = 120, 60.0


GIVEN = {
    "Head": (0, 1.65, 0),
    "Neck": (0, 1.4, 0),
    "Waist": (0, 1.05, 0),
    "RShoulder": (0.18, 1.38, 0),
    "RElbow": (0.25, 1.1, 0.03),
    "RWrist": (0.28, 0.86, -0.05),
    "RFin": (0.28, 0.7, -0.1),
    "RHip": (0.09, 0.95, 0),
    "RKnee": (0.1, 0.52, -0.05),
    "RAnkle": (0.11, 0.08, 0),
    "RHeel": (0.11, 0.02, 0.06),
    "RFoot": (0.11, 0.02, -0.19),
}


PLUG_IN_GAIT = {
    "RFHD": (0.07, 1.58, -0.09),
    "RBHD": (0.07, 1.58, 0.09),
    "C7": (0, 1.42, 0.07),
    "CLAV": (0, 1.36, -0.08),
    "T10": (0, 1.2, 0.1),
    "STRN": (0, 1.18, -0.1),
    "RSHO": (0.18, 1.42, 0),
    "RELB": (0.29, 1.1, 0.03),
    "RWRA": (0.27, 0.87, -0.08),
    "RWRB": (0.29, 0.86, -0.01),
    "RFIN": (0.3, 0.79, -0.06),
    "RASI": (0.12, 1.03, -0.08),
    "RPSI": (0.05, 1.04, 0.09),
    "RTHI": (0.19, 0.75, -0.02),
    "RKNE": (0.16, 0.52, -0.04),
    "RTIB": (0.16, 0.3, 0),
    "RANK": (0.15, 0.09, 0.01),
    "RHEE": (0.11, 0.05, 0.09),
    "RTOE": (0.12, 0.05, -0.1),
}


def dance(points, frames=FRAMES):
    """Return names and positions of a body that sways, turns and walks; metres, Y up."""
    whole = dict(points)
    for name, (x, y, z) in points.items():
        if name[0] == "R":
            whole["L" + name[1:]] = (-x, y, z)
    time = np.arange(frames) / RATE_HZ
    still = np.array(list(whole.values()), float)
    sway = 0.02 * np.sin(2 * np.pi * time[:, None, None] + still[None, :, :1] * 9)
    turn = Rotation.from_rotvec(np.outer(0.7 * np.sin(time), [0.0, 1.0, 0.0]))
    moving = still + sway * still[None, :, 1:2]
    turned = np.stack([turn[i].apply(moving[i]) for i in range(frames)])
    return tuple(whole), turned + np.stack([0.5 * time, 0 * time, -0.2 * time], 1)[:, None]


def motion_file(points=GIVEN, *, unit_m=1.0, up="y", source="trc", frames=FRAMES):
    names, position = dance(points, frames)
    return MotionFile(source, names, position, RATE_HZ, unit_m, up)


def track_of(motion, **settings):
    return make_joint_track(motion, ImportSettings(**settings), file_name="okuri48.trc")


def said(track, text):
    return any(text in note for note in track.notes)
