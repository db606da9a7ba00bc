"""Fitted poses: derivatives, blobs, recovered limbs and a whole synthetic take."""

import numpy as np
import pytest

from storage.schema import JOINTS, SEGMENTS
from tasks.geometry import articulated, blobs, limb_search
from tasks.geometry.articulated import BONES, PARENT, SEGMENT, Pose
from tasks.geometry.blob_fitting import FitSettings, Target, fit_frame, miss, weigh, worth
from tasks.geometry.fit_model import bones_of_voxels, make_model
from tasks.geometry.voxels import VoxelGrid, encode_runs, take_frame, voxel_centers, voxel_index
from tasks.pose_fitting import fit_poses, fitted_blobs

B = BONES.index


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.fixture
def origin(rng):
    return rng.normal(size=(len(BONES), 3))


@pytest.fixture
def pose(rng):
    turns = [articulated.rotation_of(v) for v in rng.normal(size=(len(BONES), 3))]
    return Pose(rng.normal(size=3), np.stack(turns))


def test_the_derivative_of_a_point_is_what_a_small_move_does(rng, origin, pose):
    """With identity weights the right side is the gradient of half the squared distance."""
    bone, offset = np.array([B("RHand"), B("LFoot"), B("Head")]), rng.normal(size=(3, 3))
    goal = rng.normal(size=(3, 3))

    def half_squared(at):
        places = articulated.carry(at, articulated.place_bones(at, origin), bone, offset)
        return 0.5 * ((goal - places) ** 2).sum()

    joints = articulated.place_bones(pose, origin)
    points = articulated.carry(pose, joints, bone, offset)
    system = np.zeros((articulated.UNKNOWNS, articulated.UNKNOWNS + 1))
    weights = np.tile(np.eye(3), (3, 1, 1))
    articulated.add_points(bone, points, weights, goal - points, joints, system)
    for unknown in range(articulated.UNKNOWNS):
        step = np.zeros(articulated.UNKNOWNS)
        values = []
        for size in (1e-6, -1e-6):
            step[unknown] = size
            turned = np.empty_like(pose.rotation)
            articulated.move(step, pose.rotation, turned)
            values.append(half_squared(Pose(pose.root + step[:3], turned)))
        slope = (values[0] - values[1]) / 2e-6
        assert system[unknown, -1] == pytest.approx(-slope, abs=1e-6)
    np.testing.assert_allclose(system[:, :-1], system[:, :-1].T, atol=1e-12)
    assert np.abs(system[:, -1]).max() > 0.1


def test_the_normal_matrix_is_the_jacobian_times_itself(rng, origin, pose):
    joints = articulated.place_bones(pose, origin)
    bone, offset = np.array([B("LForeArm")]), rng.normal(size=(1, 3))
    point = articulated.carry(pose, joints, bone, offset)
    root = rng.normal(size=(3, 3))
    weight = root @ root.T
    system = np.zeros((articulated.UNKNOWNS, articulated.UNKNOWNS + 1))
    articulated.add_points(bone, point, weight[None], np.zeros((1, 3)), joints, system)
    jacobian = np.zeros((3, articulated.UNKNOWNS))
    jacobian[:, :3] = np.eye(3)
    k = int(bone[0])
    while k >= 0:
        for axis in range(3):
            jacobian[:, 3 + 3 * k + axis] = np.cross(np.eye(3)[axis], point[0] - joints[k])
        k = int(PARENT[k])
    np.testing.assert_allclose(system[:, :-1], jacobian.T @ weight @ jacobian, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-10, 0.3, 3.0, 3.14])
def test_a_rotation_is_found_again(rng, angle):
    axis = rng.normal(size=3)
    vector = axis / np.linalg.norm(axis) * angle
    again = articulated.vector_of(articulated.rotation_of(vector))
    np.testing.assert_allclose(again, vector, atol=1e-7)


def test_a_steady_turn_goes_on(origin):
    def at(t):
        turns = np.tile(articulated.rotation_of(np.array([0.0, 0.2 * t, 0.0])), (15, 1, 1))
        turns[B("RForeArm")] = turns[0] @ articulated.rotation_of(np.array([0.3 * t, 0, 0]))
        return Pose(np.array([0.1 * t, 0.0, 0.0]), turns)

    ahead = articulated.extrapolate(at(1), at(2), 1.0, 1.0)
    np.testing.assert_allclose(ahead.rotation[:11], at(3).rotation[:11], atol=1e-9)
    np.testing.assert_allclose(ahead.root, at(3).root)


