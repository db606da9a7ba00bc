"""Read the arms-stretched shape of a performer off a hull: arms, head and trunk.

The digitization paper (section 3.3) lets a person begin with the arms stretched sideways and
says no more about how the first labels are found. Here lengths come from the shape where it
shows them (tips of the hands, line of the arms, top of the head, feet) and from published
proportions of the body where clothes hide it (Drillis and Contini 1966, as printed in Winter,
Biomechanics and Motor Control of Human Movement), widened by what rigs of motion capture have.
Points are metres with y up.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

USUAL_REACH, LEAST_REACH = 2.4, 2.1
"""Half the span over the height of the head above the arms, usual, and least with both hands:
2.85 by Drillis and Contini to the collar bone's outer end, 2.2 to 2.7 from the arms' line."""
SLEEVE_REACH = 0.87
"""Where a sleeve that hides the hand ends, in half spans: between wrist and knuckles."""
SLOPE_SPREAD = 0.05
"""Usual tangent of an arm from straight sideways, when somebody is asked to stretch it."""
SHOULDER_SHARE = 0.20
"""Shoulder from the middle, in half spans: 0.23 by Drillis and Contini for the outer end of the
collar bone, whose joint is farther in; rigs of motion capture have 0.15 to 0.22."""
UPPER_ARM_SHARE, FOREARM_SHARE = 0.40, 0.37
"""Of the arm from shoulder to finger tip; 0.423 and 0.332 by Drillis and Contini to a stretched
finger, 0.38 to 0.42 and 0.35 to 0.40 in rigs."""
SPAN_PER_STATURE = 1.03
"""Arm span over stature; the arms are stretched, the knees need not be."""
HEAD_ABOVE_ARMS = 0.20
"""Top of the head over the line of stretched arms, in statures: 0.182 by Drillis and Contini to
the shoulders' upper ends; with the span it tells the stature of somebody who crouches."""
NECK_SHARE = 0.25
"""Base of the neck above the line of the arms, of what the top of the head is above it: where the
shoulders' slopes meet the neck."""
HIPS_BELOW_TOP = 0.495
"""From the top of the head to the middle of the hips, in statures: 0.470 by Drillis and Contini
to the bone beside the joint, which is 0.02 higher; 0.48 to 0.51 in rigs."""
TIP_INSIDE = 0.035
"""How far a finger's tip joint lies inside the hull's end, in half spans: 2.5 cm, a finger's radius
and what a hull of pixels of 1 cm is too long."""
HIPS_SPREAD = 0.02
"""How far the hips of a body in its pose usually are from there."""
HIPS_ABOVE_FORK = 0.075
"""From where the hull's legs meet to the middle of the hips, in statures: the hip joint is 0.035
above the crotch (0.51 by De Leva 1996, 0.475 in the ANSUR survey of 1988), and a hull is closed by
some 6 cm of cloth and of what no camera sees between two thighs."""
HIGHER_SPREAD, HIGHER_WITHIN = 0.012, 0.07
"""How much that differs for a fork that is higher than usual, and how much higher one may be."""
LOWER_SPREAD, LOWER_WITHIN = 0.02, 0.05
"""The same for a lower one: thighs may touch, trousers hang, and what is lower is a skirt's hem."""
WAIST_SHARE = 0.56
"""Where the loins begin, from the base of the neck to the hips."""
HIP_SHARE = 0.0575
"""Hip joint from the middle, in statures: 0.096 by Drillis and Contini is half the width over
the bones; the joint centers are 0.05 to 0.06 (Bell et al. 1989)."""


