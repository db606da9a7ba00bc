"""Tests of what the store functions of posing refuse."""

from pathlib import Path

import numpy as np
import pytest

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.initial_model import InitialModel
from tasks.posing import _check_measurable
from tests.box_frames import Frames
from tests.conftest import swaying_body


@pytest.mark.parametrize("path", [None, Path("in/initial.json")])
def test_a_segment_of_too_few_voxels_is_refused_with_what_to_do(path):
    frames = Frames([((0, 0, 0), (11, 19, 1))])
    label = np.repeat(np.arange(1, 12), 19)
    label[:5] = 2
    model = InitialModel(0, swaying_body(2, 1)[0], label.astype(np.uint8), 1.0, ())
    assert model.position.shape == (len(JOINTS), 3)
    todo = r"place the joints in initial\.json" if path is None else r"joints in in/initial\.json"
    with pytest.raises(InputError, match=rf"measured in frame 0: labels 1 \(14\).*{todo}"):
        _check_measurable(model, frames, path)
