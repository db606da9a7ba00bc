"""Hulls, joints and arguments that make no initial model are refused, with what to do."""

import numpy as np
import pytest

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.body.initial import search
from tasks.body.initial.search import (
    InitialModelSettings,
    find_initial_model,
    label_from_joints,
    model_from_joints,
)
from tasks.geometry.voxels import VoxelGrid
from tests.figures.initial_figures import (
    GRID,
    VOXEL,
    figure_of,
    runs_of,
)


def test_hanging_arms_are_refused_with_what_to_do(stretched):
    hanging = stretched.copy()
    for side in "RL":
        shoulder = stretched[JOINTS.index(f"{side}Shoulder")]
        for name in ("Elbow", "Wrist", "Fin"):
            number = JOINTS.index(side + name)
            length = np.linalg.norm(stretched[number] - shoulder)
            hanging[number] = shoulder + length * np.array([0.0, -1.0, 0.05])
    runs = runs_of(figure_of(hanging, "fitting").occupied)
    with pytest.raises(InputError, match=r"arms reach 0\.\d+ m .* arms stretched.*initial\.json"):
        find_initial_model(runs, GRID, 30.0)


def test_nobody_and_two_people_are_said():
    with pytest.raises(InputError, match="in frame 0 there are only 0 voxels"):
        find_initial_model(runs_of(np.zeros(GRID.shape, bool)), GRID, 30.0)
    narrow = np.zeros(GRID.shape, bool)
    narrow[20:28, :80, 30:40] = narrow[90:98, :80, 100:110] = True
    pole, flat = np.zeros((2, *GRID.shape), bool)
    pole[20:23, :90, 30:33] = flat[20:60, :1, 30:60] = True
    for shape, high in ((pole, "1\\.78"), (flat, "0\\.02")):
        with pytest.raises(InputError, match=f"reaches to two sides of a performer {high} m high"):
            find_initial_model(runs_of(shape), GRID, 30.0)
    with pytest.raises(InputError, match="two large pieces of 6400 and 6400 voxels"):
        find_initial_model(runs_of(narrow), GRID, 30.0)


def test_arms_that_are_none_are_refused(figure, monkeypatch):
    """A fan in the right hand reaches farther than the arm, and its bones end beside the hull."""
    fin, elbow = (figure.joints[JOINTS.index(name)] for name in ("RFin", "RElbow"))
    out = (fin - elbow) / np.linalg.norm(fin - elbow)
    angle, reach = np.meshgrid(np.linspace(-0.8, 0.8, 90), np.linspace(0.0, 0.7, 60))
    up = np.array([0.0, 1.0, 0.0])
    leaf = fin + reach[..., None] * (np.cos(angle)[..., None] * out + np.sin(angle)[..., None] * up)
    held = figure.occupied.copy()
    index = np.rint((leaf.reshape(-1, 3) - GRID.origin_m) / VOXEL).astype(int)
    held[tuple(index[((index >= 0) & (index < GRID.shape)).all(axis=1)].T)] = True
    with pytest.raises(
        InputError, match=r"stretched sideways, or place the joints in initial\.json"
    ):
        find_initial_model(runs_of(held), GRID, 30.0)
    found = find_initial_model(runs_of(figure.occupied), GRID, 30.0)
    monkeypatch.setattr(search, "bones_inside", lambda *_: 0.58)
    strict = InitialModelSettings(least_inside=0.59)
    with pytest.raises(
        InputError, match=r"only \d+% of the bones that were found in frame 0 lie in"
    ):
        find_initial_model(runs_of(figure.occupied), GRID, 30.0, settings=strict)
    lenient = InitialModelSettings(least_inside=0.58)
    assert find_initial_model(runs_of(figure.occupied), GRID, 30.0, settings=lenient).frame == 0
    assert found.confidence > 0.5


def test_a_performer_partly_outside_the_volume_is_said(figure):
    x = np.flatnonzero(figure.occupied.any(axis=(1, 2)))
    cut = np.ascontiguousarray(figure.occupied[: x[-1] - 5])
    grid = VoxelGrid(GRID.origin_m, VOXEL, cut.shape)
    with pytest.raises(InputError, match=r"partly outside the volume .* enlarge the \[volume\]"):
        find_initial_model(runs_of(cut), grid, 30.0)


def test_joints_that_do_not_fit_the_take_are_named_all_at_once(figure, found):
    runs = runs_of(figure.occupied)
    wrong = found.position.copy()
    wrong[JOINTS.index("RFin")] += [0.0, 0.9, 0.0]
    wrong[JOINTS.index("LKnee")] = np.nan
    pattern = r"LKnee must be placed; RFin is 0\.\d\d m outside .*there are 3 labels"
    with pytest.raises(InputError, match=pattern):
        model_from_joints(runs, GRID, wrong, label=np.ones(3, np.uint8))
    with pytest.raises(InputError, match="frame 7 of the initial model is not one"):
        model_from_joints(runs, GRID, found.position, frame=7)
    with pytest.raises(InputError, match="shows nobody"):
        model_from_joints(runs_of(np.zeros(GRID.shape, bool)), GRID, found.position)
    with pytest.raises(ValueError, match="cannot be labelled without LKnee"):
        label_from_joints(runs, GRID, 0, wrong)


def test_wrong_arguments_are_named(figure):
    runs = runs_of(figure.occupied)
    with pytest.raises(ValueError, match="on a grid of"):
        find_initial_model(runs, VoxelGrid((0, 0, 0), VOXEL, (3, 4, 5)), 30.0)
    with pytest.raises(ValueError, match="stature_m nan must be"):
        find_initial_model(runs, GRID, 30.0, stature_m=float("nan"))
    with pytest.raises(ValueError, match="reach is -1, it must be a number larger than 0"):
        InitialModelSettings(reach=-1)
