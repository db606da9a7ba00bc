"""The experiments of the retrieval paper, sections 4.1 to 4.5, on performers whose truth is known.

Every query is a clip that one performer danced on one day; what was danced elsewhere, and when,
is what the search must find.
"""

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.motion.stature import joints_present, measure_stature
from tasks.retrieval.normalization import pack_motion
from tasks.retrieval.searching import clip_take, search_takes
from tasks.retrieval.segments import PackedTake
from tasks.retrieval.weighting import SearchSettings
from tasks.studio.performances import demo_performances

pytestmark = pytest.mark.compiled  # a hundred thousand frames of warping


@pytest.fixture(scope="module")
def demo():
    return demo_performances()


@pytest.fixture(scope="module")
def archive(demo):
    return {take.take: pack(take) for take in demo[0]}


def pack(take, stature_m=None):
    position, rate_hz = take.performance.position, take.performance.rate_hz
    rows = pack_motion(position, rate_hz, stature_m or measure_stature(position, JOINTS))
    return PackedTake(take.take, rows, rate_hz, len(position), joints_present(position))


def danced(demo, movement, *names):
    """Where a movement was danced: (take, start, end) in the takes named, or in all."""
    return [
        (take.take, clip.start, clip.end)
        for take in demo[0]
        for clip in take.performance.clips
        if clip.movement == movement and (not names or take.take in names)
    ]


def search(archive, clip, *, within=(), **settings):
    """The matches of a clip, in the takes named or in all."""
    takes = [archive[name] for name in (within or archive)]
    take, start, end = clip
    query = clip_take(archive[take], start, end)
    return search_takes(query, takes, SearchSettings(**settings)).matches


def overlap(match, clip):
    """Frames in both of all frames in either; 0 in different takes."""
    take, start, end = clip
    both = min(match.end, end) - max(match.start, start) + 1
    either = max(match.end, end) - min(match.start, start) + 1
    return max(both, 0) / either if match.take == take else 0.0


def found(matches, clips):
    """The rank (from 0) at which each clip was found, None where it was not."""
    ranks = []
    for clip in clips:
        at = [rank for rank, match in enumerate(matches) if overlap(match, clip) > 0.5]
        assert len(at) <= 1, f"{clip} was found more than once"
        ranks.append(at[0] if at else None)
    return ranks


def test_4_1_radio_exercise_is_found_on_another_day(demo, archive):
    for movement in ("radio arms", "radio sides", "radio knees"):
        query = danced(demo, movement, "radio-tk-day1")[0]
        again = danced(demo, movement, "radio-tk-day2")
        matches = search(archive, query, within=["radio-tk-day2"], top=5)
        assert found(matches, again) == [0]
        assert overlap(matches[0], again[0]) > 0.85
        assert matches[1].distance > 2.0 * matches[0].distance


def test_4_1_radio_exercise_is_found_by_the_right_finger_alone(demo, archive):
    query = danced(demo, "radio arms", "radio-tk-day1")[0]
    again = danced(demo, "radio arms", "radio-tk-day2")
    only = tuple((f"R{name}", 0.0) for name in ("Shoulder", "Elbow", "Wrist"))
    matches = search(archive, query, within=["radio-tk-day2"], part="right-arm", weights=only)
    assert found(matches, again) == [0]


def test_4_2_okuri_is_found_in_a_longer_take_of_another_day(demo, archive):
    query = danced(demo, "okuri 48", "okuri48-tk-day1")[0]
    again = danced(demo, "okuri 48", "okuri48-tk-day2")
    matches = search(archive, query, within=["okuri48-tk-day2"])
    assert sorted(found(matches, again)) == [0, 1]
    assert min(overlap(match, clip) for match, clip in zip(matches, again, strict=False)) > 0.85


