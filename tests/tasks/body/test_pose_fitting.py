"""Tests of what the store functions of posing refuse."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.body.initial.search import InitialModel
from tasks.body.initial_model import _check_measurable
from tasks.body.pose_fitting import _labels_to_carry
from tests.conftest import swaying_body
from tests.figures.box_frames import Frames


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


def test_labels_that_a_person_gave_are_carried_as_they_are(monkeypatch):
    """Found ones have the heads of the arms, and what was no segment's stays so."""
    joints = dict(zip(JOINTS, swaying_body(1, 1)[0], strict=True))
    shoulder = joints["LShoulder"]
    out = (shoulder - joints["RShoulder"]) / np.linalg.norm(shoulder - joints["RShoulder"])
    center = shoulder + np.array([[-0.01], [-0.01], [0.1]]) * out
    label = np.array([2, 0, 6], np.uint8)
    assert _labels_to_carry(None, center, label, joints).tolist() == [6, 0, 6]
    for given, carried in ((label, [2, 0, 6]), (None, [6, 0, 6])):
        monkeypatch.setattr(
            "tasks.body.pose_fitting.read_initial", lambda _, g=given: SimpleNamespace(label=g)
        )
        found = _labels_to_carry(Path("initial.json"), center, label, joints)
        assert found.tolist() == carried