@dataclass(frozen=True, eq=False)
class Arms:
    """Two arms and the directions they give."""

    left: Points
    """(3,) unit vector, horizontal; towards the left hand once the facing is known."""
    middle: Points
    """(3,) where the neck is between the finger tips' verticals, at the height of the tips."""
    half_span_m: float
    reach_m: Points
    """(2,) from the middle's vertical to that of each finger tip; unequal if an arm is bent."""
    tip: Points
    """(2, 3) finger tips: against `left`, then along it."""
    line: Points
    """(2, 2, 2) a side: height and place forward, each as value at the middle and slope."""
    slope: float
    """The steepest of the lines, as tangent: 0 where both arms are straight sideways."""
    rough_m: float
    """Typical distance of the arms' thin parts from their lines."""
    thin: float
    """Share of an arm's length that shows an arm and no hanging cloth, the smaller side's."""
    has_hands: bool
    """Whether both arms end in something as thin as a hand."""

    @property
    def front(self) -> Points:
        """(3,) unit vector, horizontal."""
        return np.cross(self.left, [0.0, 1.0, 0.0])

    def along(self, side: int, share: float) -> Points:
        """Return the point (3,) of an arm's line that is so many half spans from the middle.

        Beyond the shoulder what an arm falls short of half a span is missing everywhere alike.
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
    upper = point[point[:, 1] > low + 0.55 * (high - low)]
    if not len(upper):  # flat
        return None
    middle = np.median(upper, axis=0)
    flat = (upper - middle)[:, [0, 2]]
    reach = np.hypot(*flat.T)
    far = flat[reach > 0.6 * reach.max()]
    if len(far) < 2:
        return None
    axis = np.linalg.eigh(far.T @ far)[1][:, 1]
    axis = axis * (1.0 if axis[np.argmax(abs(axis))] > 0 else -1.0)
    left = np.array([axis[0], 0.0, axis[1]])
    tip = np.empty((2, 3))
    for _ in range(4):
        aside = (upper - middle) @ left
        tip[0] = upper[aside < aside.min() + 2.5 * voxel_m].mean(axis=0)
        tip[1] = upper[aside > aside.max() - 2.5 * voxel_m].mean(axis=0)
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

    `away` are points (voxel, 3) from there. Below the head, between the shoulders' slopes.
    """
    aside, height = away @ left, away[:, 1]
    above = (abs(aside) < 0.3 * half) & (np.hypot(away[:, 0], away[:, 2]) < 0.45 * half)
    above &= height > 0.06 * half
    if not above.any():
        return 0.0
    top = height[above].max()
    place = float(aside[above & (height > 0.5 * top)].mean())
    slab = above & (abs(height - NECK_SHARE * top) < 0.1 * top)
    for _ in range(3):
        near = slab & (abs(aside - place) < 0.12 * half)
        if not near.any():
            break
        place = float(aside[near].mean())
    return place


def _fit_arms(
    upper: Points, middle: Points, left: Points, half: float, voxel_m: float
) -> tuple[Points, float, float, float, bool]:
    """Return the lines of both arms, steepest slope, roughness, thin share, if hands show."""
    front = np.cross(left, [0.0, 1.0, 0.0])
    aside, ahead = (upper - middle) @ left, (upper - middle) @ front
    thickest = 0.055 * max(2.0 * half, float(np.ptp(upper[:, 1])) / 0.45)
    lines, slopes, roughs, thins = np.zeros((2, 2, 2)), [0.0], [0.0], []
    bare = []
    for side in range(2):
        out = (2 * side - 1) * aside
        slab = np.floor(out / voxel_m).astype(int)
        first, last = int(0.30 * half / voxel_m), int(half / voxel_m)
        found, hidden = [], 0
        for number in range(first, last):
            here = slab == number
            if here.sum() < 4:
                continue
            height = upper[here, 1]
            low, high = np.percentile(height, [2, 98])
            if high - low < thickest:
                found.append([(number + 0.5) * voxel_m, (low + high) / 2, np.mean(ahead[here])])
            elif number > 0.92 * last:
                hidden += 1
        thins.append(len(found) / max(last - first, 1))
        bare.append(hidden < 0.02 * last)
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
    """Return value and slope of the line of least absolute distances, and their median."""
    design = np.stack([np.ones(len(x)), x], axis=1)
    weight, line = np.full(len(x), 100.0), np.zeros(2)
    level = [[0.0, 1.0 / SLOPE_SPREAD]]  # few slabs say little about a slope: near 0, then
    for _ in range(12):
        root = np.sqrt(weight) / 0.1
        rows = np.concatenate([design * root[:, None], level])
        line[:] = np.linalg.lstsq(rows, np.append(y * root, 0.0), rcond=None)[0]
        weight = 1.0 / np.maximum(abs(y - design @ line), 0.002)
    return line, float(np.median(abs(y - design @ line)))


def reach_of_head(point: Points, arms: Arms) -> float:
    """Return half the span over the height of the head above the arms: 2.2 to 2.7."""
    aside, ahead = (point - arms.middle) @ arms.left, (point - arms.middle) @ arms.front
    near = (abs(aside) < 0.2 * arms.half_span_m) & (abs(ahead) < 0.35 * arms.half_span_m)
    above = float(point[near, 1].max() - arms.middle[1]) if near.any() else 0.0
    return arms.half_span_m / max(above, 1e-6)


def missing_reach(point: Points, arms: Arms) -> float:
    """Return how many times as long half the span is with hands that the hull has lost; or 1."""
    reach = reach_of_head(point, arms)
    longer = USUAL_REACH / reach if reach < LEAST_REACH else 1.0
    return longer if arms.has_hands else max(longer, 1.0 / SLEEVE_REACH)


def lengthen_arms(arms: Arms, half_span_m: float) -> Arms:
    """Return the arms with hands that the hull has lost put in, on the arms' lines."""
    reach = arms.reach_m * half_span_m / arms.half_span_m
    longer = replace(arms, half_span_m=half_span_m, reach_m=reach)
    tip = np.stack([longer.along(side, 1.0 - TIP_INSIDE) for side in range(2)])
    return replace(longer, tip=tip)
