"""Tests of tasks.motion.bearings through tasks.motion.importing: unit, up axis, floor and sides."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from storage.errors import InputError
from storage.schema import JOINTS
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


def test_between_two_units_the_ratio_of_statures_decides_or_the_stature_that_is_given():
    motion = motion_file()
    child = replace(motion, position=motion.position * 100 / track_of(motion).stature_m)
    unsaid = replace(child, unit_m=None)
    assert said(track_of(unsaid), "The unit was taken to be inches (0.0254 m): so the body is 2.54")
    assert said(track_of(unsaid, stature_m=1.1), "The unit was taken to be centimeters")


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
