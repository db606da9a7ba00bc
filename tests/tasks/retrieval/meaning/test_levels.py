"""Named levels of distance: their order, what they do not depend on, and what lies within them."""

import itertools

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.retrieval.meaning.levels import LEVELS, level_of, level_thresholds, threshold_of
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.searching import SearchSettings, search_takes
from tasks.studio.dancing.choreography import lonely, okuri48, radio_arms, walk
from tasks.studio.performances import SH, TK, YS, generate_performance
from tests.benchmarks.similarity import truth

RATE_HZ = truth.RATE_HZ


@pytest.mark.parametrize("part", PARTS)
def test_the_levels_of_a_part_are_in_order_and_both_sides_have_the_same(part):
    levels = level_thresholds(SearchSettings(part=part))
    assert tuple(levels) == LEVELS == ("same", "like")
    assert 0 < levels["same"] < levels["like"] < 0.2
    other = part.replace("left", "right")
    assert level_thresholds(SearchSettings(part=other)) == levels


@pytest.mark.parametrize("joint", JOINTS)
def test_the_levels_of_a_joint_are_in_order(joint):
    alone = tuple((name, float(name == joint)) for name in JOINTS)
    levels = level_thresholds(SearchSettings(weights=alone))
    assert 0 < levels["same"] < levels["like"] < 0.3
    other = {"R": "L", "L": "R"}.get(joint[0], joint[0]) + joint[1:]
    swapped = tuple((name, float(name == other)) for name in JOINTS)
    assert level_thresholds(SearchSettings(weights=swapped)) == levels


def test_only_the_shares_of_the_weights_matter():
    part = SearchSettings(part="feet")
    twice = SearchSettings(part="feet", weights=tuple((name, 2.0) for name in PARTS["feet"]))
    named = tuple((name, 3.0 * (name in PARTS["feet"])) for name in JOINTS)
    levels = level_thresholds(part)
    assert level_thresholds(twice) == level_thresholds(SearchSettings(weights=named)) == levels
    free = [SearchSettings(weights=(("RFin", 4.0 * k), ("RFoot", 2.0 * k))) for k in (0.5, 1.0)]
    assert level_thresholds(free[0]) != level_thresholds(free[1])  # others keep their 1
    none = tuple((name, 0.0) for name in JOINTS if name not in ("RFin", "RFoot"))
    free = [
        SearchSettings(weights=(("RFin", 4.0 * k), ("RFoot", 2.0 * k), *none)) for k in (0.5, 1.0)
    ]
    assert level_thresholds(free[0]) == level_thresholds(free[1])


def test_free_weights_lie_between_what_they_are_made_of():
    """More weight of a joint that moves farther raises the levels, step by step."""
    none = tuple((name, 0.0) for name in JOINTS if name not in ("RFin", "RHip", "RFoot"))
    reach = [
        level_thresholds(SearchSettings(weights=(("RFin", weight), ("RHip", 1.0), *none)))["like"]
        for weight in (1e-3, 0.3, 1.0, 3.0, 1e3)
    ]
    assert reach == sorted(reach)
    assert reach[0] < reach[-1]


def test_what_the_path_adds_is_allowed_for():
    without, little, much = (
        level_thresholds(SearchSettings(path_weight=weight)) for weight in (0.0, 0.1, 0.3)
    )
    for level in LEVELS:
        assert without[level] < little[level] < much[level]
        assert much[level] - without[level] == pytest.approx(
            3 * (little[level] - without[level]), abs=5e-4
        )


def test_a_distance_is_of_the_nearest_level_that_it_lies_below():
    settings = SearchSettings(part="arms")
    same, like = level_thresholds(settings).values()
    assert level_of(0.0, settings) == "same"
    assert level_of(same, settings) == "like"  # as a threshold: only what is below
    assert level_of(np.nextafter(same, 0), settings) == "same"
    assert level_of(np.nextafter(like, 0), settings) == "like"
    assert level_of(like, settings) is None
    assert level_of(0.0, SearchSettings(steps="paper")) is None


