"""Fit doubtful stretches again with arms, or legs, exchanged, where that lowers the doubt.

After hands or knees met, the likelier way round is not always the true one: cloth decides it. What
else speaks against a limb, such as crossed knees or an elbow in the trunk, often tells.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from storage.schema import SEGMENTS
from tasks.body.doubt.evidence import gather_evidence
from tasks.body.doubt.probability import LIMB_SEGMENTS, tell_doubt
from tasks.body.extremities.candidates import Candidates
from tasks.body.poses.joint import Account, FittedPoses, describe_fits
from tasks.body.poses.sides import fit_exchanged
from tasks.geometry.runs import runs

_DOUBTED = 0.3
"""A stretch is fitted again where a segment of a pair has a greater doubt [probability]. So few
frames of a take are that it takes little time; chosen, not measured."""

_LEAST_S = 0.1
"""Stretches that are shorter stay as they are [s]. They are no exchange."""

_AROUND_S = 0.2
"""How far around a stretch its doubt is compared [s]. What is odd at its ends counts then."""

_BESIDE_S = 0.07
"""How far beyond its ends a stretch is exchanged [s]. Doubt begins a little late; chosen."""

_LEAST_GAIN = -0.01
"""How much likelier voxels must be the other way round, for it to be tried [mean logarithm of their
likelihoods]. Of 16 doubtful stretches of 30 rendered captures in which the voxels were up to 0.12
less likely that way, each lost more joints when it was exchanged. But between ways that are as
likely (`side_margin`) how hands went on decides, and doubt may take that back: in a rendered take
arms that passed each other within a frame were exchanged for two seconds."""

_LOWER = 0.1
"""By how much at least the doubt must fall [probability, mean over frames]. In twelve rendered
captures all five exchanges beyond it had more joints in their places after it."""

_WORSE = 0.02
"""By how much voxels may become less likely [mean logarithm of their likelihoods]. As `_LOWER`."""


def doubt_and_repair(
    fitted: FittedPoses, candidates: Sequence[Candidates]
) -> tuple[FittedPoses, NDArray[np.float32]]:
    """Return the poses of a take, arms or legs exchanged where that lowers the doubt, and it.

    Parameters
    ----------
    fitted
        The fitted take; it is returned as it is where nothing is exchanged.
    candidates
        Where hands could be in each frame.

    Returns
    -------
    fitted
        The poses.
    doubt : (time, 11) float32
        How likely each segment is in the wrong place, as of `tell_doubt`.
    """
    account, rate_hz = fitted.account, fitted.account.take.rate_hz
    whole = 0, account.take.frames
    doubt = _doubt_of(fitted, account, candidates, whole)
    changed = False
    for pair, stretch in _stretches(doubt, account.exchange_gains, rate_hz):
        other = _exchange(fitted, account, candidates, pair, stretch)
        changed |= other is not None
        account = other or account
    if not changed:
        return fitted, doubt
    repaired = describe_fits(account, fitted.unsure_sides, fitted.initial, fitted.model.origin)
    return repaired, _doubt_of(repaired, account, candidates, whole)


def _stretches(
    doubt: NDArray[np.float32], gains: NDArray[np.float64], rate_hz: float
) -> Iterator[tuple[int, tuple[int, int]]]:
    """Yield pairs, and stretches in which they are doubtful and could be exchanged."""
    for pair in range(2):
        names = [name for row in LIMB_SEGMENTS for name in row[2 * pair : 2 * pair + 2]]
        doubted = doubt[:, [SEGMENTS.index(name) for name in names]].max(axis=1) > _DOUBTED
        gain = gains[:, pair]  # NaN is neither
        could_be, worse = gain > _LEAST_GAIN, gain <= _LEAST_GAIN
        beside = round(_BESIDE_S * rate_hz)
        for first, last in runs(doubted & ~worse):
            if could_be[first:last].any() and last - first >= max(2, round(_LEAST_S * rate_hz)):
                around = range(max(0, first - beside), min(len(doubt), last + beside))
                own = [frame for frame in around if not worse[frame]]
                yield pair, (own[0], own[-1] + 1)


def _exchange(
    fitted: FittedPoses, account: Account, candidates: Sequence[Candidates], pair: int,
    stretch: tuple[int, int],
) -> Account | None:  # fmt: skip
    """Return the account with a pair exchanged in a stretch; None where that is no better."""
    first, last = stretch
    exchanged = fit_exchanged(account.take, account.fits, pair, stretch)
    if exchanged is None:
        return None
    take, fits = exchanged
    gain = np.mean([fit.likelihood for fit in fits])
    gain -= np.mean([fit.likelihood for fit in account.fits[first:last]])
    other = replace(account, take=take, fits=(*account.fits[:first], *fits, *account.fits[last:]))
    reach = round(_AROUND_S * account.take.rate_hz)
    around = max(0, first - reach), min(account.take.frames, last + reach)
    before, after = (
        _doubt_of(fitted, each, candidates, around).max(axis=1).mean() for each in (account, other)
    )
    return other if gain > -_WORSE and after < before - _LOWER else None


def _doubt_of(
    fitted: FittedPoses, account: Account, candidates: Sequence[Candidates], frames: tuple[int, int]
) -> NDArray[np.float32]:
    """Return (time, 11) how doubtful some of the frames are as an account has them."""
    own = account.part(*frames)
    unsure = fitted.unsure_sides[slice(*frames)]
    there = describe_fits(own, unsure, fitted.initial, fitted.model.origin)
    evidence = gather_evidence(there, candidates[slice(*frames)])
    return tell_doubt(evidence, account.take.rate_hz)
