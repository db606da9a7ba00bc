"""Regions of labeled voxels: neighbors, the largest region of a label, growing (3.4.1, 3.4.3).

Voxels are neighbors when they share a face. They are given in the order of their numbers, as
`voxel_index` gives them, so that a voxel's neighbors are found by walking that list along
itself; every region is then a walk over the table of neighbors, made once a frame.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import KDTree

NOBODY = -1
"""The neighbor of a voxel where there is none."""

_FEW = 200  # voxels that are sought faster along the list than by a tree, which has to be made


def voxel_neighbors(index: NDArray[np.integer]) -> NDArray[np.int32]:
    """Return the place in the list of each voxel's six neighbors.

    Parameters
    ----------
    index : (voxel, 3) int
        In the grid, in order: x-major, then y, then z; each voxel once.

    Returns
    -------
    (voxel, 6) int32
        Neighbors towards -z, +z, -y, +y, -x, +x; -1 where there is none.

    Raises
    ------
    ValueError
        If the voxels are not in order.
    """
    index = np.asarray(index)
    neighbors = np.full((len(index), 6), NOBODY, np.int32)
    number, step = np.empty(len(index), np.int64), np.ones(3, np.int64)
    if len(index) and not _number_voxels(np.ascontiguousarray(index), number, step):
        raise ValueError(
            "the voxels are not in order or not each once; pass them as voxel_index gives them"
        )
    _find_neighbors(number, step, neighbors)
    return neighbors


def label_regions(
    label: NDArray[np.integer], neighbors: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return which connected region of one label each voxel is in, and the regions' sizes.

    Parameters
    ----------
    label : (voxel,) int
        Any numbers; 0 is no label, and in no region.
    neighbors : (voxel, 6) int32
        As `voxel_neighbors` gives them.

    Returns
    -------
    region : (voxel,) int32
        From 0, in the order of their first voxels; -1 without label.
    size : (region,) int64
        Voxels in each.
    """
    region = np.full(len(label), NOBODY, np.int32)
    first_and_size = np.zeros((len(label), 2), np.int64)
    count = _find_regions(np.ascontiguousarray(label), neighbors, region, first_and_size)
    return region, first_and_size[:count, 1].copy()


def keep_largest_regions(
    label: NDArray[np.uint8], neighbors: NDArray[np.int32]
) -> NDArray[np.uint8]:
    """Return labels with 0 outside each label's largest region (constraint 1 of the paper).

    Of equally large regions the one with the first voxel stays.
    """
    kept = np.array(label, np.uint8)
    region = np.full(len(kept), NOBODY, np.int32)
    _drop_small(kept, neighbors, region, np.zeros((len(kept), 2), np.int64))
    return kept


