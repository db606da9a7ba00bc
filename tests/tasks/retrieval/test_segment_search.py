import itertools
from dataclasses import replace

import numpy as np
import pytest

from tasks.retrieval import segment_search
from tasks.retrieval.normalization import PARTS, ROWS, mirror_rows
from tasks.retrieval.pruned import pruning
from tasks.retrieval.pruned.summaries import summarize_rows
from tasks.retrieval.searching import Query, SearchSettings, search_takes
from tasks.retrieval.segment_search import search_gradually, search_segments
from tasks.retrieval.segments import ALIGNMENT, PackedTake, Segment

JOINTS = PARTS["whole"]


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def forced(monkeypatch):
    """Prune whatever it costs, and tell what share of the samples was warped."""
    monkeypatch.setattr(pruning, "_GAIN", np.inf)
    monkeypatch.setattr(pruning, "_CHEAP", 0)
    monkeypatch.setattr(segment_search, "_FIRST_LOOK", np.inf)
    monkeypatch.setattr(segment_search, "_HOPELESS", np.inf)
    warped = []
    warp = pruning._warp

    def count(portion, version, spans, threshold):
        warped.append(int((spans[:, 2] - spans[:, 0]).sum()))
        return warp(portion, version, spans, threshold)

    monkeypatch.setattr(pruning, "_warp", count)

    def share(segments, versions=1):
        samples = sum(int(segment.samples.sum()) for segment in segments)
        done = sum(warped) / samples / versions
        warped.clear()
        return done

    return share


