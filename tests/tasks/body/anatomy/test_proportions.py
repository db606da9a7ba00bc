"""Proportions of children and adults, beside what was published."""

import numpy as np
import pytest

from tasks.body.anatomy.proportions import GROWN_M, HIPS_BELOW_TOP, hips_below_top, leg_share


@pytest.mark.parametrize(
    ("stature_m", "sitting_height"), [(0.88, 0.58), (1.1, 0.56), (1.22, 0.555), (1.6, 0.525)]
)
def test_children_have_the_trunk_that_was_measured(stature_m, sitting_height):
    """Sitting heights over statures at 2, 5 and 7 years and of adults; a seat is below the hips."""
    seat_below_hips = 0.525 - HIPS_BELOW_TOP
    assert hips_below_top(stature_m) == pytest.approx(sitting_height - seat_below_hips, abs=0.01)


def test_proportions_change_steadily_and_are_an_adults_from_some_stature_on():
    stature = np.linspace(0.3, 2.0, 400)
    below = np.array([hips_below_top(each) for each in stature])
    assert (np.diff(below) <= 0).all()
    assert abs(np.diff(below)).max() < 0.001
    assert (below[stature >= GROWN_M] == HIPS_BELOW_TOP).all()
    np.testing.assert_allclose([leg_share(each) for each in stature], (1 - below) / 0.505)
