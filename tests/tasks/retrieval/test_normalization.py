import math

import numpy as np
import pytest

from storage import schema
from tasks.motion.stature import joints_present, measure_stature
from tasks.retrieval import normalization
from tasks.retrieval.normalization import (
    PARTS,
    PATH_ROWS,
    ROWS,
    SHOULDER_ROWS,
    clip_samples,
    frame_of_sample,
    mirror_rows,
    pack_motion,
    sample_count,
    sample_of_frame,
)
from tasks.retrieval.paths import TURN_LEVER
from tests.twins import search as naive

JOINTS = PARTS["whole"]


@pytest.fixture
def rng():
    return np.random.default_rng(33)


@pytest.fixture
def position(rng):
    """A dancer of 37 frames who goes and turns; some joints are missing here and there."""
    track = rng.normal(size=(37, 21, 3)) * 0.3 + [2.0, 1.0, -3.0]
    track += rng.normal(size=(37, 1, 3)).cumsum(axis=0) * 0.1
    track[5, JOINTS.index("RFin")] = np.nan
    track[11, JOINTS.index("LHip")] = np.nan
    track[20:22, JOINTS.index("RShoulder")] = np.nan
    return track


def turned(position, angle):
    c, s = np.cos(angle), np.sin(angle)
    return position @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T


def test_whole_is_every_joint_in_the_order_of_the_archive():
    assert PARTS["whole"] == schema.JOINTS


def test_parts_are_those_of_the_design_and_of_the_papers_experiments():
    assert set(PARTS) == {
        *("whole", "upper", "lower", "arms", "right-arm", "left-arm"),
        *("legs", "right-leg", "left-leg", "feet", "hands", "head"),
    }
    assert set(PARTS["feet"]) == {"RHeel", "RFoot", "LHeel", "LFoot"}
    assert PARTS["left-arm"] == ("LShoulder", "LElbow", "LWrist", "LFin")
    assert PARTS["right-leg"] == ("RHip", "RKnee", "RAnkle", "RHeel", "RFoot")
    assert set(PARTS["hands"]) == {"RWrist", "RFin", "LWrist", "LFin"}
    assert {*PARTS["upper"], *PARTS["lower"]} == {*JOINTS}
    assert not {*PARTS["upper"]} & {*PARTS["lower"]}


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 50.0, 24.0, 29.97, 45.0])
def test_packing_agrees_with_its_naive_twin(position, rate_hz):
    rows = pack_motion(position, rate_hz, 1.7)
    samples = naive.resample(position.astype(np.float32).astype(float), rate_hz)
    assert rows.shape == (ROWS, len(samples))
    assert rows.dtype == np.float32
    assert rows.flags.c_contiguous
    hips = np.array([naive.normalize(pose, 1.7) for pose in samples])
    shoulders = np.array([naive.normalize(pose, 1.7, "Shoulder") for pose in samples])
    joints = rows[: SHOULDER_ROWS.start].reshape(21, 3, -1)
    np.testing.assert_allclose(joints, hips.transpose(1, 2, 0), atol=2e-6)
    about = joints - rows[SHOULDER_ROWS]
    np.testing.assert_allclose(about, shoulders.transpose(1, 2, 0), atol=4e-6)
    path = naive.path(samples, 1.7, TURN_LEVER)
    np.testing.assert_allclose(rows[PATH_ROWS], path.T, atol=2e-5)
    assert 0 < np.isnan(rows).sum() < rows.size / 2


def test_moving_turning_and_scaling_a_take_changes_nothing(position):
    rows = pack_motion(position, 50.0, 1.7)
    other = turned(position + np.array([3.0, 0.0, -1.0]), 2.0) * 1.3
    np.testing.assert_allclose(pack_motion(other, 50.0, 1.7 * 1.3), rows, atol=1e-5)


def test_the_hips_point_to_plus_z_about_the_origin(position):
    rows = pack_motion(position[:10], 30.0, 1.7).reshape(23, 3, -1)
    right, left = rows[JOINTS.index("RHip")], rows[JOINTS.index("LHip")]
    np.testing.assert_allclose(right + left, 0, atol=1e-6)
    np.testing.assert_allclose((left - right)[0], 0, atol=1e-6)
    assert ((left - right)[2] > 0).all()


def test_a_sample_on_a_frame_does_not_see_its_missing_neighbor(position):
    position[6:8] = np.nan
    rows = pack_motion(position, 75.0, 1.7)
    missing = np.isnan(rows[0])
    neighbors = [{math.floor(2.5 * n), math.ceil(2.5 * n)} for n in range(rows.shape[1])]
    expected = [bool(frames & {6, 7, 11}) for frames in neighbors]
    np.testing.assert_array_equal(missing, expected)
    assert not missing[2]  # frame 5 itself


@pytest.mark.parametrize("rate_hz", [30 * (1 - 1e-9), 30 * (1 + 1e-9)])
def test_a_sample_on_a_frame_but_for_rounding_is_that_frame(position, rate_hz):
    rows = pack_motion(position, rate_hz, 1.7)
    np.testing.assert_array_equal(rows[:66], pack_motion(position, 30.0, 1.7)[:66])


def test_hips_over_each_other_point_nowhere(position):
    position[3, JOINTS.index("LHip")] = position[3, JOINTS.index("RHip")] + [0, 0.1, 0]
    rows = pack_motion(position, 30.0, 1.7)
    assert np.isnan(rows[: SHOULDER_ROWS.stop, 3]).all()
    assert np.isfinite(rows[: SHOULDER_ROWS.stop, 2]).all()


