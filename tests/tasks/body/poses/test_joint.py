"""Fitted poses of a figure of tubes: blobs, targets, cloth and a whole synthetic take."""

import numpy as np
import pytest

from storage.schema import JOINTS, SEGMENTS
from tasks.body.anatomy import bones as articulated
from tasks.body.anatomy.bones import BONES, SEGMENT, Pose
from tasks.body.anatomy.nearest_bones import bones_of_voxels
from tasks.body.blobs import blobs
from tasks.body.blobs.fitting import (
    Fit,
    FitSettings,
    Target,
    fit_frame,
    penalized_likelihood,
    target_distances,
    weigh,
)
from tasks.body.blobs.model import make_model
from tasks.body.poses import joint
from tasks.body.poses.joint import fit_poses, fitted_blobs
from tasks.body.poses.passes import Fitting
from tasks.body.poses.settings import JointMethodSettings
from tasks.geometry.voxels import encode_runs, take_frame, voxel_centers, voxel_index
from tests.figures.tube_figures import GRID, figure_of_tubes, model_of

B = BONES.index


@pytest.mark.parametrize("widening", [1.0, 1.5])
def test_blobs_are_pulled_to_the_middle_of_their_voxels_by_at_most_their_share(waving, widening):
    runs, _, figures = waving
    model = model_of(figures[0], runs)
    points = voxel_centers(GRID, voxel_index(runs, 1))
    voxels = blobs.gather_voxels(points, np.zeros(len(points), int), np.ones((1, 16), np.float32))
    pose = articulated.rest_pose(model.origin)
    joints = articulated.place_bones(pose, model.origin)
    own, count = len(model.blobs.bone), len(model.kind)
    placed = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
    evidence, mass = (np.empty((own, 3, 3)), np.empty((own, 3))), np.empty(own)
    share = model.blobs.share / 2  # so that some have more than they may
    weigh(
        (voxels.count, voxels.points, voxels.likeness, voxels.boxes),
        (model.origin, model.body, share, model.weight, model.kind),
        joints, pose.rotation, widening, (0.006, 1.6, 0.4), placed, evidence, mass,
    )  # fmt: skip
    mean = joints[model.blobs.bone] + model.blobs.offset
    away = points[:, None] - mean
    inverse = np.linalg.inv(model.blobs.covariance)
    squared = np.einsum("vbi,bij,vbj->vb", away, inverse, away) / widening**2
    weight = model.weight[:own] / widening**3 * np.where(squared < 18, np.exp(-squared / 2), 0)
    weight /= weight.sum(1, keepdims=True) + 0.006  # this figure wears no cloth
    assert count - own == 0 or model.cloth.share.sum() < 0.02
    middle = weight.T @ points / weight.sum(0)[:, None]
    np.testing.assert_allclose(evidence[1], middle - mean, atol=2e-3)
    pull = np.minimum(weight.mean(0), 1.6 * share)
    assert (weight.mean(0) > 1.6 * share).any()
    np.testing.assert_allclose(evidence[0], pull[:, None, None] * inverse, rtol=0.02, atol=1e-6)


@pytest.mark.compiled
def test_a_hand_goes_where_it_was_seen(waving):
    runs, _, figures = waving
    model = model_of(figures[0], runs)
    points = voxel_centers(GRID, voxel_index(runs, 0))
    voxels = blobs.gather_voxels(points, np.zeros(len(points), int), np.ones((1, 16), np.float32))
    pose, hand = articulated.rest_pose(model.origin), B("LHand")
    place = model.origin[hand] + np.array([0.03, 0.05, 0.0])
    target = Target(hand, np.array([0.03, 0.0, 0.0]), place, 1e4, 0.2)
    fit = fit_frame(model, voxels, pose, pose, [target], settings=FitSettings())
    free = fit_frame(model, voxels, pose, pose, settings=FitSettings())
    assert target_distances(model, fit.pose, [target])[0] < 0.01
    assert target_distances(model, free.pose, [target])[0] > 0.04
    assert penalized_likelihood(model, fit, [target]) > penalized_likelihood(model, free, [target])


