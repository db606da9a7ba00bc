"""The chance told of a distance is met: of noise, of planted truth, and of dance as recorded."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.retrieval.meaning import chance as module
from tasks.retrieval.meaning.chance import FEWEST_CLIPS, Chance, measure_chance, one_in
from tasks.retrieval.searching import Query, SearchSettings, search_takes
from tasks.retrieval.segments import PackedTake
from tests.benchmarks.similarity.motions import make_query, make_take, pack_query

FRAMES = 24
FEET = SearchSettings(part="feet", top=100_000)


def noise(seed, samples, name="noise"):
    """A take in which nothing repeats, and whose joints sway alike."""
    query = pack_query(*make_query(FRAMES, seed=1))
    take, _ = make_take(samples, query, copies=0, seed=seed)
    return replace(take, name=name)


def asked(seed):
    """A query that sways so too, and is danced nowhere."""
    return Query(noise(1000 + seed, FRAMES + 8).rows[:, 4 : 4 + FRAMES], np.ones(21, bool))


def test_in_noise_the_chance_is_met_as_often_as_told():
    """The share of clips told to be as rare as p is p; of what is rarer, there is no more."""
    takes = [noise(3, 4000, "a"), noise(4, 4000, "b")]
    unseen = [noise(5, 4000, "c"), noise(6, 4000, "d")]
    met = []
    for seed in range(40):
        query = asked(seed)
        chance = measure_chance(query, takes, FEET, threads=1)
        met += [chance.of(m.distance) for m in search_takes(query, unseen, FEET, threads=1).matches]
    met = np.array(met)
    assert len(met) > 8000
    for told in (0.5, 0.3, 0.1, 0.05):
        # the clips of one query hang together: 40 queries are what varies
        assert (met <= told).mean() == pytest.approx(told, rel=0.25)
    for told in (0.01, 0.003, 0.001):
        most = told * len(met) + 4 * np.sqrt(told * len(met))
        assert (met <= told).sum() <= most
    assert (met <= 0.01).mean() > 0.002  # what is always "never" would keep every bound


def test_neither_the_clip_itself_nor_true_matches_make_a_match_common():
    query = asked(1)
    empty, _ = make_take(6000, query, copies=0, seed=8)
    full, _ = make_take(6000, query, copies=40, seed=8)
    few, many = (measure_chance(query, [take], FEET, threads=1) for take in (empty, full))
    match = search_takes(query, [full], FEET, threads=1).matches[30]
    assert few.of(match.distance) < 0.01
    assert many.of(match.distance) < 0.01
    assert many.of(np.median(few.distance)) == pytest.approx(0.5, abs=0.2)


def test_what_is_the_same_backwards_is_common():
    still = noise(9, 3000)
    still.rows[:, 600:2400] = still.rows[:, [600]]
    query = Query(still.rows[:, 700 : 700 + FRAMES], still.joints_present)
    chance = measure_chance(query, [still], FEET, threads=1)
    assert chance.of(0.0) > 0.2
    assert chance.expected(0.0) == pytest.approx(chance.of(0.0) * chance.clips)


def test_scale_heading_and_order_of_takes_change_no_chance():
    query, takes = asked(2), [noise(10, 2000, "a"), noise(11, 2000, "b")]
    there = measure_chance(query, takes, FEET, threads=1)
    back = measure_chance(query, takes[::-1], FEET, threads=2)
    np.testing.assert_array_equal(there.distance, back.distance)
    assert there.clips == back.clips > FEWEST_CLIPS


def test_a_large_archive_is_sampled_evenly(monkeypatch):
    takes = [noise(20 + n, samples, f"{n}") for n, samples in enumerate((5000, 300, 1100, 3000))]
    query = asked(3)
    takes[-1].rows[:] = query.rows.mean(axis=1, keepdims=True)  # near, and only there
    everything = measure_chance(query, takes, FEET, threads=1)
    monkeypatch.setattr(module, "SAMPLED", 2500)
    sampled = measure_chance(query, takes, FEET, threads=1)
    assert len(everything.distance) / 6 < len(sampled.distance) < len(everything.distance) / 2
    assert sampled.clips == pytest.approx(everything.clips, rel=0.1)
    for share in (0.2, 0.5, 0.8):
        distance = np.quantile(everything.distance, share)
        assert sampled.of(distance) == pytest.approx(everything.of(distance), abs=0.1)


def test_mirrored_clips_count_too():
    query, takes = asked(4), [noise(12, 4000)]
    alone = measure_chance(query, takes, FEET, threads=1)
    both = measure_chance(query, takes, replace(FEET, mirror=True), threads=1)
    assert both.of(alone.distance[5]) > alone.of(alone.distance[5])


def test_of_a_small_archive_nothing_is_told():
    for takes in ([], [noise(13, 10)], [noise(13, 600)]):
        chance = measure_chance(asked(5), takes, FEET, threads=1)
        assert not chance.can_be_told
        assert chance.of(0.01) is None
        assert chance.expected(0.01) is None


def test_a_nearer_match_is_never_more_likely():
    distance = np.sort(np.random.default_rng(1).gamma(9.0, 0.01, 300))
    chance = Chance(distance, 300)
    told = [chance.of(x) for x in np.linspace(0, 0.3, 500)]
    assert (np.diff(told) >= 0).all()
    assert told[0] == chance.least == 1 / 30_000
    assert told[-1] == 1.0
    assert chance.of(distance[150]) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(
    "distance",
    [np.zeros(80), np.full(80, 0.1), np.append(np.zeros(6), np.linspace(0.1, 0.2, 74))],
    ids=["all-at-nothing", "all-alike", "some-at-nothing"],
)
def test_clips_that_are_equally_near_are_told_as_seen(distance):
    chance = Chance(distance, 80)
    assert chance.of(0.0) >= (distance <= 0).mean()
    assert chance.of(0.0) > 0
    assert chance.of(0.5) == 1.0


@pytest.mark.parametrize(
    ("chance", "clips"),
    [(1.0, 1), (0.4, 2), (0.01, 100), (1 / 1287, 1200), (1 / 99, 99), (3e-6, 330_000)],
)
def test_chances_are_told_in_two_digits_and_never_too_rare(chance, clips):
    assert one_in(chance) == clips


def test_queries_that_lack_a_joint_are_refused_as_by_the_search():
    query = asked(6)
    query.rows[-20, 3] = np.nan  # a joint of the feet, in one sample
    rows = query.rows.copy()
    rows[33:36, 3] = np.nan
    take = PackedTake("a", noise(14, 800).rows, 30.0, 800, np.ones(21, bool))
    with pytest.raises(ValueError, match="lacks"):
        measure_chance(Query(rows, query.joints_present), [take], SearchSettings(), threads=1)
