"""Tell right limbs from left ones where they wear different colors.

A sleeve of another color, or a bare arm, tells two arms apart after they crossed. What each side
wears is learned from the poses of the whole take, of which most have it right; light from one side
is no mark of a side, so lightness is not asked. Where colors are on the wrong sides for a while,
the limbs are exchanged, if the voxels are about as likely then.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tasks.body.anatomy.bones import Floats, place_bones
from tasks.body.anatomy.colors import SHAPE, SPREAD, log_ratio
from tasks.body.blobs.fitting import Fit
from tasks.body.poses.limbs import LIMBS
from tasks.body.poses.passes import Fitting
from tasks.body.poses.sides import fit_exchanged
from tasks.engine.threads import side_by_side
from tasks.geometry.runs import runs
from tasks.geometry.voxels import voxel_centers

_OWN = 0.045
"""How near the line of a forearm or shank its voxels are [statures]. Three quarters of a thigh's
thickness; chosen, not measured."""

_AROUND_S = 1.0
"""How long before and after a frame colors are not learned for it [s]. A limb that is exchanged
there would vouch for itself; chosen, not measured."""

_MOMENT_S = 0.1
"""How far before and after a frame its colors are averaged [s]. As doubt is."""

_MOST_TOLD = 2.0
"""What a color tells at most [nats]. One that was seen on one side only may be a shadow's."""

_TELLING = 0.25
"""What the colors of a frame tell of its sides where sides are asked [nats, median of a take]. Of
rendered captures it was .5 to 1.3 where sleeves or legs had different colors, and .05 at most in
nearly all where they had not."""

_SURELY = -0.3
"""Marks below which limbs are exchanged [shares of the median]. In a rendered child that exchanged
its arms and legs they were -.4 to -1.7, and .2 or more in nearly all frames that were right."""

_LEAST_S = 0.1
"""How long that must be so at least [s]. An exchange that is over sooner is none."""

_WORSE = 0.06
"""By how much voxels may become less likely [mean logarithm of their likelihoods]. As much as the
other way round is worse where it is hardly believed (`evidence`)."""

_NOT_SO = -1.0
"""How much likelier limbs are exchanged that wear what their sides do [mean logarithm of the
likelihoods of voxels]. It is far below all that others told."""

_CHROMAS = SHAPE[0] * SHAPE[1]


def exchange_by_colors(
    take: Fitting, fits: Sequence[Fit], gains: Floats, initial_frame: int
) -> tuple[Fitting, list[Fit], Floats]:
    """Return the fits with limbs exchanged where their colors are on the wrong sides.

    Parameters
    ----------
    take
        The take that was fitted.
    fits
        The fits of its frames.
    gains : (time, 2) float64
        How much likelier arms, or legs, would be exchanged, as of `tell_sides`.
    initial_frame
        Here the sides are right.

    Returns
    -------
    take
        As given, with the cues of hands and feet exchanged where the limbs were.
    fits : list of Fit
    gains : (time, 2) float64
        As given, turned round where limbs were exchanged; of those that surely wear what their
        sides do -1, of those that do not 0 at least.
    """
    kept, gains = list(fits), gains.copy()
    least = max(2, round(_LEAST_S * take.rate_hz))
    for pair in range(2):
        mark, exchanged = _mark(take, kept, pair, initial_frame), False
        for first, last in runs(mark < 0.0):
            if last - first < least or mark[first:last].min() > _SURELY:
                continue
            tried = fit_exchanged(take, kept, pair, (first, last))
            if tried is None:
                continue
            crossed, other = tried
            gain = np.mean([fit.likelihood for fit in other])
            gain -= np.mean([fit.likelihood for fit in kept[first:last]])
            if gain > -_WORSE:
                take, exchanged = crossed, True
                kept[first:last] = other
                gains[first:last, pair] = -gain
        if exchanged:
            mark = _mark(take, kept, pair, initial_frame)
        right, wrong = mark > -_SURELY, mark < _SURELY
        gains[right, pair] = np.minimum(gains[right, pair], _NOT_SO)
        gains[wrong, pair] = np.maximum(gains[wrong, pair], 0.0)
    return take, kept, gains


