"""Which cameras' silhouettes contradict those of the others.

The cameras to blame are the fewest without which the others explain each other (leave-one-out
consensus over visual hulls; the idea of RANSAC, Fischler and Bolles 1981, with all small subsets
tried). Whether two films were exchanged is found by exchanging them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tasks.checks.bounds import grid_corners
from tasks.checks.votes import Scene, Votes, collect_votes, compare_hull, hull_of, make_scene
from tasks.geometry.projection import Projection, camera_centers
from tasks.geometry.voxels import VoxelGrid

_MOST_TRIALS = 10  # exchanges of films, all of those of five cameras; 0.2 s each


@dataclass(frozen=True)
class Witnesses:
    """Cameras, their silhouettes in some frames, and their votes on all that they see together."""

    scene: Scene
    votes: list[Votes]
    """A frame each."""
    usable: tuple[int, ...]
    """The cameras whose silhouettes can be of a performer."""
    min_cameras: int
    """Fewer silhouettes make no hull."""

    def hull(self, votes: Votes, cameras: Sequence[int]) -> NDArray[np.bool_]:
        """Return which points of a frame's votes are in the hull of some cameras."""
        return hull_of(votes, cameras, self.min_cameras)


def hear_witnesses(
    silhouettes: NDArray[np.bool_],
    projection: Projection,
    grid: VoxelGrid,
    usable: tuple[int, ...],
    min_cameras: int,
) -> Witnesses:
    """Return the votes of all that the cameras see together, far beyond the volume.

    Parameters
    ----------
    silhouettes : (time, camera, row, column) bool
        Of some frames.
    projection
        The cameras, in the same order.
    grid
        The volume.
    usable, min_cameras
        As of `Witnesses`.
    """
    low, high = grid_corners(grid)
    centers = camera_centers(projection)
    least, most = np.minimum(low, centers.min(axis=0)), np.maximum(high, centers.max(axis=0))
    half = np.maximum(most - least, (most - least).max() / 2) / 2
    scene = make_scene(silhouettes, projection, tuple((low + high) / 2), usable)
    middle = (least + most) / 2
    votes = collect_votes(scene, middle - half, middle + half, min_cameras=min_cameras)
    return Witnesses(scene, votes, usable, min_cameras)


def share_explained(witnesses: Witnesses, cameras: Sequence[int], camera: int) -> float:
    """Return the share of a camera's silhouettes that the hull of some cameras covers."""
    scene, votes = witnesses.scene, witnesses.votes
    return compare_hull(scene, votes, cameras, camera, witnesses.min_cameras)[0]


def share_overlapped(witnesses: Witnesses, camera: int) -> float:
    """Return intersection over union of a camera's silhouettes and the hull of the others."""
    others = [c for c in witnesses.usable if c != camera]
    scene, votes = witnesses.scene, witnesses.votes
    return compare_hull(scene, votes, others, camera, witnesses.min_cameras)[1]


def least_explained(witnesses: Witnesses, cameras: Sequence[int]) -> float:
    """Return the share of the silhouette that the hull of some cameras covers worst of theirs."""
    return min(share_explained(witnesses, cameras, c) for c in cameras)


def find_to_blame(
    witnesses: Witnesses, worst: float, consistent: float, guilt: float
) -> tuple[int, ...]:
    """Return the fewest cameras without which the others explain each other; none if no such.

    Parameters
    ----------
    witnesses
        All of them.
    worst
        What the hull of all explains of one silhouette at least.
    consistent, guilt
        As of `tasks.checks.agreement.AgreementSettings`.
    """
    for count in (1, 2):
        found = []
        for blamed in combinations(witnesses.usable, count):
            others = [c for c in witnesses.usable if c not in blamed]
            if len(others) >= witnesses.min_cameras:
                found.append((least_explained(witnesses, others), blamed, others))
        best, blamed, others = max(found, default=(0.0, (), ()))
        own = np.mean([share_explained(witnesses, others, c) for c in blamed] or [1.0])
        # leaving out a camera always helps a little; who is to blame caused most of the loss
        caused = 1 - best <= 0.5 * (1 - worst) and 1 - own >= guilt * (1 - best)
        if best >= consistent and caused:
            return blamed
    return ()


def find_exchanged(
    witnesses: Witnesses, grid: VoxelGrid, blamed: tuple[int, ...], worst: float, consistent: float
) -> tuple[int, ...]:
    """Return the pair of cameras whose films, exchanged, let all cameras agree; none if no such.

    Parameters
    ----------
    blamed
        The two that are to blame, or none where every pair may be.
    grid
        The volume.
    witnesses, worst, consistent
        As of `find_to_blame`.
    """
    scene = witnesses.scene
    size = scene.projection.image_size
    pairs = [blamed] if blamed else _suspects(witnesses)[:_MOST_TRIALS]
    for one, other in pairs:
        if (size[one] != size[other]).any():
            continue
        order = np.arange(len(size))
        order[[one, other]] = other, one
        trial = hear_witnesses(
            scene.silhouettes[:, order],
            scene.projection,
            grid,
            witnesses.usable,
            witnesses.min_cameras,
        )
        least = least_explained(trial, witnesses.usable)
        if least >= consistent and 1 - least <= 0.5 * (1 - worst):
            return one, other
    return ()


def _suspects(witnesses: Witnesses) -> list[tuple[int, ...]]:
    """Return the pairs of cameras, the ones without which the others agree best first."""
    pairs = list(combinations(witnesses.usable, 2))
    rests = [[c for c in witnesses.usable if c not in pair] for pair in pairs]
    best = [least_explained(witnesses, rest) for rest in rests]
    return [pairs[n] for n in np.argsort(best)[::-1]]
