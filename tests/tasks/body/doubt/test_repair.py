"""A doubtful stretch is exchanged where that lowers the doubt, and nowhere else."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from storage.schema import SEGMENTS
from tasks.body.anatomy.bones import Pose, rotation_of
from tasks.body.blobs.fitting import Fit
from tasks.body.doubt import repair

DOUBTED, STRETCH = (3, 6), (1, 8)


def with_gains(fitted, gain):
    gains = np.full((len(fitted.poses), 2), gain)
    return replace(fitted, account=replace(fitted.account, exchange_gains=gains))


def turned(fit, likelihood):
    """Return a fit whose arms are elsewhere."""
    rotation = fit.pose.rotation.copy()
    rotation[3:7] = rotation_of(np.array([0.0, 0.4, 0.0]))
    return Fit(Pose(fit.pose.root, rotation), likelihood, fit.support)


@pytest.fixture
def doubted(right, monkeypatch):
    """The figure, with arms that are doubted in a stretch; exchanged they are doubted less."""
    fitted, seen = right
    tried, told = [], SimpleNamespace(likelihood=1.0, after=0.2)

    def exchange(take, fits, pair, stretch):
        tried.append((pair, stretch))
        return take, [turned(fit, told.likelihood) for fit in fits[slice(*stretch)]]

    def doubt(evidence, _rate_hz):
        frames = len(evidence["apart"])
        found = np.zeros((frames, len(SEGMENTS)), np.float32)
        stretch = slice(*DOUBTED) if frames == len(fitted.poses) else slice(None)
        exchanged = evidence["jerking_lower"].any()  # only an exchange moves the figure
        found[stretch, SEGMENTS.index("LForeArm")] = told.after if exchanged else 0.8
        return found

    monkeypatch.setattr(repair, "fit_exchanged", exchange)
    monkeypatch.setattr(repair, "tell_doubt", doubt)
    return with_gains(fitted, 0.05), seen, tried, told


def test_a_stretch_is_exchanged_where_that_lowers_the_doubt(doubted):
    fitted, seen, tried, *_ = doubted
    found, doubt = repair.doubt_and_repair(fitted, seen)
    assert doubt.max() == np.float32(0.2)
    assert tried == [(0, STRETCH)]
    moved = np.nanmax(np.linalg.norm(found.position - fitted.position, axis=2), axis=1) > 0.05
    assert np.flatnonzero(moved).tolist() == [*range(*STRETCH)]


@pytest.mark.parametrize(("likelihood", "after"), [(0.9, 0.2), (1.0, 0.75)])
def test_a_stretch_stays_that_is_less_likely_or_as_doubtful_exchanged(doubted, likelihood, after):
    fitted, seen, tried, told = doubted
    told.likelihood, told.after = likelihood, after
    assert repair.doubt_and_repair(fitted, seen)[0] is fitted
    assert tried


@pytest.mark.parametrize("gain", [-0.5, -0.05, np.nan])
def test_what_cannot_be_exchanged_is_not_tried(doubted, gain):
    fitted, seen, tried, *_ = doubted
    alike = with_gains(fitted, gain)
    assert repair.doubt_and_repair(alike, seen)[0] is alike
    assert not tried


def test_nearly_as_likely_is_tried(doubted):
    fitted, seen, tried, *_ = doubted
    repair.doubt_and_repair(with_gains(fitted, -0.005), seen)
    assert tried == [(0, STRETCH)]


def test_frames_that_cannot_be_exchanged_are_left_out(doubted):
    fitted, seen, tried, *_ = doubted
    fitted = with_gains(fitted, 0.05)
    fitted.account.exchange_gains[: DOUBTED[0]] = -np.inf
    repair.doubt_and_repair(fitted, seen)
    assert tried == [(0, (DOUBTED[0], STRETCH[1]))]


def test_nobody_is_exchanged_with_nobody(doubted, monkeypatch):
    fitted, seen, *_ = doubted
    monkeypatch.setattr(repair, "fit_exchanged", lambda *_: None)
    assert repair.doubt_and_repair(fitted, seen)[0] is fitted