@pytest.mark.compiled  # fifty turns of fitting
def test_a_fit_climbs(waving):
    """Each turn explains the voxels better, until the pose is that of the figure.

    Nearly nothing is foreseen: nothing at all would leave it open how a straight arm is twisted.
    """
    runs, _, figures = waving
    model = model_of(figures[0], runs)
    bent = voxel_centers(GRID, voxel_index(runs, 3))
    voxels = blobs.gather_voxels(bent, np.zeros(len(bent), int), np.ones((1, 16), np.float32))
    start = articulated.rest_pose(model.origin)
    likelihood = [
        fit_frame(
            model, voxels, start, start, settings=FitSettings(foreseen=1e-4), steps=n, widening=1.0
        ).likelihood
        for n in (0, 2, 4, 8, 16)
    ]
    assert (np.diff(likelihood) > -1e-6).all()
    assert likelihood[1] > likelihood[0] + 0.1
    fit = fit_frame(model, voxels, start, start, settings=FitSettings(), steps=16)
    elbow = articulated.place_bones(fit.pose, model.origin)[B("RForeArm")]
    wrist = articulated.place_bones(fit.pose, model.origin)[B("RHand")]
    lifted = np.arctan2(wrist[1] - elbow[1], elbow[0] - wrist[0])
    assert lifted == pytest.approx(0.48, abs=0.06)


@pytest.fixture(scope="module")
def waving():
    """A figure that bends its forearms; frame 5 is empty."""
    figures = [figure_of_tubes(0.16 * t) for t in range(9)]
    occupied = np.stack([f[1] for f in figures])
    occupied[5] = False
    position = np.stack([[f[0][name] for name in JOINTS] for f in figures])
    return encode_runs(occupied), position, figures


def hulls_of(runs):
    return [take_frame(runs, frame) for frame in range(runs.frames)]


def test_feet_pull_more_while_the_body_is_followed(waving, monkeypatch):
    model, frames = model_of(waving[2][0], waving[0]), 3
    pulls = {"follow": [], "merge": [], "settle": []}
    rest = articulated.rest_pose(model.origin)
    fits = [Fit(rest, 0.0, np.ones(len(BONES)))] * frames

    def note(name, found):
        def noted(take, *_):
            pulls[name].append([target.weight for target in take.targets(0)])
            return found

        return noted

    monkeypatch.setattr(joint, "follow", note("follow", fits))
    monkeypatch.setattr(joint, "merge", note("merge", [rest] * frames))
    monkeypatch.setattr(joint, "settle", note("settle", fits))
    monkeypatch.setattr(joint, "settle_centers", lambda take, _: take.model)
    monkeypatch.setattr(joint, "tell_sides", lambda take, found: (take, found, None, None))
    monkeypatch.setattr(joint, "exchange_by_colors", lambda *given: given[:3])
    monkeypatch.setattr(joint, "turn_feet", lambda _, found: found)
    cues = np.zeros((frames, 5, 3))
    take = Fitting(
        GRID, 30.0, model, JointMethodSettings(), cues, None, cues[0], [()] * frames,
        np.ones((1, 16), np.float32),
    )  # fmt: skip
    joint.fit_in_passes(take, 0, rest, None)
    own = [target.weight for target in take.targets(0)]
    more = np.array([1.0, 1.0, 1.0, 2.5, 2.5])  # face, hands, feet
    for name, expected in (("follow", own * more), ("merge", own * more), ("settle", own)):
        assert pulls[name]
        np.testing.assert_allclose(pulls[name], [expected] * len(pulls[name]))


@pytest.mark.slow
def test_a_waving_figure_is_followed_through_an_empty_frame(waving):
    runs, position, figures = waving
    fitted = fit_poses(hulls_of(runs), GRID, 30.0, position[0], figures[0][2])
    away = np.linalg.norm(fitted.position - position, axis=2)
    assert away[[0, 1, 2, 3, 4, 7, 8]].max() < 0.05
    assert away.max() < 0.15
    assert fitted.doubtful.tolist() == [t == 5 for t in range(9)]
    assert (fitted.quality[5] == 0).all()
    mean, inverse = fitted_blobs(fitted, 8)
    segment = SEGMENT[fitted.model.blobs.bone]
    _, occupied, label = figures[8]
    points = np.asarray(GRID.origin_m) + np.argwhere(occupied) * GRID.voxel_m
    d = points[:, None] - mean
    nearest = segment[np.einsum("vbi,bij,vbj->vb", d, inverse, d).argmin(1)] + 1
    assert (nearest == label).mean() > 0.9


