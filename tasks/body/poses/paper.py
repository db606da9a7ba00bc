"""Fit the body to provisional labels, from the head outwards (digitization paper, 3.4.2).

A segment's ellipsoid, with radii of two standard deviations, is turned about the segment's joint
until it holds as many as it can of the voxels with the segment's label. The head is moved, too.
Each parameter is searched within bounds around its value in the frame before. Parents come
before children, and a child never corrects its parent: a limb whose parent is wrong is lost, here
as in the paper. The method is kept for study.

The paper leaves some things open. Here its search is a descent along one parameter at a time, with
steps that are halved; angles are turns about the segment's own axes, X first; bounds are speeds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.segments import PARENTS, SEGMENT_COUNT, BodyShape, carry_joints
from tasks.engine.kernels import njit
from tasks.engine.settings import Count, CountOrNone, Positive, check_ranges

_RADII_SQUARED = 4.0
"""Square of an ellipsoid's radius along an axis [variances]. The radius is two standard deviations
(digitization paper, equations 3 and 4)."""

_TURN_FOR_STATURE = 7
"""The turn that is tried together with a move of the head by a stature [rad]. A step of 8 degrees
then goes with one of 3 cm. Chosen by eye on the shared captures; not measured."""


@dataclass(frozen=True)
class PaperMethodSettings:
    """Everything that changes a pose fitted by the `paper` method.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    turn_speed: Positive = 12.6
    """How fast a segment turns in its parent about each axis at most [rad/s]. It is two turns a
    second; a kicking lower leg comes near it."""

    head_speed: Positive = 2.0
    """How fast the head moves along each axis at most [statures/s]. A sprint is 5."""

    first_step: Positive = 0.14
    """First step of a turn [rad]. It is 8 degrees, by about which a sleeve's ellipsoid turns by
    itself. The head's first step of a move is a seventh of this, in statures."""

    halvings: CountOrNone = 3
    """How often the steps are halved [halvings]. Three lead to one degree and 4 mm, less than a
    voxel at a hand."""

    rounds: Count = 8
    """How often all parameters are tried with one step at most [rounds]. Chosen by eye on the
    shared captures; not measured."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """A body's pose over time, and how well it fits."""

    joint: NDArray[np.float64]
    """(time, 21, 3) joints in the world, metres; NaN where the first frame has none."""

    position: NDArray[np.float64]
    """(time, 11, 3) each segment's own joint in the world, metres."""

    rotation: NDArray[np.float64]
    """(time, 11, 3, 3) each segment's axes in the world, in columns."""

    quality: NDArray[np.float64]
    """(time, 11) share of a segment's voxels inside its ellipsoid; 0 where it has no voxel."""


