import numpy as np
import pytest

from tasks.body.initial.joints import exchange_feet
from tasks.body.initial.legs import find_feet, find_fork, measure_depths, measure_leg
from tasks.geometry.voxels import VoxelGrid

ORIGIN = np.array([-0.5, 0.01, -0.5])
CENTER = np.stack(np.meshgrid(*(np.arange(100),) * 3, indexing="ij"), -1) * 0.01 + ORIGIN
FRONT, LEFT = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
STATURE = 1.66


def foot_of(ankle, out_degrees, outward=LEFT):
    """Return the voxels of a foot that is turned out from FRONT."""
    out = np.radians(out_degrees)
    along = np.cos(out) * FRONT + np.sin(out) * outward
    across = np.cross(along, [0.0, 1.0, 0.0])
    return np.array(
        [ankle * [1, 0, 1] + a * along + b * across + [0, height, 0]
         for a in np.arange(-0.06, 0.2, 0.01) for b in (-0.03, 0, 0.03) for height in (0, 0.03)]
    )  # fmt: skip


def leg_of(hull, foot, hip, inward=-LEFT):
    depths = measure_depths(hull.astype(np.uint8), ORIGIN, 0.01)
    return measure_leg(foot, hip, FRONT, inward, depths, STATURE)


def skirt_of(hip, ankle):
    """Return an upright skirt, wide enough to tell nothing of where knees are."""
    middle = (hip + ankle) / 2
    away = np.linalg.norm((CENTER - middle) * [1, 0, 1], axis=-1)
    return (away < 0.4) & (CENTER[..., 1] < hip[1] + 0.05)