def test_4_2_okuri_to_the_other_side_is_found_by_its_mirror_image_only(demo, archive):
    query = danced(demo, "okuri 48", "okuri48-tk-day1")[0]
    other = danced(demo, "okuri 48 mirrored", "okuri48-tk-day1", "okuri48-tk-day2")
    plain, mirrored = (search(archive, query, top=6, mirror=mirror) for mirror in (False, True))
    assert found(plain, other) == [None, None]
    assert None not in found(mirrored, other)
    assert {m.mirrored for m in mirrored for clip in other if overlap(m, clip) > 0.5} == {True}


@pytest.mark.parametrize("take", ["okuri49-tk-day1", "okuri49-sh-day3"])
def test_4_3_okuri_with_raised_hands_is_found_by_the_feet_and_missed_by_the_whole_body(
    demo, archive, take
):
    query = danced(demo, "okuri 48", "okuri48-tk-day1")[0]
    raised = danced(demo, "okuri 49", take)
    feet = search(archive, query, within=[take], part="feet")
    whole = search(archive, query, within=[take], part="whole")
    assert sorted(found(feet, raised)) == [0, 1]
    assert feet[2].distance > 3.0 * feet[1].distance
    ranks = found(whole, raised)
    assert all(rank is None or rank >= 3 for rank in ranks)
    assert all(overlap(match, clip) < 0.1 for match in whole[:3] for clip in raised)


def test_4_4_a_turn_to_the_right_is_found_for_a_turn_to_the_left(demo, archive):
    query = danced(demo, "turn left", "turn-tk-day1")[0]
    left, right = (danced(demo, f"turn {side}", "turn-sh-day2") for side in ("left", "right"))
    matches = search(archive, query, within=["turn-sh-day2"])
    assert sorted(found(matches, left + right)) == [0, 1]
    assert matches[1].distance < 1.5 * matches[0].distance
    assert matches[2].distance > 2.5 * matches[1].distance


def test_4_4_with_its_path_a_turn_to_the_right_ranks_clearly_behind(demo, archive):
    query = danced(demo, "turn left", "turn-tk-day1")[0]
    left, right = (danced(demo, f"turn {side}", "turn-sh-day2") for side in ("left", "right"))
    matches = search(archive, query, within=["turn-sh-day2"], path_weight=0.2)
    assert found(matches, left + right) == [0, 1]
    assert matches[1].distance > 2.5 * matches[0].distance
    matches = search(archive, query, within=["turn-sh-day2"], path_weight=1.0)
    assert found(matches, left + right) == [0, None]
    assert matches[1].distance > 4.0 * matches[0].distance


def test_4_5_lonely_is_found_every_time_with_performers_of_other_size(demo, archive):
    query = danced(demo, "lonely", "lonely-tk-day1")[0]
    others = danced(demo, "lonely", "lonely-sh-day2", "lonely-ys-day3")
    matches = search(archive, query, top=12)
    assert found(matches, [query]) == [0]
    assert matches[0].distance == 0.0
    assert sorted(found(matches, others)) == [1, 2, 3, 4, 5]
    assert matches[6].distance > 2.0 * matches[5].distance


def test_4_5_without_the_normalization_of_size_another_performer_is_further_away(demo, archive):
    query = danced(demo, "lonely", "lonely-tk-day1")[0]
    tall = danced(demo, "lonely", "lonely-ys-day3")
    unscaled = {take.take: pack(take, 1.6) for take in demo[0]}
    near, far = (
        search(takes, query, within=["lonely-ys-day3"], top=2) for takes in (archive, unscaled)
    )
    assert sorted(found(near, tall)) == [0, 1]
    assert np.mean([m.distance for m in far]) > 1.5 * np.mean([m.distance for m in near])


def test_every_search_of_the_demo_finds_what_it_promises_first(demo, archive):
    for shown in demo[1]:
        clip = (shown.take, shown.start, shown.end)
        matches = search(
            archive, clip, part=shown.part, mirror=shown.mirror, path_weight=shown.path_weight
        )
        promised = [(take, truth.start, truth.end) for take, truth in shown.finds]
        assert found(matches, [clip]) == [0], shown.question
        assert sorted(found(matches, promised)) == list(range(1, len(promised) + 1))
