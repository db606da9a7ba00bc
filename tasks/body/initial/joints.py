"""Put the joints of a body together from its arms, trunk and legs."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tasks.body.anatomy.proportions import (
    ANKLE_HEIGHT,
    FOOT_HEIGHT,
    FOREARM_SHARE,
    HIP_SHARE,
    SHOULDER_SHARE,
    UPPER_ARM_SHARE,
    Points,
    unit,
)
from tasks.body.initial.arms import Arms, lengthen_arms, missing_reach
from tasks.body.initial.facing import vote_facing
from tasks.body.initial.legs import (
    Depths,
    Leg,
    bend_leg,
    find_feet,
    find_fork,
    measure_depths,
    measure_leg,
)
from tasks.body.initial.raised import find_raised_foot, standing_part
from tasks.body.initial.trunk import Trunk, lift_hips, measure_trunk
from tasks.geometry.voxels import VoxelGrid, voxel_centers

_CHAINS = (
    ("Waist", "Neck", "Head"),
    *(tuple(s + n for n in ("Shoulder", "Elbow", "Wrist", "Fin")) for s in "RL"),
    *(tuple(s + n for n in ("Hip", "Knee", "Ankle")) for s in "RL"),
)
"""The joints that bones join, chain after chain."""

CROSSED = 6.0
"""How much worse legs must fit that stand as their feet do to be crossed, in the cost of a `Leg`.
Chosen by eye on the shared captures; not measured."""

RAISED_CROSSED = 1.0
"""As `CROSSED`, where a foot is raised, of the knees alone: who crosses the legs turns the foot in.
Of four such bodies the two that crossed their legs fitted 1.9 and 5.5 worse not crossed, the others
0.1 and 2.7 worse crossed, or better."""

LEAST_VOTE = 0.2
"""Vote for a facing below which it is doubtful. Chosen by eye on the shared captures; not
measured."""

USUAL_INSIDE = 0.9
"""How much of the bones usually lies inside the hull [share of their lengths]. 0.94 to 1 where arms
are stretched (see `InitialModelSettings.least_inside`)."""


def find_joints(
    cells: NDArray[np.integer],
    arms: Arms,
    grid: VoxelGrid,
    colored: tuple[Points, NDArray[np.uint8]] | None,
    stature_m: float | None,
) -> tuple[dict[str, Points], float, list[str]]:
    """Return a person's joints, how sure they are, and notes.

    Parameters
    ----------
    cells : (voxel, 3) int
        Index of the person's voxels in the grid.
    arms
        As measured on them, facing either way.
    grid
        What was carved.
    colored : ((surface voxel, 3), (surface voxel, 3))
        Centers in metres and RGB of the surface, or None.
    stature_m
        The person's height where known.

    Returns
    -------
    joints : dict of (3,) float64
        Metres, by the names of the archive, all 21.
    sure : float
        0 to 1: how clear the facing is and how much of the bones lies inside the hull.
    notes : list of str
        A sentence each.
    """
    notes = [
        "Wrists, waist and hips were placed by the proportions of a body, hips by where the legs "
        "meet, too, where that shows."
    ]
    point = voxel_centers(grid, cells)
    longer = missing_reach(point, arms)
    if longer > 1.0:
        arms = lengthen_arms(arms, arms.half_span_m * longer)
        notes.append("The hull has lost the hands: elbows to finger tips are a guess.")
    trunk = measure_trunk(point, arms, grid.voxel_m, stature_m)
    feet = find_feet(point, arms.left, trunk.hips, trunk.stature_m, grid.voxel_m)
    is_raised = False
    if len(feet) < 2 and colored is not None:
        feet = _with_raised(feet[0], point, colored, arms, trunk, grid.voxel_m)
        is_raised = len(feet) == 2
    trunk = lift_hips(trunk, find_fork(cells, point, feet))
    vote, told_by = vote_facing(point, arms, trunk, feet, *(colored or (None, None)))
    if vote < 0:
        arms, feet = arms.turned(), feet[::-1]
    if told_by:
        notes.append(f"Which way the performer faces was told by {' and '.join(told_by)}.")
    if abs(vote) < LEAST_VOTE:
        notes.append("Which way the performer faces is doubtful: check right and left.")
    if len(feet) < 2:
        notes.append("The feet could not be told apart: the legs are a guess.")
        feet = [feet[0], feet[0]]
    joints = _place_arms(arms, trunk)
    depths = _depths_of(cells, grid)
    joints |= _place_legs(feet, arms, trunk, depths, is_raised=is_raised)
    raised = abs(float(joints["RHeel"][1] - joints["LHeel"][1]))
    if raised > ANKLE_HEIGHT * trunk.stature_m:
        notes.append(
            f"One foot is {raised:.2f} m above the other: look at the picture whether the leg is "
            "lifted or the hull has lost its end."
        )
    inside = _share_inside(joints, depths)
    if inside < USUAL_INSIDE:
        notes.append(f"Only {inside:.0%} of the bones lie inside the hull: look at the picture.")
    sure = min(1.0, 2.0 * abs(vote)) * inside**2
    return joints, sure, notes


def exchange_feet(
    joints: Mapping[str, Points], cells: NDArray[np.integer], grid: VoxelGrid, stature_m: float
) -> tuple[dict[str, Points], float]:
    """Return a person's joints with the feet exchanged, and how much worse the legs fit then.

    Beside what the knees say, legs that are crossed then are as unlikely as where they are measured
    first, the more so the farther the feet are to their sides.

    Parameters
    ----------
    joints : mapping of (3,) float64
        Metres, by the names of the archive, those of the legs complete.
    cells : (voxel, 3) int
        Index of the person's voxels in the grid.
    grid
        What was carved.
    stature_m
        The person's height.
    """
    depths = _depths_of(cells, grid)
    left = unit((joints["LHip"] - joints["RHip"]) * [1.0, 0.0, 1.0])
    front = np.cross(left, [0.0, 1.0, 0.0])

    def bend(side: str, foot: str, inward: Points) -> Leg:
        ends = joints[foot + "Ankle"], joints[foot + "Heel"], joints[foot + "Foot"]
        return bend_leg(joints[side + "Hip"], ends, front, inward, depths, stature_m)

    kept = bend("R", "R", left).knee_cost + bend("L", "L", -left).knee_cost
    legs = [bend("R", "L", left), bend("L", "R", -left)]
    apart = joints["LAnkle"] - joints["RAnkle"]
    stand = abs(apart[1]) < FOOT_HEIGHT * stature_m
    aside = np.clip(float(apart @ left) / (2 * HIP_SHARE * stature_m), -1.0, 1.0)
    worse = sum(leg.knee_cost for leg in legs) - kept
    worse += (CROSSED if stand else RAISED_CROSSED) * aside
    return dict(joints) | _joints_of(legs), float(worse)


def _with_raised(
    foot: Points, point: Points, colored: tuple[Points, NDArray[np.uint8]], arms: Arms,
    trunk: Trunk, voxel_m: float,
) -> list[Points]:  # fmt: skip
    """Return a foot, and another one off the floor if there is one, against and along `left`."""
    stands = standing_part(foot, voxel_m)
    other = find_raised_foot(point, stands, colored, trunk.stature_m, voxel_m)
    feet = [foot] if other is None else [stands, other]
    return sorted(feet, key=lambda each: float(np.median(each @ arms.left)))


def _place_legs(
    feet: list[Points], arms: Arms, trunk: Trunk, depths: Depths, *, is_raised: bool
) -> dict[str, Points]:
    """Return the joints of the legs, with the feet exchanged where that fits much better."""
    hips = [
        trunk.hips + (2 * side - 1) * HIP_SHARE * trunk.stature_m * arms.left for side in range(2)
    ]

    def measure(feet: list[Points]) -> list[Leg]:
        return [
            measure_leg(foot, hip, arms.front, inward, depths, trunk.stature_m)
            for foot, hip, inward in zip(feet, hips, (arms.left, -arms.left), strict=True)
        ]

    ways = [measure(feet), measure(feet[::-1])]
    cost = [sum(leg.knee_cost if is_raised else leg.cost for leg in legs) for legs in ways]
    crossed = RAISED_CROSSED if is_raised else CROSSED
    return _joints_of(ways[0] if cost[0] <= cost[1] + crossed else ways[1])


def _joints_of(legs: Sequence[Leg]) -> dict[str, Points]:
    """Return the joints of the right and the left leg by name."""
    joints = {}
    for name, leg in zip("RL", legs, strict=True):
        joints |= {f"{name}Hip": leg.hip, f"{name}Knee": leg.knee, f"{name}Ankle": leg.ankle}
        joints |= {f"{name}Heel": leg.heel, f"{name}Foot": leg.toe}
    return joints


def _depths_of(cells: NDArray[np.integer], grid: VoxelGrid) -> Depths:
    """Return how deep inside a person's voxels (voxel, 3) each voxel of a box around them lies."""
    begin = cells.min(axis=0) - 1
    crop = np.zeros(cells.max(axis=0) - begin + 2, np.uint8)
    crop[tuple((cells - begin).T)] = 1
    return measure_depths(crop, voxel_centers(grid, begin), grid.voxel_m)


