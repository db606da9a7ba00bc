"""Label the voxels of a frame from the frame before (digitization paper, 3.4.1).

A voxel takes the label of the nearest voxel of the frame before. The regions of skin color that
were the face and the hands stay face and hands. Each segment keeps its largest region. Then the
segment that lost most of its share of the volume takes neighboring voxels, until no segment is
below its share at t = 0.

The paper leaves some things open. Here a share is reached to within a tolerance; of a ring of
neighbors a segment takes only as many voxels as it wants, evenly along the ring; and the number of
rings is bounded, for shares need not be reachable.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Lt
from numpy.typing import NDArray

from tasks.body.labels.nearest import copy_nearest
from tasks.body.labels.regions import clean_labels
from tasks.engine.kernels import njit
from tasks.engine.settings import CountOrNone, NotNegative, Positive, check_ranges
from tasks.geometry.voxel_lines import FIRST, LENGTH, VoxelLines, X, Y, Z

_IN_RING = np.uint8(1)
"""Mark of a voxel that is in the ring."""

_ENCLOSED = np.uint8(2)
"""Mark of a voxel that no other label is beside."""

_LEFT = np.uint8(4)
"""Mark of a voxel that has no more its first label."""


@dataclass(frozen=True)
class ProvisionalSettings:
    """Everything that changes a provisional label.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    volume_tolerance: Annotated[float, Ge(0), Lt(1)] = 0.03
    """How far below its share of the volume a segment may stay [share of that share]. As much as
    voxels of 1 cm can tell of a hand."""

    most_rings: CountOrNone = 20
    """Rings that are added to segments at most. Under cloth the more rings there are the more
    labels are wrong: of a kimono 4 % after none, 8 % after 20, 18 % after 100."""

    most_rings_of_paper: CountOrNone = 400
    """Rings that are added at most by the method `paper`. The paper repeats until the shares
    converge; shares that cannot be reached together never do. With 0, 40, 120 and 400 the paper's
    chain labels .59, .66, .72 and .77 of a fitting costume right, of a kimono .35, .29, .48 and
    .40."""

    skin_speed: Positive = 5.0
    """How fast a hand or the face moves at most [statures a second]. As fast as a punch."""

    least_skin_m2: NotNegative = 0.0012
    """Smallest region of skin that counts. A fifth of the back of a hand."""

    keep: bool = True
    """Whether provisional labels are made for the archive. The method `joint` reads none: without
    them a take is digitized in a tenth less processor time."""

    def __post_init__(self) -> None:
        check_ranges(self)

    def reach_m(self, stature_m: float, rate_hz: float) -> float:
        """Return how far skin moves from frame to frame at most, m."""
        return self.skin_speed * stature_m / rate_hz


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
    """Return labels that grew, the most shrunken first, until no segment is below its share.

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
    """Give rings of neighbors to the segment furthest below its share, until none is below."""
    enough, most_rings = limits
    stretch, count = _find_stretches(label, lines)
    wanted = share * (len(label) - count[0])
    worst = _most_shrunken(count, wanted, enough)
    if worst < 0:
        return
    box, place, step = _paint(label, lines)
    stretch, begin = _sort_by_label(stretch, place, lines)
    marks = np.zeros(len(box), np.uint8)
    ring = np.empty(len(label), np.int32)
    room = np.zeros(len(share) + 1, np.int64)
    for s in range(len(share)):
        room[s + 1] = room[s] + max(np.int64(np.ceil(wanted[s])), 0)
    gained, gains = np.empty(room[-1], np.int32), np.full(len(share), -1, np.int64)
    for _ in range(most_rings):
        own = worst + 1
        mine = stretch[begin[own] : begin[own + 1]]
        if gains[worst] < 0:
            gains[worst] = 0
            _mark_enclosed(box, step, own, mine, marks)
        size = _find_ring(box, step, mine, ring, marks)
        member = gained[room[worst] : room[worst + 1]]
        kept, size = _add_gained(box, step, own, (member, gains[worst]), (ring, size), marks)
        for n in range(size):
            marks[ring[n]] &= _ENCLOSED | _LEFT
        taken = min(size, np.int64(np.ceil(wanted[worst])) - count[own])
        for n in range(taken):
            member[kept + n] = ring[n * size // taken]
        _take(box, step, own, member[kept : kept + taken], count, marks)
        gains[worst] = kept + taken
        worst = _most_shrunken(count, wanted, enough)
        if not size or worst < 0:
            break
    _read(box, place, lines, label)


@njit(cache=True, nogil=True, inline="always")
def _find_stretches(label: Any, lines: Any) -> Any:
    """Return line, first voxel, end and label of each stretch, and the voxels of each label."""
    turn = np.empty(len(label) + 1, np.int32)  # voxels with another label than the one before
    turns = 0
    for n in range(1, len(label)):
        turn[turns] = n  # without a branch: one in twelve is kept
        turns += label[n] != label[n - 1]
    turn[turns] = len(label)
    stretch, count = np.empty((len(lines) + turns, 4), np.int32), np.zeros(256, np.int64)
    s = t = 0
    for line in range(len(lines)):
        n = lines[line, FIRST]
        end = n + lines[line, LENGTH]
        while n < end:
            begin, n = n, min(turn[t], end)
            t += turn[t] == n
            stretch[s, 0], stretch[s, 1], stretch[s, 2] = line, begin, n
            stretch[s, 3] = label[begin]
            count[label[begin]] += n - begin
            s += 1
    return stretch[:s], count


@njit(cache=True, nogil=True, inline="always")
def _sort_by_label(stretch: Any, place: Any, lines: Any) -> Any:
    """Return place and length of each stretch in the box, and where those of each label begin."""
    begin = np.zeros(257, np.int64)
    for s in range(len(stretch)):
        begin[stretch[s, 3] + 1] += 1
    begin = np.cumsum(begin)
    after = begin.copy()
    ordered = np.empty((len(stretch), 2), np.int32)
    for s in range(len(stretch)):
        line, first, end, label = stretch[s, 0], stretch[s, 1], stretch[s, 2], stretch[s, 3]
        n = after[label]
        after[label] += 1
        ordered[n, 0], ordered[n, 1] = place[line] + first - lines[line, FIRST], end - first
    return ordered, begin


@njit(cache=True, nogil=True, inline="always")
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


@njit(cache=True, nogil=True, inline="always")
def _read(box: Any, place: Any, lines: Any, label: Any) -> None:
    """Write the labels of a box."""
    for line in range(len(lines)):
        for k in range(lines[line, LENGTH]):
            label[lines[line, FIRST] + k] = box[place[line] + k]


@njit(cache=True, nogil=True, inline="always")
def _mark_enclosed(box: Any, step: Any, own: Any, stretch: Any, marks: Any) -> None:
    """Mark the voxels of the stretches of a label that are beside no other label."""
    deep, wide, own = step[3], step[5], np.uint8(own)
    for s in range(len(stretch)):
        for n in range(stretch[s, 0], stretch[s, 0] + stretch[s, 1]):
            between = (box[n - 1] == own) | (box[n - 1] == 0)
            between &= (box[n + 1] == own) | (box[n + 1] == 0)
            between &= (box[n - deep] == own) | (box[n - deep] == 0)
            between &= (box[n + deep] == own) | (box[n + deep] == 0)
            between &= (box[n - wide] == own) | (box[n - wide] == 0)
            between &= (box[n + wide] == own) | (box[n + wide] == 0)
            marks[n] |= _ENCLOSED * between


@njit(cache=True, nogil=True)
def _most_shrunken(count: Any, wanted: Any, enough: Any) -> Any:
    """Return the segment furthest below its share, or -1 where all have enough of it."""
    least, worst = enough, -1
    for k in range(len(wanted)):
        if count[k + 1] < least * wanted[k]:
            least, worst = count[k + 1] / wanted[k], k
    return worst


@njit(cache=True, nogil=True, inline="always")
def _find_ring(box: Any, step: Any, stretch: Any, ring: Any, marks: Any) -> Any:
    """Write the voxels beside what a label has left of its stretches; return how many they are."""
    size = np.int64(0)
    for s in range(len(stretch)):
        begin, end = stretch[s, 0], stretch[s, 0] + stretch[s, 1]
        is_open = np.uint8(0)
        for n in range(begin, end):
            is_open |= (marks[n] & (_ENCLOSED | _LEFT)) == 0
        if is_open:
            for n in range(begin, end):
                if marks[n] & (_ENCLOSED | _LEFT) == 0:
                    size = _add_beside(box, step, n, ring, size, marks)
    return size


@njit(cache=True, nogil=True, inline="always")
def _add_gained(box: Any, step: Any, own: Any, gained: Any, ring: Any, marks: Any) -> Any:
    """Write the voxels beside those that a label gained; return how many it kept and the ring's."""
    member, end = gained
    voxels, size = ring
    kept = 0
    for m in range(end):
        voxel = np.int64(member[m])
        if box[voxel] == own:  # was not taken since
            member[kept] = voxel
            kept += 1
            if not marks[voxel] & _ENCLOSED:
                size = _add_beside(box, step, voxel, voxels, size, marks)
    return kept, size


@njit(cache=True, nogil=True)
def _add_beside(box: Any, step: Any, voxel: Any, ring: Any, size: Any, marks: Any) -> Any:
    """Write the neighbors of a voxel with other labels into the ring; return its size."""
    own = box[voxel]
    marks[voxel] |= _ENCLOSED
    for k in range(6):
        other = voxel + step[k]
        if box[other] and box[other] != own:
            marks[voxel] &= _IN_RING | _LEFT
            if not marks[other] & _IN_RING:
                marks[other] |= _IN_RING
                ring[size] = other
                size += 1
    return size


@njit(cache=True, nogil=True, inline="always")
def _take(box: Any, step: Any, own: Any, taken: Any, count: Any, marks: Any) -> None:
    """Give voxels to a label, and forget of those beside them whether they are enclosed."""
    for voxel in taken:
        count[box[voxel]] -= 1
        box[voxel] = own
        marks[voxel] |= _LEFT
        for k in range(6):
            marks[voxel + step[k]] &= _IN_RING | _LEFT
    count[own] += len(taken)