def test_a_knee_beyond_its_limit_is_pushed_back(origin):
    rotation = np.tile(np.eye(3), (15, 1, 1))
    k = B("RLowerLeg")
    rotation[k] = articulated.rotation_of(np.array([-0.6, 0.0, 0.0]))  # shin forwards (+z)
    limits = np.array([[k, 1, 0, -1, 0, 0, 0, 1, 0.1]], float)
    system = np.zeros((articulated.UNKNOWNS, articulated.UNKNOWNS + 1))
    nothing = np.zeros((15, 2))
    articulated.add_priors(rotation, rotation, nothing, limits, system[:, :-1], system[:, -1])
    assert system[3 + 3 * k, -1] > 0.1
    rotation[k] = rotation[k].T
    system[:] = 0
    articulated.add_priors(rotation, rotation, nothing, limits, system[:, :-1], system[:, -1])
    assert not system.any()


def _mostly_spread(rng, number, size):
    root = rng.normal(size=(number, 3, 3)) * size + size * np.eye(3)
    return root @ root.transpose(0, 2, 1)


@pytest.mark.parametrize("count", [1, 63, 64, 150])
def test_voxels_share_out_as_in_a_plain_loop(rng, count):
    points = rng.normal(size=(count, 3)) * (4.0, 1.0, 1.0)
    points = points[np.argsort(points[:, 0])]  # blocks that lie apart: some blobs are far from some
    mean = points[rng.integers(count, size=5)] + 0.3 * rng.normal(size=(5, 3))
    covariance = _mostly_spread(rng, 5, 0.4)
    factor, nobody = rng.uniform(0.5, 2.0, size=5).astype(np.float32), 0.03
    looks = rng.uniform(0.2, 5.0, size=(7, 3)).astype(np.float32)
    cell = rng.integers(-1, 6, size=count)
    kind = np.array([0, 2, 1, 1, 0])
    inverse = np.linalg.inv(covariance)
    half = np.sqrt(18 * np.einsum("bii->bi", covariance))
    voxels = blobs.gather_voxels(points, cell, looks)
    sums = np.empty((5, 4))
    likelihood = blobs.share_out(
        (voxels.count, voxels.points, voxels.likeness, voxels.boxes),
        (mean, inverse, half, factor, kind),
        nobody,
        sums,
    )
    expected, total = np.zeros((5, 4)), 0.0
    for n, point in enumerate(points):
        weight = np.zeros(5)
        for b in range(5):
            away = point - mean[b]
            squared = float(away @ inverse[b] @ away)
            own = factor[b] * looks[cell[n], kind[b]]
            weight[b] = own * np.exp(-squared / 2) if squared < 18 else 0.0
        total += np.log(weight.sum() + nobody)
        expected[:, 0] += weight / (weight.sum() + nobody)
        expected[:, 1:] += (weight / (weight.sum() + nobody))[:, None] * point
    np.testing.assert_allclose(sums, expected, atol=1e-4)
    assert likelihood == pytest.approx(total / count, abs=1e-5)
    assert 0 < expected[:, 0].sum() < count


def test_a_blob_is_placed_with_all_that_is_within_its_reach(rng, origin, pose):
    covariance = _mostly_spread(rng, 4, 0.1)
    bone, offset = (
        np.array([B("Head"), B("RHand"), B("LFoot"), B("Waist")]),
        rng.normal(size=(4, 3)),
    )
    hang = np.zeros((4, 3))
    hang[3] = (0.0, -0.4, 0.1)
    joints = articulated.place_bones(pose, origin)
    mean, inverse, half = np.empty((4, 3)), np.empty((4, 3, 3)), np.empty((4, 3))
    body = (bone, offset, hang, np.linalg.inv(covariance), covariance, 3)
    blobs.place_blobs(body, joints, pose.rotation, 1.5, (mean, inverse, half))
    np.testing.assert_allclose(
        mean, articulated.carry(pose, joints, bone, offset) + hang, atol=1e-12
    )
    for b in range(4):
        turned = pose.rotation[bone[b]] if b < 3 else np.eye(3)  # what hangs does not turn
        wide = turned @ covariance[b] @ turned.T * 1.5**2
        np.testing.assert_allclose(inverse[b] @ wide, np.eye(3), atol=1e-9)
        some = rng.normal(size=(4000, 3)) @ np.linalg.cholesky(wide).T * 3
        near = np.einsum("pi,ij,pj->p", some, inverse[b], some) < 18
        assert (np.abs(some[near]) <= half[b]).all()
        assert (np.abs(some[near]).max(0) > 0.8 * half[b]).all()


