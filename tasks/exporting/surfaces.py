"""A closed surface around occupied voxels, by marching tetrahedra.

Eight neighboring voxel centers are the corners of a cell, and each cell is cut into the six
tetrahedra along its diagonal (Kuhn 1960), whose faces meet those of the next cell. Within a
tetrahedron the surface is a triangle or a quadrilateral between the middles of the edges from
an occupied to an empty corner (Doi and Koide 1991). Unlike the outsides of cubes, and unlike
marching cubes, this is a manifold whatever the voxels are, also where two of them touch only at
an edge or a corner. The stairs are then smoothed by Taubin's filter (1995), which moves vertices
without shrinking what they enclose, and never changes which of them are joined.
"""

import itertools
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.spatial import KDTree

from tasks.engine.settings import CountOrNone, Positive, Share, check_ranges


@dataclass(frozen=True)
class SurfaceSettings:
    """How the stairs of the voxels are smoothed."""

    smoothing_steps: CountOrNone = 30
    """Pairs of a shrinking and a growing step; 0 leaves every vertex midway between voxels. With 30
    the normals of a sphere of 10 voxels are 15 degrees off instead of 38, its volume 0.1 %."""
    shrinking: Share = 0.5
    """How far a vertex moves to the middle of its neighbors in a shrinking step. Chosen, not
    measured."""
    growing: Positive = 0.51
    """How far it moves away from them in a growing step [share of the way]. A little more than
    shrinking (Taubin 1995, section 4)."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


def closed_surface(
    index: NDArray[np.integer],
    origin_m: ArrayLike,
    voxel_m: float,
    *,
    settings: SurfaceSettings = SurfaceSettings(),
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the closed surface of occupied voxels.

    Before smoothing, a flat side lies where the voxels end, and edges and corners are beveled.
    Voxels that touch only at an edge or a corner are joined or kept apart, by which way their
    diagonal runs.

    Parameters
    ----------
    index : (voxel, 3) int
        Of the occupied voxels, in any order.
    origin_m : (3,) float
        Center of voxel (0, 0, 0).
    voxel_m : float
        Edge of a voxel.

    Returns
    -------
    vertex : (vertex, 3) float64
        Metres.
    face : (face, 3) int32
        Vertices of each triangle, counterclockwise seen from outside. Every edge is in exactly
        two triangles, once in each direction. Without voxels there are no triangles.

    Raises
    ------
    ValueError
        If the index is not one of voxels, or the voxel has no size.
    """
    index = np.asarray(index)
    if index.ndim != 2 or index.shape[1] != 3 or not np.issubdtype(index.dtype, np.integer):
        raise ValueError(
            f"voxels of shape {index.shape} and type {index.dtype} have no surface; "
            "pass their (voxel, 3) integer index"
        )
    if not (np.isfinite(voxel_m) and voxel_m > 0):
        raise ValueError(f"voxel_m {voxel_m} must be larger than 0 m")
    if not len(index):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    begin = index.min(axis=0).astype(np.int64) - 1
    occupied = np.zeros(index.max(axis=0) - begin + 2, np.uint8)
    occupied[tuple((index - begin).T)] = 1
    vertex, face = _march(occupied)
    vertex = _smooth(vertex, face, settings)
    return np.asarray(origin_m, np.float64) + (vertex + begin) * voxel_m, face


def nearest_colors(
    vertex: NDArray[np.floating], center: NDArray[np.floating], color: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Return the color of the voxel nearest to each vertex.

    Parameters
    ----------
    vertex : (vertex, 3) float
        Metres.
    center : (voxel, 3) float
        Of the colored voxels, metres.
    color : (voxel, 3) uint8
        RGB.

    Returns
    -------
    (vertex, 3) uint8
        RGB.

    Raises
    ------
    ValueError
        If there are vertices and no colored voxel.
    """
    if not len(vertex):
        return np.zeros((0, 3), np.uint8)
    if not len(center):
        raise ValueError("there is no colored voxel to color the surface from; color them first")
    _, nearest = KDTree(center).query(vertex)
    return color[nearest]


def _march(occupied: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices (in voxels) and triangles around what is occupied in a padded box."""
    nx, ny, nz = np.array(occupied.shape) - 1
    code = np.zeros((nx, ny, nz), np.uint8)
    for corner, (x, y, z) in enumerate(_CORNERS):
        code |= occupied[x : x + nx, y : y + ny, z : z + nz] << np.uint8(corner)
    cell = np.argwhere((code > 0) & (code < 255))
    edges = _triangles_of_cells()[code[tuple(cell.T)]]
    which, triangle = np.nonzero(edges[:, :, 0] >= 0)
    edge = edges[which, triangle].astype(np.int64)
    lower = cell[which][:, None] + _CORNERS[edge // 8]
    number = np.ravel_multi_index(tuple(np.moveaxis(lower, -1, 0)), occupied.shape)
    names, face = np.unique(number * 8 + edge % 8, return_inverse=True)
    place = np.stack(np.unravel_index(names // 8, occupied.shape), axis=1)
    return place + 0.5 * _CORNERS[names % 8], face.reshape(-1, 3).astype(np.int32)


def _smooth(
    vertex: NDArray[np.float64], face: NDArray[np.int32], settings: SurfaceSettings
) -> NDArray[np.float64]:
    """Return vertices moved toward, then away from, the mean of their neighbors, in turn."""
    start, end = face.ravel(), np.roll(face, -1, axis=1).ravel()
    joined = coo_array((np.ones(len(start)), (start, end)), shape=(len(vertex),) * 2).tocsr()
    neighbors = joined.sum(axis=1)[:, None]
    for _ in range(settings.smoothing_steps):
        for share in (settings.shrinking, -settings.growing):
            vertex = vertex + share * (joined @ vertex / neighbors - vertex)
    return vertex


_CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])


@cache
def _triangles_of_cells() -> NDArray[np.int8]:
    """Return (256, 12, 3) for each set of occupied corners the edges that triangles join.

    An edge is 8 times its lower corner, plus its direction as a corner; -1: no triangle. Edges
    run from a corner to one that is nowhere lower, so the lower one is what both share.
    """
    table = np.full((256, 12, 3), -1, np.int8)
    for code in range(256):
        triangles = []
        for first, second, _ in itertools.permutations((1, 2, 4)):
            tetrahedron = (0, first, first | second, 7)
            inside = [corner for corner in tetrahedron if code >> corner & 1]
            outside = [corner for corner in tetrahedron if not code >> corner & 1]
            ring = [(a, b) for a in inside for b in outside]
            if not ring:
                continue
            if len(ring) == 4:
                ring[2], ring[3] = ring[3], ring[2]
            p, q, r = (_CORNERS[a] + _CORNERS[b] for a, b in ring[:3])
            outward = _CORNERS[outside].mean(axis=0) - _CORNERS[inside].mean(axis=0)
            if np.cross(q - p, r - p) @ outward < 0:
                ring.reverse()
            name = [8 * (a & b) + (a ^ b) for a, b in ring]
            triangles += [(name[0], name[k], name[k + 1]) for k in range(1, len(ring) - 1)]
        if triangles:
            table[code, : len(triangles)] = triangles
    return table