def _share_inside(joints: Mapping[str, Points], depths: Depths) -> float:
    """Return the share of the bones' lengths that lies inside the hull."""
    return float((depths.at(_along_bones(joints)) > 0).mean())


def bones_inside(joints: Mapping[str, Points], point: Points, voxel_m: float) -> float:
    """Return the share of the bones' lengths that is no farther than a voxel from a point."""
    return float((KDTree(point).query(_along_bones(joints))[0] <= voxel_m).mean())


def _along_bones(joints: Mapping[str, Points]) -> Points:
    """Return points (point, 3), twelve evenly along each bone."""
    part = np.linspace(0.0, 1.0, 12)[:, None]
    pairs = [pair for chain in _CHAINS for pair in pairwise(chain)]
    return np.concatenate([joints[a] + part * (joints[b] - joints[a]) for a, b in pairs])


def _place_arms(arms: Arms, trunk: Trunk) -> dict[str, Points]:
    """Return the joints of head, spine and arms."""
    joints = {"Head": trunk.head, "Neck": trunk.neck, "Waist": trunk.waist}
    arm = 1.0 - SHOULDER_SHARE
    elbow = SHOULDER_SHARE + UPPER_ARM_SHARE * arm
    for side, name in enumerate("RL"):
        joints[f"{name}Shoulder"] = arms.along(side, SHOULDER_SHARE)
        joints[f"{name}Elbow"] = arms.along(side, elbow)
        joints[f"{name}Wrist"] = arms.along(side, elbow + FOREARM_SHARE * arm)
        joints[f"{name}Fin"] = arms.tip[side]
    return joints
