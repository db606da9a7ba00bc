"""Find feet and knees of a performer whose arms are stretched, under trousers or a skirt.

The legs may stand in any pose. Feet are near the floor. A knee is where thigh and shank, of the
lengths that a body has, lie deepest inside the hull. Points are metres with y up.
"""

from bisect import bisect_left
from dataclasses import dataclass

import cc3d
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tasks.body.anatomy.proportions import (
    ANKLE_FROM_HEEL,
    ANKLE_HEIGHT,
    FOOT_HEIGHT,
    FOOT_LENGTH,
    SHANK_SHARE,
    SOLE_HEIGHT,
    THIGH_SHARE,
    TOE_OUT,
    Points,
    leg_share,
    unit,
)

KNEE_ASIDE = 0.03
"""How far a knee usually is beside the plane of hip, ankle and where it bends [statures]. Chosen by
eye on the shared captures; not measured."""

TURNED_OUT = 15.0
"""How far a foot is turned out from where the performer faces, usually [degrees]. 7 in walking
(Seber et al. 2000), 60 in a dancer's first positions."""

TURNED_OUT_SPREAD = 20.0
"""How much that usually differs [degrees]. Chosen by eye on the shared captures; not measured."""

INSIDE = 0.03
"""Depth in the hull from which a bone counts as inside [statures]. A shank's radius."""

SHIN_HEIGHTS = (0.20, 0.13, FOOT_HEIGHT, 0.035)
"""Heights above the floor below which two legs are looked for, one height after the other
[statures]. Shins are told apart more surely than feet, and a skirt hides shins; chosen by eye on
the shared captures, not measured."""

FEET_APART = 0.12
"""Width of what is near the floor from which two feet are in it [statures]. Chosen by eye on the
shared captures; not measured."""

SECOND_FOOT = 0.15
"""Voxels of the second piece from which it is a foot [share of the first piece]. Chosen by eye on
the shared captures; not measured."""

SOLE_LAYER = 0.03
"""Height of the layer of a foot that tells its direction [statures]. Chosen by eye on the shared
captures; not measured."""

LEAST_OBLONG = 1.5
"""How much more a sole must spread along its longer axis than across to tell the foot's direction
[ratio of variances]. Chosen by eye on the shared captures; not measured."""

LEAST_AHEAD = 0.35
"""Cosine of the largest angle between a foot and where the performer faces. 70 degrees, chosen by
eye on the shared captures, not measured."""

MOST_TOE = 0.65
"""How far before the middle of a sole a toe is at most [lengths of the foot]. Chosen by eye on the
shared captures; not measured."""

LENGTH_SPREAD = 0.012
"""How much the length of a thigh or shank usually differs from the usual one [statures]. Chosen by
eye on the shared captures; not measured."""

KNEE_GRIDS = ((0.24, 17), (0.03, 9))
"""How far around the best knee so far others are looked for [statures], and how many of them along
each direction. Coarse, then fine; chosen by eye on the shared captures, not measured."""

FIRST_PART = 0.1
"""Where on a thigh looking begins, from the hip, and a tenth nearer the knee on a shank [share of
the bone]. At the joints themselves hulls are thin; chosen by eye on the shared captures, not
measured."""

LACK_COST = 60.0
"""Cost of a leg that is nowhere in the hull. Chosen by eye on the shared captures; not measured."""

BACKWARD_COST = 100.0
"""Cost of a knee that bends backward [1 / stature]. Chosen by eye on the shared captures; not
measured."""


@dataclass(frozen=True, eq=False)
class Leg:
    """The joints of a leg, (3,) each."""

    hip: Points
    knee: Points
    ankle: Points
    heel: Points
    toe: Points
    cost: float
    """How badly the knee fits lengths and hull, and the foot its side; a usual leg costs 0.1 to
    3."""
    knee_cost: float
    """How badly the knee fits lengths and hull alone."""


@dataclass(frozen=True, eq=False)
class Depths:
    """How deep inside the hull each point of a box lies."""

    depth_m: NDArray[np.float32]
    """(x, y, z)"""
    origin_m: Points
    """(3,) center of the first voxel."""
    voxel_m: float

    def at(self, point: Points) -> Points:
        """Return (...,) the depth at points (..., 3), metres; 0 outside."""
        index = np.rint((point - self.origin_m) / self.voxel_m).astype(np.int64)
        inside = np.all((index >= 0) & (index < self.depth_m.shape), axis=-1)
        index = np.where(inside[..., None], index, 0)
        return np.where(inside, self.depth_m[tuple(np.moveaxis(index, -1, 0))], 0.0)


