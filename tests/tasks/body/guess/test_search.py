"""A guess of a performer who never stretches the arms: found, and refused where it cannot be."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import KDTree

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.body.guess import search
from tasks.body.guess.search import guess_body
from tasks.body.guess.single_frames import Shown, fit_both_ways, forward
from tasks.body.guess.usual_body import make_usual_body
from tasks.body.initial.frames import InitialModelSettings
from tasks.body.initial_model import _guessed_model
from tasks.geometry.voxels import find_surface, padded_crop, take_frame, voxel_index
from tests.figures.initial_figures import (
    GRID,
    SCORED,
    figure_of,
    runs_of,
    stretched_body,
    with_arms,
)

FRAMES = 10
STRETCHED = stretched_body()
LOWERED = {"R": 1.2, "L": -1.2}
"""How far each arm is turned about the performer's front [rad]."""


def lowered(more):
    """Return the joints (21, 3) with the arms down, and a little more or less so."""
    joints = dict(zip(JOINTS, STRETCHED, strict=True))
    front = np.cross(joints["LHip"] - joints["RHip"], [0.0, 1.0, 0.0])
    x, y, z = front / np.linalg.norm(front)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = {}
    for side, angle in LOWERED.items():
        angle *= 1.0 + more
        turn[side] = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return with_arms(STRETCHED, turn)


@pytest.fixture(scope="module")
def danced():
    return [lowered(0.04 * np.sin(n)) for n in range(FRAMES)]


@pytest.fixture(scope="module")
def shown(danced):
    figures = [figure_of(position, "fitting") for position in danced]
    runs = runs_of(*(figure.occupied for figure in figures))
    surfaces = []
    for n, figure in enumerate(figures):
        crop, begin = padded_crop(runs, n)
        is_surface, index = find_surface(take_frame(runs, n), crop, begin)
        [(near, color)] = figure.surfaces
        _, nearest = KDTree(near).query(index)
        surfaces.append((is_surface, color[nearest], np.zeros(len(index), np.uint8)))
    return Shown([take_frame(runs, n) for n in range(FRAMES)], GRID, surfaces.__getitem__)


def errors_m(joints, position):
    own = np.array([joints[name] for name in SCORED])
    return np.linalg.norm(own - position[[JOINTS.index(name) for name in SCORED]], axis=1)


@pytest.mark.compiled
def test_a_body_of_usual_proportions_finds_its_pose_and_the_way_it_faces(shown, danced):
    height = np.ptp(shown.points(0)[:, 1])
    body = make_usual_body(height)
    best, other = fit_both_ways(shown, 0, body)
    joints = dict(zip(JOINTS, danced[0], strict=True))
    front = np.cross(joints["LHip"] - joints["RHip"], [0.0, 1.0, 0.0])
    assert best.likelihood > other.likelihood
    assert forward(best.pose) @ front > 0.9 * np.linalg.norm(front)
    assert forward(other.pose) @ front < 0.0
    assert errors_m(body.place(best.pose), danced[0]).max() < 0.15


@pytest.mark.compiled
@pytest.mark.slow
def test_joints_are_guessed_from_frames_that_agree(shown, danced, monkeypatch):
    monkeypatch.setattr(search, "LOOKED_AT", 3)
    monkeypatch.setattr(search, "MEASURED", 1)
    found = guess_body(shown, 30.0, range(FRAMES), None)
    assert errors_m(found.joints, danced[found.frame]).mean() < 0.05
    assert len(found.looked_at) == 3
    assert found.frame in found.looked_at
    assert found.margin > 0.0
    assert found.apart_m < 0.05
    assert 0.6 < found.confidence <= 0.8


def take_of(occupied):
    """Return what the stage reads of a take of some frames."""
    runs = runs_of(*occupied)

    class Frames:
        grid = GRID

        def __len__(self):
            return len(occupied)

        def index(self, frame):
            return voxel_index(runs, frame)

        def hull(self, frame):
            return take_frame(runs, frame)

        surface = None

    return Frames()


@pytest.mark.parametrize("fault", ["few frames", "two people", "half outside"])
def test_takes_that_cannot_be_guessed_are_refused_with_the_reason(danced, fault):
    body = figure_of(danced[0], "fitting").occupied
    frames, said = {
        "few frames": ([body] * 9, "9 of the frames looked at show one whole person"),
        "two people": (
            [body | np.roll(body, 60, axis=0)] * 12,
            "0 of the frames .*: in frame 0 there are two large pieces of .* as of two people",
        ),
        "half outside": (
            [np.roll(body, -int(np.argwhere(body)[:, 0].min()), axis=0)] * 12,
            "0 of the frames .*: in frame 0 the performer is partly outside the volume",
        ),
    }[fault]
    source = SimpleNamespace(fps=30.0, stature_m=None)
    with pytest.raises(InputError, match=f"no arms; nor can the body be guessed: {said}"):
        _guessed_model(take_of(frames), source, InitialModelSettings(), "no arms")
