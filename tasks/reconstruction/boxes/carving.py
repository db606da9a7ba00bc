"""Find the voxels whose centers all cameras film inside silhouettes, box by box.

Boxes of voxels are decided as a whole wherever a camera's answer cannot differ within them
(octree carving; Szeliski 1993), so that the cost grows with the hull's surface. The bounds of
a box's image hold for each of its voxel centers, so the result is the one of testing each
voxel. With center (a, b) and half sizes (da, db) of a box's image before bending, and e the
bound of the lens' second derivatives, the bent image lies within |J| (da, db) + e (da + db)^2
/ 2 of the bent center (Taylor; J is the Jacobian there).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.geometry.projection import Projection, bend_point
from tasks.reconstruction.boxes.bits import WORD
from tasks.reconstruction.boxes.integral_images import count_pixels
from tasks.reconstruction.boxes.lens_bounds import lens_table

MOST_CAMERAS = 62
"""How many cameras can carve at most [cameras]. Those that are undecided about a box are bits of
one signed number of 64 bits."""

_BOX = WORD
"""Side of the boxes that carving starts with [voxels]. None straddles two words."""

_LEAF = 4
"""Side of the boxes whose voxels are tested one by one [voxels]. It changes the speed only."""

_STACK = 32
"""How many boxes wait at most to be split [boxes]. Each of the three halvings of a box leaves seven
more."""

_FIRST_BOXES = 64
"""For how many boxes there is room at first [boxes]. The room grows with them."""

_UNDECIDED = 0
"""A camera's vote on a box in which its votes on voxels may differ."""

_UNSEEN = 1
"""A camera's vote on a box that it does not see."""

_INSIDE = 2
"""A camera's vote on a box that it films inside its silhouette."""

_OUTSIDE = 3
"""A camera's vote on a box that it films outside its silhouette."""

_NEAREST_M = 1e-6
"""A box that comes nearer to the plane of a camera is not decided as a whole. Farther boxes divide
by numbers that rounding does not change much."""

_ROUNDING = 1e-9
"""Bound of the rounding errors of a bound of an image [share]. Double precision is exact to 2e-16,
and some tens of operations are made."""

_ROUNDING_PX = 1e-6
"""Bound of the rounding errors of a pixel's place. Double precision is exact to 1e-10
of a million pixels."""

_LARGEST_PX = 1e6
"""A box whose image may be larger is not decided as a whole. No image is so large, and such a bound
is that of a lens that bends too much."""

