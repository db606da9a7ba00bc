"""Tests of what the store functions of posing add to the methods: doubts, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.geometry.voxels import VoxelGrid, encode_runs, voxel_index
from tasks.initial_model import InitialModel
from tasks.posing import DoubtSettings, _check_measurable, _doubts
from tests.conftest import swaying_body

GRID = VoxelGrid((0.0, 0.0, 0.0), 0.1, (30, 20, 10))


class Frames:
    """What `_doubts` and `_check_measurable` read of a take."""

    grid = GRID

    def __init__(self, *boxes):
        self._boxes = boxes

    def __len__(self):
        return len(self._boxes)

    def hull(self, frame):
        occupied = np.zeros((1, *GRID.shape), bool)
        for low, high in self._boxes[frame]:
            occupied[0, low[0] : high[0], low[1] : high[1], low[2] : high[2]] = True
        return encode_runs(occupied)

    def index(self, frame):
        return voxel_index(self.hull(frame), 0)


def test_voxels_that_nothing_explains_and_a_cut_performer_are_doubtful():
    body = ((5, 3, 3), (9, 15, 7))
    second = ((20, 3, 3), (23, 12, 7))
    frames = Frames([body], [body, second], [], [((0, 3, 3), (9, 15, 7))], [body])
    mean = np.tile(np.array([0.65, 0.85, 0.45]), (5, 1, 1))
    inverse = np.tile(np.diag([11.0, 4.0, 11.0]), (5, 1, 1, 1))
    blobs = list(zip(mean, inverse, strict=True))
    doubtful = np.array([False, False, True, False, False])
    found = _doubts(frames, doubtful, blobs, (4, 0.9), DoubtSettings())
    assert found["unexplained"].tolist() == [False, True, False, False, False]
    assert found["cut_off"].tolist() == [False, False, False, True, False]
    assert found["doubtful"].tolist() == [False, True, True, True, False]
    assert not found["unmeasured"].any()
    # as much as at the beginning: wide sleeves
    usual = _doubts(frames, doubtful, blobs, (1, 0.9), DoubtSettings())
    assert not usual["unexplained"].any()


def test_a_badly_measured_body_makes_every_frame_doubtful():
    frames = Frames(*[[((5, 3, 3), (9, 15, 7))]] * 3)
    blobs = [(np.array([[0.65, 0.85, 0.45]]), np.diag([11.0, 4.0, 11.0])[None])] * 3
    found = _doubts(frames, np.zeros(3, bool), blobs, (0, 0.4), DoubtSettings())
    assert found["unmeasured"].all()
    assert found["doubtful"].all()
    assert not found["unexplained"].any()


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