def measure_depths(crop: NDArray[np.uint8], origin_m: Points, voxel_m: float) -> Depths:
    """Return how deep inside the occupied voxels (x, y, z) of a padded box each voxel lies."""
    depth = np.asarray(ndimage.distance_transform_edt(crop), np.float32)
    return Depths(depth * np.float32(voxel_m), origin_m, voxel_m)


def find_feet(
    point: Points, left: Points, hips: Points, stature_m: float, voxel_m: float
) -> list[Points]:
    """Return the voxels (voxel, 3) of the two feet, against and along `left`.

    Feet are the lower ends of two shins, or what shows of two feet under a skirt. There is one foot
    where two cannot be told apart.
    """
    low = point[:, 1].min()
    for height in SHIN_HEIGHTS:
        near = point[point[:, 1] < low + height * stature_m]
        pieces = _two_pieces(near, voxel_m)
        if pieces is not None:
            pieces.sort(key=lambda piece: float(np.median((piece - hips) @ left)))
            tall = FOOT_HEIGHT * stature_m
            return [piece[piece[:, 1] < piece[:, 1].min() + tall] for piece in pieces]
    near = point[point[:, 1] < low + FOOT_HEIGHT * stature_m]
    aside = (near - hips) @ left
    if np.ptp(aside) < FEET_APART * stature_m:
        return [near]
    cut = (aside.min() + aside.max()) / 2.0
    return [near[aside < cut], near[aside >= cut]]


def find_fork(cells: NDArray[np.integer], point: Points, feet: list[Points]) -> float | None:
    """Return the height above the floor at which two legs meet, m; None where feet are not two.

    Below that height no voxel of the one leg shares a face with a voxel of the other.

    Parameters
    ----------
    cells : (voxel, 3) int
        Index of the person's voxels in the grid.
    point : (voxel, 3) float64
        Their centers.
    feet
        As `find_feet` returned them.
    """
    if len(feet) < 2:
        return None
    first = [np.linalg.norm(point - foot[0], axis=1).argmin() for foot in feet]
    height = cells[:, 1] - cells[:, 1].min()
    crop = np.zeros(np.ptp(cells, axis=0) + 1, np.uint8)
    own = tuple((cells - cells.min(axis=0)).T)

    def meet(top: int) -> bool:
        crop[own] = height <= top
        piece = np.asarray(cc3d.connected_components(crop, connectivity=6))[own]
        return bool(piece[first[0]] == piece[first[1]] != 0)

    levels = range(int(height[first].max()), int(height.max()) + 1)
    fork = bisect_left(levels, True, key=meet)
    if fork == len(levels):
        return None
    met = height == levels[fork]
    return float(point[met, 1][0] - point[:, 1].min())


def _two_pieces(point: Points, voxel_m: float) -> list[Points] | None:
    """Return the two largest connected pieces of points, or None where the second is too small."""
    index = np.rint((point - point.min(axis=0)) / voxel_m).astype(np.int64)
    crop = np.zeros(index.max(axis=0) + 1, np.uint8)
    crop[tuple(index.T)] = 1
    piece = np.asarray(cc3d.connected_components(crop, connectivity=26))[tuple(index.T)]
    sizes = np.bincount(piece)
    order = np.argsort(sizes)[::-1]
    if len(order) < 3 or sizes[order[1]] < SECOND_FOOT * sizes[order[0]]:
        return None
    return [point[piece == order[k]] for k in range(2)]


def measure_leg(
    foot: Points, hip: Points, front: Points, inward: Points, depths: Depths, stature_m: float
) -> Leg:
    """Return a leg from a foot's voxels (voxel, 3) and its hip joint.

    `front` is where the performer faces, `inward` where the other leg is: horizontal unit vectors.
    """
    toe, heel = _foot_ends(foot, front, stature_m)
    ankle = heel + ANKLE_FROM_HEEL * FOOT_LENGTH * stature_m * _level(toe - heel)
    ankle[1] = foot[:, 1].min() + ANKLE_HEIGHT * stature_m
    return bend_leg(hip, (ankle, heel, toe), front, inward, depths, stature_m)


