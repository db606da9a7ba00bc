"""Generated performers move as bodies can, stand on the floor, and say truly what they dance."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.motion.stature import measure_stature
from tasks.retrieval.normalization import OTHER_SIDE, pack_motion
from tasks.studio.dancing.choreography import (
    freely,
    lonely,
    mirrored,
    okuri48,
    okuri49,
    radio_arms,
    radio_knees,
    turning,
    wait,
    walk,
)
from tasks.studio.dancing.limbs import bend_limb, turned
from tasks.studio.performances import SH, TK, YS, demo_performances, generate_performance

RIGID = [
    ("Head", "Neck"),
    ("Neck", "Waist"),
    ("RHip", "LHip"),
    ("RShoulder", "LShoulder"),
    *(
        (side + a, side + b)
        for side in "RL"
        for a, b in [
            ("Shoulder", "Elbow"),
            ("Elbow", "Wrist"),
            ("Wrist", "Fin"),
            ("Hip", "Knee"),
            ("Knee", "Ankle"),
            ("Ankle", "Heel"),
            ("Ankle", "Foot"),
            ("Heel", "Foot"),
        ]
    ),
    *(("Neck", side + "Shoulder") for side in "RL"),
]


@pytest.fixture(scope="module")
def demo():
    return demo_performances()


def joint(position, name):
    return position[:, JOINTS.index(name)]


def angle_deg(a, b, c):
    """The angle at b, by the arc cosine of unit vectors."""
    u, v = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (a - b, c - b))
    return np.degrees(np.arccos(np.clip((u * v).sum(axis=1), -1.0, 1.0)))


def headings(position):
    across = joint(position, "LHip") - joint(position, "RHip")
    return np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))


def packed(performance, clip, samples=100):
    """A clip in its body's frame, at so many instants evenly apart: (sample, joint, 3)."""
    position = performance.position
    rows = pack_motion(position, 30.0, measure_stature(position, JOINTS))[:63]
    at = np.linspace(clip.start, clip.end, samples).round().astype(int)
    return rows[:, at].reshape(21, 3, -1).transpose(2, 0, 1)


def test_every_bone_keeps_its_length_in_every_take(demo):
    for take in demo[0]:
        for a, b in RIGID:
            position = take.performance.position
            length = np.linalg.norm(joint(position, a) - joint(position, b), axis=1)
            assert np.ptp(length) < 1e-4, (take.take, a, b)
            assert length.min() > 0.02, (take.take, a, b)


def test_no_joint_moves_faster_than_a_human_or_jerks(demo):
    for take in demo[0]:
        position, rate_hz = take.performance.position, take.performance.rate_hz
        speed = np.linalg.norm(np.diff(position, axis=0), axis=2) * rate_hz
        acceleration = np.linalg.norm(np.diff(position, n=2, axis=0), axis=2) * rate_hz**2
        assert 1.0 < speed.max() < 10.0, take.take
        assert acceleration.max() < 150.0, take.take


def test_knees_bend_forward_and_elbows_never_overstretch(demo):
    for take in demo[0]:
        position = take.performance.position
        for side in "RL":
            hip, knee, ankle, heel, toe, shoulder, elbow, wrist = (
                joint(position, side + name)
                for name in (
                    *("Hip", "Knee", "Ankle", "Heel", "Foot"),
                    *("Shoulder", "Elbow", "Wrist"),
                )
            )
            ahead = (toe - heel) * [1.0, 0.0, 1.0]
            assert ((knee - (hip + ankle) / 2.0) * ahead).sum(axis=1).min() > 0.0, take.take
            bent = angle_deg(shoulder, elbow, wrist)
            assert 25.0 < bent.min() < bent.max() < 172.0, take.take
            assert angle_deg(hip, knee, ankle).min() > 80.0, take.take


