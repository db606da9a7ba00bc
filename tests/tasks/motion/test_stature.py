"""The stature of a take is measured on its joints, or the default."""

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.motion.stature import DEFAULT_STATURE_M, measure_stature, take_stature


def test_the_stature_of_a_take_is_measured_or_the_default():
    position = np.full((3, 21, 3), np.nan)
    height = {"Head": 1.6, "Neck": 1.4, "RHip": 0.9, "LHip": 0.9}
    height |= {"RKnee": 0.5, "LKnee": 0.45, "RAnkle": 0.1, "LAnkle": 0.1}
    for name in height:
        position[:, JOINTS.index(name)] = [0, height[name], 0]
    assert take_stature(position) == pytest.approx(1.6 - 0.1)
    assert take_stature(position) == measure_stature(position, JOINTS)
    position[:, JOINTS.index("Neck")] = np.nan
    assert take_stature(position) == DEFAULT_STATURE_M == 1.6
