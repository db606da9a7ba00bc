import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.studio.performances import TK, generate_performance
from tests.benchmarks.bodies.captures import PLANS, dance_of
from tests.benchmarks.bodies.dances import add_heels, on_floor, reshape, spin
from tests.benchmarks.bodies.scores import (
    SCORED,
    joint_errors,
    label_accuracy,
    longest_run,
    score_joints,
    true_name,
)
from tests.benchmarks.bodies.sensitivity import Settings, variations
from tests.benchmarks.bodies.spoiling import _flip_blobs


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.fixture(scope="module")
def danced():
    plan = PLANS["okuri-kimono"]
    return dance_of(plan, data=None, frames=40)  # type: ignore[arg-type]


def joint(position, name):
    return position[:, JOINTS.index(name)]


def length(position, a, b):
    return np.linalg.norm(joint(position, a) - joint(position, b), axis=1)


def truth_of(position):
    names = [true_name(name) for name in SCORED]
    own = position[:, [JOINTS.index(name) for name in SCORED]]
    return {"joint_names": np.array(names), "joints": own}


def test_heels_that_were_taken_away_come_back(danced):
    robbed = danced.copy()
    for side in "RL":
        robbed[:, JOINTS.index(side + "Heel")] = np.nan
    error = np.linalg.norm(add_heels(robbed, 1.68) - danced, axis=2)
    assert error.max() < 0.02
    assert error[:, JOINTS.index("RHeel")].max() > 0.0


def test_the_lowest_sole_comes_to_the_floor(danced):
    placed = on_floor(danced + np.array([0.0, 0.3, 0.0]))
    soles = [JOINTS.index(name) for name in ("RHeel", "LHeel", "RFoot", "LFoot")]
    assert placed[:, soles, 1].min() == pytest.approx(0.0)
    np.testing.assert_allclose(np.diff(placed, axis=0), np.diff(danced, axis=0), atol=1e-12)


def test_a_reshaped_body_has_the_lengths_asked_for(danced):
    found = reshape(danced, legs=0.6, trunk=0.7, arms=0.8, head=0.9)
    for bone, ratio in {
        ("RHip", "RKnee"): 0.6,
        ("LAnkle", "LFoot"): 0.6,
        ("Waist", "Neck"): 0.7,
        ("LShoulder", "LElbow"): 0.8,
        ("RWrist", "RFin"): 0.8,
        ("Neck", "Head"): 0.9,
    }.items():
        np.testing.assert_allclose(length(found, *bone), ratio * length(danced, *bone))


def test_a_spin_turns_by_what_was_asked_at_most_and_keeps_the_body():
    still = np.repeat(generate_performance_frame()[None], 61, axis=0)
    found = spin(still, 20.0)
    across = joint(found, "LHip") - joint(found, "RHip")
    turn = np.degrees(np.diff(np.unwrap(np.arctan2(across[:, 0], across[:, 2]))))
    assert turn.max() == pytest.approx(20.0, abs=0.1)
    assert turn.min() >= -1e-9
    np.testing.assert_allclose(found[..., 1], still[..., 1], atol=1e-12)
    np.testing.assert_allclose(length(found, "RFin", "LFoot"), length(still, "RFin", "LFoot"))


def generate_performance_frame():
    from tasks.studio.dancing.choreography import wait

    return generate_performance([wait()], TK, rate_hz=10.0).position[0]


def test_joint_scores_count_what_is_lost_and_what_was_flagged(danced):
    found = danced.copy()
    found[3:8, JOINTS.index("RFin"), 0] += 0.151
    found[20, JOINTS.index("Head")] = np.nan
    found[30, JOINTS.index("LKnee"), 1] += 0.149
    flagged = np.zeros(len(danced), bool)
    flagged[[5, 6, 25]] = True
    score = score_joints(joint_errors(found, truth_of(danced)), flagged)
    assert score["lost"] == pytest.approx(6 / (40 * 14))
    assert (score["run"], score["wrong"], score["flagged"]) == (5, 6, 3)
    assert score["precision"] == pytest.approx(2 / 3)
    assert score["recall"] == pytest.approx(2 / 6)
    expected = 1e3 * (5 * 0.151 + 0.149) / (40 * 14 - 1)
    assert score["mean_mm"] == pytest.approx(expected)


def test_runs_are_of_one_joint():
    wrong = np.array([[1, 0], [0, 1], [0, 1], [1, 1], [1, 0]], bool)
    assert longest_run(wrong) == 3


def test_label_accuracy_leaves_out_what_is_far_from_the_body():
    truth = {"verts": np.array([[[0.0, 0, 0], [1.0, 0, 0]]]), "vert_segment": np.array([0, 4])}
    center = np.array([[0.05, 0, 0], [0.95, 0, 0], [0.945, 0, 0], [0.5, 0, 0]])
    label = np.array([1, 5, 1, 7])
    assert label_accuracy([(center, label, 0)], truth) == pytest.approx(2 / 3)


def test_every_constant_is_changed_both_ways_and_alone():
    changed = list(variations(Settings()))
    names = [name for name, _, _ in changed]
    assert {"joint.fit.nobody", "extremities.skin.few", "initial.reach"} <= set(names)
    assert all(names.count(name) == 2 for name in names)
    for name, number, settings in changed:
        value = settings
        for part in name.split("."):
            value = getattr(value, part)
        assert value == number
    assert len({repr(settings) for _, _, settings in changed}) >= len(changed) - 4


def test_silhouettes_get_holes_and_bites(rng):
    silhouette = np.zeros((60, 50), np.uint8)
    silhouette[15:45, 12:38] = 1
    spoilt = silhouette.copy()
    _flip_blobs(spoilt, rng)
    assert set(np.unique(spoilt)) == {0, 1}
    assert 10 < (spoilt != silhouette).sum() < 400