def test_blobs_hold_the_voxels_they_are_made_of(rng):
    points = rng.normal(size=(500, 3)) * (0.05, 0.1, 0.2)
    made = blobs.make_blobs(
        points, np.zeros(500, int), np.zeros((1, 3)), np.array([4]), softness_m=0.01
    )
    assert made.share.sum() == pytest.approx(1)
    middle = made.share @ made.offset
    np.testing.assert_allclose(middle, points.mean(0), atol=1e-9)
    away = made.offset - middle
    between = np.einsum("b,bi,bj->ij", made.share, away, away)
    within = np.einsum("b,bij->ij", made.share, made.covariance)
    np.testing.assert_allclose(
        between + within, np.cov(points.T) + 0.01**2 * np.eye(3), rtol=0.05, atol=1e-4
    )


@pytest.mark.parametrize("widening", [1.0, 1.5])
def test_blobs_are_pulled_to_the_middle_of_their_voxels_by_at_most_their_share(
    rng, waving, widening
):
    runs, _, figures = waving
    model = _model_of(figures[0], runs)
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


def test_a_hand_goes_where_it_was_seen(waving):
    runs, _, figures = waving
    model = _model_of(figures[0], runs)
    points = voxel_centers(GRID, voxel_index(runs, 0))
    voxels = blobs.gather_voxels(points, np.zeros(len(points), int), np.ones((1, 16), np.float32))
    pose, hand = articulated.rest_pose(model.origin), B("LHand")
    place = model.origin[hand] + np.array([0.03, 0.05, 0.0])
    target = Target(hand, np.array([0.03, 0.0, 0.0]), place, 1e4, 0.2)
    fit = fit_frame(model, voxels, pose, pose, [target], settings=FitSettings())
    free = fit_frame(model, voxels, pose, pose, settings=FitSettings())
    assert miss(model, fit.pose, [target])[0] < 0.01
    assert miss(model, free.pose, [target])[0] > 0.04
    assert worth(model, fit, [target]) > worth(model, free, [target])


def test_poses_blend_by_the_shortest_way(origin, pose):
    about = np.array([0.2, -0.3, 0.1])
    other = Pose(pose.root + 1.0, articulated.rotation_of(about) @ pose.rotation)
    mixed = articulated.blend([pose, other], np.array([1.0, 3.0]), pose)
    np.testing.assert_allclose(mixed.root, pose.root + 0.75)
    expected = articulated.rotation_of(0.75 * about) @ pose.rotation
    np.testing.assert_allclose(mixed.rotation, expected, atol=1e-9)


def _model_of(figure, runs):
    joints, _, label = figure
    points = voxel_centers(GRID, voxel_index(runs, 0))
    forward = np.array([0.0, 0.0, 1.0])
    return make_model(points, bones_of_voxels(points, label, joints, forward), joints, forward)


