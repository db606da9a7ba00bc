"""How likely a segment is in the wrong place, from weighted evidence."""

import numpy as np
import pytest

from storage.schema import SEGMENTS
from tasks.body.doubt.probability import tell_doubt, windowed
from tasks.body.doubt.weights import WEIGHTS

NONE = {kind: (-4.0, {}) for kind in ("trunk", "UpperArm", "ForeArm", "UpperLeg", "LowerLeg")}


def evidence(frames=40, **given):
    """Return two kinds of evidence, nothing but what is given: name to (time, limb) places."""
    found = {name: np.zeros((frames, 4)) for name in ("apart", "far")}
    for name, places in given.items():
        found[name][places] = 1.0
    return found


def test_where_nothing_speaks_against_a_limb_its_doubt_is_how_often_it_is_wrong():
    doubt = tell_doubt(evidence(), 30.0, NONE)
    assert doubt.dtype == np.float32
    np.testing.assert_allclose(doubt, 1 / (1 + np.exp(4.0)), rtol=1e-6)


def test_evidence_counts_for_its_own_limb_by_its_weight():
    weights = NONE | {"ForeArm": (-2.0, {"moment apart": 5.0, "while far": 1.0})}
    found = evidence(apart=(slice(None), 1), far=(slice(None), 0))
    doubt = tell_doubt(found, 30.0, weights)
    at = {name: doubt[:, SEGMENTS.index(name)] for name in SEGMENTS}
    np.testing.assert_allclose(at["LForeArm"], 1 / (1 + np.exp(-3.0)), rtol=1e-6)
    np.testing.assert_allclose(at["RForeArm"], 1 / (1 + np.exp(1.0)), rtol=1e-6)
    for name in set(SEGMENTS) - {"LForeArm", "RForeArm"}:
        np.testing.assert_allclose(at[name], 1 / (1 + np.exp(4.0)), rtol=1e-6)


@pytest.mark.parametrize("rate_hz", [30.0, 120.0])
def test_a_window_is_as_long_at_any_rate(rate_hz):
    frames = round(4 * rate_hz)
    found = windowed(evidence(frames, apart=(frames // 2, 2)), rate_hz)
    for name, reach_s in (("now apart", 1 / 30), ("moment apart", 0.1), ("while apart", 0.4)):
        reached = np.flatnonzero(found[name][:, 2])
        assert (reached[[0, -1]] - frames // 2) / rate_hz == pytest.approx([-reach_s, reach_s])
        assert found[name].sum() == pytest.approx(1.0)
    assert not found["moment far"].any()


def test_a_take_of_one_frame_has_a_doubt():
    assert np.isfinite(tell_doubt(evidence(1), 30.0, NONE)).all()


def test_no_weight_speaks_for_a_limb():
    for base, weights in WEIGHTS.values():
        assert base < -2.0
        assert all(weight > 0 for weight in weights.values())
