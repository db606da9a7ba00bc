"""Which cameras' silhouettes are inconsistent with those of the others.

The inconsistent cameras are the fewest without which the others explain each other (leave-one-out
consensus over visual hulls; the idea of RANSAC, Fischler and Bolles 1981, with all small subsets
tried). Whether two films were exchanged is found by exchanging them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tasks.checks.hulls.bounds import grid_corners
from tasks.checks.hulls.voxel_consistency import (
    Scene,
    VoxelConsistency,
    compare_hull,
    hull_of,
    make_scene,
    measure_voxel_consistency,
)
from tasks.geometry.projection import Projection, camera_centers
from tasks.geometry.voxels import VoxelGrid

_MOST_TRIALS = 10
"""How many exchanges of films are tried. All of those of five cameras; each takes 0.2 s."""
_MOST_INCONSISTENT = 2
"""How many cameras may be inconsistent together. Two are what exchanged films make."""
_MOST_OF_LOSS = 0.5
"""How much of what was unexplained may be left once the cause is taken away [share]. Leaving out
any camera helps a little, so most of the loss must go with it; chosen, not measured."""


@dataclass(frozen=True)
class Consistency:
    """Which cameras film each voxel inside their silhouettes, in some frames."""

    scene: Scene
    voxels: list[VoxelConsistency]
    """Of each frame."""
    usable: tuple[int, ...]
    """The cameras whose silhouettes can be of a performer."""
    min_cameras: int
    """Fewer silhouettes make no hull."""

    def hull(self, voxels: VoxelConsistency, cameras: Sequence[int]) -> NDArray[np.bool_]:
        """Return which voxels of a frame are in the hull of some cameras."""
        return hull_of(voxels, cameras, self.min_cameras)


def measure_consistency(
    silhouettes: NDArray[np.bool_],
    projection: Projection,
    grid: VoxelGrid,
    usable: tuple[int, ...],
    min_cameras: int,
) -> Consistency:
    """Return which cameras film what inside their silhouettes, far beyond the volume.

    Parameters
    ----------
    silhouettes : (time, camera, row, column) bool
        Of some frames.
    projection
        The cameras, in the same order.
    grid
        The volume.
    usable, min_cameras
        As of `Consistency`.
    """
    low, high = grid_corners(grid)
    centers = camera_centers(projection)
    least, most = np.minimum(low, centers.min(axis=0)), np.maximum(high, centers.max(axis=0))
    half = np.maximum(most - least, (most - least).max() / 2) / 2
    scene = make_scene(silhouettes, projection, tuple((low + high) / 2), usable)
    middle = (least + most) / 2
    voxels = measure_voxel_consistency(scene, middle - half, middle + half, min_cameras=min_cameras)
    return Consistency(scene, voxels, usable, min_cameras)


def share_explained(consistency: Consistency, cameras: Sequence[int], camera: int) -> float:
    """Return the share of a camera's silhouettes that the hull of some cameras covers."""
    scene, voxels = consistency.scene, consistency.voxels
    return compare_hull(scene, voxels, cameras, camera, consistency.min_cameras)[0]


def share_overlapped(consistency: Consistency, camera: int) -> float:
    """Return intersection over union of a camera's silhouettes and the hull of the others."""
    others = [c for c in consistency.usable if c != camera]
    scene, voxels = consistency.scene, consistency.voxels
    return compare_hull(scene, voxels, others, camera, consistency.min_cameras)[1]


def least_explained(consistency: Consistency, cameras: Sequence[int]) -> float:
    """Return the share of the silhouette that the hull of some cameras covers worst of theirs."""
    return min(share_explained(consistency, cameras, c) for c in cameras)


def find_inconsistent_cameras(
    consistency: Consistency, worst: float, consistent: float, unexplained_ratio: float
) -> tuple[int, ...]:
    """Return the fewest cameras without which the others explain each other; none if no such.

    Parameters
    ----------
    consistency
        Of all cameras.
    worst
        What the hull of all explains of one silhouette at least.
    consistent, unexplained_ratio
        As of `tasks.checks.agreement.AgreementSettings`.
    """
    for count in range(1, _MOST_INCONSISTENT + 1):
        found = []
        for inconsistent in combinations(consistency.usable, count):
            others = [c for c in consistency.usable if c not in inconsistent]
            if len(others) >= consistency.min_cameras:
                found.append((least_explained(consistency, others), inconsistent, others))
        best, inconsistent, others = max(found, default=(0.0, (), ()))
        own = np.mean([share_explained(consistency, others, c) for c in inconsistent] or [1.0])
        # leaving out a camera always helps a little; the inconsistent caused most of the loss
        caused = 1 - best <= _MOST_OF_LOSS * (1 - worst) and 1 - own >= unexplained_ratio * (
            1 - best
        )
        if best >= consistent and caused:
            return inconsistent
    return ()


def find_exchanged(
    consistency: Consistency,
    grid: VoxelGrid,
    inconsistent: tuple[int, ...],
    worst: float,
    consistent: float,
) -> tuple[int, ...]:
    """Return the pair of cameras whose films, exchanged, let all cameras agree; none if no such.

    Parameters
    ----------
    inconsistent
        The two that were found to be, or none where every pair may be.
    grid
        The volume.
    consistency, worst, consistent
        As of `find_inconsistent_cameras`.
    """
    scene = consistency.scene
    size = scene.projection.image_size
    pairs = [inconsistent] if inconsistent else _likely_pairs(consistency)[:_MOST_TRIALS]
    for one, other in pairs:
        if (size[one] != size[other]).any():
            continue
        order = np.arange(len(size))
        order[[one, other]] = other, one
        trial = measure_consistency(
            scene.silhouettes[:, order],
            scene.projection,
            grid,
            consistency.usable,
            consistency.min_cameras,
        )
        least = least_explained(trial, consistency.usable)
        if least >= consistent and 1 - least <= _MOST_OF_LOSS * (1 - worst):
            return one, other
    return ()


def _likely_pairs(consistency: Consistency) -> list[tuple[int, ...]]:
    """Return the pairs of cameras, the ones without which the others agree best first."""
    pairs = list(combinations(consistency.usable, 2))
    rests = [[c for c in consistency.usable if c not in pair] for pair in pairs]
    best = [least_explained(consistency, rest) for rest in rests]
    return [pairs[n] for n in np.argsort(best)[::-1]]