def smooth(rng, frames, count, step, amplitude):
    """Return (count, frames) curves that turn every `step` frames."""
    knots = rng.normal(0, amplitude, (count, frames // step + 2))
    at = np.arange(knots.shape[1]) * step
    return np.array([np.interp(np.arange(frames), at, row) for row in knots])


def dance(rng, frames, step=9):
    return (rng.normal(0, 0.3, (ROWS, 1)) + smooth(rng, frames, ROWS, step, 0.25)).astype(
        np.float32
    )


def again(rng, rows, alike=0.01):
    """Return a dance at another speed, a little otherwise, or seen in a mirror."""
    frames = rows.shape[1]
    speed = np.exp(smooth(rng, frames, 1, 20, 0.2)[0])
    at = np.cumsum(speed)
    at = np.interp(np.arange(0, at[-1]), at, np.arange(frames))
    rows = np.array([np.interp(at, np.arange(frames), row) for row in rows])
    rows += smooth(rng, len(at), ROWS, 15, alike)
    rows = rows.astype(np.float32)
    return mirror_rows(rows) if rng.random() < 0.3 else rows


def make_takes(rng, base, count=12, rates=(30.0,)):
    """Return varied takes; some lack joints, or frames, or are short."""
    takes = []
    for number in range(count):
        rows = again(rng, base[number % len(base)])
        present = np.ones(21, bool)
        kind = number % 6
        if kind == 1:
            lost = rng.choice([4, 7, 13, 20])  # no hip
            rows[3 * lost : 3 * lost + 3] = np.nan
            present[lost] = False
        elif kind == 2:
            rows[:, 30:33] = np.nan
            rows[12:15, rng.random(rows.shape[1]) < 0.02] = np.nan
        elif kind == 3 and number > 6:
            rows = rows[:, : rng.integers(1, 40)]
        elif kind == 4:
            joint = JOINTS.index("RShoulder")
            rows[3 * joint : 3 * joint + 3], rows[63:66] = np.nan, np.nan
            present[joint] = False
        elif kind == 5:
            rows[:, 50] += 7.0  # a stray frame
        rate = rates[number % len(rates)]
        frames = int(rows.shape[1] * rate / 30) + 1
        name = f"take {number:03}"
        takes.append(PackedTake(name, np.ascontiguousarray(rows), rate, frames, present))
    return takes


def side_by_side(takes, *, holes=(), summarized=True):
    """Return takes as a segment, with a hole before each of the places given."""
    names, first, at = [], [], 0
    for take in takes:
        names.append(take.name)
        first.append(at)
        at += (take.rows.shape[1] // ALIGNMENT + 1) * ALIGNMENT
    rows = np.full((ROWS, at), np.nan, np.float32)
    for begin, take in zip(first, takes, strict=True):
        rows[:, begin : begin + take.rows.shape[1]] = take.rows
    return Segment(
        rows,
        names,
        np.array(first, np.int64),
        np.array([take.rows.shape[1] for take in takes], np.int64),
        np.array([take.frames for take in takes], np.int64),
        np.array([take.rate_hz for take in takes]),
        np.array([take.joints_present for take in takes]),
        np.array([place not in holes for place in range(len(takes))]),
        summarize_rows(rows) if summarized else {},
    )


def query_of(rng, base, frames):
    rows = base[rng.integers(len(base))]
    first = int(rng.integers(rows.shape[1] - frames))
    return Query(rows[:, first : first + frames], np.ones(21, bool), "asked", first)


SETTINGS = [
    {},
    {"part": "feet"},
    {"part": "arms"},
    {"part": "whole", "mirror": True},
    {"part": "right-arm", "mirror": True, "path_weight": 0.3},
    {"part": "head", "weights": (("LFin", 2.5), ("Neck", 0.1))},
    {"part": "legs", "path_weight": 2.0, "threshold": 0.2},
    {"threshold": 0.06, "top": 40},
    {"part": "hands", "top": 1},
    {"weights": (("RFin", 1e4), ("Head", 1e-3))},
]


@pytest.mark.compiled
@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_a_pruned_search_finds_what_a_scan_finds_to_the_last_bit(rng, forced, settings):
    base = [dance(rng, frames) for frames in (240, 300, 210)]
    takes = make_takes(rng, base, 40, rates=(30.0, 120.0, 24.0))
    segments = [side_by_side(takes[:23]), side_by_side(takes[23:])]
    asked = SearchSettings(**{"top": 5, **settings})
    pruned = 0
    for frames in (8, 13, 24, 33, 50, 61, 80, 100, 120, 150):
        query = query_of(rng, base, frames)
        expected = search_takes(query, takes, asked)
        assert search_segments(query, segments, asked, threads=2) == expected
        pruned += forced(segments, 1 + asked.mirror) < 0.5
    assert len(expected.skipped) > 4
    assert pruned >= 4


@pytest.mark.compiled
@pytest.mark.parametrize("settings", [{"steps": "paper"}, {}, {"mirror": True, "part": "arms"}])
def test_what_is_not_pruned_is_scanned(rng, settings):
    base = [dance(rng, 240)]
    takes = make_takes(rng, base, 16)
    asked = SearchSettings(**settings)
    for frames, summarized in itertools.product((2, 31), (True, False)):
        query = query_of(rng, base, frames)
        segment = side_by_side(takes, summarized=summarized)
        assert search_segments(query, [segment], asked) == search_takes(query, takes, asked)


@pytest.mark.compiled
@pytest.mark.usefixtures("forced")
def test_holes_are_not_searched(rng):
    base = [dance(rng, 240)]
    takes = make_takes(rng, base, 14)
    query = query_of(rng, base, 40)
    holes = (0, 3, 6, 7, 13)
    segments = [side_by_side(takes, holes=holes), side_by_side([takes[3]])]
    left = [take for place, take in enumerate(takes) if place not in holes]
    expected = search_takes(query, [*left, takes[3]])
    assert search_segments(query, segments) == expected
    assert {match.take for match in expected.matches} - {takes[3].name}


@pytest.mark.compiled
@pytest.mark.usefixtures("forced")
def test_answers_become_certain_from_the_nearest_on(rng):
    base = [dance(rng, 300, step=60)]
    segments = []
    for part in np.split(np.linspace(0.004, 0.2, 30), 2):
        rows = [again(rng, base[0], alike) for alike in part]
        takes = [
            PackedTake(f"take {alike}", each, 30.0, each.shape[1], np.ones(21, bool))
            for alike, each in zip(part, rows, strict=True)
        ]
        segments.append(side_by_side(takes))
    asked, certain = SearchSettings(top=20), set()
    for frames in (50, 120, 200):
        query = query_of(rng, base, frames)
        answers = list(search_gradually(query, segments, asked, threads=1))
        last = answers[-1]
        assert last.certain_below == np.inf
        assert last == search_segments(query, segments, asked)
        below = [answer.certain_below for answer in answers]
        assert below == sorted(below)
        for answer in answers:
            sure = [m for m in answer.matches if m.distance < answer.certain_below]
            assert sure == last.matches[: len(sure)]
            assert len(sure) == sum(m.distance < answer.certain_below for m in last.matches)
            certain.add(len(sure))
    assert len(certain) > 1


@pytest.mark.compiled
@pytest.mark.usefixtures("forced")
def test_the_unit_finds_what_is_within_a_threshold(rng):
    base = [dance(rng, 240)]
    takes = make_takes(rng, base, 12)
    asked = SearchSettings(top=6)
    query = query_of(rng, base, 40)
    expected = search_takes(query, takes, asked).matches
    found = {}

    def remember(portions, best, _):
        for portion in portions:
            found[id(portion)] = pruning.find_candidates(portion, expected[-1].distance, 6)
            best.add(found[id(portion)])
        yield np.inf

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(segment_search, "_look", remember)
        answer = search_segments(query, [side_by_side(takes)], asked)
    assert answer.matches == expected
    assert len(found) > 1


@pytest.mark.compiled
@pytest.mark.usefixtures("forced")
def test_frames_before_a_live_end_may_not_be_cut(rng, monkeypatch):
    base = [dance(rng, frames) for frames in (240, 300)]
    query, asked = query_of(rng, base, 40), SearchSettings(top=3)
    slow = np.array([np.interp(np.arange(0, 39, 0.55), np.arange(40), row) for row in query.rows])
    takes = make_takes(rng, base, 20)
    takes[0].rows[:, 100 : 100 + slow.shape[1]] = slow
    segments = [side_by_side(takes)]
    expected = search_takes(query, takes, asked)
    assert search_segments(query, segments, asked) == expected
    monkeypatch.setattr(pruning, "warm_up", lambda frames: frames // 2)
    assert search_segments(query, segments, asked) != expected


@pytest.mark.compiled
@pytest.mark.usefixtures("forced")
@pytest.mark.parametrize("summarized", [True, False])
def test_what_is_compared_is_checked_before_an_answer(rng, summarized):
    base = [dance(rng, 240)]
    takes = make_takes(rng, base, 8)
    seen = np.zeros(10_000, bool)

    def check(first, end):
        seen[first:end] = True

    segment = replace(side_by_side(takes, summarized=summarized), check=check)
    for answer in search_gradually(query_of(rng, base, 30), [segment]):
        for match in answer.matches:
            place = segment.names.index(match.take)
            first = int(segment.first[place])
            assert seen[first + match.start : first + match.end + 1].all()
    if not summarized:  # all is scanned, and what has changed could hide a match
        for first, samples in zip(segment.first, segment.samples, strict=True):
            assert seen[first : first + samples].all()


def test_nothing_to_search_finds_nothing(rng):
    query = Query(dance(rng, 20), np.ones(21, bool))
    assert search_segments(query, []).matches == []
    short = PackedTake("short", dance(rng, 6), 30.0, 6, np.ones(21, bool))
    answer = search_segments(query, [side_by_side([short])])
    assert answer == search_takes(query, [short])
    assert answer.too_short == {"short"}


def test_a_query_that_lacks_a_compared_joint_is_refused(rng):
    rows = dance(rng, 40)
    query = Query(rows[:, :20].copy(), np.ones(21, bool), "asked")
    query.rows[12:15, 3] = np.nan
    segment = side_by_side([PackedTake("a", rows, 30.0, 40, np.ones(21, bool))])
    with pytest.raises(ValueError, match=r"query asked lacks RElbow \(in frame 3\)"):
        search_segments(query, [segment])