def test_a_fit_climbs(waving):
    """Each turn explains the voxels better, until the pose is that of the figure."""
    runs, _, figures = waving
    model = _model_of(figures[0], runs)
    bent = voxel_centers(GRID, voxel_index(runs, 3))
    voxels = blobs.gather_voxels(bent, np.zeros(len(bent), int), np.ones((1, 16), np.float32))
    start = articulated.rest_pose(model.origin)
    likelihood = [
        fit_frame(
            model, voxels, start, start, settings=FitSettings(foreseen=0.0), steps=n, widening=1.0
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


@pytest.mark.parametrize("limb", limb_search.LIMBS, ids=["r arm", "l arm", "r leg", "l leg"])
def test_a_limb_reaches_the_place_whatever_its_swivel(rng, pose, limb):
    origin = rng.normal(size=(len(BONES), 3)) * 0.3
    offset = np.array([0.1, 0.0, 0.05])
    start = articulated.place_bones(pose, origin)[limb.upper]
    upper = np.linalg.norm(origin[limb.lower] - origin[limb.upper])
    lower = np.linalg.norm(origin[limb.end] + offset - origin[limb.lower])
    place = start + np.array([0.0, 0.6, 0.8]) * np.hypot(upper, lower)
    found = limb_search.reach_for(pose, origin, limb, offset, place, 4)
    elbows = []
    for other in found:
        joints = articulated.place_bones(other, origin)
        end = joints[limb.end] + other.rotation[limb.end] @ offset
        np.testing.assert_allclose(end, place, atol=1e-9)
        elbows.append(joints[limb.lower])
    assert np.linalg.norm(elbows[0] - elbows[2]) > 0.05


def test_the_choice_changes_only_where_the_fits_meet():
    places = np.zeros((2, 12, 1, 3))
    places[1, :, 0, 0] = [1, 1, 1, 1, 1, 0, 0, 1, 1, 1, 1, 1]
    costs = np.zeros((2, 12))
    costs[0, 7:] = 1.0
    costs[1, :4] = 1.0
    chosen = limb_search.choose_fits(costs, places, 0.05)
    assert (chosen[:4] == 0).all()
    assert (chosen[7:] == 1).all()


GRID = VoxelGrid((-1.0, 0.01, -0.5), 0.02, (100, 92, 50))

JOINT_PLACES = {
    "Head": (0, 1.7, 0), "Neck": (0, 1.44, 0), "Waist": (0, 1.0, 0),
    "RShoulder": (-0.18, 1.4, 0), "RElbow": (-0.45, 1.4, 0), "RWrist": (-0.68, 1.4, 0),
    "RFin": (-0.85, 1.4, 0), "RHip": (-0.1, 0.9, 0), "RKnee": (-0.11, 0.5, 0),
    "RAnkle": (-0.12, 0.09, 0), "RHeel": (-0.12, 0.03, -0.06), "RFoot": (-0.12, 0.03, 0.16),
}  # fmt: skip
TUBES = (
    (0, "Head", "Neck", 0.09, 0), (1, "Neck", "Waist", 0.13, 1), (2, "Waist", "Hips", 0.13, 2),
    (3, "Shoulder", "Elbow", 0.05, 3), (4, "Elbow", "Fin", 0.04, 4),
    (7, "Hip", "Knee", 0.08, 7), (8, "Knee", "Ankle", 0.05, 8), (8, "Heel", "Foot", 0.04, 8),
)  # fmt: skip


def _joints(bend):
    """Return the joints of a figure whose forearms are bent up by an angle."""
    at = {name: np.array(place, float) for name, place in JOINT_PLACES.items()}
    for name in list(at):
        if name[0] == "R":
            at["L" + name[1:]] = at[name] * (-1, 1, 1)
    for side, sign in (("R", -1), ("L", 1)):
        for name in ("Wrist", "Fin"):
            length = abs(at[side + name][0] - at[side + "Elbow"][0])
            way = np.array([sign * np.cos(bend), np.sin(bend), 0.0])
            at[side + name] = at[side + "Elbow"] + length * way
    at["Hips"] = (at["RHip"] + at["LHip"]) / 2
    return at


def _figure(bend):
    """Return the joints, occupied voxels and labels of a figure of tubes."""
    at = _joints(bend)
    index = np.argwhere(np.ones(GRID.shape, bool))
    points = np.asarray(GRID.origin_m) + index * GRID.voxel_m
    best, label = np.full(len(points), np.inf), np.zeros(len(points), np.uint8)
    for number, first, last, radius, _ in TUBES:
        for shift, side in ((0, "R"), (2, "L")) if first not in at else ((0, ""),):
            a, b = at[side + first], at[side + last]
            share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            away = np.linalg.norm(points - a - share[:, None] * (b - a), axis=1) / radius
            label[away < best] = number + 1 + shift
            best = np.minimum(best, away)
    occupied = best < 1
    return at, occupied.reshape(GRID.shape), label[occupied]


@pytest.fixture(scope="module")
def waving():
    """A figure that bends its forearms; frame 5 is empty."""
    figures = [_figure(0.16 * t) for t in range(9)]
    occupied = np.stack([f[1] for f in figures])
    occupied[5] = False
    position = np.stack([[f[0][name] for name in JOINTS] for f in figures])
    return encode_runs(occupied), position, figures


def hulls_of(runs):
    return [take_frame(runs, frame) for frame in range(runs.frames)]


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
    missing = position[0].copy()
    missing[JOINTS.index("RKnee")] = np.nan
    with pytest.raises(ValueError, match="has no RKnee; place"):
        fit_poses(hulls_of(runs), GRID, 30.0, missing, label)