def test_no_hand_or_elbow_goes_through_the_trunk(demo):
    for take in demo[0]:
        position = take.performance.position
        low = (joint(position, "RHip") + joint(position, "LHip")) / 2.0
        along = joint(position, "Neck") - low
        for name in ("RElbow", "RWrist", "RFin", "LElbow", "LWrist", "LFin"):
            away = joint(position, name) - low
            share = (away * along).sum(axis=1) / (along**2).sum(axis=1)
            near = away - np.clip(share, 0.0, 1.0)[:, None] * along
            assert np.linalg.norm(near, axis=1).min() > 0.14, (take.take, name)


def test_feet_stand_on_the_floor_and_one_of_them_never_slides(demo):
    for take in demo[0]:
        position, rate_hz = take.performance.position, take.performance.rate_hz
        toes = np.stack([joint(position, side + "Foot") for side in "RL"])
        heels = np.stack([joint(position, side + "Heel") for side in "RL"])
        assert min(toes[..., 1].min(), heels[..., 1].min()) > -0.01
        speed = np.linalg.norm(np.diff(toes, axis=1), axis=2) * rate_hz
        assert speed.min(axis=0).max() < 1e-3, take.take
        steps = speed.max(axis=0) > 0.5
        assert 0.02 < steps.mean() < 0.9, take.take
        low = np.maximum(toes[..., :-1, 1], toes[..., 1:, 1]) < 5e-4
        assert np.linalg.norm(np.diff(toes, axis=1)[low], axis=1).max() < 0.002, take.take


def test_a_foot_that_stands_is_flat_on_the_floor():
    position = generate_performance([walk(), okuri48()], TK).position
    for side in "RL":
        toe, heel = joint(position, side + "Foot"), joint(position, side + "Heel")
        still = np.linalg.norm(np.diff(toe, axis=0), axis=1) < 1e-12
        assert still.mean() > 0.5
        assert np.abs(np.stack([toe, heel])[:, :-1, 1][:, still]).max() < 1e-3


def test_a_standing_performer_stands_upright_over_the_feet():
    position = generate_performance([wait()], SH, variation=0.0).position
    ankles = (joint(position, "RAnkle") + joint(position, "LAnkle")) / 2.0
    hips = (joint(position, "RHip") + joint(position, "LHip")) / 2.0
    assert np.linalg.norm((hips - ankles)[:, [0, 2]], axis=1).max() < 0.1
    assert (joint(position, "Head")[:, 1] > joint(position, "Neck")[:, 1] + 0.2).all()


def test_the_same_day_gives_the_same_motion_and_another_day_resembles_it():
    days = [generate_performance([lonely()], TK, day=day) for day in (1, 1, 2)]
    np.testing.assert_array_equal(days[0].position, days[1].position)
    first, again, other = (packed(day, day.clips[0]) for day in days)
    assert np.abs(first - again).max() == 0.0
    apart = np.linalg.norm(first - other, axis=2).mean()
    stranger = generate_performance([radio_arms()], TK, day=1)
    strange = np.linalg.norm(first - packed(stranger, stranger.clips[0]), axis=2).mean()
    assert 0.004 < apart < 0.05
    assert strange > 3.0 * apart


def test_a_take_repeats_a_movement_but_not_exactly():
    twice = generate_performance([okuri48(), okuri48()], YS, day=4)
    one, two = (packed(twice, clip) for clip in twice.clips)
    assert 0.002 < np.linalg.norm(one - two, axis=2).mean() < 0.05


def test_turning_right_is_turning_left_the_other_way_round_with_the_same_arms():
    left, right = (
        generate_performance([turning(side)], TK, variation=0.0).position
        for side in ("left", "right")
    )
    np.testing.assert_allclose(headings(right), -headings(left), atol=1e-9)
    assert headings(left)[-1] - headings(left)[0] == pytest.approx(np.pi, abs=1e-3)
    upper = [
        n for n, name in enumerate(JOINTS) if not name.endswith(("Knee", "Ankle", "Heel", "Foot"))
    ]
    one, other = (pack_motion(p, 30.0, 1.5)[:63].reshape(21, 3, -1) for p in (left, right))
    np.testing.assert_allclose(one[upper], other[upper], atol=1e-5)
    assert np.abs(one - other).max() < 0.3


