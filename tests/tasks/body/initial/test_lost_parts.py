"""Hands, arms and feet that hulls have lost: put in, put back from other frames, or said."""

import re

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.body.anatomy.proportions import LEAST_REACH
from tasks.body.initial.arms import measure_arms, reach_of_head
from tasks.body.initial.search import (
    find_initial_model,
)
from tasks.geometry.voxels import voxel_centers
from tasks.studio.dancing.choreography import freely
from tasks.studio.performances import TK, generate_performance
from tests.benchmarks.bodies.dances import reshape
from tests.figures.initial_figures import (
    GRID,
    VOXEL,
    errors_mm,
    figure_of,
    runs_of,
)


def without(figure, part, more_m=0.0):
    """Return the voxels of a figure without what is beyond a joint, seen from the one before."""
    before, joint = (figure.joints[JOINTS.index(name)] for name in part)
    center = np.moveaxis(np.indices(GRID.shape), 0, -1) * VOXEL + GRID.origin_m
    beyond = (center - joint) @ (joint - before) > -more_m * np.linalg.norm(joint - before)
    near = np.linalg.norm(center - joint, axis=-1) < 0.6
    cut = figure.occupied & beyond & near
    other = figure.joints[JOINTS.index("LR"[part[1][0] == "L"] + part[1][1:])]
    cut &= np.linalg.norm(center - joint, axis=-1) < np.linalg.norm(center - other, axis=-1)
    assert cut.sum() > 50
    return figure.occupied & ~cut


FOOT, HAND = ("RKnee", "RAnkle"), ("LElbow", "LWrist")


def test_lost_hands_are_put_in_and_said(stretched):
    figure = figure_of(stretched, "fitting")
    right, left = (stretched[JOINTS.index(f"{side}Fin")] for side in "RL")
    index = np.argwhere(figure.occupied)
    center = voxel_centers(GRID, index)
    aside = abs((center - (right + left) / 2) @ (left - right)) / ((left - right) @ (left - right))
    hull = np.zeros_like(figure.occupied)
    hull[tuple(index[aside < 0.5 * 0.71].T)] = True
    whole = find_initial_model(runs_of(figure.occupied), GRID, 30.0)
    model = find_initial_model(runs_of(hull), GRID, 30.0)
    assert any("lost the hands" in note for note in model.notes)
    assert model.confidence < 0.5 * whole.confidence
    for side in "RL":
        off = model.position - whole.position
        assert np.linalg.norm(off[JOINTS.index(f"{side}Fin")]) < 0.2


def test_a_large_head_is_not_taken_for_lost_hands(stretched):
    """A child of 1.1 m: of short legs and arms, whose head is nearly an adult's."""
    child = reshape(stretched[None], legs=0.66, trunk=0.75, arms=0.7, head=1.15)[0]
    figure = figure_of(child, "fitting")
    point = voxel_centers(GRID, np.argwhere(figure.occupied))
    assert reach_of_head(point, measure_arms(point, VOXEL)) < LEAST_REACH
    model = find_initial_model(runs_of(figure.occupied), GRID, 30.0, surfaces=figure.surfaces)
    assert not any("lost the hands" in note for note in model.notes)
    error = errors_mm(model, child)
    assert error.mean() < 40
    assert error.max() < 110
    assert model.confidence > 0.6


def test_an_arm_that_is_cut_short_does_not_move_the_trunk(stretched):
    figure = figure_of(stretched, "fitting")
    at = dict(zip(JOINTS, stretched, strict=True))
    center = np.moveaxis(np.indices(GRID.shape), 0, -1) * VOXEL + GRID.origin_m
    outward = at["LFin"] - at["LShoulder"]
    figure.occupied[(center - at["LWrist"]) @ outward > 0] = False
    found = find_initial_model(runs_of(figure.occupied), GRID, 30.0, surfaces=figure.surfaces)
    off = np.linalg.norm(found.position - stretched, axis=1) * 1000
    error = {name: off[JOINTS.index(name)] for name in ("Neck", "RShoulder", "LShoulder")}
    assert max(error.values()) < 45, error
    assert found.position[JOINTS.index("LFin")] @ outward < at["LWrist"] @ outward


@pytest.mark.parametrize("part", [FOOT, HAND], ids=["foot", "hand"])
@pytest.mark.parametrize("first", [0, 5])
def test_a_whole_frame_is_chosen(stretched, part, first):
    """All frames but three, which are next to each other, have lost the same part."""
    figure = figure_of(stretched, "fitting")
    cut = without(figure, part)
    whole = (first, first + 1, first + 2)
    frames = [figure.occupied if number in whole else cut for number in range(8)]
    model = find_initial_model(runs_of(*frames), GRID, 15.0, surfaces=figure.surfaces * 8)
    assert model.frame in whole
    assert len(model.label) == figure.occupied.sum()
    same = find_initial_model(runs_of(figure.occupied), GRID, 15.0, surfaces=figure.surfaces)
    np.testing.assert_allclose(model.position, same.position, atol=1e-9)
    assert model.confidence == pytest.approx(same.confidence)


@pytest.mark.compiled
def test_what_each_frame_has_lost_is_put_back_from_the_others(figure, found):
    """Every frame has lost something, each time something else."""
    parts = (FOOT, HAND, ("LKnee", "LAnkle"), ("RElbow", "RWrist"))
    frames = [without(figure, parts[number % 4]) for number in range(12)]
    runs = runs_of(*frames)
    model = find_initial_model(runs, GRID, 30.0, surfaces=figure.surfaces * 12)
    np.testing.assert_allclose(model.position, found.position, atol=1e-9)
    assert len(model.label) == frames[model.frame].sum()
    assert model.confidence < found.confidence
    assert any("what the frames around it have was put back" in note for note in model.notes)
    assert not any("put back" in note for note in found.notes)


def test_frames_too_far_apart_put_nothing_back(stretched):
    """Of three frames a third of a second apart two show another pose."""
    danced = generate_performance([freely(3)], TK, rate_hz=3.0).position
    other = figure_of(danced[4] - danced[4].mean(axis=0) * [1, 0, 1], "fitting").occupied
    figure = figure_of(stretched, "fitting")
    runs = runs_of(other, figure.occupied, other)
    model = find_initial_model(runs, GRID, 3.0, surfaces=figure.surfaces * 3)
    alone = find_initial_model(runs_of(figure.occupied), GRID, 3.0, surfaces=figure.surfaces)
    np.testing.assert_array_equal(model.position, alone.position)
    assert model.confidence == alone.confidence


def test_a_leg_whose_end_no_frame_has_is_said(stretched):
    figure = figure_of(stretched, "fitting")
    frames = [without(figure, FOOT, 0.1)] * 4
    model = find_initial_model(runs_of(*frames), GRID, 30.0, surfaces=figure.surfaces * 4)
    assert any(re.match(r"One foot is 0\.\d\d m above the other", note) for note in model.notes)
    whole = find_initial_model(runs_of(figure.occupied), GRID, 30.0, surfaces=figure.surfaces)
    assert not any("One foot" in note for note in whole.notes)
