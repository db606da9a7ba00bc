"""Measure the stretched arms of a performer on a hull.

The digitization paper (section 3.3) lets a person begin with the arms stretched sideways and says
no more about how the first labels are found. Here the shape tells lengths where it shows them (tips
of the hands, line of the arms, top of the head), and the proportions of a body tell them where
clothes hide it. Points are metres with y up.
"""

from dataclasses import dataclass, replace

import numpy as np

from tasks.body.anatomy.proportions import (
    LEAST_REACH,
    LEAST_SPAN,
    NECK_SHARE,
    SHOULDER_SHARE,
    SPAN_PER_STATURE,
    USUAL_REACH,
    Points,
)

SLEEVE_REACH = 0.87
"""Where a sleeve that hides the hand ends [half spans]. Between wrist and knuckles; chosen by eye
on the shared captures, not measured."""

SLOPE_SPREAD = 0.05
"""Tangent of the angle that an arm usually has from straight sideways, when somebody is asked to
stretch it. Chosen by eye on the shared captures; not measured."""

TIP_INSIDE = 0.035
"""How far a finger's tip joint lies inside the hull's end [half spans]. 2.5 cm: a finger's radius,
and what a hull of pixels of 1 cm is too long."""

TIP_LAYER = 2.5
"""How far from the outermost voxel a voxel still is a finger tip's [voxels]. Chosen by eye on the
shared captures; not measured."""

UPPER_SHARE = 0.45
"""Height of the upper part of a body in which arms are looked for [share of its height]. Chosen by
eye on the shared captures; not measured."""

FAR_SHARE = 0.6
"""How far from the middle, seen from above, the voxels are that tell the arms' direction at first
[share of the farthest]. Chosen by eye on the shared captures; not measured."""

HEAD_ASIDE = 0.2
"""How far beside the middle a voxel of the head is at most [half spans]. Chosen by eye on the
shared captures; not measured."""

HEAD_AHEAD = 0.35
"""How far before or behind the middle a voxel of the head is at most [half spans]. Chosen by eye on
the shared captures; not measured."""

NECK_ASIDE = 0.12
"""How far beside the neck's middle a voxel of the neck is at most [half spans]. Chosen by eye on
the shared captures; not measured."""

NECK_TALL = 0.1
"""How far above and below the neck's height a voxel of the neck is at most [heights of the head
above the arms' line]. Chosen by eye on the shared captures; not measured."""

ABOVE_ASIDE = 0.3
"""How far beside the middle of the span the voxels above the arms are at most of which head and
neck are [half spans]. Chosen by eye on the shared captures; not measured."""

ABOVE_AROUND = 0.45
"""How far from the middle of the span, seen from above, these voxels are at most [half spans].
Chosen by eye on the shared captures; not measured."""

ABOVE_LEAST = 0.06
"""How far above the finger tips these voxels are at least [half spans]. Chosen by eye on the shared
captures; not measured."""

THICKEST = 0.055
"""How thick an arm is at most where it is told from hanging cloth [statures]. Chosen by eye on the
shared captures; not measured."""

ARM_BEGINS = 0.30
"""Where slabs of an arm are cut from, away from the trunk [half spans]. Chosen by eye on the shared
captures; not measured."""

HAND_BEGINS = 0.92
"""Where the slabs begin that show whether an arm ends in a hand [half spans]. Chosen by eye on the
shared captures; not measured."""

MOST_HIDDEN = 0.02
"""How much of an arm's end may be hidden in cloth if its hand shows [half spans]. Chosen by eye on
the shared captures; not measured."""

FIRST_WEIGHT = 100.0
"""Weight that every slab has when an arm's line is fitted first [1 / m]. As of a slab that is 1 cm
off."""

LEAST_OFF_M = 0.002
"""Distance from an arm's line below which a slab weighs no more. Chosen by eye on the shared
captures; not measured."""

LINE_SPREAD = 0.1
"""How little a slab says against the usual slope of an arm [square roots of m]. Chosen by eye on
the shared captures; not measured."""