def fit_frame_as_paper(
    center: NDArray[np.floating],
    label: NDArray[np.integer],
    shape: BodyShape,
    previous: tuple[NDArray[np.floating], NDArray[np.floating]],
    settings: PaperMethodSettings,
    *,
    rate_hz: float,
    stature_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the pose of one frame, fitted from the head outwards to provisional labels.

    Parameters
    ----------
    center : (voxel, 3) float
        Metres.
    label : (voxel,) int
        Provisional labels, 1 to 11; 0 is none.
    shape
        The body, measured at t = 0.
    previous : (11, 3) and (11, 3, 3) float
        Position and rotation of each segment in the world, in the frame before.
    settings
        Steps and bounds of the search.
    rate_hz
        Frames a second.
    stature_m
        The performer's height.

    Returns
    -------
    position : (11, 3) float64
        Joints in the world, metres.
    rotation : (11, 3, 3) float64
        Axes in the world, in columns.
    quality : (11,) float64
        Share of a segment's voxels inside its ellipsoid.

    Raises
    ------
    ValueError
        If rate or stature is not larger than 0, or labels and voxels do not fit.
    """
    if not (rate_hz > 0 and stature_m > 0):
        raise ValueError(f"rate {rate_hz} Hz and stature {stature_m} m must be larger than 0")
    if len(center) != len(label):
        raise ValueError(f"{len(label)} labels do not fit {len(center)} voxels; pass one for each")
    position, rotation = (np.array(part, np.float64) for part in previous)
    before = rotation.copy()
    quality = np.zeros(SEGMENT_COUNT)
    steps = np.array(
        [settings.first_step] * 3 + [settings.first_step / _TURN_FOR_STATURE * stature_m] * 3
    )
    bounds = np.array([settings.turn_speed] * 3 + [settings.head_speed * stature_m] * 3) / rate_hz
    tries = (settings.halvings, settings.rounds)
    for segment, parent in enumerate(PARENTS):
        free = 6 if parent < 0 else 3
        if parent >= 0:
            position[segment] = position[parent] + rotation[parent] @ shape.offset[segment]
            rotation[segment] = rotation[parent] @ (before[parent].T @ before[segment])
        voxels = np.ascontiguousarray((center[label == segment + 1] - position[segment]).T)
        scaled = shape.axes[segment] / np.sqrt(_RADII_SQUARED * shape.variance[segment])
        body = (rotation[segment], shape.centroid[segment], np.ascontiguousarray(scaled))
        change = np.zeros(6)
        inside = _search(voxels, body, change[:free], (steps[:free], bounds[:free]), tries)
        position[segment] += change[3:]
        rotation[segment] = rotation[segment] @ _turn(change)
        quality[segment] = inside / max(voxels.shape[1], 1)
    return position, rotation, quality


def join_poses(
    shape: BodyShape,
    frames: Sequence[tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]],
) -> PoseTrack:
    """Return the track of a take from its frames' poses, as of `fit_frame_as_paper`.

    Raises
    ------
    ValueError
        If there is no frame.
    """
    if not frames:
        raise ValueError("no frame was fitted; fit one or more")
    position, rotation, quality = (np.stack(part) for part in zip(*frames, strict=True))
    return PoseTrack(carry_joints(shape.joint, position, rotation), position, rotation, quality)


@njit(cache=True, nogil=True)
def _turn(change: Any) -> Any:
    """Return the rotation by three angles: about X, then the new Y, then the new Z."""
    a, b, c = np.cos(change[0]), np.cos(change[1]), np.cos(change[2])
    d, e, f = np.sin(change[0]), np.sin(change[1]), np.sin(change[2])
    return np.array(
        [
            [b * c, -b * f, e],
            [a * f + d * e * c, a * c - d * e * f, -d * b],
            [d * f - a * e * c, d * c + a * e * f, a * b],
        ]
    )


@njit(cache=True, nogil=True, fastmath=True)
def _count_inside(voxels: Any, body: Any, change: Any) -> Any:
    """Return how many voxels are inside the ellipsoid, by equations (3) and (4).

    The places of the voxels begin at the segment's joint.
    """
    rotation, centroid, scaled = body
    turned = rotation @ _turn(change)
    mean = turned @ centroid
    whiten = (turned @ scaled).T
    if len(change) == 6:
        mean = mean + change[3:]
    shift = whiten @ mean
    a, b, c = whiten[0], whiten[1], whiten[2]
    inside = 0
    for n in range(voxels.shape[1]):
        x, y, z = voxels[0, n], voxels[1, n], voxels[2, n]
        u = a[0] * x + a[1] * y + a[2] * z - shift[0]
        v = b[0] * x + b[1] * y + b[2] * z - shift[1]
        w = c[0] * x + c[1] * y + c[2] * z - shift[2]
        inside += u * u + v * v + w * w <= 1.0
    return inside


@njit(cache=True, nogil=True)
def _search(voxels: Any, body: Any, change: Any, limits: Any, tries: Any) -> Any:
    """Change parameters within bounds while more voxels come inside; return how many are inside."""
    steps, bounds = limits
    halvings, rounds = tries
    best = _count_inside(voxels, body, change)
    for halving in range(halvings + 1):
        share = 0.5**halving
        for _ in range(rounds):
            chosen, move = -1, 0.0
            for k in range(len(change)):
                own = change[k]
                for sign in (-1.0, 1.0):
                    change[k] = own + sign * share * steps[k]
                    if abs(change[k]) <= bounds[k]:
                        inside = _count_inside(voxels, body, change)
                        if inside > best:
                            best, chosen, move = inside, k, change[k]
                change[k] = own
            if chosen < 0:
                break
            change[chosen] = move
    return best
