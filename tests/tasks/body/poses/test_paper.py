import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from storage.schema import JOINTS
from tasks.body.anatomy import segments as tree
from tasks.body.anatomy import shape as body_model
from tasks.body.poses import paper as paper_fitting
from tests.conftest import swaying_body
from tests.twins.segments import pose_in_world

RATE_HZ, STATURE_M = 30.0, 1.6
SETTINGS = paper_fitting.PaperMethodSettings()


@pytest.fixture
def rng():
    return np.random.default_rng(53)


@pytest.fixture
def body(rng):
    """Return voxels, labels and model of a body of eleven clouds, each along its segment."""
    joint = swaying_body(2, 1)[0]
    center, label = [], []
    for k, (origin, ends) in enumerate(zip(tree.ORIGINS, tree.ENDS, strict=True)):
        begin = joint[JOINTS.index(origin)]
        end = np.mean([joint[JOINTS.index(name)] for name in ends], axis=0)
        share = rng.uniform(0.1, 1.0, (900 + 10 * k, 1))
        cloud = (
            begin + share * (end - begin) + rng.normal(size=(len(share), 3)) * [0.05, 0.02, 0.03]
        )
        center.append(cloud)
        label.append(np.full(len(share), k + 1))
    center, label = np.concatenate(center), np.concatenate(label)
    return center, label, body_model.measure_body(center, label, joint)


def fit(center, label, model, *, settings=SETTINGS, rate_hz=RATE_HZ):
    return paper_fitting.fit_frame_as_paper(
        center,
        label,
        model.shape,
        (model.position, model.rotation),
        settings,
        rate_hz=rate_hz,
        stature_m=STATURE_M,
    )


def count_by_equation_3(voxels, mean, inverse):
    """Write out equations (3) and (4): (M - g)^T (4 K)^-1 (M - g) <= 1."""
    spread = np.linalg.inv(inverse)
    fitting = np.linalg.inv(4 * spread)
    return sum((point - mean) @ fitting @ (point - mean) <= 1 for point in voxels)


def moved(body, segment, turn):
    """Return the clouds after a segment, and what hangs on it, was turned about its joint."""
    center, label, model = body
    local, rotation = tree.pose_in_parents(model.position, model.rotation)
    rotation[segment] = rotation[segment] @ Rotation.from_euler("XYZ", turn).as_matrix()
    position, rotation = pose_in_world(local, rotation)
    of = label - 1
    away = np.einsum("nji,nj->ni", model.rotation[of], center - model.position[of])
    return position[of] + np.einsum("nij,nj->ni", rotation[of], away), (position, rotation)


def test_turns_are_about_x_then_y_then_z(rng):
    for _ in range(5):
        angles = rng.uniform(-1, 1, 3)
        wanted = Rotation.from_euler("XYZ", angles).as_matrix()
        np.testing.assert_allclose(paper_fitting._turn(angles), wanted, atol=1e-12)


def test_quality_is_the_share_inside_by_equations_3_and_4(body):
    center, label, model = body
    still = paper_fitting.PaperMethodSettings(turn_speed=1e-9, head_speed=1e-9)
    position, rotation, quality = fit(center, label, model, settings=still)
    np.testing.assert_allclose(position, model.position, atol=1e-9)
    mean, inverse = tree.place_ellipsoids(model.shape, position, rotation)
    for k in range(11):
        voxels = center[label == k + 1]
        inside = count_by_equation_3(voxels, mean[k], inverse[k])
        assert quality[k] == pytest.approx(inside / len(voxels))
        assert 0.5 < quality[k] < 1


def test_a_fit_never_holds_fewer_voxels_than_it_began_with(body):
    center, label, model = body
    *_, before = fit(
        center,
        label,
        model,
        settings=paper_fitting.PaperMethodSettings(turn_speed=1e-9, head_speed=1e-9),
    )
    *_, after = fit(center, label, model)
    assert after[0] >= before[0]
    assert after[1:].mean() > 0.7


@pytest.mark.parametrize("segment", [3, 4, 8, 9])
def test_a_limb_that_turned_is_followed(body, segment):
    center, (position, rotation) = moved(body, segment, [0.0, 0.25, -0.3])
    found, turned, quality = fit(center, *body[1:])
    truth = position + (rotation @ body[2].shape.centroid[..., None])[..., 0]
    guess = found + (turned @ body[2].shape.centroid[..., None])[..., 0]
    still = body[2].position + (body[2].rotation @ body[2].shape.centroid[..., None])[..., 0]
    moves = np.linalg.norm(truth[segment] - still[segment])
    assert np.linalg.norm(guess[segment] - truth[segment]) < 0.45 * moves
    assert quality[segment] > 0.6