def grow_labels(label: NDArray[np.uint8], neighbors: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Return labels where voxels with 0 have the nearest label that they are connected to.

    Distance is counted in steps from neighbor to neighbor; of equally near labels the first in
    the order of neighbors is taken. Voxels that no label is connected to keep 0.
    """
    grown = np.array(label, np.uint8)
    _grow(grown, neighbors)
    return grown


def clean_labels(
    label: NDArray[np.integer],
    index: NDArray[np.integer],
    *,
    neighbors: NDArray[np.int32] | None = None,
) -> NDArray[np.uint8]:
    """Return labels of which each is one connected region (digitization paper, 3.4.3).

    Each label's largest region stays, and every other voxel takes the nearest label that it is
    connected to. What is connected to no such region, a piece of the hull apart from the rest,
    takes the label of the nearest labeled voxel: only there a label has a second region.

    Parameters
    ----------
    label : (voxel,) int
        1 to 255; 0 is not decided.
    index : (voxel, 3) int
        In the grid, in order.
    neighbors : (voxel, 6) int32
        As `voxel_neighbors` gives them, where they are known already.

    Raises
    ------
    ValueError
        If labels and voxels do not fit, a label is out of range, or the voxels are not in order.
    """
    label, index = np.asarray(label), np.asarray(index)
    if label.shape != index.shape[:1] or index.shape[1:] != (3,):
        raise ValueError(
            f"{label.shape} labels and voxels of shape {index.shape} do not fit; pass a label and "
            "three indices for each voxel"
        )
    is_small = label.dtype == np.uint8 or not len(label)
    if not (is_small or (label.min() >= 0 and label.max() <= 255)):
        raise ValueError(
            f"labels from {label.min()} to {label.max()} are no labels; pass 0 (none) to 255"
        )
    if neighbors is None:
        neighbors = voxel_neighbors(index)
    clean = keep_largest_regions(label.astype(np.uint8), neighbors)
    _grow(clean, neighbors)
    lost = clean == 0
    if lost.any() and not lost.all():
        place = nearest_at_rim(index[lost], index, neighbors, ~lost)
        clean[lost] = clean[place]
    return clean


def nearest_at_rim(
    sought: NDArray[np.integer],
    index: NDArray[np.integer],
    neighbors: NDArray[np.int32],
    counts: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Return the place in the list of the voxel nearest to each of some voxels outside.

    Parameters
    ----------
    sought : (sought, 3) int
        In the grid; none of them is one of the list that counts.
    index, neighbors : (voxel, 3) int and (voxel, 6) int32
        The list, and its neighbors as `voxel_neighbors` gives them.
    counts : (voxel,) bool
        Which voxels of the list count; at least one.
    """
    sought, index = np.ascontiguousarray(sought), np.ascontiguousarray(index)
    if len(sought) > _FEW:
        rim = np.flatnonzero(counts & (neighbors < 0).any(axis=1))
        tree = KDTree(index[rim], balanced_tree=False, compact_nodes=False)
        return rim[tree.query(sought)[1]]
    nearest = np.empty(len(sought), np.int64)
    _search(sought, index, neighbors, counts, nearest)
    return nearest


@njit(cache=True, nogil=True)
def _number_voxels(index: Any, number: Any, step: Any) -> Any:
    """Write voxels' numbers in their box and steps along z, y, x; return whether they rise."""
    low, high = index[0].copy(), index[0].copy()
    for n in range(len(index)):
        for k in range(3):
            low[k] = min(low[k], index[n, k])
            high[k] = max(high[k], index[n, k])
    step[1] = high[2] - low[2] + 2  # an empty layer: lines never wrap
    step[2] = (high[1] - low[1] + 2) * step[1]
    for n in range(len(index)):
        x, y, z = index[n, 0] - low[0], index[n, 1] - low[1], index[n, 2] - low[2]
        number[n] = x * step[2] + y * step[1] + z
        if n and number[n] <= number[n - 1]:
            return False
    return True


@njit(cache=True, nogil=True)
def _find_neighbors(number: Any, step: Any, neighbors: Any) -> None:
    """Write who stands a step away along z, y and x, by walking the list after itself."""
    for axis in range(3):
        ahead = 0
        for n in range(len(number)):
            wanted = number[n] + step[axis]
            while ahead < len(number) and number[ahead] < wanted:
                ahead += 1
            if ahead < len(number) and number[ahead] == wanted:
                neighbors[n, 2 * axis + 1], neighbors[ahead, 2 * axis] = ahead, n


@njit(cache=True, nogil=True)
def _find_regions(label: Any, neighbors: Any, region: Any, first_and_size: Any) -> Any:
    """Write the region of each voxel, and of each region; return how many there are.

    Stretches of a label along z are joined to those that they touch before them along y and x;
    of stretches that are joined the first stands for all.
    """
    first = np.empty(len(label), np.int32)
    stretches = 0
    for n in range(len(label)):
        own = label[n]
        if own == 0:
            continue
        back = neighbors[n, 0]
        goes_on = back >= 0 and label[back] == own
        if not goes_on:
            first[stretches] = stretches
            stretches += 1
        region[n] = stretches - 1
        for k in (2, 4):
            beside = neighbors[n, k]
            if beside < 0 or label[beside] != own:
                continue
            if goes_on and neighbors[back, k] == beside - 1 and label[beside - 1] == own:
                continue  # joined a voxel ago
            a, b = _first_of(first, stretches - 1), _first_of(first, region[beside])
            first[max(a, b)] = min(a, b)
    count = _count_firsts(first[:stretches])
    for n in range(len(label)):
        if region[n] >= 0:
            region[n] = first[region[n]]
            if first_and_size[region[n], 1] == 0:
                first_and_size[region[n], 0] = n
            first_and_size[region[n], 1] += 1
    return count


@njit(cache=True, nogil=True)
def _first_of(first: Any, stretch: Any) -> Any:
    """Return the stretch that stands for one, and shorten the way there."""
    while first[stretch] != stretch:
        first[stretch] = first[first[stretch]]
        stretch = first[stretch]
    return stretch


@njit(cache=True, nogil=True)
def _count_firsts(first: Any) -> Any:
    """Write the number of its region for each stretch; return how many regions there are."""
    count = 0
    for stretch in range(len(first)):
        if first[stretch] == stretch:
            first[stretch] = count
            count += 1
        else:  # it was joined to an earlier one, which has its number by now
            first[stretch] = first[first[stretch]]
    return count


@njit(cache=True, nogil=True)
def _search(sought: Any, index: Any, neighbors: Any, counts: Any, nearest: Any) -> None:
    """Write the place of the voxel nearest to each sought one, the first of equally near.

    From outside, the nearest voxel is at a rim: one with an empty neighbor.
    """
    least = np.full(len(sought), 2**62)
    for n in range(len(index)):
        enclosed = True
        for k in range(6):
            enclosed &= neighbors[n, k] >= 0
        if enclosed or not counts[n]:
            continue
        for s in range(len(sought)):
            dx, dy, dz = (
                np.int64(index[n, 0] - sought[s, 0]),
                np.int64(index[n, 1] - sought[s, 1]),
                np.int64(index[n, 2] - sought[s, 2]),
            )
            away = dx * dx + dy * dy + dz * dz
            if away < least[s]:
                least[s], nearest[s] = away, n


@njit(cache=True, nogil=True)
def _drop_small(label: Any, neighbors: Any, region: Any, first_and_size: Any) -> None:
    """Write 0 for the voxels outside each label's largest region."""
    count = _find_regions(label, neighbors, region, first_and_size)
    largest = np.full(256, NOBODY, np.int64)
    for number in range(count):
        own = label[first_and_size[number, 0]]
        best = largest[own]
        if best < 0 or first_and_size[number, 1] > first_and_size[best, 1]:
            largest[own] = number
    for voxel in range(len(label)):
        if region[voxel] != largest[label[voxel]]:
            label[voxel] = 0


@njit(cache=True, nogil=True)
def _grow(label: Any, neighbors: Any) -> None:
    """Write labels into voxels without, ring by ring."""
    waiting = np.flatnonzero(label == 0).astype(np.int32)
    found = np.empty(len(waiting), np.uint8)
    left = len(waiting)
    changed = True
    while changed:
        changed = False
        for n in range(left):
            found[n] = 0
            for k in range(6):
                other = neighbors[waiting[n], k]
                if other >= 0 and label[other]:
                    found[n] = label[other]
                    break
        still = 0
        for n in range(left):
            voxel = waiting[n]
            if found[n]:
                label[voxel] = found[n]
                changed = True
            else:
                waiting[still] = voxel
                still += 1
        left = still