Axes = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def carve_boxes(
    silhouettes: NDArray[np.bool_], projection: Projection, axes: Axes, rule: tuple[int, int]
) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Return the voxels whose centers lie inside the silhouettes, as bits.

    Parameters
    ----------
    silhouettes : (camera, row, column) bool
        True where a pixel, as filmed, shows the performer.
    projection
        The cameras, in the same order, `MOST_CAMERAS` at most.
    axes
        (x,), (y,) and (z,) coordinates of the grid's voxel centers, m.
    rule
        How many cameras that see a voxel may film it outside their silhouettes, and how many must
        see it.

    Returns
    -------
    words : (x, y, word) uint32
        A box that holds them all, as `tasks.reconstruction.boxes.bits.read_bits` takes it.
    begin : (3,) int64
        Index in the grid of the box's first voxel.
    """
    silhouettes = np.ascontiguousarray(silhouettes)
    counts, crops = count_pixels(silhouettes, projection.image_size)
    views = (silhouettes, counts, crops, lens_table(projection, axes))
    boxes = _survey(views, axes, rule)
    if not len(boxes):
        return np.empty((0, 0, 0), np.uint32), np.zeros(3, np.int64)
    begin = boxes[:, :3].min(axis=0)
    shape = [len(axis) for axis in axes]
    sides = np.minimum(boxes[:, :3].max(axis=0) + _BOX, shape) - begin
    words = np.zeros((sides[0], sides[1], -(-sides[2] // WORD)), np.uint32)
    _refine(views, axes, rule, boxes, begin, words)
    return words, begin


@njit(cache=True, nogil=True, error_model="numpy")
def _project(lens: Any, c: Any, points: Any, count: Any) -> None:
    """Write the nearest pixel of each point, in rows 3 and 4; column -1 where it is not seen.

    The loops have no branches, so that they are vectorized.
    """
    x, y, z, u, v, s = points
    radius = lens[c, 4, 2]
    for n in range(count):
        d = lens[c, 2, 0] * x[n] + lens[c, 2, 1] * y[n] + lens[c, 2, 2] * z[n] + lens[c, 2, 3]
        a = lens[c, 0, 0] * x[n] + lens[c, 0, 1] * y[n] + lens[c, 0, 2] * z[n] + lens[c, 0, 3]
        b = lens[c, 1, 0] * x[n] + lens[c, 1, 1] * y[n] + lens[c, 1, 2] * z[n] + lens[c, 1, 3]
        ahead = d > 0
        d = d if ahead else 1.0
        u[n], v[n] = a / d, b / d
        s[n] = u[n] * u[n] + v[n] * v[n] if ahead else np.inf
    if radius < np.inf:
        k1, k2, p1, p2 = lens[c, 5, 0], lens[c, 5, 1], lens[c, 5, 2], lens[c, 5, 3]
        k = (k1, k2, p1, p2, lens[c, 6, 0], lens[c, 6, 1], lens[c, 6, 2], lens[c, 6, 3])
        for n in range(count):
            seen = s[n] <= radius * radius
            q = s[n] if seen else 0.0
            u[n], v[n] = bend_point(u[n], v[n], q, k)
            s[n] = q if seen else np.inf
    for n in range(count):
        column = np.floor(lens[c, 3, 0] * u[n] + lens[c, 3, 1] * v[n] + lens[c, 3, 2] + 0.5)
        row = np.floor(lens[c, 4, 0] * v[n] + lens[c, 4, 1] + 0.5)
        filmed = (column >= 0) & (column < lens[c, 3, 3]) & (row >= 0) & (row < lens[c, 4, 3])
        u[n] = column if filmed & (s[n] < np.inf) else -1.0
        v[n] = row


@njit(cache=True, nogil=True, inline="always")
def _look(counts: Any, crops: Any, lens: Any, c: Any, middle: Any, half: Any) -> Any:
    """Return a camera's vote on every voxel of a box, or that it may differ among them."""
    x, y, z = middle
    hx, hy, hz = half
    r00, r01, r02 = lens[c, 0, 0], lens[c, 0, 1], lens[c, 0, 2]
    r10, r11, r12 = lens[c, 1, 0], lens[c, 1, 1], lens[c, 1, 2]
    r20, r21, r22 = lens[c, 2, 0], lens[c, 2, 1], lens[c, 2, 2]
    edge, bend, rounding = lens[c, 7, 0], lens[c, 7, 1], lens[c, 7, 2]
    d = r20 * x + r21 * y + r22 * z + lens[c, 2, 3]
    reach = abs(r20) * hx + abs(r21) * hy + abs(r22) * hz + rounding
    if d + reach <= 0:
        return _UNSEEN
    if d - reach < _NEAREST_M:
        return _UNDECIDED
    near = 1.0 / (d - reach)
    far = 1.0 / d
    a = (r00 * x + r01 * y + r02 * z + lens[c, 0, 3]) * far
    b = (r10 * x + r11 * y + r12 * z + lens[c, 1, 3]) * far
    da = abs(r00 - a * r20) * hx + abs(r01 - a * r21) * hy + abs(r02 - a * r22) * hz
    db = abs(r10 - b * r20) * hx + abs(r11 - b * r21) * hy + abs(r12 - b * r22) * hz
    da = (da + rounding * (1 + abs(a))) * near
    db = (db + rounding * (1 + abs(b))) * near
    if edge < np.inf:
        nearest_a, nearest_b = max(abs(a) - da, 0.0), max(abs(b) - db, 0.0)
        if nearest_a * nearest_a + nearest_b * nearest_b > edge * edge * (1 + _ROUNDING):
            return _UNSEEN
        if (abs(a) + da) ** 2 + (abs(b) + db) ** 2 > edge * edge * (1 - _ROUNDING):
            return _UNDECIDED
        (a, b), (da, db) = _bend_box(lens, c, (a, b), (da, db), bend)
    u = lens[c, 3, 0] * a + lens[c, 3, 1] * b + lens[c, 3, 2]
    v = lens[c, 4, 0] * b + lens[c, 4, 1]
    du = (lens[c, 3, 0] * da + abs(lens[c, 3, 1]) * db) * (1 + _ROUNDING) + _ROUNDING_PX
    dv = lens[c, 4, 0] * db * (1 + _ROUNDING) + _ROUNDING_PX
    if not (du < _LARGEST_PX and dv < _LARGEST_PX):
        return _UNDECIDED
    left, right = np.floor(u - du + 0.5), np.floor(u + du + 0.5) + 1
    top, bottom = np.floor(v - dv + 0.5), np.floor(v + dv + 0.5) + 1
    columns, rows = lens[c, 3, 3], lens[c, 4, 3]
    if right <= 0 or bottom <= 0 or left >= columns or top >= rows:
        return _UNSEEN
    if left < 0 or top < 0 or right > columns or bottom > rows:
        return _UNDECIDED
    count = _count(counts, crops, c, (int(top), int(bottom)), (int(left), int(right)))
    if count == 0:
        return _OUTSIDE
    return _INSIDE if count == (right - left) * (bottom - top) else _UNDECIDED


