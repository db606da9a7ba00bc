"""What the colors of a take say of faces and hands of bodies that were fitted without color.

A face is before its head and has the color of hands, or is brighter than hair. The fronts of the
heads that were fitted most surely tell what color skin has; what else has it may be a hand.
"""

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from tasks.body.anatomy.bones import BONE_NUMBER, Floats, Pose
from tasks.body.anatomy.colors import color_cells, count_colors, log_ratio
from tasks.body.anatomy.skin import FACE_SPAN, LEAST_RATIO
from tasks.body.blobs.fitting import Fit, Target, fit_frame, penalized_likelihood
from tasks.body.guess.single_frames import FINE, FINE_WIDENING, LOOSE, Shown
from tasks.body.guess.usual_body import FRONT, UsualBody
from tasks.body.initial.facing import LEVELS_ADDED, LIGHT_SHARE, UNLIKE
from tasks.body.poses.limbs import LIMBS, reach_for

HEAD_SPAN = (0.0, 1.2)
"""Between which places a voxel near the head may be the head's [shares of the way from neck to
top]. The neck shows skin, too."""

SKULL_RADIUS = 0.09
"""How far from the line through neck and head a voxel is the head's [statures]. A head's breadth
and half, for the line may be off; chosen by eye on the shared captures, not measured."""

HAND_RADIUS = 0.05
"""How far from a finger tip a voxel is a hand's [statures]. Half a hand's length."""

LEAST_VOXELS = 20
"""Voxels of a head, or of hands, with fewer of which nothing is said [voxels]. Chosen by eye on the
shared captures; not measured."""

HALF_DEEP = 0.06
"""Half the depth of a head [statures]. De Leva (1996) has heads 0.12 deep."""

FACE_AHEAD = 0.5
"""How far to the front of the head its voxels are a face's [cosine]. 60 degrees to each side."""

LUMP_M = 0.025
"""How far apart voxels of a lump are at most [m]. Two and a half voxels of 1 cm; chosen by eye on
the shared captures, not measured."""

LEAST_LUMP = 10
"""Voxels that a lump has at least [voxels]. Chosen by eye on the shared captures; not measured."""

MOST_LUMPS = 4
"""How many lumps are tried [lumps]. Hands, and what is taken for them."""

FLOOR = 0.1
"""Height above the lowest voxel below which skin is a foot's [statures]. Chosen by eye on the
shared captures; not measured."""

HAND_PULL = 60.0
"""Information about a hand's place [1/m²]. As `JointMethodSettings.hand_pull`."""

PULL_WITHIN = 0.15
"""Distance from which its place pulls less [statures]. As `JointMethodSettings.pull_within`."""

HAND_STEPS = 6
"""Turns of the fit with a hand at a lump [turns]. Chosen by eye on the shared captures; not
measured."""

SWIVELS = 3
"""How many places of the elbow are tried [places]. Chosen by eye on the shared captures; not
measured."""

UNSEEN = 0.12
"""What a hand costs that is at no lump [mean logarithm of the voxels' likelihoods]. As
`JointMethodSettings.hand_missing`."""


def vote_face(shown: Shown, frame: int, body: UsualBody, pose: Pose) -> float:
    """Return from -1 to 1 whether the front of the head looks like a face, its back like hair."""
    joints = body.place(pose)
    point, color = shown.surface(frame)
    share, off = _along_head(joints, point)
    head = _is_between(share, FACE_SPAN)
    head &= np.linalg.norm(off, axis=1) < SKULL_RADIUS * body.stature_m
    if head.sum() < LEAST_VOXELS:
        return 0.0
    own = color[head].astype(np.float64)
    total = own.sum(axis=1)
    like = (total - (total.min() + total.max()) / 2) / max(float(np.ptp(total)) / 2, 30.0)
    near = [
        np.linalg.norm(point - joints[side + "Fin"], axis=1) < HAND_RADIUS * body.stature_m
        for side in "RL"
    ]
    hands = color[near[0] | near[1]].astype(np.float64)
    if len(hands) > LEAST_VOXELS:
        alike = _likeness(own, np.median(hands, axis=0))
        like = alike if np.ptp(alike) >= 0.5 else like
    ahead = off[head] @ (pose.rotation[BONE_NUMBER["Head"]] @ FRONT)
    ahead /= HALF_DEEP * body.stature_m
    return float(np.clip(np.mean(like * ahead) - like.mean() * ahead.mean(), -1.0, 1.0))


