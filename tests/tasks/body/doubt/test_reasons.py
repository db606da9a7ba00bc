"""In which frames a pose is doubtful that its method is content with."""

import numpy as np
import pytest

from tasks.body.doubt.reasons import DoubtSettings, find_doubts, settle_doubt
from tests.figures.box_frames import Frames


def standing(count):
    """Return frames that show one box, and the blob that it is."""
    frames = Frames(*[[((5, 3, 3), (9, 15, 7))]] * count)
    return frames, [(np.array([[0.65, 0.85, 0.45]]), np.diag([11.0, 4.0, 11.0])[None])] * count


def doubts(frames, doubtful, blobs, hands=None, *, initial_frame=4, confidence=0.9):
    hands = np.zeros((len(frames), 2, 3)) if hands is None else hands
    return find_doubts(
        frames, doubtful, blobs, hands, 30.0,
        initial_frame=initial_frame, confidence=confidence, settings=DoubtSettings(),
    )  # fmt: skip


def test_voxels_that_nothing_explains_and_a_cut_performer_are_doubtful():
    body = ((5, 3, 3), (9, 15, 7))
    second = ((20, 3, 3), (23, 12, 7))
    frames = Frames([body], [body, second], [], [((0, 3, 3), (9, 15, 7))], [body])
    mean = np.tile(np.array([0.65, 0.85, 0.45]), (5, 1, 1))
    inverse = np.tile(np.diag([11.0, 4.0, 11.0]), (5, 1, 1, 1))
    blobs = list(zip(mean, inverse, strict=True))
    doubtful = np.array([False, False, True, False, False])
    found = doubts(frames, doubtful, blobs)
    assert found["unexplained"].tolist() == [False, True, False, False, False]
    assert found["cut_off"].tolist() == [False, False, False, True, False]
    assert found["doubtful"].tolist() == [False, True, True, True, False]
    assert not found["unmeasured"].any()
    # as much as at the beginning: wide sleeves
    usual = doubts(frames, doubtful, blobs, initial_frame=1)
    assert not usual["unexplained"].any()


def test_a_badly_measured_body_makes_every_frame_doubtful():
    frames, blobs = standing(3)
    found = doubts(frames, np.zeros(3, bool), blobs, initial_frame=0, confidence=0.4)
    assert found["unmeasured"].all()
    assert found["doubtful"].all()
    assert not found["unexplained"].any()


def test_a_hand_that_was_hidden_for_long_is_a_guess():
    frames, blobs = standing(40)
    hands = np.zeros((40, 2, 3))
    hands[3:11, 1] = np.nan  # 8 frames
    hands[5:14, 0] = np.nan  # 9: 0.3 s
    hands[30:, 0] = np.nan
    found = doubts(frames, np.zeros(40, bool), blobs, hands)
    assert np.flatnonzero(found["hidden"]).tolist() == [*range(5, 14), *range(30, 40)]
    assert (found["doubtful"] == found["hidden"]).all()


def test_settings_out_of_their_ranges_are_all_named():
    message = r"far is 0\.0, .* larger than 0; unexplained is 3\.0, .* at most 1"
    with pytest.raises(ValueError, match=message):
        DoubtSettings(far=0.0, unexplained=3.0)


def test_what_is_no_matter_of_a_limb_makes_all_segments_doubtful():
    doubt, quality = np.zeros((5, 11), np.float32), np.ones((5, 11))
    doubt[1, 4] = 0.6
    quality[4] = 0.0
    names = ("unmeasured", "unexplained", "cut_off", "hidden")
    found = {name: np.arange(5) == frame for name, frame in zip(names, (9, 2, 1, 0), strict=True)}
    settled = settle_doubt(doubt, quality, found, DoubtSettings(doubtful=0.2, other_cause=0.3))
    assert settled["doubt"].dtype == np.float32
    np.testing.assert_allclose(settled["doubt"][:, 0], [0, 0.3, 0.3, 0, 1], rtol=1e-6)
    assert settled["doubt"][1, 4] == np.float32(0.6)
    assert settled["doubtful"].tolist() == [False, True, True, False, True]
