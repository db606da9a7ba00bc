"""Tell the points of a surface of many tubes that are outside from those that no one sees.

Tubes overlap where they meet: the first ring of an arm is inside the chest. Such points are not
of the body's surface.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Points = NDArray[np.float64]


def outer_vertices(
    vertex: NDArray[np.floating], triangle: NDArray[np.integer], *, most_frames: int = 8
) -> NDArray[np.bool_]:
    """Return which vertices are mostly outside all tubes but their own.

    Parameters
    ----------
    vertex : (time, vertex, 3)
        Of closed surfaces that share no vertex.
    triangle : (triangle, 3)
        Vertices, counter-clockwise seen from outside.
    most_frames : int
        So many frames are looked at, evenly spread: where tubes meet, all are much alike.

    Returns
    -------
    (vertex,) bool
        True of a vertex that is inside another tube in less than half of the frames.
    """
    count = vertex.shape[1]
    edges = triangle[:, [0, 1, 1, 2]].reshape(-1, 2)
    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (count, count))
    tubes, tube = connected_components(links, directed=False)
    looked = np.unique(np.linspace(0, len(vertex) - 1, most_frames).round().astype(int))
    hidden = np.zeros(count, int)
    for points in vertex[looked].astype(np.float64):
        inside = np.zeros(count, bool)
        for own in range(tubes):
            corner = points[triangle[tube[triangle[:, 0]] == own]]
            least, most = corner.min(axis=(0, 1)), corner.max(axis=(0, 1))
            near = ((points > least) & (points < most)).all(axis=1) & (tube != own) & ~inside
            if near.any():
                inside[near] = windings(points[near], corner) > 0.5
        hidden += inside
    return 2 * hidden < len(looked)


def windings(point: Points, corner: Points) -> Points:
    """Return how often a closed surface goes around points: 1 inside, 0 outside.

    By the solid angles of its triangles (van Oosterom and Strackee 1983).

    Parameters
    ----------
    point : (point, 3) float64
        Not on the surface.
    corner : (triangle, 3, 3) float64
        The corners of each triangle, counter-clockwise seen from outside.
    """
    a, b, c = (corner[None, :, side] - point[:, None] for side in range(3))
    far_a, far_b, far_c = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    volume = np.einsum("pti,pti->pt", a, np.cross(b, c))
    across = (
        far_a * far_b * far_c
        + np.einsum("pti,pti->pt", a, b) * far_c
        + np.einsum("pti,pti->pt", b, c) * far_a
        + np.einsum("pti,pti->pt", c, a) * far_b
    )
    return np.arctan2(volume, across).sum(axis=1) / (2.0 * np.pi)