def bend_leg(
    hip: Points, foot: tuple[Points, Points, Points], front: Points, inward: Points,
    depths: Depths, stature_m: float,
) -> Leg:  # fmt: skip
    """Return a leg from its hip joint and its ankle, heel and toe.

    `front` and `inward` are as for `measure_leg`.
    """
    ankle, heel, toe = foot
    along = _level(toe - heel)
    out = np.degrees(np.arctan2(-along @ inward, along @ front))
    bends = np.radians(out - TOE_OUT)
    ahead = np.cos(bends) * front - np.sin(bends) * inward
    knee, bent = _find_knee(hip, ankle, ahead, depths, stature_m)
    turned = ((out - TURNED_OUT) / TURNED_OUT_SPREAD) ** 2
    return Leg(hip, knee, ankle, heel, toe, float(bent + turned), bent)


def _level(way: Points) -> Points:
    """Return the horizontal direction of a way."""
    return unit(way * [1.0, 0.0, 1.0])


def _foot_ends(foot: Points, front: Points, stature_m: float) -> tuple[Points, Points]:
    """Return toe and heel: the ends of the sole's longer axis, a foot's usual length apart."""
    low = foot[:, 1].min()
    sole = foot[foot[:, 1] < low + SOLE_LAYER * stature_m]
    flat = sole[:, [0, 2]] - sole[:, [0, 2]].mean(axis=0)
    spread, axes = np.linalg.eigh(flat.T @ flat)
    axis = np.array([axes[0, 1], 0.0, axes[1, 1]])
    if spread[1] < LEAST_OBLONG * spread[0] or abs(axis @ front) < LEAST_AHEAD:
        axis = front
    axis = axis * np.sign(axis @ front)
    reach = sole @ axis
    middle = np.median(sole, axis=0)
    first, last = np.percentile(reach, [2, 98])
    length = FOOT_LENGTH * stature_m
    last = min(last, float(middle @ axis) + MOST_TOE * length)
    toe = middle + (last - middle @ axis) * axis
    heel = middle + (max(first, last - length) - middle @ axis) * axis
    toe[1] = heel[1] = low + SOLE_HEIGHT * stature_m
    return toe, heel


def _find_knee(
    hip: Points, ankle: Points, front: Points, depths: Depths, stature_m: float
) -> tuple[Points, float]:
    """Return where a knee lies deepest in the hull at about the right lengths, and the cost."""
    down = ankle - hip
    length = max(float(np.linalg.norm(down)), 1e-6)
    down = down / length
    ahead = front - (front @ down) * down
    ahead /= max(float(np.linalg.norm(ahead)), 1e-6)
    aside = np.cross(down, ahead)
    best = hip + THIGH_SHARE / (THIGH_SHARE + SHANK_SHARE) * length * down
    least, shorter = np.inf, leg_share(stature_m)
    part = np.linspace(FIRST_PART, 1.0, 10)[:, None, None]
    for reach, count in KNEE_GRIDS:
        steps = np.linspace(-reach, reach, count) * stature_m
        a, b, c = (x.ravel() for x in np.meshgrid(steps, steps, steps / 2.0, indexing="ij"))
        knee = best + a[:, None] * ahead + b[:, None] * aside + c[:, None] * down
        thigh, shank = np.linalg.norm(knee - hip, axis=1), np.linalg.norm(ankle - knee, axis=1)
        wrong = ((thigh / stature_m - shorter * THIGH_SHARE) / LENGTH_SPREAD) ** 2
        wrong += ((shank / stature_m - shorter * SHANK_SHARE) / LENGTH_SPREAD) ** 2
        lines = np.concatenate(
            [hip + part * (knee - hip), ankle + (part - FIRST_PART) * (knee - ankle)]
        )
        lack = np.clip(1.0 - depths.at(lines) / (INSIDE * stature_m), 0.0, None)
        backward = np.clip(-(knee - hip) @ ahead / stature_m, 0.0, None)
        off = ((knee - hip) @ aside / (KNEE_ASIDE * stature_m)) ** 2
        cost = wrong + LACK_COST * (lack**2).mean(axis=0) + BACKWARD_COST * backward + off
        best, least = knee[int(np.argmin(cost))], float(cost.min())
    return best, least