def _mark(take: Fitting, fits: Sequence[Fit], pair: int, initial_frame: int) -> Floats:
    """Return the marks of a pair, with those of the initial frame for right.

    Where this frame is marked wrong, but those around it are not, colors contradict themselves and
    tell nothing: one frame is no reason to exchange all others.
    """
    mark = mark_sides(take, fits, pair)
    if mark[initial_frame] >= _SURELY:
        return mark
    around = round(_AROUND_S * take.rate_hz)
    begun = mark[max(0, initial_frame - around) : initial_frame + around + 1]
    return -mark if np.median(begun) < _SURELY else np.zeros_like(mark)


def mark_sides(take: Fitting, fits: Sequence[Fit], pair: int) -> Floats:
    """Return (time,) what colors say of the sides of arms (pair 0) or legs (pair 1).

    Returns
    -------
    (time,) float64
        1 where each side wears what it usually does, -1 where it wears what the other one does; 0
        throughout where both sides wear the same.
    """
    limbs = LIMBS[2 * pair : 2 * pair + 2]

    def worn(t: int) -> list[NDArray[np.integer]]:
        joints = place_bones(fits[t].pose, take.model.origin)
        index, cell = take.samples[t]
        own = cell >= 0
        points, chroma = voxel_centers(take.grid, index[own]), cell[own] // SHAPE[2]
        away = [_from_line(points, joints[limb.lower], joints[limb.end]) for limb in limbs]
        near = np.minimum(*away) < _OWN * take.model.stature
        return [chroma[near & (away[0] < away[1])], chroma[near & (away[1] < away[0])]]

    chromas = side_by_side(worn, range(take.frames))
    told = _tell(chromas, max(1, round(_AROUND_S * take.rate_hz)))
    usual = float(np.median(told))
    if usual < _TELLING:
        return np.zeros(take.frames)
    moment = 2 * max(1, round(_MOMENT_S * take.rate_hz)) + 1
    return ndimage.uniform_filter1d(told, moment, mode="nearest") / usual


def _tell(chromas: Sequence[Sequence[NDArray[np.integer]]], around: int) -> Floats:
    """Return (time,) how much likelier colors are of their sides than of the others' [nats].

    What is worn is learned from frames that are farther than `around` frames.
    """
    frames = len(chromas)
    count = np.array(
        [[np.bincount(_all(chromas[first : first + around], side), minlength=_CHROMAS)
          for side in range(2)] for first in range(0, frames, around)]
    )  # fmt: skip
    total, told = count.sum(axis=0), np.zeros(frames)
    for block, first in enumerate(range(0, frames, around)):
        others = total - count[max(block - 1, 0) : block + 2].sum(axis=0)
        worn = others.reshape(2, *SHAPE[:2]).astype(np.float64)
        spread = [ndimage.gaussian_filter(side, SPREAD).reshape(-1) for side in worn]
        ratio = log_ratio(*spread).clip(-_MOST_TOLD, _MOST_TOLD)
        for t in range(first, min(first + around, frames)):
            right, left = chromas[t]
            if len(right) + len(left):
                told[t] = (ratio[right].sum() - ratio[left].sum()) / (len(right) + len(left))
    return told


def _all(chromas: Sequence[Sequence[NDArray[np.integer]]], side: int) -> NDArray[np.integer]:
    """Return the colors of a side in some frames."""
    return np.concatenate([each[side] for each in chromas])


def _from_line(point: Floats, start: Floats, end: Floats) -> Floats:
    """Return (point,) how far points (point, 3) are from the line between two others."""
    line = end - start
    share = np.clip((point - start) @ line / max(float(line @ line), 1e-12), 0.0, 1.0)
    return np.linalg.norm(point - start - share[:, None] * line, axis=1)
