import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tasks.motion.stature import joints_present, measure_stature
from tasks.retrieval import searching
from tasks.retrieval.normalization import PARTS, pack_motion
from tasks.retrieval.searching import Match, SearchSettings, clip_motion, clip_take, search_takes
from tasks.retrieval.segments import PackedTake
from tests.twins import search as naive

JOINTS = PARTS["whole"]
FRAMES = 59


@pytest.fixture
def rng():
    return np.random.default_rng(55)


@pytest.fixture
def dance(rng):
    """A function that makes positions (time, 21, 3) of someone who goes about and turns."""

    def make(frames=FRAMES):
        build = rng.normal(size=(21, 3)) * 0.25 + [0, 1, 0]
        for side, z in (("R", -1), ("L", 1)):
            build[JOINTS.index(side + "Hip")] = [0, 0.9, 0.15 * z]
            build[JOINTS.index(side + "Shoulder")] = [0, 1.3, 0.25 * z]
        body = build + rng.normal(size=(frames, 21, 3)).cumsum(axis=0) * 0.02
        path = rng.normal(size=(frames, 3)).cumsum(axis=0) * [0.05, 0, 0.05]
        return turned(body, rng.normal(size=frames).cumsum() * 0.2) + path[:, None]

    return make


def turned(position, angle):
    c, s = np.cos(angle), np.sin(angle)
    o, i = np.zeros_like(c), np.ones_like(c)
    turn = np.stack([c, o, s, o, i, o, -s, o, c], axis=-1).reshape(*np.shape(angle), 3, 3)
    return position @ np.swapaxes(turn, -1, -2)


def pack(name, position, rate_hz=30.0, stature_m=None):
    stature_m = stature_m or measure_stature(position, JOINTS)
    rows = pack_motion(position, rate_hz, stature_m)
    return PackedTake(name, rows, rate_hz, len(position), joints_present(position))


def without(position, *joints):
    lost = position.copy()
    lost[:, [JOINTS.index(name) for name in joints]] = np.nan
    return lost


def found(query, takes, threads=1, **settings):
    return search_takes(query, takes, SearchSettings(**settings), threads=threads).matches


def nearest(query, take, **settings):
    [match] = found(query, [take], top=1, **settings)
    return match