def test_a_mirrored_movement_is_danced_as_in_a_mirror():
    plain, other = (
        generate_performance(movements, SH, variation=0.0).position
        for movements in ([okuri49(), wait()], [mirrored(okuri49()), mirrored(wait())])
    )
    np.testing.assert_allclose(other, (plain * [-1.0, 1.0, 1.0])[:, OTHER_SIDE], atol=1e-9)
    assert replace(mirrored(mirrored(okuri49())), name="okuri 49") == okuri49()
    assert np.abs(plain - other).max() > 0.5


def test_okuri_49_takes_the_steps_of_okuri_48_with_the_hands_above_the_shoulders():
    low, high = (
        generate_performance([m], TK, variation=0.0).position for m in (okuri48(), okuri49())
    )
    clip = slice(30, -30)
    for name in ("RFoot", "LFoot", "RHeel", "LHeel"):
        np.testing.assert_array_equal(joint(low, name), joint(high, name))
    for side in "RL":
        hips, shoulders = (joint(low, side + "Hip"), joint(high, side + "Shoulder"))
        assert (joint(low, side + "Fin")[clip, 1] < hips[clip, 1] + 0.06).all()
        assert (joint(high, side + "Wrist")[clip, 1] > shoulders[clip, 1]).all()
    moved = (low[-1] - low[0]).mean(axis=0)
    assert moved[0] > 0.4  # to the performer's left


def test_statures_are_in_proportion_to_heights():
    for performer in (TK, SH, YS):
        position = generate_performance([walk(), okuri48()], performer).position
        stature = measure_stature(position, JOINTS)
        assert stature == pytest.approx(0.96 * performer.height_m, rel=0.01)
        top = joint(generate_performance([walk()], performer).position, "Head")[:, 1].max()
        assert 0.95 * performer.height_m < top < 1.01 * performer.height_m


def test_place_and_heading_move_and_turn_the_whole_performance():
    movements = [walk(), turning("left")]
    here = generate_performance(movements, YS, day=3).position
    there = generate_performance(movements, YS, day=3, place_m=(2.0, -1.0), heading=0.7).position
    np.testing.assert_allclose(headings(there) - headings(here), 0.7, atol=1e-9)
    np.testing.assert_allclose(there[..., 1], here[..., 1], atol=1e-12)
    start = (there[0, :, [0, 2]] - np.array([[2.0], [-1.0]])) ** 2
    np.testing.assert_allclose(start.sum(axis=0), (here[0, :, [0, 2]] ** 2).sum(axis=0), atol=1e-9)


def test_a_performer_who_has_turned_walks_on_where_the_turn_leads():
    curve = walk(6, turn=0.5 * np.pi)
    performance = generate_performance([curve, curve, walk()], TK, variation=0.0)
    hips = (joint(performance.position, "RHip") + joint(performance.position, "LHip")) / 2.0
    first, then, last = (hips[clip.end] - hips[clip.start] for clip in performance.clips)
    assert first[0] > 0.3
    assert first[2] > 0.5
    np.testing.assert_allclose(then[[0, 2]], [first[2], -first[0]], atol=0.03)
    np.testing.assert_allclose(last[[0, 2]], [0.0, -3 * 0.2 * TK.height_m], atol=0.05)


def test_a_bow_puts_the_hips_back_so_as_not_to_fall_over():
    performance = generate_performance([wait(), lonely()], TK, variation=0.0)
    position, clip = performance.position, performance.clips[1]
    behind = sum(
        joint(position, f"{side}Ankle")[:, 2] - joint(position, f"{side}Hip")[:, 2] for side in "RL"
    )
    deepest = joint(position, "Head")[clip.start : clip.end, 1].argmin() + clip.start
    assert behind[deepest] > 0.06 + behind[:20].mean()


