"""What speaks against a limb is told of that limb, and of no other."""

from dataclasses import replace

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.body.anatomy.bones import Pose, place_bones, rotation_of
from tasks.body.blobs.fitting import Fit
from tasks.body.blobs.model import middles
from tasks.body.doubt.evidence import gather_evidence
from tasks.body.doubt.probability import tell_doubt
from tasks.body.doubt.weights import WEIGHTS
from tasks.body.poses.limbs import LIMBS

FRAMES = 9
LEFT_ARM, RIGHT_LEG = 1, 2


def turned(pose, bones, vector):
    """Return a pose with bones turned by a vector, rad."""
    rotation = pose.rotation.copy()
    rotation[bones] = rotation_of(np.array(vector)) @ rotation[bones]
    return Pose(pose.root, rotation)


def changed(fitted, **account):
    return replace(fitted, account=replace(fitted.account, **account))


def test_nothing_speaks_against_a_pose_that_fits(right):
    fitted, seen = right
    found = gather_evidence(fitted, seen)
    assert all(values.shape == (FRAMES, 4) for values in found.values())
    for name in (
        "apart",
        "contested",
        "exchangeable",
        "handless",
        "far",
        "without_end",
        "off_sight",
    ):
        assert found[name].max() < 0.05, name
    assert found["crossed"].max() < 0.0
    assert tell_doubt(found, 30.0).max() < 0.1
    asked = {kind.split()[1] for _, own in WEIGHTS.values() for kind in own}
    assert asked <= found.keys()


def test_passes_that_disagree_speak_against_their_limb(right):
    fitted, seen = right
    fits, other = fitted.account.fits, turned(fitted.poses[0], LIMBS[LEFT_ARM].bones, (0, 0.9, 0))
    again = (*fits[:2], Fit(other, 1.0, fits[0].support), *fits[3:])
    found = gather_evidence(changed(fitted, passes=(fits, again)), seen)["apart"]
    assert found[2, LEFT_ARM] > 1.0
    found[2, LEFT_ARM] = 0.0
    assert not found.any()


def test_a_pair_that_could_be_exchanged_speaks_against_both(right):
    fitted, seen = right
    gains = np.full((FRAMES, 2), -0.5)
    gains[:5] = [[-0.5, -0.06], [-0.5, -0.01], [np.nan, -0.5], [-0.5, 0.1], [-0.5, -9.0]]
    found = gather_evidence(changed(fitted, exchange_gains=gains), seen)
    np.testing.assert_allclose(found["exchangeable"][:, 2], found["exchangeable"][:, 3])
    assert found["exchangeable"][0, 2] == pytest.approx(np.exp(-1.0))
    assert found["exchangeable"][3, 2] == 1.0
    assert not found["exchangeable"][2, :2].any()


def test_a_hand_without_skin_and_a_limb_outside_the_voxels_are_told(right):
    fitted, seen = right
    none = replace(seen[0], hand=seen[0].hand[:1], hand_skin=np.ones(1))
    moved = turned(fitted.poses[0], LIMBS[LEFT_ARM].bones, (0, 0, -0.5))
    position = fitted.position.copy()
    position[:, JOINTS.index("LFin")] += [0.0, -0.3, 0.2]
    found = gather_evidence(
        replace(fitted, poses=(moved,) * FRAMES, position=position), [none] * FRAMES
    )
    assert found["handless"][:, 0].max() < 0.05
    assert found["handless"][:, 1].min() > 0.9
    assert found["outside"][:, LEFT_ARM].min() > 5 * max(found["outside"][:, RIGHT_LEG].max(), 0.1)


def test_frames_without_voxels_or_hands_do_no_harm(right):
    fitted, seen = right
    empty = fitted.account.take.samples[0][0][:0], fitted.account.take.samples[0][1][:0]
    take = replace(fitted.account.take, samples=[empty] * FRAMES)
    nobody = replace(seen[0], hand=np.empty((0, 3)), hand_skin=np.empty(0))
    found = gather_evidence(changed(fitted, take=take), [nobody] * FRAMES)
    assert all(np.isfinite(values).all() for values in found.values())


def test_passes_that_disagree_count_less_where_one_explains_clearly_more(right):
    fitted, seen = right
    fits = fitted.account.fits
    other = turned(fitted.poses[0], LIMBS[LEFT_ARM].bones, (0, 0.9, 0))
    again = tuple(Fit(other, 1.0 - worse, fits[0].support) for worse in (0.0, 0.02, 1.0))
    told = changed(fitted, passes=(fits, (*again, *fits[3:])))
    found = gather_evidence(changed(told, exchange_gains=np.full((FRAMES, 2), -0.5)), seen)
    apart, contested = (found[name][:4, LEFT_ARM] for name in ("apart", "contested"))
    assert contested[:2] / apart[:2] == pytest.approx([1.0, np.exp(-1.0)])
    assert contested[2:].max() < 1e-6
    assert not gather_evidence(told, seen)["contested"].any()  # colors tell the sides


def test_an_end_is_off_where_it_was_seen_as_surely_as_that_was(right):
    fitted, seen = right
    stature, middle = fitted.model.stature, middles(fitted.model, fitted.poses[0])
    cues, sure = np.full((FRAMES, 5, 3), np.nan), np.zeros((FRAMES, 5))
    cues[:, 1] = middle[LIMBS[0].end] + [0.0, 0.2 * stature, 0.0]
    cues[:, 4] = middle[LIMBS[3].end]
    sure[:, [1, 4]] = 0.5, 1.0
    take = replace(fitted.account.take, cues=cues, cue_weights=sure)
    found = gather_evidence(changed(fitted, take=take), seen)
    np.testing.assert_allclose(found["off_sight"][0], [1.0, 0.0, 0.0, 0.0], atol=1e-9)


def test_arms_in_the_trunk_and_knees_together_are_told(right):
    fitted, seen = right
    fitted = changed(fitted, exchange_gains=np.full((FRAMES, 2), -0.5))
    found = gather_evidence(fitted, seen)
    folded = turned(fitted.poses[0], LIMBS[LEFT_ARM].bones, (0, 0, -1.45))
    moved = gather_evidence(replace(fitted, poses=(folded,) * FRAMES), seen)
    assert (moved["end_in_trunk"] - found["end_in_trunk"])[:, LEFT_ARM].min() > 0.05
    np.testing.assert_allclose(moved["end_in_trunk"][:, 0], found["end_in_trunk"][:, 0])
    apart = np.linalg.norm(np.diff(middle_joints(fitted, LIMBS[2:]), axis=0)) / fitted.model.stature
    np.testing.assert_allclose(found["beside_other"][:, 2:], np.exp(-apart / 0.08))


def middle_joints(fitted, limbs):
    """Return (limb, 3) elbows or knees, m."""
    joints = place_bones(fitted.poses[0], fitted.model.origin)
    return joints[[limb.lower for limb in limbs]]
