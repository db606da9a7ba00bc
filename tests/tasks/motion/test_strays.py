"""Positions at which no body can be are missing; a body that is far away as a whole is refused."""

from dataclasses import replace

import numpy as np
import pytest

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.motion.strays import remove_strays
from tests.figures.motion_files import FRAMES, RATE_HZ, motion_file, said, track_of

NAMES = motion_file().names


def strays_of(position, rate_hz=RATE_HZ):
    cleaned, notes, faults = remove_strays(position, NAMES, rate_hz)
    assert faults == []
    lost = np.isnan(cleaned).any(axis=2)
    np.testing.assert_array_equal(cleaned[~lost], position[~lost])
    assert len(notes) == lost.any()
    return lost


@pytest.mark.parametrize("far_m", [6.0, 3000.0, 900e3, 1e7])
def test_a_marker_far_from_the_body_is_missing_there_alone(far_m):
    position = motion_file().position.copy()
    position[40:43, 5, 1] += far_m
    assert np.argwhere(strays_of(position)).tolist() == [[40, 5], [41, 5], [42, 5]]


@pytest.mark.parametrize(
    ("far_m", "frames"),
    [
        (far_m, frames)
        for far_m in (30.0, 3000.0, 900e3)
        for frames in (slice(7, 8), slice(0, 1), slice(50, 75), slice(110, 120), slice(119, 120))
    ]
    + [(3000.0, slice(70, 120)), (900e3, slice(0, 55))],
)
def test_frames_in_which_the_whole_body_is_elsewhere_are_missing(far_m, frames):
    position = motion_file().position.copy()
    position[frames] += [far_m, 0, 0]
    lost = strays_of(position)
    assert lost[frames].all()
    assert lost.sum() == len(range(*frames.indices(FRAMES))) * len(NAMES)


@pytest.mark.parametrize("rate_hz", [0.5, 24.0, 120.0, 1000.0])
def test_a_dancer_that_runs_across_a_wide_stage_loses_nothing(rate_hz):
    body = motion_file().position[:1]
    seconds = np.arange(600) / rate_hz
    path = 30 * np.sin(seconds / 3)  # 10 m/s at its fastest
    position = body + np.stack([path, 0 * path, 4 * path], axis=1)[:, None] * [0.2, 0, 0.2]
    assert not strays_of(position, rate_hz).any()


def test_nothing_is_touched_where_nothing_strays():
    position = motion_file().position
    cleaned, notes, faults = remove_strays(position, NAMES, RATE_HZ)
    assert cleaned is position
    assert notes == faults == []
    nothing = np.full((4, len(NAMES), 3), np.nan)
    assert remove_strays(nothing, NAMES, RATE_HZ)[0] is nothing


def test_one_wild_frame_is_filled_from_its_neighbors_and_said():
    motion = motion_file()
    wild = motion.position.copy()
    wild[60] += [0, 3000, 0]
    track = track_of(replace(motion, position=wild))
    np.testing.assert_allclose(track.position, track_of(motion).position, atol=1e-3)
    assert track.filled[60].all()
    assert said(
        track, "21 positions are more than 5 m from the body, or with it more than 10 m off"
    )


@pytest.mark.parametrize("source", ["bvh", "trc"])
def test_a_body_at_900_km_is_refused(source):
    motion = motion_file(source=source)
    with pytest.raises(
        InputError, match=r"body is 900 km from the file's zero, where 1 km at most"
    ):
        track_of(replace(motion, position=motion.position + np.array([900e3, 0, 0])))


def test_a_body_without_its_hips_is_refused_with_where_they_are():
    motion = motion_file()
    wild = motion.position.copy()
    wild[:, motion.names.index("RHip")] += [7, 0, 0]
    with pytest.raises(InputError, match=r"has no RHip, and the hips.*more than 5 m from the body"):
        track_of(replace(motion, position=wild), scale=1.0)


def test_a_root_that_jumps_away_in_some_frames_leaves_the_rest_in_place():
    motion = motion_file(source="bvh")
    wild = motion.position.copy()
    wild[30:50] += [900e3, 0, 0]
    track = track_of(replace(motion, position=wild))
    lost = np.isnan(track.position[..., 0])
    assert lost[30:50].all()
    assert lost.sum() == 20 * len(JOINTS)
    assert track.stature_m == pytest.approx(track_of(motion).stature_m, abs=0.01)