def test_the_rate_samples_one_and_the_same_motion():
    slow, fast = (
        generate_performance([radio_knees()], SH, day=5, rate_hz=rate) for rate in (60.0, 120.0)
    )
    frames = min(len(slow.position), len(fast.position[::2]))
    np.testing.assert_allclose(slow.position[:frames], fast.position[::2][:frames], atol=0.004)
    assert abs(fast.clips[0].end - 2 * slow.clips[0].end) <= 1


def test_clips_name_what_is_danced_in_order_and_within_the_take(demo):
    for take in demo[0]:
        clips = take.performance.clips
        assert clips[0].start > 0
        assert clips[-1].end < len(take.performance.position)
        assert all(before.end < after.start for before, after in pairwise(clips))
        assert {clip.performer for clip in clips} == {take.performer.name}
    danced = generate_performance([walk(), freely(1), lonely()], TK).clips
    assert [clip.movement for clip in danced] == ["walk", "freely", "lonely"]


def test_the_demo_has_known_repeats_by_three_performers_on_several_days(demo):
    takes, searches = demo
    assert len({take.take for take in takes}) == len(takes) == 12
    assert {take.performer.name for take in takes} == {"TK", "SH", "YS"}
    assert len({take.day for take in takes}) == 3
    for take in takes:
        assert 15.0 < len(take.performance.position) / take.performance.rate_hz < 60.0
        assert len(take.performance.position) != 21
    clips = {(t.take, c.start, c.end) for t in takes for c in t.performance.clips}
    for search in searches:
        own = (search.take, search.start, search.end)
        found = [(take, clip.start, clip.end) for take, clip in search.finds]
        assert own in clips
        assert found
        assert clips.issuperset(found)
        assert own not in found
    again = demo_performances()[0]
    np.testing.assert_array_equal(again[7].performance.position, takes[7].performance.position)


@pytest.mark.parametrize(("movements", "rate_hz"), [([], 60.0), ([wait()], 0.0)])
def test_a_performance_without_frames_is_refused(movements, rate_hz):
    with pytest.raises(ValueError, match="give at least one movement and a positive rate"):
        generate_performance(movements, TK, rate_hz=rate_hz)


def test_a_limb_bends_by_the_law_of_cosines():
    root, target = np.zeros((1, 3)), np.array([[0.0, -0.5, 0.0]])
    middle, end = bend_limb(root, target, np.array([[0.0, 0.3, 2.0]]), upper_m=0.4, lower_m=0.3)
    np.testing.assert_allclose(middle, [[0.0, -0.32, 0.24]], atol=1e-6)  # 3-4-5
    np.testing.assert_allclose(end, target, atol=1e-6)
    middle, end = bend_limb(
        root, 9.0 * target, np.array([[0.0, 0.0, 1.0]]), upper_m=0.4, lower_m=0.3, reach=0.98
    )
    assert end[0, 1] == pytest.approx(-0.98 * 0.7, abs=1e-6)
    assert np.linalg.norm(middle) == pytest.approx(0.4)
    assert np.linalg.norm(end - middle) == pytest.approx(0.3)


def test_a_trunk_turns_left_bows_forward_and_leans_left():
    frames = turned(
        np.array([np.pi / 2, 0.0, 0.0]), np.array([0.0, 0.3, 0.0]), np.array([0, 0, 0.2])
    )
    np.testing.assert_allclose(frames[0, :, 2], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(frames[1, :, 1], [0.0, np.cos(0.3), np.sin(0.3)], atol=1e-12)
    np.testing.assert_allclose(frames[2, :, 1], [np.sin(0.2), np.cos(0.2), 0.0], atol=1e-12)