def test_a_threshold_is_a_number_or_a_level():
    settings = SearchSettings(part="feet")
    levels = level_thresholds(settings)
    assert threshold_of(None, settings) is None
    assert threshold_of("0.05", settings) == threshold_of(0.05, settings) == 0.05
    assert [threshold_of(name, settings) for name in LEVELS] == list(levels.values())
    for wrong in ("foo", "", "nan", "0", 0.0, -1, float("nan"), "Same", "x" * 500):
        with pytest.raises(ValueError, match=r"give a distance above 0, same or like$") as caught:
            threshold_of(wrong, settings)
        assert len(str(caught.value)) < 120
    with pytest.raises(ValueError, match="'like' has no meaning with the steps 'paper'"):
        threshold_of("like", SearchSettings(steps="paper"))
    with pytest.raises(ValueError, match="there is no part 'foot'"):
        threshold_of("like", SearchSettings(part="foot"))


@pytest.fixture(scope="module")
def performances():
    """Three movements by two performers on a day each, and by the first on another one."""
    movements = [radio_arms(), okuri48(), walk(4), lonely()]
    return [
        generate_performance(order, performer, day=day, rate_hz=RATE_HZ)
        for performer, day, order in (
            (TK, 1, movements), (TK, 2, movements[::-1]), (SH, 3, movements), (YS, 4, movements),
        )
    ]  # fmt: skip


@pytest.mark.parametrize("part", ["whole", "arms", "feet"])
def test_dance_of_known_truth_lies_within_its_level(performances, part):
    asked, *others = performances
    settings = SearchSettings(part=part, top=1)
    take = truth.packed("asked", asked.position)
    # feet that stand, as in the radio exercise, stand everywhere
    for clip in asked.clips[1:2] if part == "feet" else asked.clips[:2]:
        query = truth.cut(take, clip.start, clip.end)
        for number, other in enumerate(others):
            there = truth.packed("there", other.position)
            at = next(each for each in other.clips if each.movement == clip.movement)
            [match] = search_takes(query, [there], settings, threads=1).matches
            assert truth.overlap((match.start, match.end), (at.start, at.end)) > 0.5
            level = level_of(match.distance, settings)
            assert level == "same" if number == 0 else level is not None


def test_other_movements_are_nothing_like_it(performances):
    asked, other = performances[0], performances[1]
    whole = SearchSettings(top=1)
    take, there = truth.packed("asked", asked.position), truth.packed("there", other.position)
    for a, b in itertools.product(asked.clips, other.clips):
        query = truth.cut(take, a.start, a.end)
        rows = there.rows[:, b.start : b.end + 1]
        alone = truth.PackedTake("b", rows, RATE_HZ, rows.shape[1], there.joints_present)
        for match in search_takes(query, [alone], whole, threads=1).matches:
            assert (level_of(match.distance, whole) is not None) == (a.movement == b.movement)


def test_a_clip_that_was_altered_keeps_its_level(performances):
    """Turned, moved, of another size, slower, faster, noisy: as near as before, or nearly."""
    position, clip = performances[0].position, performances[0].clips[0]
    query = truth.cut(truth.packed("asked", position), clip.start, clip.end)
    rng = np.random.default_rng(3)
    made = truth.variants(position, clip.start, clip.end, rng)
    made["larger"] = 1.3 * made["as it was"]
    for name, altered in made.items():
        settings = SearchSettings(mirror=name == "mirrored", top=1)
        [match] = search_takes(query, [truth.packed("there", altered)], settings, threads=1).matches
        level = level_of(match.distance, settings)
        if name in ("other heading", "larger", "as it was", "mirrored", "30 % slower"):
            assert level == "same", name
        if name in ("other limbs", "noise of 1 cm", "30 % faster"):
            assert level is not None, name
        assert match.mirrored == (name == "mirrored")
