"""Label the voxels of a frame from the frame before (digitization paper, 3.4.1).

A voxel takes the label of the nearest voxel of the frame before; the regions of skin color that
were the face and the hands keep being them; each segment keeps its largest region; and the
segment that lost most of its share of the volume takes neighboring voxels until none is below
its share at t = 0.

What the paper leaves open: a share is reached to within a tolerance, and of a ring of neighbors
only as many voxels are taken, evenly along it, as are wanted; the number of rings is bounded,
for shares need not be reachable.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.label_regions import clean_labels, nearest_at_rim, voxel_neighbors

_REACH = 10  # voxels within which a dense box is searched, beyond a tree


def _offsets() -> NDArray[np.int64]:
    """Return (offset, 3) the steps within reach, the shortest first, then in order."""
    steps = np.arange(-_REACH, _REACH + 1)
    offset = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    distance = (offset**2).sum(axis=1)
    nearest = np.argsort(distance, kind="stable")
    return offset[nearest[distance[nearest] <= _REACH**2]]


_OFFSETS = _offsets()


@dataclass(frozen=True)
class ProvisionalSettings:
    """Everything that changes a provisional label.

    Raises
    ------
    ValueError
        If a number is not finite or out of range.
    """

    volume_tolerance: float = 0.03
    """How far below its share a segment may stay, as part of it: what voxels of 1 cm can tell of
    a hand."""

    most_rings: int = 400
    """Rings that are added at most. Of the paper's "repeat until the shares converge"; shares
    that cannot be reached together never do. With 0, 40, 120 and 400 the paper's chain labels
    .59, .66, .72 and .77 of a fitting costume right, of a kimono .35, .29, .48 and .40."""

    skin_speed: float = 5.0
    """How fast a hand or the face moves at most, statures a second: a punch is 5."""

    least_skin_m2: float = 0.0012
    """Smallest region of skin that counts, square metres: a fifth of the back of a hand."""

    def __post_init__(self) -> None:
        faults = []
        if not (math.isfinite(self.volume_tolerance) and 0 <= self.volume_tolerance < 1):
            faults.append(f"volume_tolerance {self.volume_tolerance} must be from 0 to below 1")
        if self.most_rings < 0:
            faults.append(f"most_rings {self.most_rings} must be 0 or more")
        if not (math.isfinite(self.skin_speed) and self.skin_speed > 0):
            faults.append(f"skin_speed {self.skin_speed} must be larger than 0")
        if not (math.isfinite(self.least_skin_m2) and self.least_skin_m2 >= 0):
            faults.append(f"least_skin_m2 {self.least_skin_m2} must be 0 or more")
        if faults:
            raise ValueError(f"no frame can be labeled so: {'; '.join(faults)}")

    def reach_m(self, stature_m: float | None, rate_hz: float) -> float:
        """Return how far skin moves from frame to frame at most, m; of 1.6 m if not known."""
        return self.skin_speed * (stature_m or 1.6) / rate_hz


def label_from_previous(
    index: NDArray[np.integer],
    previous_index: NDArray[np.integer],
    previous_label: NDArray[np.integer],
) -> NDArray[np.uint8]:
    """Return the label of the nearest voxel of the frame before, for each voxel.

    Of equally near voxels the first in order is taken.

    Parameters
    ----------
    index : (voxel, 3) int
        In the grid, in order.
    previous_index : (previous voxel, 3) int
        Of the frame before, in order.
    previous_label : (previous voxel,) int
        Its final labels, 1 to 255.

    Raises
    ------
    ValueError
        If labels and voxels do not fit, or the frame before has no voxel.
    """
    if len(previous_index) != len(previous_label) or not len(previous_index):
        raise ValueError(
            f"{len(previous_index)} voxels with {len(previous_label)} labels say nothing of the "
            "next frame; pass the last frame that has voxels, and a label for each"
        )
    if not len(index):
        return np.zeros(0, np.uint8)
    low, high = np.array(index[0], np.int64), np.array(index[0], np.int64)
    for voxels in (index, previous_index):
        _stretch_box(voxels, low, high)
    sides = high - low + 1 + 2 * _REACH
    stride = np.array([sides[1] * sides[2], sides[2], 1])
    box = np.zeros(int(np.prod(sides)), np.uint8)
    label = np.zeros(len(index), np.uint8)
    before = (previous_index, np.asarray(previous_label, np.uint8))
    _take_nearest(index, before, (low - _REACH, stride), _OFFSETS @ stride, box, label)
    far = np.flatnonzero(label == 0)
    if len(far):
        around = voxel_neighbors(previous_index)
        every = np.ones(len(previous_index), np.bool_)
        label[far] = before[1][nearest_at_rim(index[far], previous_index, around, every)]
    return label


def restore_volumes(
    label: NDArray[np.uint8],
    neighbors: NDArray[np.int32],
    share: NDArray[np.floating],
    settings: ProvisionalSettings,
) -> NDArray[np.uint8]:
    """Return labels grown, the most shrunken first, until no segment is below its share.

    Parameters
    ----------
    label : (voxel,) uint8
        1 to 11; 0 is none, and never taken.
    neighbors : (voxel, 6) int32
        As `voxel_neighbors` gives them.
    share : (11,) float
        Of the labeled voxels at t = 0.
    settings
        When to stop.
    """
    grown = np.array(label, np.uint8)
    limits = (1.0 - settings.volume_tolerance, settings.most_rings)
    _dilate(grown, neighbors, np.asarray(share, np.float64), limits)
    return grown


def label_provisionally(
    index: NDArray[np.integer],
    previous_index: NDArray[np.integer],
    previous_label: NDArray[np.integer],
    share: NDArray[np.floating],
    settings: ProvisionalSettings,
    *,
    skin_label: NDArray[np.integer] | None = None,
    neighbors: NDArray[np.int32] | None = None,
) -> NDArray[np.uint8]:
    """Return the provisional labels of a frame.

    Parameters
    ----------
    index : (voxel, 3) int
        In the grid, in order.
    previous_index, previous_label
        Of the frame before, as `label_from_previous`.
    share : (11,) float
        Each segment's share of the labeled voxels at t = 0.
    settings
        How volumes are restored.
    skin_label : (voxel,) int
        Label of the segment whose skin a voxel is, 0 elsewhere, where skin was tracked.
    neighbors : (voxel, 6) int32
        As `voxel_neighbors` gives them, where they are known already.

    Raises
    ------
    ValueError
        As `label_from_previous` and `clean_labels`.
    """
    if neighbors is None:
        neighbors = voxel_neighbors(index)
    label = label_from_previous(index, previous_index, previous_label)
    if skin_label is not None:
        label = np.where(skin_label > 0, skin_label, label).astype(np.uint8)
    label = clean_labels(label, index, neighbors=neighbors)
    return restore_volumes(label, neighbors, share, settings)


@njit(cache=True, nogil=True)
def _stretch_box(index: Any, low: Any, high: Any) -> None:
    """Move the corners of a box until all voxels are inside."""
    for n in range(len(index)):
        for k in range(3):
            low[k] = min(low[k], index[n, k])
            high[k] = max(high[k], index[n, k])


@njit(cache=True, nogil=True)
def _place_of(voxel: Any, frame: Any) -> Any:
    """Return where a voxel is in a box kept as a line."""
    low, stride = frame
    away = (voxel[0] - low[0]) * stride[0] + (voxel[1] - low[1]) * stride[1]
    return away + voxel[2] - low[2]


@njit(cache=True, nogil=True)
def _take_nearest(index: Any, before: Any, frame: Any, step: Any, box: Any, label: Any) -> None:
    """Write the label of the nearest voxel of the frame before, where one is within reach."""
    previous_index, previous_label = before
    for n in range(len(previous_index)):
        box[_place_of(previous_index[n], frame)] = previous_label[n]
    for n in range(len(index)):
        place = _place_of(index[n], frame)
        for k in range(len(step)):
            there = box[place + step[k]]
            if there:
                label[n] = there
                break


@njit(cache=True, nogil=True)
def _dilate(label: Any, neighbors: Any, share: Any, limits: Any) -> None:
    """Give rings of neighbors to the segment furthest below its share, until none is."""
    enough, most_rings = limits
    count = np.zeros(256, np.int64)
    member = np.empty((len(share), len(label)), np.int32)
    members = np.zeros(len(share), np.int64)
    for voxel in range(len(label)):
        own = np.int64(label[voxel])
        count[own] += 1
        if 0 < own <= len(share):
            member[own - 1, members[own - 1]] = voxel
            members[own - 1] += 1
    wanted = share * (len(label) - count[0])
    ring = np.empty(len(label), np.int32)
    marks = np.zeros((2, len(label)), np.bool_)
    for _ in range(most_rings):
        worst = _most_shrunken(count, wanted, enough)
        if worst < 0:
            break
        kept, size = _find_ring(
            label, neighbors, worst + 1, (member[worst], members[worst]), ring, marks
        )
        taken = min(size, np.int64(np.ceil(wanted[worst])) - count[worst + 1])
        for n in range(taken):
            voxel = ring[n * size // taken]
            count[label[voxel]] -= 1
            label[voxel] = worst + 1
            member[worst, kept + n] = voxel
            for k in range(6):
                if neighbors[voxel, k] >= 0:
                    marks[1, neighbors[voxel, k]] = False
        count[worst + 1] += taken
        members[worst] = kept + taken
        if not size:
            break


@njit(cache=True, nogil=True)
def _most_shrunken(count: Any, wanted: Any, enough: Any) -> Any:
    """Return the segment furthest below its share, or -1 where all have enough of it."""
    least, worst = enough, -1
    for k in range(len(wanted)):
        if count[k + 1] < least * wanted[k]:
            least, worst = count[k + 1] / wanted[k], k
    return worst


@njit(cache=True, nogil=True)
def _find_ring(label: Any, neighbors: Any, own: Any, members: Any, ring: Any, marks: Any) -> Any:
    """Write the labeled voxels next to a label; return how many members and voxels there are.

    `marks` are what is in the ring, none before and after, and what is known to be enclosed by
    its own label.
    """
    member, end = members
    in_ring, enclosed = marks
    kept = size = 0
    for m in range(end):
        voxel = member[m]
        if label[voxel] == own:  # was not taken since
            member[kept] = voxel
            kept += 1
            if enclosed[voxel]:
                continue
            enclosed[voxel] = True
            for k in range(6):
                other = neighbors[voxel, k]
                if other >= 0 and label[other] and label[other] != own:
                    enclosed[voxel] = False
                    if not in_ring[other]:
                        in_ring[other] = True
                        ring[size] = other
                        size += 1
    for n in range(size):
        in_ring[ring[n]] = False
    return kept, size
