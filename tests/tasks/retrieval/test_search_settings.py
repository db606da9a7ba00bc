"""Settings of a search: what weights mean, and which settings mean nothing."""

import pytest

from tasks.retrieval.normalization import PARTS
from tasks.retrieval.searching import SearchSettings, clip_motion, joint_weights, search_takes
from tests.conftest import swaying_body

JOINTS = PARTS["whole"]


def test_weights_replace_those_of_the_part():
    settings = SearchSettings("feet", weights=(("RFoot", 2.5), ("LFoot", 0), ("Head", 0.5)))
    weights = dict(zip(JOINTS, joint_weights(settings).tolist(), strict=True))
    assert {k: v for k, v in weights.items() if v} == {
        "RHeel": 1,
        "LHeel": 1,
        "RFoot": 2.5,
        "Head": 0.5,
    }
    assert joint_weights(settings, ("Head", "LFoot", "RFoot", "RHeel")).tolist() == [0.5, 0, 2.5, 1]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (SearchSettings("foot"), "no part 'foot'; did you mean feet"),
        (SearchSettings("xyzzy"), "no part 'xyzzy'; choose from whole, upper"),
        (SearchSettings(weights=(("rfot", 1),)), "no joint 'rfot'; did you mean RFoot"),
        (SearchSettings(weights=(("Head", -1),)), "weight of Head is -1; give a number from 0"),
        (SearchSettings(weights=(("Head", float("nan")),)), "weight of Head is nan; give a"),
        (SearchSettings(weights=(("Head", float("inf")),)), "weight of Head is inf; give a"),
        (SearchSettings(weights=(("Head", 1e300),)), r"Head is 1e\+300; .* up to 1,000,000, and"),
        (SearchSettings(weights=(("Head", 1e-300),)), "Head is 1e-300; .* at least 1e-06"),
        (SearchSettings(path_weight=1e300), r"path weight is 1e\+300; give a .* up to 1,000,000"),
        (SearchSettings("head", weights=(("Head", 0), ("Neck", 0))), "every weight is zero; give"),
        (SearchSettings(steps="slop"), "no steps 'slop'; did you mean slope"),
        (SearchSettings(path_weight=-1), "path weight is -1; give a number from 0 up"),
        (SearchSettings(threshold=0.0), "threshold is 0.0; give a distance above 0"),
        (SearchSettings(threshold=float("nan")), "threshold is nan; give a distance above 0"),
        (SearchSettings(top=0), "0 nearest matches are asked for; ask for 1 or more"),
        (SearchSettings("foot", steps="x"), "'foot'; did you mean feet.*; there are no steps 'x'"),
    ],
)
def test_settings_without_a_meaning_are_refused(settings, message):
    query = clip_motion(swaying_body(0, 14), 30.0, 1.6)
    with pytest.raises(ValueError, match=message):
        search_takes(query, [], settings)
