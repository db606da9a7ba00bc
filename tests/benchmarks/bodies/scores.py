"""Score poses and labels of a take against the truth of its capture.

Labels: of the voxels within 6 cm of the true surface, the share whose segment is that of the
nearest true point; mean over frames. Joints: distance of 14 joints from their true places.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from storage.schema import JOINTS

SCORED = (
    *("Head", "Neck"),
    *(side + name for side in "RL" for name in ("Shoulder", "Elbow", "Fin", "Hip", "Knee", "Foot")),
)
"""The joints whose place does not depend on convention."""
LOST_M, NEAR_M = 0.150, 0.06

_WORDS = {"Head": "head_top", "Fin": "finger", "Foot": "toe"}


def true_name(joint: str) -> str:
    """Return the name of a joint in the truth of a capture."""
    if joint in ("Head", "Neck"):
        return _WORDS.get(joint, joint.lower())
    return f"{joint[0].lower()}_{_WORDS.get(joint[1:], joint[1:].lower())}"


def true_joints(truth: Any) -> NDArray[np.float64]:
    """Return (time, 14, 3), m, of the joints scored."""
    names = [str(name) for name in truth["joint_names"]]
    return np.asarray(truth["joints"], np.float64)[:, [names.index(true_name(j)) for j in SCORED]]


def joint_errors(position: NDArray[np.floating], truth: Any) -> NDArray[np.float64]:
    """Return how far (time, 14) joints are from their true places, m; infinite where missing.

    Parameters
    ----------
    position : (time, 21, 3)
        Metres, joints as in `storage.schema.JOINTS`.
    truth
        As `np.load` opens `<capture>_truth.npz`; its frames are those of `position`.
    """
    own = np.asarray(position, np.float64)[:, [JOINTS.index(joint) for joint in SCORED]]
    error = np.linalg.norm(own - true_joints(truth), axis=2)
    return np.where(np.isfinite(error), error, np.inf)


def longest_run(wrong: NDArray[np.bool_]) -> int:
    """Return the most frames in a row (along the first axis) that one column is wrong."""
    longest, run = 0, np.zeros(wrong.shape[1:], int)
    for row in wrong:
        run = np.where(row, run + 1, 0)
        longest = max(longest, int(run.max()))
    return longest


def score_joints(
    error: NDArray[np.float64], doubtful: NDArray[np.bool_] | None = None
) -> dict[str, Any]:
    """Return the figures of a take's joints.

    Parameters
    ----------
    error : (time, 14)
        As `joint_errors` returns it.
    doubtful : (time,) bool, optional
        The frames that were flagged.

    Returns
    -------
    dict
        `mean_mm` and `p95_mm` of the joints found, `lost` share of joint-frames, `run` the
        longest of them; `wrong` frames with a lost joint, `flagged` frames, `precision` (share of
        flagged that are wrong) and `recall` (share of wrong that are flagged), NaN of none; and
        `parts`: the median in mm and the lost share of each joint.
    """
    lost = ~(error <= LOST_M)
    found = 1e3 * error[np.isfinite(error)]
    wrong = lost.any(axis=1)
    parts = {
        joint: [1e3 * float(np.median(error[:, n])), float(lost[:, n].mean())]
        for n, joint in enumerate(SCORED)
    }
    score: dict[str, Any] = {
        "mean_mm": float(found.mean()) if len(found) else np.nan,
        "p95_mm": float(np.percentile(found, 95)) if len(found) else np.nan,
        "lost": float(lost.mean()),
        "run": longest_run(lost),
        "wrong": int(wrong.sum()),
        "parts": parts,
    }
    if doubtful is not None:
        right = int((doubtful & wrong).sum())
        score["flagged"] = int(doubtful.sum())
        score["precision"] = right / doubtful.sum() if doubtful.any() else np.nan
        score["recall"] = right / wrong.sum() if wrong.any() else np.nan
    return score


def label_accuracy(
    frames: Iterable[tuple[NDArray[np.floating], NDArray[np.integer], int]], truth: Any
) -> float:
    """Return the share of voxels near the body that have the right label, mean over frames.

    Parameters
    ----------
    frames : iterable of (center, label, frame)
        (voxel, 3) metres and (voxel,) label 1 to 11 of a frame.
    truth
        As for `joint_errors`.
    """
    segment = np.asarray(truth["vert_segment"])
    vertex = truth["verts"]
    shares = []
    for center, label, frame in frames:
        points = np.asarray(vertex[frame], np.float64)
        distance, nearest = KDTree(points).query(center, distance_upper_bound=NEAR_M)
        near = np.isfinite(distance)
        right = segment[np.asarray(nearest)[near]] + 1 == label[near]
        shares.append(float(right.mean()) if near.any() else 0.0)
    return float(np.mean(shares))