def assert_same(matches, expected):
    assert [(m.take, m.start, m.end) for m in matches] == [
        (m.take, m.start, m.end) for m in expected
    ]
    np.testing.assert_allclose(
        [m.distance for m in matches], [m.distance for m in expected], rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize(
    ("settings", "weights"),
    [
        ({}, dict.fromkeys(JOINTS, 1.0)),
        ({"part": "feet"}, dict.fromkeys(PARTS["feet"], 1.0)),
        ({"part": "right-arm"}, dict.fromkeys(PARTS["right-arm"], 1.0)),
        ({"part": "head", "weights": (("LFin", 2.5),)}, {"Head": 1, "Neck": 1, "LFin": 2.5}),
        ({"part": "head", "weights": (("Neck", 0), ("Waist", 1))}, {"Head": 1, "Waist": 1}),
        ({"part": "feet", "path_weight": 0.4}, dict.fromkeys(PARTS["feet"], 1.0)),
        ({"part": "hands", "steps": "paper"}, dict.fromkeys(PARTS["hands"], 1.0)),
    ],
    ids=["whole", "feet", "arm", "added", "removed", "path", "paper"],
)
@pytest.mark.parametrize("rate_hz", [30.0, 45.0])
def test_search_agrees_with_its_naive_twin(dance, settings, weights, rate_hz):
    asked, other = without(dance(), "RHeel"), dance(70)
    other[33, JOINTS.index("LFin")] = np.nan
    query = clip_take(pack("asked", asked), 20, 27)
    matches = found(query, [pack("other", other, rate_hz)], top=4, **settings)
    given = {k: v for k, v in settings.items() if k in ("steps", "path_weight")}
    expected = naive.search((asked, 30.0), (20, 27), (other, rate_hz), weights, top=4, **given)
    assert len(expected) > 2
    assert_same(matches, [Match("other", *match) for match in expected])


@pytest.mark.parametrize("part", ["whole", "arms"])
@pytest.mark.parametrize("path_weight", [0.0, 0.5])
@pytest.mark.parametrize("rate_hz", [30.0, 100.0, 120.0])
def test_a_clip_finds_itself_at_distance_zero(dance, part, path_weight, rate_hz):
    take = pack("a", dance(130 if rate_hz > 30 else FRAMES), rate_hz)
    step = round(rate_hz / 10)
    match = nearest(clip_take(take, step, 5 * step), take, part=part, path_weight=path_weight)
    assert match == Match("a", step, 5 * step, 0.0)


def test_a_clip_of_a_file_finds_itself_in_the_archive(dance):
    position = dance()
    take = pack("a", position.astype(np.float32))
    stature_m = measure_stature(position.astype(np.float32), JOINTS)
    assert nearest(clip_motion(position, 30.0, stature_m, (13, 30)), take).distance == 0
    whole = clip_motion(position, 30.0, stature_m, name="b.bvh")
    assert nearest(whole, take) == Match("a", 0, FRAMES - 1, 0.0)


@pytest.mark.parametrize("part", ["whole", "left-arm"])
def test_moving_turning_and_scaling_a_take_changes_no_distance(dance, part):
    asked, other = dance(), dance()
    query = clip_take(pack("asked", asked), 13, 24)
    settings = {"part": part, "path_weight": 0.3, "top": 3}
    before = found(query, [pack("a", other)], **settings)
    after = found(query, [pack("a", turned(other + np.array([5, 0, -2]), 2.1) * 1.4)], **settings)
    assert_same(after, before)
    assert before[0].distance > 0.01


def test_the_mirrored_motion_is_found_by_mirror_only(dance):
    position = dance()
    take = pack("a", turned(naive.mirror(position), 1.1))
    query = clip_take(pack("asked", position), 20, 40)
    plain, mirrored = nearest(query, take), nearest(query, take, mirror=True)
    assert plain.distance > 0.05
    assert (mirrored.start, mirrored.end, mirrored.mirrored) == (20, 40, True)
    assert mirrored.distance < 1e-5
    assert not nearest(query, pack("a", position), mirror=True).mirrored


def test_mirror_looks_for_the_right_arm_on_the_left(dance):
    position = dance()
    other = without(naive.mirror(position), *PARTS["right-leg"][1:])
    other[:, [JOINTS.index(n) for n in PARTS["right-arm"][1:]]] += 0.5
    query = clip_take(pack("asked", position), 20, 40)
    weights = (("RFin", 2.0), ("RKnee", 3.0))
    take = pack("a", other, stature_m=measure_stature(position, JOINTS))
    match = nearest(query, take, part="right-arm", mirror=True, weights=weights)
    assert match.mirrored
    assert (match.start, match.end) == (20, 40)
    assert match.distance < 1e-5


def test_the_mirror_image_lacks_the_joint_of_the_other_side(dance):
    position = dance()
    take = pack("a", naive.mirror(position))
    match = nearest(clip_take(pack("asked", without(position, "LFin")), 20, 40), take, mirror=True)
    assert (match.start, match.end, match.mirrored) == (20, 40, True)


def test_the_mirror_image_turns_the_other_way(dance):
    position = dance()
    take = pack("a", naive.mirror(position))
    query = clip_take(pack("asked", position), 20, 40)
    settings = {"part": "head", "mirror": True, "path_weight": 2.0}
    assert nearest(query, take, **settings).distance < 1e-4
    assert nearest(query, take, **{**settings, "mirror": False}).distance > 0.1


def test_mirrored_and_plain_matches_share_no_frame(dance):
    position = dance()
    both = np.concatenate([position, naive.mirror(position)])
    query = clip_take(pack("asked", position), 3, 12)
    matches = found(query, [pack("a", both)], mirror=True, top=50)
    frames = [frame for m in matches for frame in range(m.start, m.end + 1)]
    assert len(frames) == len(set(frames))
    assert {m.mirrored for m in matches} == {False, True}


def test_turning_left_is_told_from_turning_right_by_the_path(dance):
    pose = dance(1)[0]
    pose -= pose[[JOINTS.index("RHip"), JOINTS.index("LHip")]].mean(axis=0)
    angle = np.linspace(0, 2, FRAMES)
    left, right = (turned(np.tile(pose, (FRAMES, 1, 1)), sign * angle) for sign in (1, -1))
    query = clip_take(pack("left", left), 10, 30)
    takes = [pack("right", right), pack("left again", left)]
    assert {m.distance < 1e-5 for m in found(query, takes, top=2)} == {True}
    told = {m.take: m.distance for m in found(query, takes, path_weight=1.0, top=9)}
    # 2 rad in 58 frames, one way or the other, at a lever of a quarter stature
    assert told["right"] == pytest.approx(2 * 2 / (58 / 30) / 4, rel=1e-3)
    assert told["left again"] < 1e-5


def test_about_the_shoulders_arms_do_not_see_leaning(dance):
    position = dance()
    leaning = position.copy()
    upper = [JOINTS.index(name) for name in (*PARTS["arms"], *PARTS["head"])]
    leaning[:, upper] += np.linspace(0, 0.5, FRAMES)[:, None, None] * [1.0, -0.3, 0.5]
    query = clip_take(pack("asked", position), 20, 40)
    take = replace(pack("a", position), rows=pack_motion(leaning, 30.0, 1.0), name="leaning")
    query = replace(query, rows=pack_motion(position, 30.0, 1.0)[:, 20:41])
    match = nearest(query, take, part="arms")
    assert (match.start, match.end) == (20, 40)
    assert match.distance < 1e-5
    assert nearest(query, take, part="arms", weights=(("Waist", 0.01),)).distance > 0.05


@pytest.mark.parametrize("joint", ["RKnee", "Head"])
def test_a_weight_of_zero_removes_a_joint(dance, joint):
    asked, other = dance(), dance()
    query = clip_take(pack("asked", asked), 13, 24)
    moved = other.copy()
    moved[:, JOINTS.index(joint)] += 0.1
    stature_m = measure_stature(other, JOINTS)
    before, after = (
        replace(pack("a", position), rows=pack_motion(position, 30.0, stature_m))
        for position in (other, moved)
    )
    weights = ((joint, 0.0),)
    assert found(query, [before], weights=weights) == found(query, [after], weights=weights)
    assert found(query, [before]) != found(query, [after])


def test_takes_searched_together_are_searched_as_if_alone(dance):
    query = clip_take(pack("asked", dance()), 13, 24)
    takes = [pack(name, dance(frames)) for name, frames in (("b", 33), ("a", 70), ("c", 64))]
    alone = [match for take in takes for match in found(query, [take], top=99)]
    together = found(query, takes, top=99, threads=2)
    assert together == sorted(alone, key=lambda m: (m.distance, m.take, m.start))
    assert found(query, takes, top=3) == together[:3]
    assert len({match.take for match in together}) == 3


def test_equal_distances_are_ordered_by_take_then_start(dance):
    position = dance()
    asked = pack("asked", position)
    twice = np.concatenate([position[13:25], position[13:25]])
    rows = np.concatenate([asked.rows[:, 13:25]] * 2, axis=1)
    takes = [PackedTake(name, rows, 30.0, len(twice), asked.joints_present) for name in ("b", "a")]
    matches = found(clip_take(asked, 13, 24), takes)
    assert [(m.take, m.start) for m in matches[:4]] == [("a", 0), ("a", 12), ("b", 0), ("b", 12)]
    assert {m.distance for m in matches[:4]} == {0.0}


def test_a_long_take_cut_for_threads_gives_the_same(dance, monkeypatch):
    query, take = clip_take(pack("asked", dance()), 13, 24), pack("a", dance(200))
    whole = found(query, [take], top=99, mirror=True)
    monkeypatch.setattr(searching, "_PIECE", 17)
    monkeypatch.setattr(searching, "_PIECE_IN_QUERIES", 1)
    clip = np.zeros((12, 3), np.float32), np.ones(1, np.float32), np.zeros((3, 2), np.int64)
    spans = searching._pieces(take, clip, "slope", 4)
    assert len(spans) == 8
    assert [span[2] for span in spans[:-1]] == [span[1] for span in spans[1:]]
    assert [span[0] for span in spans] == [max(0, span[1] - 22) for span in spans]
    assert found(query, [take], top=99, mirror=True, threads=4) == whole
    assert len(searching._pieces(take, clip, "paper", 4)) == 1


def test_a_frame_with_a_missing_joint_is_in_no_match(dance):
    other = dance(90)
    other[40:42, JOINTS.index("LWrist")] = np.nan
    query, take = clip_take(pack("asked", dance()), 13, 24), pack("a", other)
    whole, legs = (found(query, [take], part=part, top=99) for part in ("whole", "legs"))
    assert not any(m.start <= 41 and m.end >= 40 for m in whole)
    assert any(m.start <= 41 and m.end >= 40 for m in legs)
    assert len(whole) > 2


def test_a_joint_of_half_the_frames_is_compared_and_one_of_fewer_is_not(dance):
    asked, other = dance(), dance(40)
    half, fewer = other.copy(), other.copy()
    half[20:, JOINTS.index("LFin")] = np.nan
    fewer[19:, JOINTS.index("LFin")] = np.nan
    query = clip_take(pack("asked", asked), 13, 20)
    assert max(m.end for m in found(query, [pack("a", half)], top=9)) < 20
    assert max(m.end for m in found(query, [pack("a", fewer)], top=9)) > 20


def test_only_what_is_below_the_threshold_and_at_most_the_top_is_found(dance):
    query, take = clip_take(pack("asked", dance()), 13, 18), pack("a", dance(90))
    every = found(query, [take], top=99)
    assert len(every) > 5
    below = found(query, [take], top=99, threshold=every[3].distance)
    assert below == every[:3]
    assert found(query, [take], top=2) == every[:2]


def test_takes_that_cannot_be_compared_are_named(dance):
    query = clip_take(pack("asked", dance()), 0, 40)
    takes = [
        pack("no arms", without(dance(), *PARTS["arms"][1:4], *PARTS["arms"][5:])),
        pack("one shoulder", without(dance(), "LShoulder")),
        pack("short", dance(20)),
        pack("fit", dance(21)),
    ]
    settings = SearchSettings("arms", weights=(("RShoulder", 0), ("LShoulder", 0)), mirror=True)
    answer = search_takes(query, takes, settings)
    assert {match.take for match in answer.matches} == {"fit"}
    assert answer.skipped == {
        "no arms": "it has no joint with weight that the query has too",
        "one shoulder": "it lacks a shoulder, and the arms and head are compared from the "
        "shoulders",
        "short": "it is too short: 0.7 s, and the shortest match of this query has 0.7 s",
    }
    assert not search_takes(query, takes[:3], settings).matches


def test_a_query_that_lacks_a_compared_joint_is_refused_by_joint_and_frames(dance):
    asked = dance(130)
    asked[48:57, JOINTS.index("RFin")] = np.nan
    asked[64, JOINTS.index("LKnee")] = np.nan
    query, take = clip_take(pack("asked", asked, 120.0), 40, 80), pack("a", dance())
    message = r"query asked:40-80 lacks RFin \(in frames 48-56\), LKnee \(in frame 64\); choose"
    with pytest.raises(ValueError, match=message):
        search_takes(query, [take])
    assert found(query, [take], weights=(("RFin", 0), ("LKnee", 0)))
    assert found(query, [pack("a", without(dance(), "RFin", "LKnee"))])


def test_a_query_without_hips_shoulders_or_path_is_refused(dance):
    asked = dance()
    asked[[20, 23], JOINTS.index("RHip")] = np.nan
    asked[30, JOINTS.index("LShoulder")] = np.nan
    packed, take = pack("asked", asked), pack("a", dance())
    with pytest.raises(ValueError, match=r"lacks the hips \(in frames 20-23\); choose"):
        search_takes(clip_take(packed, 15, 28), [take])
    with pytest.raises(ValueError, match=r"lacks the shoulders \(in frame 30\); choose"):
        search_takes(clip_take(packed, 28, 35), [take], SearchSettings("head"))
    with pytest.raises(ValueError, match=r"lacks the path \(in frame 26\); choose"):
        search_takes(clip_take(packed, 24, 28), [take], SearchSettings(path_weight=1))


def test_a_mirrored_query_names_its_own_joints(dance):
    asked = dance()
    asked[20, JOINTS.index("RFin")] = np.nan
    query = clip_take(pack("asked", asked), 15, 28)
    take = pack("a", without(dance(), "RFin"))
    assert found(query, [take])
    with pytest.raises(ValueError, match=r"lacks RFin \(in frame 20\)"):
        found(query, [take], mirror=True)


def test_a_clip_beyond_its_take_is_refused(dance):
    with pytest.raises(ValueError, match="50-59 is not within the take; give START-END"):
        clip_take(pack("asked", dance()), 50, 59)


def test_nothing_given_is_changed(dance):
    take = pack("a", dance())
    before = take.rows.copy()
    take.rows.flags.writeable = False
    found(clip_take(take, 13, 24), [take], mirror=True, part="arms", path_weight=1)
    np.testing.assert_array_equal(take.rows, before)


def test_the_search_imports_no_more_than_numpy_and_numba():
    heavy = ("scipy.linalg", "scipy.spatial", "xarray", "zarr", "prefect", "pandas", "cv2")
    code = "import sys, tasks.retrieval.searching; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(heavy) & set(done.stdout.split())
