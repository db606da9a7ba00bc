"""What is learned of doubt is what made the lessons, and as sure as they allow."""

import runpy
from dataclasses import replace

import numpy as np
import pytest

from storage.schema import SEGMENTS
from tasks.body.doubt.probability import tell_doubt, windowed
from tests.benchmarks.bodies.doubt_learning import (
    _ASKED,
    Lesson,
    learn_weights,
    parts_of,
    write_weights,
)
from tests.benchmarks.bodies.scores import SCORED

NAMES = {name for asked in _ASKED.values() for name in asked.split()}


@pytest.fixture(scope="module")
def lessons():
    """Elbows are lost by the odds of what passes disagree; nothing else means anything."""
    rng = np.random.default_rng(3)
    found = []
    for n in range(7):
        evidence = {name: rng.uniform(0.0, 1.0, (300, 4)) for name in sorted(NAMES)}
        smooth = np.repeat(rng.uniform(0.0, 1.0, (10, 4)), 30, axis=0)
        evidence["apart"] = smooth
        error = np.full((300, len(SCORED)), 0.02)
        for arm, elbow in enumerate(("RElbow", "LElbow")):
            odds = 8.0 * smooth[:, arm] - 6.0
            error[rng.random(300) < 1.0 / (1.0 + np.exp(-odds)), SCORED.index(elbow)] = 0.3
        found.append(Lesson(evidence, error, 30.0, str(n)))
    return found


def test_what_speaks_is_found_and_is_as_sure_as_it_may_be(lessons):
    weights = learn_weights(lessons)
    base, own = weights["UpperArm"]
    told = [windowed(lesson.evidence, lesson.rate_hz) for lesson in lessons]
    effect = {k: w * np.concatenate([each[k] for each in told]).std() for k, w in own.items()}
    apart = sum(size for kind, size in effect.items() if kind.endswith(" apart"))
    assert apart > 3 * max([s for k, s in effect.items() if not k.endswith(" apart")], default=0.1)
    assert base < -2.0
    told = np.concatenate([tell_doubt(each.evidence, 30.0, weights) for each in lessons])
    wrong = np.concatenate([each.wrong for each in lessons])
    doubt, lost = (each[:, SEGMENTS.index("LUpperArm")] for each in (told, wrong))
    for low, high in ((0.0, 0.1), (0.3, 0.7), (0.7, 1.0)):
        own = (doubt >= low) & (doubt < high)
        assert own.sum() > 100
        assert abs(doubt[own].mean() - lost[own].mean()) < 0.1
    assert told[:, SEGMENTS.index("RLowerLeg")].max() < 0.05


def test_dances_are_left_out_whole(lessons):
    named = [replace(lessons[0], dance=dance) for dance in "abcadefb"]
    assert parts_of(named).tolist() == [0, 1, 2, 0, 3, 4, 0, 1]


def test_weights_are_read_as_they_were_written(lessons, tmp_path):
    weights = {"trunk": (-7.5, {}), "UpperArm": (-3.25, {"while apart": 1.5, "moment far": 2.75})}
    write_weights(
        tmp_path / "weights.py", weights, {str(n): lesson for n, lesson in enumerate(lessons)}
    )
    assert runpy.run_path(str(tmp_path / "weights.py"))["WEIGHTS"] == weights
    assert "2100 frames of 7 captures" in (tmp_path / "weights.py").read_text()
