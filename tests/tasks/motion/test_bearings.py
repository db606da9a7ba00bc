"""Tests of tasks.motion.bearings through tasks.motion.importing: unit, up axis, floor and sides."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from storage.errors import InputError
from storage.formats import read_motion_file
from storage.schema import JOINTS
from tasks.motion.importing import make_joint_track
from tests.figures.motion_files import GIVEN, PLUG_IN_GAIT, motion_file, said, track_of


@pytest.mark.parametrize("points", [GIVEN, PLUG_IN_GAIT], ids=["joints", "markers"])
@pytest.mark.parametrize(
    ("unit_m", "name"),
    [
        (1.0, "meters"),
        (0.01, "centimeters"),
        (0.001, "millimeters"),
        (0.0254, "inches"),
        (0.0254 / 0.45, "CMU units"),
    ],
)
def test_an_unsaid_unit_is_inferred_from_the_stature_and_said(points, unit_m, name):
    motion = motion_file(points)
    foreign = replace(motion, position=motion.position / unit_m, unit_m=None)
    track = track_of(foreign)
    np.testing.assert_allclose(track.position, track_of(motion).position, atol=1e-5)
    assert said(track, f"The unit was taken to be {name}")


def unsaid(units):
    """A body that is so many units tall, in a file that does not say its unit."""
    motion = motion_file()
    tall = track_of(motion).stature_m
    return replace(motion, position=motion.position * units / tall, unit_m=None)


def test_a_child_in_centimeters_is_not_a_giant_in_inches():
    child = track_of(unsaid(96))
    assert said(child, "taken to be centimeters (0.01 m): so the body is 0.96 m tall.")
    assert child.stature_m == pytest.approx(0.96, abs=1e-6)
    assert said(track_of(unsaid(100), stature_m=2.5), "The unit was taken to be inches")
    assert said(track_of(unsaid(100), stature_m=1.1), "The unit was taken to be centimeters")


def test_where_two_units_make_a_likely_body_both_are_said():
    track = track_of(unsaid(82))
    assert said(
        track,
        "The unit was taken to be inches (0.0254 m): so the body is 2.08 m tall; in centimeters "
        "it would be 0.82 m, which --scale 0.01 says.",
    )
    assert track.stature_m == pytest.approx(82 * 0.0254, abs=1e-5)


def test_where_no_unit_makes_a_likely_body_the_nearest_is_taken():
    assert said(track_of(unsaid(0.6)), "taken to be meters (1 m): so the body is 0.60 m tall.")
    assert said(track_of(unsaid(2200)), "taken to be millimeters (0.001 m): so the body is 2.20 m")


@pytest.mark.data
def test_a_child_of_a_real_file_is_a_child(shared_data):
    motion = read_motion_file(shared_data / "reports" / "R06" / "child.bvh")
    track = make_joint_track(motion, file_name="child.bvh")
    assert track.stature_m == pytest.approx(0.959, abs=0.001)


def test_without_a_head_the_unit_is_inferred_from_the_legs():
    legs = {name: at for name, at in GIVEN.items() if name not in ("Head", "Neck")}
    motion = motion_file(legs)
    track = track_of(replace(motion, position=motion.position * 1000, unit_m=None))
    assert said(track, "The unit was taken to be millimeters")
    assert (track.stature_m, track.stature_source) == (None, "unknown")
    assert said(track, "the take is compared as one of 1.6 m")
    assert said(track, "Missing joints: Head.")


def test_a_given_scale_overrules_what_the_file_says():
    motion = motion_file()
    track = track_of(replace(motion, unit_m=0.001), scale=2.0)
    expected = 2 * track_of(motion).position
    np.testing.assert_allclose(track.position, expected, atol=1e-5)
    assert said(track, "One unit is 2 m, as given.")


def test_a_given_scale_that_makes_no_body_is_refused():
    motion = motion_file()
    with pytest.raises(InputError, match=r"given 592 m in one unit the body is 9\d\d m tall: give"):
        track_of(motion, scale=592.0)
    with pytest.raises(InputError, match=r"given 0\.01 m in one unit the body is 0\.01\d+ m tall"):
        track_of(motion, scale=0.01)


def test_a_unit_that_makes_a_giant_is_refused_with_the_one_that_would_fit():
    motion = motion_file()
    wrong = replace(motion, position=motion.position * 1000, unit_m=1.0)
    with pytest.raises(InputError, match=r"body is 1\.\d+e\+03 m tall.*in millimeters.*--scale"):
        track_of(wrong)


def test_a_body_whose_size_cannot_be_seen_needs_a_scale():
    few = {name: at for name, at in GIVEN.items() if name[1:] in ("Hip", "Wrist", "Elbow")}
    motion = motion_file(few)
    with pytest.raises(InputError, match=r"does not say its unit, and no leg shows.*--scale"):
        track_of(replace(motion, unit_m=None))
    assert said(track_of(motion), "Y points up") is False


@pytest.mark.parametrize("points", [GIVEN, PLUG_IN_GAIT], ids=["joints", "markers"])
@pytest.mark.parametrize(
    ("up", "rotation"),
    [
        ("z", ("x", 90)),
        ("-z", ("x", -90)),
        ("x", ("z", -90)),
        ("-x", ("z", 90)),
        ("-y", ("x", 180)),
    ],
)
def test_any_axis_may_point_up(points, up, rotation):
    motion = motion_file(points)
    turn = Rotation.from_euler(*rotation, degrees=True)
    turned = turn.apply(motion.position.reshape(-1, 3)).reshape(motion.position.shape)
    np.testing.assert_allclose(abs(turn.apply([0, 1, 0])["xyz".index(up[-1])]), 1)
    expected = track_of(motion).position
    inferred = track_of(replace(motion, position=turned, up=None))
    np.testing.assert_allclose(inferred.position, expected, atol=1e-5)
    assert said(inferred, f"{up.upper()} was taken to point up")
    given = track_of(replace(motion, position=turned, up="y"), up=up)
    np.testing.assert_allclose(given.position, expected, atol=1e-5)


def test_a_bvh_file_that_stands_along_z_is_believed_against_the_custom():
    motion = motion_file(source="bvh")
    turned = motion.position[..., [0, 2, 1]] * [1, -1, 1]
    track = track_of(replace(motion, position=turned))
    np.testing.assert_allclose(track.position, track_of(motion).position, atol=1e-5)
    assert said(track, "Z was taken to point up, not Y as is usual")


def lying(along="x", up="y", **more):
    """A dancer that lies on the floor and turns over, head along an axis."""
    motion = motion_file(**more)
    body = motion.position - motion.position.mean(axis=1, keepdims=True)
    roll = Rotation.from_rotvec(np.outer(np.linspace(0, 1.2, len(body)), [0, 1, 0]))
    body = np.stack([roll[i].apply(body[i]) for i in range(len(body))])
    body = body[..., [1, 0, 2]] * [1, -1, 1]  # the head along x, Y still up
    if along == "z":
        body = body[..., [2, 1, 0]] * [-1, 1, 1]
    body += np.array([0.2, 0, -0.3])
    body[..., 1] -= np.percentile(body[..., 1].min(axis=1), 1) - 0.02
    if up == "z":
        body = body[..., [0, 2, 1]] * [1, -1, 1]
    return replace(motion, position=body)


@pytest.mark.parametrize("along", ["x", "z"])
def test_floor_work_in_a_bvh_file_is_not_stood_up(along):
    motion = lying(along, source="bvh")
    track = track_of(motion)
    head = track.position[:, JOINTS.index("Head"), 1]
    assert 0 < np.median(head) < 0.5
    assert said(
        track, f"Y was taken to point up, as is usual: so the body lies along {along.upper()}"
    )
    stood = track_of(motion, up=along)
    assert np.median(stood.position[:, JOINTS.index("Head"), 1]) > 1.4


@pytest.mark.parametrize("up", ["y", "z"])
def test_floor_work_in_a_file_that_says_nothing_is_not_stood_up(up):
    motion = replace(lying("x", up), up=None)
    track = track_of(motion)
    assert 0 < np.median(track.position[:, JOINTS.index("Head"), 1]) < 0.5
    assert said(track, "was taken to point up: so the body lies on the floor. If it stands, X")


def test_what_a_file_says_of_its_axis_goes_before_a_body_that_lies():
    track = track_of(replace(lying("x", "z"), up="z", source="c3d"))
    assert 0 < np.median(track.position[:, JOINTS.index("Head"), 1]) < 0.5
    assert said(track, "Z points up as the file says, but the body stands along X")


@pytest.mark.data
def test_a_performer_who_lies_under_a_screen_that_says_z_lies(shared_data):
    motion = read_motion_file(shared_data / "reports" / "R07" / "lying_zscreen.c3d")
    track = make_joint_track(motion, file_name="lying.c3d")
    assert motion.up == "z"
    assert np.median(track.position[:, JOINTS.index("Head"), 1]) == pytest.approx(0.3, abs=0.1)


def test_a_skeleton_that_stands_along_z_is_believed_of_a_body_far_from_the_floor():
    motion = motion_file(source="bvh")
    turned = motion.position[..., [0, 2, 1]] * [1, -1, 1] - [0, 0, 0.9]
    small = replace(motion, position=turned, rest=turned[0])
    assert said(track_of(small), "Z was taken to point up, not Y as is usual")
    usual = replace(motion, position=turned, rest=motion.position[0])
    assert said(track_of(usual), "Y was taken to point up, as is usual")


def test_another_file_is_believed_about_its_axis_but_warned_of():
    motion = motion_file()
    turned = replace(motion, position=motion.position[..., [0, 2, 1]] * [1, -1, 1])
    assert said(track_of(turned), "Y points up as the file says, but the body stands along Z")


@pytest.mark.parametrize(
    ("source", "height", "shift"),
    [
        ("bvh", 0.0, 0.0),
        ("bvh", 0.02, 0.0),
        ("bvh", 0.3, -0.32),
        ("bvh", -0.2, 0.18),
        ("trc", -0.9, 0.88),
    ],
)
def test_a_body_above_or_below_the_floor_is_put_on_it(source, height, shift):
    motion = motion_file(source=source)
    track = track_of(replace(motion, position=motion.position + np.array([0, height, 0])))
    feet = [JOINTS.index(joint) for joint in ("RFoot", "LFoot", "RHeel", "LHeel")]
    before = motion.position[:, [motion.names.index(JOINTS[i]) for i in feet], 1] + height
    np.testing.assert_allclose(track.position[:, feet, 1], before + shift, atol=1e-3)
    assert said(track, "cm above the floor") == (shift != 0)


def test_one_wild_frame_does_not_move_the_floor():
    motion = motion_file(source="bvh")
    wild = motion.position.copy()
    wild[7] -= [0, 3, 0]
    np.testing.assert_allclose(
        track_of(replace(motion, position=wild)).position[8],
        track_of(motion).position[8],
        atol=1e-6,
    )


def test_exchanged_sides_are_noticed():
    motion = motion_file()
    other = {"R": "L", "L": "R"}
    swapped = tuple(other.get(name[0], name[0]) + name[1:] for name in motion.names)
    assert said(track_of(replace(motion, names=swapped)), "Left and right look exchanged")
    assert not said(track_of(motion), "Left and right look exchanged")