def learn_skin(
    shown: Shown, body: UsualBody, fits: Sequence[tuple[int, Fit]]
) -> NDArray[np.float64]:
    """Return (color cell,) the logarithm of how much likelier a color is on faces than elsewhere.

    `fits` are frames with fits of the body.
    """
    face, other = [], []
    for frame, fit in fits:
        joints = body.place(fit.pose)
        point, color = shown.surface(frame)
        share, off = _along_head(joints, point)
        cell, away = color_cells(color), np.linalg.norm(off, axis=1)
        head = _is_between(share, HEAD_SPAN) & (away < SKULL_RADIUS * body.stature_m)
        ahead = off @ (fit.pose.rotation[BONE_NUMBER["Head"]] @ FRONT) > FACE_AHEAD * away
        face.append(cell[head & ahead & _is_between(share, FACE_SPAN)])
        other.append(cell[~head])
    return log_ratio(count_colors(np.concatenate(face)), count_colors(np.concatenate(other)))


def skin_lumps(
    shown: Shown, frame: int, body: UsualBody, pose: Pose, skin: NDArray[np.float64]
) -> list[Floats]:
    """Return the middles (3,), m, of the largest lumps of skin that are off head and floor."""
    joints = body.place(pose)
    point, color = shown.surface(frame)
    share, off = _along_head(joints, point)
    head = _is_between(share, HEAD_SPAN)
    head &= np.linalg.norm(off, axis=1) < SKULL_RADIUS * body.stature_m
    low = point[:, 1] < point[:, 1].min(initial=np.inf) + FLOOR * body.stature_m
    bare = point[(skin[color_cells(color)] > LEAST_RATIO) & ~head & ~low]
    if not len(bare):
        return []
    first, second = KDTree(bare).query_pairs(LUMP_M, output_type="ndarray").T
    joined = coo_array((np.ones(len(first)), (first, second)), shape=(len(bare), len(bare)))
    _, lump = connected_components(joined, directed=False)
    size = np.bincount(lump)
    largest = np.argsort(-size, kind="stable")[:MOST_LUMPS]
    return [bare[lump == k].mean(axis=0) for k in largest if size[k] >= LEAST_LUMP]


def reach_lumps(
    shown: Shown, frame: int, body: UsualBody, fit: Fit, lumps: Sequence[Floats]
) -> tuple[Fit, int]:
    """Return the fit with its hands at lumps where that explains more, and how many hands are."""
    if not lumps:
        return fit, 0
    voxels, hands = shown.sample(frame, FINE), min(2, len(lumps))
    middle = [(body.joints[s + "Fin"] - body.joints[s + "Wrist"]) / 2.0 for s in "RL"]
    best, chosen, reached = fit.likelihood - UNSEEN * hands, fit, 0
    orders = permutations(range(len(lumps)), 2) if hands == 2 else ((0, None), (None, 0))
    for order in orders:
        held = [(hand, lumps[k]) for hand, k in enumerate(order) if k is not None]
        targets = [
            Target(LIMBS[hand].end, middle[hand], place, HAND_PULL, PULL_WITHIN * body.stature_m)
            for hand, place in held
        ]
        poses = [fit.pose]
        for hand, place in held:
            ways = [
                reach_for(pose, body.blobs.origin, LIMBS[hand], middle[hand], place, SWIVELS)
                for pose in poses
            ]
            poses = [pose for found in ways for pose in found]
        for pose in poses:
            other = fit_frame(
                body.blobs, voxels, pose, pose, targets,
                settings=LOOSE, steps=HAND_STEPS, widening=FINE_WIDENING,
            )  # fmt: skip
            value = penalized_likelihood(body.blobs, other, targets)
            if value > best:
                best, chosen, reached = value, other, len(held)
    return chosen, reached


def _along_head(joints: Mapping[str, Floats], point: Floats) -> tuple[Floats, Floats]:
    """Return how far up the head points are, 0 neck to 1 top, and (point, 3) off its line, m."""
    line = joints["Head"] - joints["Neck"]
    share = (point - joints["Neck"]) @ line / (line @ line)
    return share, point - joints["Neck"] - share[:, None] * line


def _is_between(share: Floats, span: tuple[float, float]) -> NDArray[np.bool_]:
    """Return where shares are between two others."""
    return (share > span[0]) & (share < span[1])


def _likeness(color: Floats, wanted: Floats) -> Floats:
    """Return (color,) from -1 to 1 how much colors (color, 3) are like one (3,)."""
    total = color.sum(axis=1) + LEVELS_ADDED
    goal = float(wanted.sum()) + LEVELS_ADDED
    unlike = np.linalg.norm(color / total[:, None] - wanted / goal, axis=1)
    unlike += LIGHT_SHARE * abs(np.log(total / goal))
    return 2.0 * np.exp(-((unlike / UNLIKE) ** 2)) - 1.0
