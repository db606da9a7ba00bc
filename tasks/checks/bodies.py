"""Whether what silhouettes carve can be one performer: large enough, not two, and nothing held."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.checks.hulls.bounds import parts_of
from tasks.checks.telling import By
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection
from tasks.geometry.voxels import VoxelGrid, decode_runs, encode_runs, take_frame
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tasks.reconstruction.regions.held import find_held
from tasks.reconstruction.still_things import describe_still_things, find_still_things

_LEAST_M3 = 0.006
"""How large the hull of a performer is at least [m³]. The smallest of nine rendered ones, of a
child of 1.15 m, has 0.025, and a hull is larger than the body; chosen, not measured."""
_SECOND = 0.35
"""How large a second body is at least [share of the first]. A child beside an adult is more, a
chair or a large fan mostly less; chosen, not measured."""
_BODY_M = 0.6
"""How high a body is at least [m]. Somebody who sits on the floor; chosen, not measured."""
_MOVES = 2.0
"""How many times as many voxels as in one frame who moves fills in all of them [times]. Of two who
both stand still none is a thing."""
_STAYS_IN = 6
"""In how many frames at least it is asked what stays in its place [frames]. Eight are looked at."""
_OF_FRAMES = 0.5
"""In how many of the frames looked at two are seen where there are two [share]."""
_HELD_IN = 2
"""In how many frames at least something is surely held, where it is [frames]. In one of eight it
may be a sleeve that is seen badly; a digitization asks for three of sixteen."""
_SEVERAL = 2
"""In how many frames two are seen where another goes by [frames]. In one they may be two halves."""


def judge_bodies(
    hulls: Sequence[NDArray[np.float64]], voxel_m: float, by: By
) -> tuple[list[str], list[str]]:
    """Return what says that hulls are not those of one performer: faults, and what is to be known.

    Parameters
    ----------
    hulls : sequence of (voxel, 3) float64
        Centers of the voxels in the volume, a frame each, m.
    voxel_m
        Edge of a voxel.
    by
        What told the performer from the stage.
    """
    seen = [hull for hull in hulls if len(hull)]
    if not seen:
        return [], []
    faults, notes = [], []
    size_m3 = float(np.median([len(hull) for hull in seen])) * voxel_m**3
    if size_m3 < _LEAST_M3:
        why = {
            "background": "the performer stands in the backgrounds, or has their colors",
            "film": "the performer stays in one place, and is taken for the stage; bring a "
            "picture of the empty stage, or masks",
            "key": "most of the performer has the color of the screen",
            "mask": "the masks lack most of the performer",
        }[by]  # fmt: skip
        faults.append(
            f"what the silhouettes carve is {1000 * size_m3:.1f} liters in the median of the "
            f"frames, and no body is below {1000 * _LEAST_M3:.0f}: {why}, or the unit of the "
            "calibration is another"
        )
    seen, still = _without_still_things(seen, voxel_m)
    notes += still
    apart = [two for hull in seen if (two := _two_bodies(hull, voxel_m)) is not None]
    often = len(apart) >= max(_OF_FRAMES * len(seen), 1)
    if often or len(apart) >= _SEVERAL:
        said = (
            f"two bodies are seen in {len(apart)} of {len(seen)} frames, "
            f"{np.median(apart):.1f} m apart"
        )
        if by == "mask" and often:
            faults.append(f"{said}: the masks are of two people; make masks of one performer")
        else:
            notes.append(
                f"{said[0].upper()}{said[1:]}: one of them is not the performer. Where they are "
                "apart in all frames, the one nearer to the middle of the volume, or with the "
                "joints of initial.json, is taken, and the other gets the label 0; where they "
                "touch, the pose may be of both: make the volume smaller, or bring masks of one."
            )
    return faults, notes


def held_notes(
    silhouettes: NDArray[np.bool_], projection: Projection, grid: VoxelGrid
) -> tuple[str, ...]:
    """Say whether something is held that a body's hull shows apart.

    Parameters
    ----------
    silhouettes : (time, camera, row, column) bool
        Of some frames all over the take.
    projection
        The cameras.
    grid
        Of the capture's volume.
    """

    def is_clear(each: NDArray[np.bool_]) -> bool:
        hull = carve_visual_hull(each, projection, grid, CarvingSettings())
        return len(hull.start) > 0 and find_held(hull, grid).is_clear

    often = sum(side_by_side(is_clear, list(silhouettes)))
    if often < _HELD_IN:
        return ()
    return (
        f"Something is held that is no part of a body, long and thin, or flat: it is seen in "
        f"{often} of {len(silhouettes)} frames. It is left out of the pose, and gets the label 0.",
    )


def _without_still_things(
    hulls: Sequence[NDArray[np.float64]], voxel_m: float
) -> tuple[Sequence[NDArray[np.float64]], tuple[str, ...]]:
    """Return hulls without what stands still beside one who moves, and a sentence on it."""
    if len(hulls) < _STAYS_IN:
        return hulls, ()
    low = np.min([hull.min(axis=0) for hull in hulls], axis=0)
    index = [np.rint((hull - low) / voxel_m).astype(int) for hull in hulls]
    sides = (np.max([own.max(axis=0) for own in index], axis=0) + 1).tolist()
    grid = VoxelGrid((low[0], low[1], low[2]), voxel_m, (sides[0], sides[1], sides[2]))
    occupied = np.zeros((len(hulls), *sides), np.bool_)
    for n, own in enumerate(index):
        occupied[n][tuple(own.T)] = True
    runs = encode_runs(occupied)
    things = find_still_things([take_frame(runs, n) for n in range(len(hulls))], grid)
    left_out = decode_runs(things, 0)
    rest = occupied & ~left_out
    if not left_out.any() or rest.any(axis=0).sum() < _MOVES * rest.sum() / len(rest):
        return hulls, ()
    left = [hull[~left_out[tuple(own.T)]] for hull, own in zip(hulls, index, strict=True)]
    return [hull for hull in left if len(hull)], describe_still_things(things, grid)


def _two_bodies(hull: NDArray[np.float64], voxel_m: float) -> float | None:
    """Return how far the middles of two bodies are apart; None where there is one."""
    part = parts_of(hull, voxel_m)
    size = np.bincount(part)
    order = np.argsort(size)[::-1][:2]
    if len(order) < 2 or size[order[1]] < _SECOND * size[order[0]]:
        return None
    bodies = [hull[part == n] for n in order]
    if min(float(np.ptp(body[:, 1])) for body in bodies) < _BODY_M:
        return None
    return float(np.linalg.norm(bodies[0].mean(axis=0) - bodies[1].mean(axis=0)))