def test_what_is_not_finite_is_missing(position):
    wrong = position.copy()
    wrong[14, JOINTS.index("Head"), 1] = np.inf
    wrong[15, JOINTS.index("LHip"), 0] = 1e300
    position[14, JOINTS.index("Head")] = np.nan
    position[15, JOINTS.index("LHip")] = np.nan
    np.testing.assert_array_equal(pack_motion(wrong, 24.0, 1.7), pack_motion(position, 24.0, 1.7))


def test_a_take_packed_in_blocks_is_the_same(position, monkeypatch):
    whole = pack_motion(position, 50.0, 1.7)
    monkeypatch.setattr(normalization, "_BLOCK", 5)
    np.testing.assert_array_equal(pack_motion(position, 50.0, 1.7), whole)


def test_a_file_packs_as_the_archive_keeps_it(position):
    stored = position.astype(np.float32)
    np.testing.assert_array_equal(pack_motion(position, 50.0, 1.7), pack_motion(stored, 50.0, 1.7))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((4, 20, 3)), 30.0, 1.6), r"have shape \(4, 20, 3\), but \(time, 21, 3\)"),
        ((np.zeros((0, 21, 3)), 30.0, 1.6), "at least one frame is wanted"),
        ((np.zeros((4, 21, 3)), 0.0, 1.6), "rate_hz is 0.0; give a positive number"),
        ((np.zeros((4, 21, 3)), 30.0, float("nan")), "stature_m is nan; give a positive"),
    ],
)
def test_what_cannot_be_packed_is_refused(arguments, message):
    position, rate_hz, stature_m = arguments
    with pytest.raises(ValueError, match=message):
        pack_motion(position, rate_hz, stature_m)


def test_mirrored_rows_are_those_of_the_mirrored_dancer(position):
    mirrored = pack_motion(turned(naive.mirror(position), 0.7), 50.0, 1.7)
    rows = pack_motion(position, 50.0, 1.7)
    np.testing.assert_allclose(mirror_rows(rows), mirrored, atol=1e-5)
    assert np.nanmax(np.abs(mirrored - rows)) > 0.1
    np.testing.assert_array_equal(mirror_rows(mirror_rows(rows)), rows)


def test_stature_agrees_with_its_naive_twin(position):
    position[2, JOINTS.index("LKnee")] = np.nan
    position[4, JOINTS.index("Head")] = np.nan
    assert measure_stature(position, JOINTS) == pytest.approx(naive.stature(position, JOINTS))


def test_stature_of_a_dancer_bent_at_the_knees_is_worked_out():
    joints = ("LAnkle", "LKnee", "LHip", "RHip", "Neck", "Head", "RKnee", "RAnkle")
    one = [
        *((0.3, 0.5, 0.1), (0.3, 0.5, 0.5), (0, 0.9, 0.2), (0, 0.9, -0.2)),
        *((0, 1.4, 0), (0, 1.65, 0), (0, 0.5, -0.2), (0.4, 0.5, -0.2)),
    ]
    frames = np.array([one, np.array(one) * 2, np.array(one) * 0.9])
    # head 0.25, trunk 0.5, left leg sqrt(0.09 + 0.16 + 0.09) + 0.4, right leg 0.4 + 0.4
    assert measure_stature(frames, joints) == pytest.approx(
        0.25 + 0.5 + (0.34**0.5 + 0.4 + 0.8) / 2
    )


@pytest.mark.parametrize("lost", ["Head", "Neck", "RHip"])
def test_stature_without_a_needed_joint_is_unknown(position, lost):
    position[:, JOINTS.index(lost)] = np.nan
    assert np.isnan(measure_stature(position, JOINTS))
    keep = [k for k, name in enumerate(JOINTS) if name != lost]
    assert np.isnan(measure_stature(position[:, keep], [JOINTS[k] for k in keep]))


def test_stature_of_a_point_is_unknown():
    assert np.isnan(measure_stature(np.ones((5, 21, 3)), JOINTS))


def test_a_take_has_a_joint_that_half_its_frames_have():
    position = np.zeros((6, 21, 3))
    position[:3, 4, 1] = np.nan
    position[:4, 5, 2] = np.nan
    assert joints_present(position).tolist() == [k != 5 for k in range(21)]


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 100.0, 29.97, 24.0, 45.0, 53.0])
def test_frames_and_samples_are_the_nearest_in_time(rate_hz):
    frames = 37
    count = sample_count(frames, rate_hz)
    times = np.arange(count) / 30
    assert times[-1] <= (frames - 1) / rate_hz + 1e-9 < times[-1] + 1 / 30
    for n in range(count):
        away = np.abs(np.arange(frames) / rate_hz - times[n])
        assert away[frame_of_sample(n, rate_hz)] == pytest.approx(away.min())
    for frame in range(frames):
        away = np.abs(times - frame / rate_hz)
        assert away[sample_of_frame(frame, rate_hz, frames)] == pytest.approx(away.min())


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 100.0, 45.0])
def test_the_clip_of_a_match_is_the_match(rate_hz):
    for n in range(sample_count(90, rate_hz)):
        frame = frame_of_sample(n, rate_hz)
        assert clip_samples(frame, frame, rate_hz, 90) == (n, n)


@pytest.mark.parametrize("clip", [(-1, 5), (5, 4), (3, 37), (40, 50)])
def test_a_clip_beyond_the_take_is_refused(clip):
    start, end = clip
    with pytest.raises(ValueError, match=f"{start}-{end} is not within.*END <= 36"):
        clip_samples(start, end, 30.0, 37)