def test_a_knee_is_where_the_leg_bends():
    hip, ankle = np.array([0.1, 0.85, 0.0]), np.array([0.12, 0.07, 0.0])
    for knee in (np.array([0.22, 0.46, 0.02]), np.array([0.11, 0.46, 0.15])):
        hull = np.zeros(CENTER.shape[:3], bool)
        for a, b in ((hip, knee), (knee, ankle)):
            share = np.clip((CENTER - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)[..., None]
            hull |= np.linalg.norm(CENTER - a - share * (b - a), axis=-1) < 0.06
        leg = leg_of(hull, foot_of(ankle, 0), hip)
        assert np.linalg.norm(leg.knee - knee) < 0.035
        assert np.linalg.norm(leg.toe - [0.12, 0.023, 0.19]) < 0.02


@pytest.mark.parametrize(("side", "degrees"), [(1, 60), (1, 10), (1, -15), (-1, 60), (-1, -15)])
def test_under_a_skirt_a_knee_bends_where_its_foot_points(side, degrees):
    """Ten degrees farther inwards, by the thigh-foot angle, at a leg's lengths (cosine rule)."""
    outward = side * LEFT
    hip, ankle = 0.1 * outward + [0.0, 0.70, 0.0], 0.1 * outward + [0.0, 0.065, 0.0]
    leg = leg_of(skirt_of(hip, ankle), foot_of(ankle, degrees, outward), hip, -outward)
    bend = np.radians(degrees - 10)
    ahead = np.cos(bend) * FRONT + np.sin(bend) * outward
    thigh, shank, height = 0.238 * STATURE, 0.243 * STATURE, hip[1] - leg.ankle[1]
    below = (thigh**2 + height**2 - shank**2) / (2 * height)
    knee = hip - [0, below, 0] + np.sqrt(thigh**2 - below**2) * ahead
    assert np.linalg.norm(leg.knee - knee) < 0.04


def test_a_foot_that_is_turned_in_is_rather_the_other_one():
    """Feet stand crossed, each turned out to its own side: that way round they cost less."""
    hips = [0.1 * side * LEFT + [0.0, 0.80, 0.0] for side in (-1, 1)]
    ankles = [-0.08 * side * LEFT + [0.0, 0.065, 0.05 * side] for side in (-1, 1)]
    feet = [foot_of(ankle, 30, side * LEFT) for ankle, side in zip(ankles, (-1, 1), strict=True)]
    hull = skirt_of(np.array([0.0, 0.8, 0.0]), np.zeros(3))

    def cost(way):
        inward = (LEFT, -LEFT)
        return sum(leg_of(hull, feet[way[n]], hips[n], inward[n]).cost for n in range(2))

    assert cost((0, 1)) + 6 < cost((1, 0))


def standing(*, fork, legs=((-0.12, 0.1), (0.12, 0.1)), hem=None):
    """Return cells, centers and feet of a trunk on legs, which meet at cells of the height `fork`.

    legs: middle to the left, and half its width, of each; hem: the height a skirt hangs to.
    """
    cells = np.argwhere(np.ones((60, 100, 30), bool))
    x, height = (cells[:, 0] - 29.5) * 0.01, cells[:, 1]
    body = np.zeros(len(cells), bool)
    for middle, half in legs:
        body |= abs(x - middle) < half
    body |= height >= fork
    body |= (height >= hem) if hem is not None else False
    cells = cells[body] + (3, 7, 5)
    point = ORIGIN + cells * 0.01
    hips = point.mean(axis=0) * [1, 0, 1] + [0, 0.5, 0]
    return cells, point, find_feet(point, LEFT, hips, 1.0, 0.01)


@pytest.mark.parametrize(("fork", "hem"), [(44, None), (61, None), (44, 21)])
def test_legs_fork_where_cells_join_them(fork, hem):
    cells, point, feet = standing(fork=fork, hem=hem)
    lowest = fork if hem is None else hem
    assert find_fork(cells, point, feet) == pytest.approx(0.01 * lowest)


def test_a_hand_between_two_legs_does_not_join_them_but_where_it_touches():
    cells, point, feet = standing(fork=44)
    between = np.array([(32, 7 + z, 20) for z in range(20, 30)])
    cells, point = np.vstack([cells, between]), np.vstack([point, ORIGIN + between * 0.01])
    assert find_fork(cells, point, feet) == pytest.approx(0.44)
    edges = np.array([(3 + x, 27 + x % 2, 20) for x in range(22, 38)])  # cells that share no face
    cells, point = np.vstack([cells, edges]), np.vstack([point, ORIGIN + edges * 0.01])
    assert find_fork(cells, point, feet) == pytest.approx(0.44)
    bridge = np.array([(3 + x, 32, 20) for x in range(60)])
    bridge = np.array([cell for cell in bridge if not (cells == cell).all(axis=1).any()])
    cells, point = np.vstack([cells, bridge]), np.vstack([point, ORIGIN + bridge * 0.01])
    assert find_fork(cells, point, feet) == pytest.approx(0.25)


def test_one_foot_and_legs_that_never_meet_have_no_fork():
    cells, point, feet = standing(fork=44)
    assert find_fork(cells, point, feet[:1]) is None
    cells, point, feet = standing(fork=1000)
    assert find_fork(cells, point, feet) is None


def legs_at(skirt):
    """Return joints of legs side by side, and the hull of trousers, or of a skirt around them."""
    joints = {}
    for side, out in (("R", -1.0), ("L", 1.0)):
        x = 0.1 * out
        joints |= {side + "Hip": np.array([x, 0.85, 0.0]), side + "Knee": np.array([x, 0.46, 0.02])}
        joints |= {
            side + "Ankle": np.array([x, 0.07, 0.0]),
            side + "Heel": np.array([x, 0.02, -0.06]),
        }
        joints[side + "Foot"] = np.array([x, 0.02, 0.2])
    if skirt:
        return joints, skirt_of(np.array([0.0, 0.85, 0.0]), np.array([0.0, 0.07, 0.0]))
    hull = np.zeros(CENTER.shape[:3], bool)
    for side in "RL":
        for a, b in ((side + "Hip", side + "Knee"), (side + "Knee", side + "Ankle")):
            way = joints[b] - joints[a]
            share = np.clip((CENTER - joints[a]) @ way / (way @ way), 0, 1)[..., None]
            hull |= np.linalg.norm(CENTER - joints[a] - share * way, axis=-1) < 0.06
    return joints, hull


@pytest.mark.parametrize("skirt", [False, True])
def test_feet_are_exchanged_and_what_the_knees_say_of_it(skirt):
    joints, hull = legs_at(skirt)
    grid = VoxelGrid((-0.5, 0.01, -0.5), 0.01, (100, 100, 100))
    found, worse = exchange_feet(joints, np.argwhere(hull), grid, STATURE)
    for side, other in ("RL", "LR"):
        for name in ("Ankle", "Heel", "Foot"):
            np.testing.assert_allclose(found[side + name], joints[other + name])
        np.testing.assert_array_equal(found[side + "Hip"], joints[side + "Hip"])
    assert (worse > 8.0) == (not skirt)
    assert worse > 5.0  # they cross
    _, back = exchange_feet(found, np.argwhere(hull), grid, STATURE)
    assert back == pytest.approx(-worse, abs=1e-9)


def test_feet_in_line_or_off_the_floor_may_be_exchanged_as_the_take_says():
    """Under a skirt nothing else is known of legs."""
    grid = VoxelGrid((-0.5, 0.01, -0.5), 0.01, (100, 100, 100))
    joints, hull = legs_at(skirt=True)
    raised = {name: joint.copy() for name, joint in joints.items()}
    for name in ("Ankle", "Heel", "Foot"):
        raised["L" + name][1] += 0.2
        joints["R" + name][0], joints["L" + name][0] = -0.01, 0.01
        joints["L" + name][2] += 0.3
    for each in (joints, raised):
        _, worse = exchange_feet(each, np.argwhere(hull), grid, STATURE)
        assert abs(worse) < 3.0
