"""Which frames show one whole person, and which of a take's later ones show stretched arms."""

import numpy as np
import pytest

from tasks.body.initial.frames import (
    InitialModelSettings,
    best_later_frame,
    first_of_each_kind,
    why_not_whole,
)
from tasks.geometry.voxels import take_frame, voxel_index
from tests.figures.initial_figures import GRID, figure_of, runs_of, stretched_body, with_arms

SETTINGS = InitialModelSettings()
STRETCHED = 14
"""Of sixteen frames."""


def about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@pytest.fixture(scope="module")
def stretched():
    return figure_of(stretched_body(), "fitting").occupied


@pytest.fixture(scope="module")
def hanging():
    body = stretched_body()
    left = body[12:13].mean(axis=0) - body[3]
    axis = np.cross(left, [0.0, 1.0, 0.0])
    axis /= np.linalg.norm(axis)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = {s: np.eye(3) + np.sin(a) * skew + (1 - np.cos(a)) * skew @ skew
            for s, a in (("R", -1.3), ("L", 1.3))}  # fmt: skip
    moved = with_arms(body, turn)
    if moved[6, 1] > body[6, 1]:
        moved = with_arms(body, {"R": turn["L"], "L": turn["R"]})
    return figure_of(moved, "fitting").occupied


def hulls_of(*frames):
    runs = runs_of(*frames)
    return [take_frame(runs, n) for n in range(len(frames))]


def test_arms_that_are_stretched_at_the_end_are_found(stretched, hanging):
    frames = [hanging] * STRETCHED + [stretched] * 2
    found = best_later_frame(hulls_of(*frames), GRID, 10.0, SETTINGS)
    assert found is not None
    assert found.frame >= STRETCHED
    assert best_later_frame(hulls_of(*[hanging] * 16), GRID, 10.0, SETTINGS) is None


def test_arms_at_the_beginning_are_not_looked_at_again(stretched):
    assert best_later_frame(hulls_of(*[stretched] * 10), GRID, 10.0, SETTINGS) is None


def test_a_frame_of_nobody_two_people_or_half_a_person_is_said_to_be_so(hanging):
    index = voxel_index(runs_of(hanging), 0)
    assert why_not_whole(index, GRID, SETTINGS) == ""
    assert "only 400 voxels" in why_not_whole(index[:400], GRID, SETTINGS)
    beside = np.roll(hanging, 60, axis=0) | hanging
    two = voxel_index(runs_of(beside), 0)
    assert "two large pieces" in why_not_whole(two, GRID, SETTINGS)
    beyond = np.roll(hanging, -int(index[:, 0].min()), axis=0)
    said = why_not_whole(voxel_index(runs_of(beyond), 0), GRID, SETTINGS)
    assert "partly outside the volume" in said
    assert "enlarge the [volume]" in said


def test_of_what_is_wrong_with_frames_each_kind_is_told_once():
    pieces = "there are two pieces of {} and {} voxels"
    seen = [(0, pieces.format(70, 66)), (4, "there are only 3 voxels"), (8, pieces.format(9, 7))]
    assert first_of_each_kind(seen) == (
        "in frame 0 there are two pieces of 70 and 66 voxels (and so in 1 more); in frame 4 there "
        "are only 3 voxels"
    )
    assert first_of_each_kind([]) == ""
