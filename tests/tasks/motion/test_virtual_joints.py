"""Joints between the markers: worked examples in the axes of a body that stands upright.

The body looks to -z, so its right is +x and up is +y, unless a test turns it.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tasks.motion import virtual_joints as vj

FRAMES = 4


def still(*point_m):
    """One point that stays where it is, with a frame in which it is missing."""
    track = np.tile(np.array(point_m, float), (FRAMES, 1))
    track[2] = np.nan
    return track


PELVIS = (still(0.12, 1, 0), still(-0.12, 1, 0), still(0.05, 1, 0.15), still(-0.05, 1, 0.15))


def test_hip_centers_of_a_pelvis_worked_by_hand_with_harringtons_equations():
    right = vj.find_hip_center(*PELVIS, right=True)
    left = vj.find_hip_center(*PELVIS, right=False)
    # PW = 240 mm and PD = 150 mm: 45.9 mm behind, 82.9 mm below, 86.5 mm beside
    np.testing.assert_allclose(right[0], [0.0865, 1 - 0.0829, 0.0459], atol=1e-12)
    np.testing.assert_allclose(left[0], [-0.0865, 1 - 0.0829, 0.0459], atol=1e-12)
    assert np.isnan(right[2]).all()
    assert np.isfinite(right[3]).all()


def test_hip_centers_worked_by_hand_with_bells_shares():
    sacrum = still(0, 1, 0.16)
    right = vj.find_hip_center_from_sacrum(PELVIS[0], PELVIS[1], sacrum, right=True)
    left = vj.find_hip_center_from_sacrum(PELVIS[0], PELVIS[1], sacrum, right=False)
    np.testing.assert_allclose(right[0], [0.0864, 1 - 0.072, 0.0456], atol=1e-12)
    np.testing.assert_allclose(left[0], [-0.0864, 1 - 0.072, 0.0456], atol=1e-12)


def test_a_tilted_pelvis_takes_its_hips_with_it():
    turn = Rotation.from_euler("xyz", [40, 20, -30], degrees=True)
    turned = [turn.apply(marker) for marker in PELVIS]
    expected = turn.apply(vj.find_hip_center(*PELVIS, right=True))
    np.testing.assert_allclose(vj.find_hip_center(*turned, right=True), expected, atol=1e-12)


def test_one_wild_frame_of_the_pelvis_moves_no_hip_of_another_frame():
    wild = np.array(PELVIS)
    wild[0, 3] += 5.0
    hips = vj.find_hip_center(*wild, right=True)
    np.testing.assert_allclose(hips[0], [0.0865, 1 - 0.0829, 0.0459], atol=1e-12)


def test_the_chord_makes_a_right_angle_inward_of_the_knee_marker():
    hip, knee_marker, thigh_marker = still(0.09, 0.9, 0), still(0.14, 0.5, 0), still(0.2, 0.7, 0)
    knee = vj.find_chord_center(hip, knee_marker, thigh_marker)[0]
    offset = 0.22 * np.hypot(0.05, 0.4) / 2 + 0.007
    assert np.linalg.norm(knee - knee_marker[0]) == pytest.approx(offset)
    assert np.dot(knee - knee_marker[0], knee - hip[0]) == pytest.approx(0)
    assert knee[0] < 0.14 - 0.04
    assert knee[2] == 0


def test_a_thigh_marker_in_front_puts_the_knee_behind_its_marker():
    args = still(0, 0.9, 0), still(0, 0.5, 0), still(0, 0.7, -0.08)
    assert vj.find_chord_center(*args)[0, 2] > 0.04


def test_the_ankle_goes_inward_as_the_knee_did():
    args = still(0.14, 0.5, 0), still(0.09, 0.5, 0), still(0.13, 0.08, 0)
    ankle = vj.shift_ankle(*args)[0]
    shank = np.array([0.04, -0.42, 0])
    offset = 0.17 * np.linalg.norm(shank) / 2 + 0.007
    assert np.linalg.norm(ankle - args[2][0]) == pytest.approx(offset)
    assert np.dot(ankle - args[2][0], shank) == pytest.approx(0)
    assert ankle[0] < 0.13 - 0.03


def test_the_shoulder_hangs_a_sixth_of_the_acromia_below_the_marker():
    near, far = still(0.2, 1.4, 0), still(-0.2, 1.4, 0)
    spine = still(0, 1.4, 0.02), still(0, 1.1, 0.02)
    shoulder = vj.drop_shoulder(near, far, upper=(spine[0],) * 2, lower=(spine[1],) * 2)
    np.testing.assert_allclose(shoulder[0], [0.2, 1.4 - 0.17 * 0.4, 0], atol=1e-12)


def test_the_crown_is_square_above_a_head_band():
    band = [
        still(x, 1.6, z) for x, z in ((0.07, -0.09), (-0.07, -0.09), (0.07, 0.09), (-0.07, 0.09))
    ]
    np.testing.assert_allclose(vj.lift_band(*band)[0], [0, 1.685, 0], atol=1e-12)
    nod = Rotation.from_euler("x", -30, degrees=True)
    crown = vj.lift_band(*(nod.apply(corner) for corner in band))[0]
    np.testing.assert_allclose(crown, nod.apply([0, 1.685, 0]), atol=1e-12)


def test_a_head_band_of_three_markers_gives_the_same_crown():
    names = ("RFrontHead", "LFrontHead", "RBackHead", "LBackHead")
    corners = ((0.07, -0.09), (-0.07, -0.09), (0.07, 0.09), (-0.07, 0.09))
    band = {name: still(x, 1.6, z) for name, (x, z) in zip(names, corners, strict=True)}
    for lost in names:
        head = vj.place_points({name: band[name] for name in names if name != lost})["Head"]
        np.testing.assert_allclose(head[0], [0, 1.685, 0], atol=1e-12)


def test_eyes_ahead_and_above_put_the_crown_straight_above_the_skull():
    head = vj.lift_skull(still(0, 1.5, 0), still(0.03, 1.58, -0.08), still(-0.03, 1.58, -0.08))
    np.testing.assert_allclose(head[0], [0, 1.5 + 1.67 * 0.08 * 2**0.5, 0], atol=1e-12)


def test_without_eyes_the_crown_is_a_share_of_the_leg_along_the_neck():
    leg = still(0, 0.9, 0), still(0, 0.5, 0), still(0, 0.1, 0)
    head = vj.lift_neck(still(0, 1.5, 0), still(0, 1.4, 0), *leg)
    np.testing.assert_allclose(head[0], [0, 1.5 + 0.235 * 0.8, 0], atol=1e-12)


def test_a_finger_tip_lies_beyond_the_knuckle():
    tip = vj.carry_on(still(0, 1, 0), still(0.09, 1, 0), vj.HAND_LENGTH)
    np.testing.assert_allclose(tip[0], [0.09 * 188 / 86, 1, 0], atol=1e-3)


def test_a_given_joint_is_never_replaced():
    given = {"RKnee": still(1, 2, 3), "RKneeLateral": still(0, 0, 0)}
    assert vj.plan_points(given) == []
    np.testing.assert_array_equal(vj.place_points(given)["RKnee"], given["RKnee"])


def test_markers_that_coincide_give_no_joint_instead_of_a_wrong_one():
    same = still(0, 1, 0)
    assert np.isnan(vj.find_chord_center(same, same, same)).all()
    assert np.isnan(vj.lift_band(same, same, same, same)).all()
    assert np.isnan(vj.find_hip_center(same, same, same, same, right=True)).all()


def test_every_rule_moves_with_the_body(rng):
    names = sorted({need for rule in vj._RULES for need in rule.needs})
    turn, shift = Rotation.random(rng=rng), rng.normal(size=3)
    for rule in vj._RULES:
        given = {name: rng.normal(size=(5, 3)) for name in names}
        moved = [turn.apply(given[name]) + shift for name in rule.needs]
        there = rule.place(*(given[name] for name in rule.needs))
        assert np.isfinite(there).all()
        np.testing.assert_allclose(rule.place(*moved), turn.apply(there) + shift, atol=1e-10)


def test_the_right_and_left_rules_are_mirror_images(rng):
    mirror = np.array([-1.0, 1, 1])
    other = {"R": "L", "L": "R"}

    def swap(name):
        sided = name[0] in "RL" and name[1:2].isupper()
        return other[name[0]] + name[1:] if sided else name

    rules = {rule.point + str(len(rule.needs)) + rule.how: rule for rule in vj._RULES}
    names = sorted({need for rule in vj._RULES for need in rule.needs})
    given = {name: rng.normal(size=(5, 3)) for name in names}
    mirrored = {swap(name): given[name] * mirror for name in names}
    checked = 0
    for rule in vj._RULES:
        twin = rules.get(swap(rule.point) + str(len(rule.needs)) + rule.how)
        if twin is None or twin is rule or {swap(n) for n in rule.needs} != set(twin.needs):
            continue
        here = rule.place(*(given[name] for name in rule.needs))
        there = twin.place(*(mirrored[name] for name in twin.needs))
        np.testing.assert_allclose(there, here * mirror, atol=1e-10)
        checked += 1
    assert checked > 30


@pytest.fixture
def rng():
    return np.random.default_rng(7)