@njit(cache=True, nogil=True, inline="always")
def _bend_box(lens: Any, c: Any, middle: Any, half: Any, bend: Any) -> Any:
    """Return the middle of a box's image after the lens, and bounds of its half sizes.

    It is the formula of `bend_point` once more, for the derivatives stand on its parts.
    """
    a, b = middle
    da, db = half
    k1, k2, p1, p2 = lens[c, 5, 0], lens[c, 5, 1], lens[c, 5, 2], lens[c, 5, 3]
    k3, k4, k5, k6 = lens[c, 6, 0], lens[c, 6, 1], lens[c, 6, 2], lens[c, 6, 3]
    s, ab = a * a + b * b, a * b
    below = 1 / (1 + s * (k4 + s * (k5 + s * k6)))
    f = (1 + s * (k1 + s * (k2 + s * k3))) * below
    slope = k1 + s * (2 * k2 + s * 3 * k3) - f * (k4 + s * (2 * k5 + s * 3 * k6))
    slope *= 2 * below
    across = abs(ab * slope + 2 * p1 * a + 2 * p2 * b)
    along_a = abs(f + a * a * slope + 2 * p1 * b + 6 * p2 * a)
    along_b = abs(f + b * b * slope + 6 * p1 * b + 2 * p2 * a)
    curve = bend * (da + db) * (da + db) / 2
    bent = (
        a * f + 2 * p1 * ab + p2 * (s + 2 * a * a),
        b * f + p1 * (s + 2 * b * b) + 2 * p2 * ab,
    )
    return bent, (along_a * da + across * db + curve, across * da + along_b * db + curve)


@njit(cache=True, nogil=True, inline="always")
def _count(counts: Any, crops: Any, c: Any, rows: Any, columns: Any) -> Any:
    """Return how many pixels of a rectangle show the performer."""
    top, left, bottom, right = crops[c, 0], crops[c, 1], crops[c, 2], crops[c, 3]
    r0, r1 = max(rows[0], top), min(rows[1], bottom)
    c0, c1 = max(columns[0], left), min(columns[1], right)
    if r0 >= r1 or c0 >= c1:
        return 0
    width = right - left + 1
    at = crops[c, 4] - (bottom - top + 1) * width - left
    above, under = at + (r0 - top) * width, at + (r1 - top) * width
    return counts[under + c1] - counts[under + c0] - counts[above + c1] + counts[above + c0]


@njit(cache=True, nogil=True)
def _decide(views: Any, axes: Any, rule: Any, box: Any) -> Any:
    """Let the undecided cameras of a box vote on it as a whole; return whether it is empty.

    box : first x, y, z; voxels on a side; undecided cameras; those that see it; the misses.
    """
    xs, ys, zs = axes
    side = box[3]
    x0, y0, z0 = xs[box[0]], ys[box[1]], zs[box[2]]
    x1 = xs[min(box[0] + side, len(xs)) - 1]
    y1 = ys[min(box[1] + side, len(ys)) - 1]
    z1 = zs[min(box[2] + side, len(zs)) - 1]
    middle = (0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1))
    half = (0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (z1 - z0))
    open_votes = 0
    for c in range(len(views[2])):
        if not (box[4] >> c) & 1:
            continue
        vote = _look(views[1], views[2], views[3], c, middle, half)
        if vote == _UNDECIDED:
            open_votes += 1
            continue
        box[4] ^= 1 << c
        box[5] += vote != _UNSEEN
        box[6] += vote == _OUTSIDE
        if box[6] > rule[0]:
            return True
    return box[5] + open_votes < rule[1]


@njit(cache=True, nogil=True)
def _survey(views: Any, axes: Any, rule: Any) -> Any:
    """Return the boxes that carving starts with and that are not empty, (box, 7)."""
    xs, ys, zs = axes
    boxes = np.empty((_FIRST_BOXES, 7), np.int64)
    box = np.empty(7, np.int64)
    found = 0
    for x in range(0, len(xs), _BOX):
        for y in range(0, len(ys), _BOX):
            for z in range(0, len(zs), _BOX):
                box[0], box[1], box[2], box[3] = x, y, z, _BOX
                box[4], box[5], box[6] = (1 << len(views[2])) - 1, 0, 0
                if _decide(views, axes, rule, box):
                    continue
                if found == len(boxes):
                    boxes = np.concatenate((boxes, boxes))
                _copy(box, boxes[found])
                found += 1
    return boxes[:found]


