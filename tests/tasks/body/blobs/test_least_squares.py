"""An articulated body: derivatives, limits, limbs that reach, and the blobs that it carries."""

import numpy as np
import pytest

from tasks.body.anatomy import bones as articulated
from tasks.body.anatomy.bones import BONES, PARENT, Pose
from tasks.body.blobs import blobs, least_squares
from tasks.body.poses import limbs as limb_search
from tasks.geometry.voxels import encode_runs
from tests.figures.tube_figures import figure_of_tubes, model_of

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
    system = np.zeros((least_squares.UNKNOWNS, least_squares.UNKNOWNS + 1))
    weights = np.tile(np.eye(3), (3, 1, 1))
    least_squares.add_points(bone, points, weights, goal - points, joints, system)
    for unknown in range(least_squares.UNKNOWNS):
        step = np.zeros(least_squares.UNKNOWNS)
        values = []
        for size in (1e-6, -1e-6):
            step[unknown] = size
            turned = np.empty_like(pose.rotation)
            least_squares.move(step, pose.rotation, turned)
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
    system = np.zeros((least_squares.UNKNOWNS, least_squares.UNKNOWNS + 1))
    least_squares.add_points(bone, point, weight[None], np.zeros((1, 3)), joints, system)
    jacobian = np.zeros((3, least_squares.UNKNOWNS))
    jacobian[:, :3] = np.eye(3)
    k = int(bone[0])
    while k >= 0:
        for axis in range(3):
            jacobian[:, 3 + 3 * k + axis] = np.cross(np.eye(3)[axis], point[0] - joints[k])
        k = int(PARENT[k])
    np.testing.assert_allclose(system[:, :-1], jacobian.T @ weight @ jacobian, atol=1e-9)


def test_a_step_along_the_tree_is_that_of_the_whole_matrix(rng, origin, pose):
    bone = rng.integers(0, len(BONES), 40)
    joints = articulated.place_bones(pose, origin)
    points = articulated.carry(pose, joints, bone, rng.normal(size=(40, 3)))
    root = rng.normal(size=(40, 3, 3))
    system = np.zeros((least_squares.UNKNOWNS, least_squares.UNKNOWNS + 1))
    least_squares.add_points(
        bone, points, root @ root.swapaxes(1, 2), rng.normal(size=(40, 3)), joints, system
    )
    normal, right = system[:, :-1], system[:, -1]
    least_squares.add_priors(
        pose.rotation, pose.rotation, np.full((len(BONES), 2), 0.3), np.zeros((0, 9)), normal, right
    )
    normal[range(3), range(3)] += 0.3
    expected = np.linalg.solve(normal.copy(), right.copy())
    step = np.empty(least_squares.UNKNOWNS)
    least_squares.solve(system, step)
    np.testing.assert_allclose(step, expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-10, 0.3, 3.0, 3.14])
def test_a_rotation_is_found_again(rng, angle):
    axis = rng.normal(size=3)
    vector = axis / np.linalg.norm(axis) * angle
    again = articulated.vector_of(articulated.rotation_of(vector))
    np.testing.assert_allclose(again, vector, atol=1e-7)


def test_a_steady_turn_goes_on():
    def at(t):
        turns = np.tile(articulated.rotation_of(np.array([0.0, 0.2 * t, 0.0])), (15, 1, 1))
        turns[B("RForeArm")] = turns[0] @ articulated.rotation_of(np.array([0.3 * t, 0, 0]))
        return Pose(np.array([0.1 * t, 0.0, 0.0]), turns)

    ahead = articulated.extrapolate(at(1), at(2), 1.0, 1.0)
    np.testing.assert_allclose(ahead.rotation[:11], at(3).rotation[:11], atol=1e-9)
    np.testing.assert_allclose(ahead.root, at(3).root)


def test_a_knee_beyond_its_limit_is_pushed_back():
    rotation = np.tile(np.eye(3), (15, 1, 1))
    k = B("RLowerLeg")
    rotation[k] = articulated.rotation_of(np.array([-0.6, 0.0, 0.0]))  # shin forwards (+z)
    limits = np.array([[k, 1, 0, -1, 0, 0, 0, 1, 0.1]], float)
    system = np.zeros((least_squares.UNKNOWNS, least_squares.UNKNOWNS + 1))
    nothing = np.zeros((15, 2))
    least_squares.add_priors(rotation, rotation, nothing, limits, system[:, :-1], system[:, -1])
    assert system[3 + 3 * k, -1] > 0.1
    rotation[k] = rotation[k].T
    system[:] = 0
    least_squares.add_priors(rotation, rotation, nothing, limits, system[:, :-1], system[:, -1])
    assert not system.any()


@pytest.mark.parametrize(("up", "is_pushed"), [(1.0, True), (0.4, False), (-0.8, False)])
def test_a_foot_does_not_stand_up_along_the_shin(up, is_pushed):
    figure = figure_of_tubes(0.0)
    model = model_of(figure, encode_runs(figure[1][None]))
    rotation = np.tile(np.eye(3), (15, 1, 1))
    k = B("LFoot")
    rotation[k] = articulated.rotation_of(np.array([-up, 0.0, 0.0]))  # toes (+z) up
    system = np.zeros((least_squares.UNKNOWNS, least_squares.UNKNOWNS + 1))
    least_squares.add_priors(
        rotation, rotation, np.zeros((15, 2)), model.limits, system[:, :-1], system[:, -1]
    )
    assert (system[3 + 3 * k, -1] > 0.1) == is_pushed
    assert system.any() == is_pushed


def test_poses_blend_by_the_shortest_way(pose):
    about = np.array([0.2, -0.3, 0.1])
    other = Pose(pose.root + 1.0, articulated.rotation_of(about) @ pose.rotation)
    mixed = articulated.blend([pose, other], np.array([1.0, 3.0]), pose)
    np.testing.assert_allclose(mixed.root, pose.root + 0.75)
    expected = articulated.rotation_of(0.75 * about) @ pose.rotation
    np.testing.assert_allclose(mixed.rotation, expected, atol=1e-9)


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
