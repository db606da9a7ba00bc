"""Segments are told apart by their colors, also by people who lack a kind of cone."""

import numpy as np
import pytest

from storage.schema import SEGMENTS
from tasks.rendering.drawing.segment_colors import SEGMENT_COLORS
from tests.figures.color_vision import DEFICIENCIES, seen

LEAST = 30.0
"""Distance in CIELAB of two colors that nobody takes for each other [units]. Swatches side by side
are told apart from 2 to 3 on; these are small, shaded and apart."""
_MIDDLE = [("Head", "Body"), ("Body", "Waist")]
_LIMBS = [("Body", "UpperArm", "ForeArm"), ("Waist", "UpperLeg", "LowerLeg")]
NEIGHBORS = [
    *_MIDDLE,
    *((middle, side + upper) for side in "RL" for middle, upper, _ in _LIMBS),
    *((side + upper, side + lower) for side in "RL" for _, upper, lower in _LIMBS),
    *((f"R{name}", f"L{name}") for _, *names in _LIMBS for name in names),
]


@pytest.mark.parametrize("deficiency", [None, *DEFICIENCIES])
def test_neighbors_and_sides_look_different_to_everybody(deficiency):
    color = dict(zip(SEGMENTS, seen(SEGMENT_COLORS, deficiency)[1:], strict=True))
    apart = {(a, b): np.linalg.norm(color[a] - color[b]) for a, b in NEIGHBORS}
    assert min(apart.values()) > LEAST, min(apart, key=apart.get)


def test_the_simulation_takes_from_reds_and_greens_what_protanopes_do_not_see():
    red, green = (
        seen([[200, 60, 40], [110, 130, 40]]),
        seen([[200, 60, 40], [110, 130, 40]], "protanopia"),
    )
    assert np.linalg.norm(green[0] - green[1]) < 0.5 * np.linalg.norm(red[0] - red[1])
    gray = [[128, 128, 128]]
    for deficiency in DEFICIENCIES:
        np.testing.assert_allclose(seen(gray, deficiency), seen(gray), atol=0.5)