@dataclass(frozen=True, eq=False)
class Arms:
    """Two arms and the directions they give."""

    left: Points
    """(3,) horizontal unit vector along the arms, towards the left hand once the facing is
    known."""
    middle: Points
    """(3,) where the neck is between the verticals of the finger tips, at the height of these."""
    half_span_m: float
    reach_m: Points
    """(2,) from the middle's vertical to that of each finger tip. A bent arm reaches less far."""
    tip: Points
    """(2, 3) the finger tips, first the one that is against `left`."""
    line: Points
    """(2, 2, 2) for each side height and place forward, each as its value at the middle and
    slope."""
    slope: float
    """Tangent of the steepest of the lines; 0 where both arms are straight sideways."""
    rough_m: float
    """Typical distance of the arms' bare parts from their lines."""
    thin: float
    """Share of an arm's length that shows an arm and no hanging cloth; of both arms the less."""
    has_hands: bool
    """Whether both arms end in something as thin as a hand."""

    @property
    def front(self) -> Points:
        """(3,) unit vector, horizontal."""
        return np.cross(self.left, [0.0, 1.0, 0.0])

    def along(self, side: int, share: float) -> Points:
        """Return the point (3,) of an arm's line at a share of half the span from the middle.

        An arm that reaches less far than half the span is shorter everywhere beyond its shoulder.
        """
        aside = share * self.half_span_m
        if share > SHOULDER_SHARE:
            arm = self.reach_m[side] - SHOULDER_SHARE * self.half_span_m
            aside = self.reach_m[side] - arm * (1.0 - share) / (1.0 - SHOULDER_SHARE)
        height, ahead = (value + slope * aside for value, slope in self.line[side])
        base = self.middle * [1.0, 0.0, 1.0] + (2 * side - 1) * aside * self.left
        return base + ahead * self.front + [0.0, height, 0.0]

    def turned(self) -> "Arms":
        """Return the same arms of somebody who faces the other way."""
        line = self.line[::-1].copy()
        line[:, 1] *= -1.0
        reach = self.reach_m[::-1].copy()
        return replace(self, left=-self.left, tip=self.tip[::-1].copy(), line=line, reach_m=reach)


def measure_arms(point: Points, voxel_m: float) -> Arms | None:
    """Return the arms of (voxel, 3) points, or None where nothing reaches to two sides."""
    low, high = point[:, 1].min(), point[:, 1].max()
    upper = point[point[:, 1] > low + (1.0 - UPPER_SHARE) * (high - low)]
    if not len(upper):  # flat
        return None
    middle = np.median(upper, axis=0)
    flat = (upper - middle)[:, [0, 2]]
    reach = np.hypot(*flat.T)
    far = flat[reach > FAR_SHARE * reach.max()]
    if len(far) < 2:
        return None
    axis = np.linalg.eigh(far.T @ far)[1][:, 1]
    axis = axis * (1.0 if axis[np.argmax(abs(axis))] > 0 else -1.0)
    left = np.array([axis[0], 0.0, axis[1]])
    tip = np.empty((2, 3))
    for _ in range(4):
        aside = (upper - middle) @ left
        tip[0] = upper[aside < aside.min() + TIP_LAYER * voxel_m].mean(axis=0)
        tip[1] = upper[aside > aside.max() - TIP_LAYER * voxel_m].mean(axis=0)
        across = (tip[1] - tip[0]) * [1.0, 0.0, 1.0]
        if np.linalg.norm(across) < 4 * voxel_m:
            return None
        left = across / np.linalg.norm(across)
    aside = upper @ left
    half = float(aside.max() - aside.min() + voxel_m) / 2.0
    middle = tip.mean(axis=0)
    middle += ((aside.max() + aside.min()) / 2.0 - middle @ left) * left
    middle += _find_neck(upper - middle, left, half) * left
    reach = np.array([middle @ left - aside.min(), aside.max() - middle @ left]) + voxel_m / 2
    line, slope, rough, thin, has_hands = _fit_arms(upper, middle, left, half, voxel_m)
    ends = np.array([aside.min(), aside.max()]) - tip @ left
    ends += np.array([1.0, -1.0]) * TIP_INSIDE * half
    tip = tip + ends[:, None] * left
    return Arms(left, middle, half, reach, tip, line, slope, rough, thin, has_hands)


def _find_neck(away: Points, left: Points, half: float) -> float:
    """Return how far along `left` the neck is from the middle of the span, m.

    The neck is below the head, between the shoulders' slopes. `away` are points (voxel, 3) from the
    middle of the span.
    """
    aside, height = away @ left, away[:, 1]
    above = abs(aside) < ABOVE_ASIDE * half
    above &= np.hypot(away[:, 0], away[:, 2]) < ABOVE_AROUND * half
    above &= height > ABOVE_LEAST * half
    if not above.any():
        return 0.0
    top = height[above].max()
    place = float(aside[above & (height > 0.5 * top)].mean())
    slab = above & (abs(height - NECK_SHARE * top) < NECK_TALL * top)
    for _ in range(3):
        near = slab & (abs(aside - place) < NECK_ASIDE * half)
        if not near.any():
            break
        place = float(aside[near].mean())
    return place