@pytest.mark.slow
def test_elbows_that_were_placed_wrong_are_found_where_forearms_turn(waving):
    runs, position, figures = waving
    wrong = position[0].copy()
    elbows = [JOINTS.index(name) for name in ("RElbow", "LElbow")]
    hips = [JOINTS.index(name) for name in ("RHip", "LHip")]
    wrong[elbows, 0] += [0.04, -0.04]  # up the arms
    fitted = fit_poses(hulls_of(runs), GRID, 30.0, wrong, figures[0][2])
    assert np.linalg.norm(fitted.initial - position[0], axis=1)[elbows].max() < 0.02
    np.testing.assert_array_equal(fitted.initial[hips], position[0][hips])


def test_cloth_that_hangs_from_an_arm_stays_below_it(waving):
    _, _, figures = waving
    joints, occupied, label = figures[0]
    points = np.asarray(GRID.origin_m) + np.argwhere(occupied) * GRID.voxel_m
    sleeve = np.argwhere(np.ones((10, 15, 2))) * GRID.voxel_m + (-0.65, 1.03, -0.02)
    both = np.concatenate([points, sleeve])
    labels = np.concatenate([label, np.full(len(sleeve), SEGMENTS.index("RForeArm") + 1)])
    forward = np.array([0.0, 0.0, 1.0])
    bone = bones_of_voxels(both, labels, joints, forward)
    model = make_model(both, bone, joints, forward)
    k = B("RForeArm")
    assert set(model.cloth.bone) >= {k}
    own = model.cloth.bone == k
    assert (model.hang[own, 1] < -0.05).all()
    rotation = np.tile(np.eye(3), (len(BONES), 1, 1))
    rotation[k] = articulated.rotation_of(np.array([0.0, 0.0, -0.9]))  # the forearm rises
    pose = Pose(model.origin[B("Body")], rotation)
    placed = articulated.place_bones(pose, model.origin)
    carried = articulated.carry(pose, placed, model.cloth.bone, model.cloth.offset)[own]
    along = (carried - placed[k]) @ (rotation[k] @ (-1.0, 0.0, 0.0))
    aside = np.linalg.norm(
        carried - placed[k] - along[:, None] * (rotation[k] @ (-1.0, 0, 0)), axis=1
    )
    assert (aside < 1e-6).all()
    bare = make_model(points, bones_of_voxels(points, label, joints, forward), joints, forward)
    assert bare.cloth.share.sum() < 0.1 * model.cloth.share.sum()


def test_arguments_that_do_not_fit_are_named(waving):
    runs, position, figures = waving
    label = figures[0][2]
    with pytest.raises(ValueError, match=r"rate_hz -1\.0 must be positive"):
        fit_poses(hulls_of(runs), GRID, -1.0, position[0], label)
    with pytest.raises(ValueError, match="initial_frame 9 is not one of the take's 9 frames"):
        fit_poses(hulls_of(runs), GRID, 30.0, position[0], label, initial_frame=9)
    with pytest.raises(ValueError, match=r"position has shape \(20, 3\)"):
        fit_poses(hulls_of(runs), GRID, 30.0, position[0, 1:], label)
    with pytest.raises(ValueError, match="give a label for each"):
        fit_poses(hulls_of(runs), GRID, 30.0, position[0], label[1:])
    with pytest.raises(ValueError, match="cues has shape"):
        fit_poses(hulls_of(runs), GRID, 30.0, position[0], label, cues=np.zeros((9, 2, 3)))
    with pytest.raises(ValueError, match="hand_ends are of 1 frames, the take has 9"):
        fit_poses(hulls_of(runs), GRID, 30.0, position[0], label, hand_ends=[np.zeros((1, 3))])
    missing = position[0].copy()
    missing[JOINTS.index("RKnee")] = np.nan
    with pytest.raises(ValueError, match="has no RKnee; place"):
        fit_poses(hulls_of(runs), GRID, 30.0, missing, label)


def test_settings_out_of_their_ranges_are_all_named():
    message = r"most_likeness is 0\.5, .* 1 or more; keep_moving is 1\.5, .*; swivels is 0, "
    with pytest.raises(ValueError, match=message):
        JointMethodSettings(most_likeness=0.5, keep_moving=1.5, swivels=0)
    with pytest.raises(ValueError, match=r"steps is 0, .* 1 or more; nobody is 0\.0, .* than 0"):
        FitSettings(steps=0, nobody=0.0)
