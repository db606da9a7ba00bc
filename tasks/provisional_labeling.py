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

from tasks.geometry.label_regions import clean_labels
from tasks.geometry.nearest_voxels import copy_nearest
from tasks.geometry.voxel_lines import FIRST, LENGTH, VoxelLines, X, Y, Z

_IN_RING, _ENCLOSED = np.uint8(1), np.uint8(2)


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
    lines: VoxelLines, previous: VoxelLines, previous_label: NDArray[np.integer]
) -> NDArray[np.uint8]:
    """Return the label of the nearest voxel of the frame before, for each voxel.

    Of equally near voxels the first in order is taken.

    Parameters
    ----------
    lines, previous
        The voxels, and those of the frame before.
    previous_label : (previous voxel,) int
        Its final labels, 1 to 255.

    Raises
    ------
    ValueError
        If labels and voxels do not fit, or the frame before has no voxel.
    """
    if previous.voxels != len(previous_label) or not previous.voxels:
        raise ValueError(
            f"{previous.voxels} voxels with {len(previous_label)} labels say nothing of the "
            "next frame; pass the last frame that has voxels, and a label for each"
        )
    return copy_nearest(lines, previous, np.asarray(previous_label, np.uint8))


def restore_volumes(
    label: NDArray[np.uint8],
    lines: VoxelLines,
    share: NDArray[np.floating],
    settings: ProvisionalSettings,
) -> NDArray[np.uint8]:
    """Return labels grown, the most shrunken first, until no segment is below its share.

    Parameters
    ----------
    label : (voxel,) uint8
        0 to 11; 0 is none, and never taken.
    lines
        The voxels.
    share : (11,) float
        Of the labeled voxels at t = 0.
    settings
        When to stop.
    """
    grown = np.array(label, np.uint8)
    if len(grown):
        limits = (1.0 - settings.volume_tolerance, settings.most_rings)
        _dilate(grown, lines.table, np.asarray(share, np.float64), limits)
    return grown


def label_provisionally(
    lines: VoxelLines,
    previous: VoxelLines,
    previous_label: NDArray[np.integer],
    share: NDArray[np.floating],
    settings: ProvisionalSettings,
    *,
    skin_label: NDArray[np.integer] | None = None,
) -> NDArray[np.uint8]:
    """Return the provisional labels of a frame.

    Parameters
    ----------
    lines
        The voxels.
    previous, previous_label
        Of the frame before, as `label_from_previous`.
    share : (11,) float
        Each segment's share of the labeled voxels at t = 0.
    settings
        How volumes are restored.
    skin_label : (voxel,) int
        Label of the segment whose skin a voxel is, 0 elsewhere, where skin was tracked.

    Raises
    ------
    ValueError
        As `label_from_previous` and `clean_labels`.
    """
    label = label_from_previous(lines, previous, previous_label)
    if skin_label is not None:
        np.copyto(label, skin_label.astype(np.uint8), where=skin_label > 0)
    return restore_volumes(clean_labels(label, lines), lines, share, settings)