def _fit_arms(
    upper: Points, middle: Points, left: Points, half: float, voxel_m: float
) -> tuple[Points, float, float, float, bool]:
    """Return the arms' lines, steepest slope, roughness and bare share, and whether hands show."""
    front = np.cross(left, [0.0, 1.0, 0.0])
    aside, ahead = (upper - middle) @ left, (upper - middle) @ front
    thickest = THICKEST * max(2.0 * half, float(np.ptp(upper[:, 1])) / UPPER_SHARE)
    lines, slopes, roughs, thins = np.zeros((2, 2, 2)), [0.0], [0.0], []
    bare = []
    for side in range(2):
        out = (2 * side - 1) * aside
        slab = np.floor(out / voxel_m).astype(int)
        first, last = int(ARM_BEGINS * half / voxel_m), int(half / voxel_m)
        order = np.argsort(slab, kind="stable")
        begins = np.searchsorted(slab[order], np.arange(first, last + 1))
        found, hidden = [], 0
        for number, begin, end in zip(range(first, last), begins, begins[1:], strict=False):
            if end - begin < 4:
                continue
            here = order[begin:end]
            height = upper[here, 1]
            low, high = np.percentile(height, [2, 98])
            if high - low < thickest:
                found.append([(number + 0.5) * voxel_m, (low + high) / 2, np.mean(ahead[here])])
            elif number > HAND_BEGINS * last:
                hidden += 1
        thins.append(len(found) / max(last - first, 1))
        bare.append(hidden < MOST_HIDDEN * last)
        if len(found) < 6:
            lines[side] = [[middle[1], 0.0], [0.0, 0.0]]
            roughs.append(half)
            continue
        table = np.array(found)
        for axis in range(2):
            lines[side, axis], rough = _fit_line(table[:, 0], table[:, 1 + axis])
            roughs.append(rough)
            slopes.append(abs(lines[side, axis, 1]))
    return lines, float(max(slopes)), float(max(roughs)), float(min(thins)), all(bare)


def _fit_line(x: Points, y: Points) -> tuple[Points, float]:
    """Return value and slope of the line of least absolute distances, and the median distance."""
    design = np.stack([np.ones(len(x)), x], axis=1)
    weight, line = np.full(len(x), FIRST_WEIGHT), np.zeros(2)
    level = [[0.0, 1.0 / SLOPE_SPREAD]]  # few slabs say little about a slope: near 0, then
    for _ in range(12):
        root = np.sqrt(weight) / LINE_SPREAD
        rows = np.concatenate([design * root[:, None], level])
        line[:] = np.linalg.lstsq(rows, np.append(y * root, 0.0), rcond=None)[0]
        weight = 1.0 / np.maximum(abs(y - design @ line), LEAST_OFF_M)
    return line, float(np.median(abs(y - design @ line)))


def reach_of_head(point: Points, arms: Arms) -> float:
    """Return half the span over the height of the head above the arms (see `USUAL_REACH`)."""
    aside, ahead = (point - arms.middle) @ arms.left, (point - arms.middle) @ arms.front
    near = abs(aside) < HEAD_ASIDE * arms.half_span_m
    near &= abs(ahead) < HEAD_AHEAD * arms.half_span_m
    above = float(point[near, 1].max() - arms.middle[1]) if near.any() else 0.0
    return arms.half_span_m / max(above, 1e-6)


def missing_reach(point: Points, arms: Arms) -> float:
    """Return by what factor lost hands lengthen half the span; 1 where none are lost.

    The arms have to be short beside the head and beside the height: a child's head is large, and
    who crouches is not high.
    """
    reach, span = reach_of_head(point, arms), 2.0 * arms.half_span_m / np.ptp(point[:, 1])
    longer = 1.0
    if reach < LEAST_REACH and span < LEAST_SPAN:
        longer = min(USUAL_REACH / reach, SPAN_PER_STATURE / span)
    return longer if arms.has_hands else max(longer, 1.0 / SLEEVE_REACH)


def lengthen_arms(arms: Arms, half_span_m: float) -> Arms:
    """Return the arms with the hands that the hull has lost put in on the arms' lines."""
    reach = arms.reach_m * half_span_m / arms.half_span_m
    longer = replace(arms, half_span_m=half_span_m, reach_m=reach)
    tip = np.stack([longer.along(side, 1.0 - TIP_INSIDE) for side in range(2)])
    return replace(longer, tip=tip)