def test_a_head_that_moved_is_followed(body):
    center, label, model = body
    move = np.array([0.04, -0.03, 0.02])
    position, rotation, quality = fit(np.add(center, move), label, model)
    middle = tree.place_ellipsoids(model.shape, position, rotation)[0][0]
    before = tree.place_ellipsoids(model.shape, model.position, model.rotation)[0][0]
    assert np.linalg.norm(middle - before - move) < 0.5 * np.linalg.norm(move)
    assert quality[0] > 0.6


def test_no_parameter_leaves_its_bounds(body):
    center, _ = moved(body, 0, [0.2, 0.3, -0.2])
    largest = []
    for rate_hz in (30.0, 120.0):
        position, rotation, _ = fit(np.add(center, [0.08, 0, 0]), *body[1:], rate_hz=rate_hz)
        _, before = tree.pose_in_parents(body[2].position, body[2].rotation)
        _, after = tree.pose_in_parents(position, rotation)
        turns = Rotation.from_matrix(np.swapaxes(before, 1, 2) @ after).as_euler("XYZ")
        moves = np.abs(position[0] - body[2].position[0])
        assert np.abs(turns).max() <= SETTINGS.turn_speed / rate_hz + 1e-9
        assert moves.max() <= SETTINGS.head_speed * STATURE_M / rate_hz + 1e-9
        largest.append([np.abs(turns).max(), moves.max()])
    assert largest[0][0] > SETTINGS.turn_speed / 120.0
    assert largest[0][1] > SETTINGS.head_speed * STATURE_M / 120.0


def test_bones_keep_their_lengths(body):
    center, _ = moved(body, 1, [0.2, 0.1, 0.3])
    position, rotation, _ = fit(center, *body[1:])
    local, _ = tree.pose_in_parents(position, rotation)
    np.testing.assert_allclose(local[1:], body[2].shape.offset[1:], atol=1e-12)


def test_a_segment_without_voxels_hangs_on_its_parent(body):
    center, label, model = body
    _, rotation, quality = fit(center, np.where(label == 5, 0, label), model)
    assert quality[4] == 0
    _, before = tree.pose_in_parents(model.position, model.rotation)
    _, after = tree.pose_in_parents(model.position, rotation)
    np.testing.assert_allclose(after[4], before[4], atol=1e-9)


@pytest.mark.compiled
def test_a_track_begins_with_the_first_pose_and_carries_the_joints(body):
    center, label, model = body
    frames = [(model.position, model.rotation, np.ones(11))]
    for moved_center in (center, np.add(center, [0.01, 0, 0])):
        frames.append(
            paper_fitting.fit_frame_as_paper(
                moved_center, label, model.shape, frames[-1][:2], SETTINGS,
                rate_hz=RATE_HZ, stature_m=STATURE_M,
            )
        )  # fmt: skip
    track = paper_fitting.join_poses(model.shape, frames)
    assert track.joint.shape == (3, 21, 3)
    assert track.rotation.shape == (3, 11, 3, 3)
    assert (track.quality[0] == 1).all()
    np.testing.assert_allclose(track.joint[0], swaying_body(2, 1)[0], atol=1e-9)
    own = [JOINTS.index(name) for name in tree.ORIGINS]
    np.testing.assert_allclose(track.joint[:, own], track.position, atol=1e-9)


def test_what_cannot_be_fitted_is_refused(body):
    center, label, model = body
    with pytest.raises(ValueError, match=r"rate 0\.0 Hz and stature"):
        fit(center, label, model, rate_hz=0.0)
    with pytest.raises(ValueError, match="labels do not fit"):
        fit(center[1:], label, model)
    with pytest.raises(ValueError, match="no frame was fitted"):
        paper_fitting.join_poses(model.shape, [])
    with pytest.raises(ValueError, match=r"turn_speed is -1\.0, it must be a number larger than 0"):
        paper_fitting.PaperMethodSettings(turn_speed=-1.0)
    with pytest.raises(ValueError, match="halvings is -1, it must be a whole number 0 or more"):
        paper_fitting.PaperMethodSettings(halvings=-1)