@njit(cache=True, nogil=True)
def _copy(box: Any, into: Any) -> None:
    """Copy the numbers of a box; numpy's way compiles texts of errors too, for seconds."""
    for k in range(len(into)):
        into[k] = box[k]


@njit(cache=True, nogil=True)
def _refine(views: Any, axes: Any, rule: Any, boxes: Any, begin: Any, words: Any) -> None:
    """Split the boxes until they are empty, full or leaves; set the bits of what is occupied."""
    shape = (len(axes[0]), len(axes[1]), len(axes[2]))
    stack = np.empty((_STACK, 7), np.int64)
    parent = np.empty(7, np.int64)
    scratch = (np.empty((6, _LEAF**3)), np.empty((2, _LEAF**3), np.int64))
    for first in range(len(boxes)):
        _copy(boxes[first], stack[0])
        depth = 1
        while depth > 0:
            depth -= 1
            _copy(stack[depth], parent)
            open_votes = 0
            for c in range(len(views[3])):
                open_votes += (parent[4] >> c) & 1
            if parent[5] >= rule[1] and parent[6] + open_votes <= rule[0]:
                _fill(words, begin, parent, shape)
            elif parent[3] == _LEAF:
                _test(views, axes, rule, parent, (begin, words), scratch)
            else:
                step = parent[3] // 2
                for child in range(8):
                    box = stack[depth]
                    _copy(parent, box)
                    box[0] += (child >> 2) * step
                    box[1] += (child >> 1 & 1) * step
                    box[2] += (child & 1) * step
                    box[3] = step
                    if box[0] < shape[0] and box[1] < shape[1] and box[2] < shape[2]:
                        depth += not _decide(views, axes, rule, box)


@njit(cache=True, nogil=True, inline="always")
def _fill(words: Any, begin: Any, box: Any, shape: Any) -> None:
    """Set the bits of a full box."""
    x0, y0, z0, side = box[0], box[1], box[2], box[3]
    at = z0 - begin[2]
    bits = ((1 << min(side, shape[2] - z0)) - 1) << (at % WORD)
    for x in range(x0, min(x0 + side, shape[0])):
        for y in range(y0, min(y0 + side, shape[1])):
            words[x - begin[0], y - begin[1], at // WORD] |= np.uint32(bits)


@njit(cache=True, nogil=True, inline="always")
def _test(views: Any, axes: Any, rule: Any, box: Any, into: Any, scratch: Any) -> None:
    """Let the undecided cameras of a leaf vote on each voxel; set the bits of the occupied."""
    silhouettes, lens = views[0], views[3]
    begin, words = into
    points, tally = scratch
    undecided, seen, misses = box[4], box[5], box[6]
    count = _lay_out(axes, box, points)
    for n in range(count):
        tally[0, n], tally[1, n] = seen, misses
    for c in range(len(lens)):
        if not (undecided >> c) & 1:
            continue
        _project(lens, c, (points[0], points[1], points[2], points[3], points[4], points[5]), count)
        for n in range(count):
            column = int(points[3, n])
            if column >= 0:
                tally[0, n] += 1
                tally[1, n] += not silhouettes[c, int(points[4, n]), column]
    deep = min(_LEAF, len(axes[2]) - box[2])
    wide = min(_LEAF, len(axes[1]) - box[1])
    at = box[2] - begin[2]
    for n in range(count):
        if tally[0, n] >= rule[1] and tally[1, n] <= rule[0]:
            x, y, z = n // (wide * deep), n // deep % wide, n % deep
            place = words[x + box[0] - begin[0], y + box[1] - begin[1]]
            place[at // WORD] |= np.uint32(1 << (at % WORD + z))


@njit(cache=True, nogil=True, inline="always")
def _lay_out(axes: Any, box: Any, points: Any) -> Any:
    """Write the voxel centers of a leaf into rows 0 to 2, in order; return how many."""
    xs, ys, zs = axes
    count = 0
    for x in range(box[0], min(box[0] + _LEAF, len(xs))):
        for y in range(box[1], min(box[1] + _LEAF, len(ys))):
            for z in range(box[2], min(box[2] + _LEAF, len(zs))):
                points[0, count], points[1, count], points[2, count] = xs[x], ys[y], zs[z]
                count += 1
    return count
