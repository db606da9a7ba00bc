import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.body import joint_tracks
from tests.conftest import swaying_body

SETTINGS = joint_tracks.JointTrackSettings()
STATURE_M = 1.6


@pytest.fixture
def rng():
    return np.random.default_rng(59)


def place(name):
    return JOINTS.index(name)


def limb(rng, begin, end, *, count=4000, radius=0.03):
    """Return voxels of a round limb that ends flat at both joints."""
    bone = (end - begin) / np.linalg.norm(end - begin)
    noise = rng.normal(size=(count, 3)) * radius / 2
    noise -= np.outer(noise @ bone, bone)
    return begin + rng.random((count, 1)) * (end - begin) + noise


@pytest.mark.parametrize(("tip", "base", "label"), [
    ("RFin", "RElbow", 5), ("LFin", "LElbow", 7),
])  # fmt: skip
@pytest.mark.parametrize("change_m", [-0.05, 0.04])
def test_a_tip_moves_to_where_its_voxels_end(rng, tip, base, label, change_m):
    joint = swaying_body(1, 1)[0].astype(float)
    bone = joint[place(tip)] - joint[place(base)]
    bone /= np.linalg.norm(bone)
    truth = joint[place(tip)] + change_m * bone
    center = limb(rng, joint[place(base)], truth)
    moved = joint_tracks.move_to_ends(
        joint, center, np.full(len(center), label), SETTINGS, stature_m=STATURE_M
    )
    np.testing.assert_allclose(moved[place(tip)], truth, atol=0.01)
    others = np.arange(21) != place(tip)
    np.testing.assert_array_equal(moved[others], joint[others])


def test_a_sleeve_that_hangs_and_another_segments_voxels_move_no_finger(rng):
    joint = swaying_body(1, 1)[0].astype(float)
    elbow, tip = joint[place("RElbow")], joint[place("RFin")]
    arm = limb(rng, elbow, tip)
    sleeve = arm + [0.2, 0.0, 0.0] + (tip - elbow) * 0.5
    center = np.concatenate([arm, sleeve, tip + rng.normal(size=(500, 3)) * 0.02])
    label = np.repeat([5, 5, 2], [len(arm), len(sleeve), 500])
    moved = joint_tracks.move_to_ends(joint, center, label, SETTINGS, stature_m=STATURE_M)
    np.testing.assert_allclose(moved[place("RFin")], tip, atol=0.01)


def test_a_change_is_bounded_and_needs_voxels(rng):
    joint = swaying_body(1, 1)[0].astype(float)
    elbow, tip = joint[place("LElbow")], joint[place("LFin")]
    center = limb(rng, elbow, elbow + 0.3 * (tip - elbow))
    label = np.full(len(center), 7)
    moved = joint_tracks.move_to_ends(joint, center, label, SETTINGS, stature_m=STATURE_M)
    change = np.linalg.norm(moved[place("LFin")] - tip)
    assert change == pytest.approx(SETTINGS.most_change * STATURE_M)
    few = joint_tracks.move_to_ends(joint, center[:29], label[:29], SETTINGS, stature_m=STATURE_M)
    np.testing.assert_array_equal(few, joint)
    joint[place("LFin")] = np.nan
    missing = joint_tracks.move_to_ends(joint, center, label, SETTINGS, stature_m=STATURE_M)
    np.testing.assert_array_equal(missing, joint)


def test_what_is_not_seen_is_flagged_where_its_segment_fits_badly():
    joint = swaying_body(4, 5)
    quality = np.full((5, 11), 0.7)
    quality[2, 4], quality[3, 10], quality[4] = 0.39, 0.1, 0.0  # RForeArm, LLowerLeg, nobody
    track, filled = joint_tracks.build_joint_track(joint, quality, SETTINGS)
    inferred = {(t, JOINTS[k]) for t, k in np.argwhere(filled).tolist()}
    assert inferred == {(2, "RWrist"), (3, "LAnkle"), (3, "LHeel")}
    assert np.isnan(track[4]).all()
    np.testing.assert_allclose(track[:4], joint[:4], rtol=1e-6)
    assert track.dtype == np.float32


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match=r"qualities of shape \(4, 11\) do not fit"):
        joint_tracks.build_joint_track(np.zeros((5, 21, 3)), np.zeros((4, 11)), SETTINGS)
    with pytest.raises(
        ValueError, match=r"radius is -0\.1, it must be .*least_quality is 2, it must be"
    ):
        joint_tracks.JointTrackSettings(radius=-0.1, least_quality=2)
    with pytest.raises(ValueError, match="least_voxels is 0, it must be a whole number 1"):
        joint_tracks.JointTrackSettings(least_voxels=0)