@njit(cache=True, nogil=True)
def _dilate(label: Any, lines: Any, share: Any, limits: Any) -> None:
    """Give rings of neighbors to the segment furthest below its share, until none is."""
    enough, most_rings = limits
    stretch, count = _find_stretches(label, lines)
    wanted = share * (len(label) - count[0])
    worst = _most_shrunken(count, wanted, enough)
    if worst < 0:
        return
    box, place, step = _paint(label, lines)
    marks = np.zeros(len(box), np.uint8)
    ring = np.empty(len(label), np.int32)
    room = np.zeros(len(share) + 1, np.int64)
    room[1:] = np.cumsum(np.maximum(count[1 : len(share) + 1], np.ceil(wanted).astype(np.int64)))
    members = np.empty(room[-1], np.int32)
    size_of = np.full(len(share), -1, np.int64)
    for _ in range(most_rings):
        member = members[room[worst] : room[worst + 1]]
        if size_of[worst] < 0:
            size_of[worst] = _find_members(stretch, place, lines, worst + 1, member)
        kept, size = _find_ring(box, step, worst + 1, (member, size_of[worst]), ring, marks)
        taken = min(size, np.int64(np.ceil(wanted[worst])) - count[worst + 1])
        for n in range(taken):
            voxel = ring[n * size // taken]
            count[box[voxel]] -= 1
            box[voxel] = worst + 1
            member[kept + n] = voxel
            for k in range(6):
                marks[voxel + step[k]] &= _IN_RING
        count[worst + 1] += taken
        size_of[worst] = kept + taken
        if not size:
            break
        worst = _most_shrunken(count, wanted, enough)
        if worst < 0:
            break
    for line in range(len(lines)):
        for k in range(lines[line, LENGTH]):
            label[lines[line, FIRST] + k] = box[place[line] + k]


@njit(cache=True, nogil=True)
def _find_stretches(label: Any, lines: Any) -> Any:
    """Return line, first voxel, end and label of each stretch of a label; and labels' counts."""
    turns = np.empty(len(label), np.bool_)
    for n in range(1, len(label)):
        turns[n] = label[n] != label[n - 1]
    stretches = len(lines)
    for n in range(1, len(label)):
        stretches += turns[n]
    stretch, count = np.empty((stretches, 4), np.int32), np.zeros(256, np.int64)
    s = 0
    for line in range(len(lines)):
        n = lines[line, FIRST]
        end = n + lines[line, LENGTH]
        while n < end:
            begin = n
            n += 1
            while n < end and not turns[n]:
                n += 1
            stretch[s, 0], stretch[s, 1], stretch[s, 2] = line, begin, n
            stretch[s, 3] = label[begin]
            count[label[begin]] += n - begin
            s += 1
    return stretch[:s], count


@njit(cache=True, nogil=True)
def _paint(label: Any, lines: Any) -> Any:
    """Return a box of labels, 0 where no voxel is, each line's place in it, and steps in it."""
    low = (lines[0, X], lines[0, Y], lines[0, Z])
    high = low
    for n in range(len(lines)):
        x, y, z = lines[n, X], lines[n, Y], lines[n, Z]
        low = (min(low[0], x), min(low[1], y), min(low[2], z))
        high = (max(high[0], x), max(high[1], y), max(high[2], z + lines[n, LENGTH] - 1))
    deep = high[2] - low[2] + 3  # an empty layer on each side
    wide = (high[1] - low[1] + 3) * deep
    box = np.zeros((high[0] - low[0] + 3) * wide, np.uint8)
    place = np.empty(len(lines), np.int32)
    for n in range(len(lines)):
        x, y, z = lines[n, X] - low[0], lines[n, Y] - low[1], lines[n, Z] - low[2]
        place[n] = (x + 1) * wide + (y + 1) * deep + z + 1
        for k in range(lines[n, LENGTH]):
            box[place[n] + k] = label[lines[n, FIRST] + k]
    return box, place, np.array([-1, 1, -deep, deep, -wide, wide])


@njit(cache=True, nogil=True)
def _find_members(stretch: Any, place: Any, lines: Any, own: Any, member: Any) -> Any:
    """Write where in the box the voxels of a label are; return how many there are."""
    count = 0
    for s in range(len(stretch)):
        if stretch[s, 3] == own:
            there = place[stretch[s, 0]] - lines[stretch[s, 0], FIRST]
            for n in range(stretch[s, 1], stretch[s, 2]):
                member[count] = there + n
                count += 1
    return count


@njit(cache=True, nogil=True)
def _most_shrunken(count: Any, wanted: Any, enough: Any) -> Any:
    """Return the segment furthest below its share, or -1 where all have enough of it."""
    least, worst = enough, -1
    for k in range(len(wanted)):
        if count[k + 1] < least * wanted[k]:
            least, worst = count[k + 1] / wanted[k], k
    return worst


@njit(cache=True, nogil=True)
def _find_ring(box: Any, step: Any, own: Any, members: Any, ring: Any, marks: Any) -> Any:
    """Write the labeled voxels next to a label; return how many members and voxels there are.

    `marks` are what is in the ring, none before and after, and what is known to be enclosed by
    its own label.
    """
    member, end = members
    kept = size = 0
    for m in range(end):
        voxel = member[m]
        if box[voxel] == own:  # was not taken since
            member[kept] = voxel
            kept += 1
            if marks[voxel] & _ENCLOSED:
                continue
            marks[voxel] |= _ENCLOSED
            for k in range(6):
                other = voxel + step[k]
                if box[other] and box[other] != own:
                    marks[voxel] &= _IN_RING
                    if not marks[other] & _IN_RING:
                        marks[other] |= _IN_RING
                        ring[size] = other
                        size += 1
    for n in range(size):
        marks[ring[n]] &= _ENCLOSED
    return kept, size
