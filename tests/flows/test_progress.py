"""How far a take is: never back, at the end 100 %, and a time that is true of steady work."""

import re

import pytest

from flows import progress
from flows.progress import ASSEMBLING, Estimate, Moment, show_watcher, time_left, watching

FRAMES = 300


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands unless it is moved: a list of the one present second."""
    now = [1000.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def work(clock, slowness=1.0, found_done=()):
    """Yield the moments of a take whose stages take `slowness` times as long as expected."""
    estimate = Estimate("okuri", FRAMES)
    for stage, (always, a_frame) in progress._EXPECTED.items():
        for frame in range(0, FRAMES + 1, 100):
            if frame and stage not in found_done:
                clock[0] += slowness * (always + a_frame * FRAMES) / 3
            yield estimate.move(stage, frame)


def expected_s():
    return sum(always + a_frame * FRAMES for always, a_frame in progress._EXPECTED.values())


@pytest.mark.parametrize("found_done", [(), ("silhouettes", "carving"), ("pose_fitting",)])
def test_a_take_goes_forward_to_all_of_it(clock, found_done):
    shares = [moment.share for moment in work(clock, found_done=found_done)]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert all(share < 1.0 for share in shares[:-1])


@pytest.mark.parametrize("slowness", [0.2, 1.0, 30.0])
def test_the_time_left_is_that_of_the_same_pace(clock, slowness):
    """Whatever the machine: what is left is what has not been worked on, at this pace."""
    end = 1000.0 + slowness * expected_s()
    known = 0
    for moment in work(clock, slowness):
        if moment.left_s is not None:
            known += 1
            assert moment.left_s == pytest.approx(end - clock[0], abs=1e-6)
    assert known > 20


def test_no_time_is_told_before_something_was_computed(clock):
    moments = list(work(clock, found_done=tuple(progress._EXPECTED)))
    assert {moment.left_s for moment in moments} == {None}


def test_blocks_that_were_found_do_not_make_the_rest_look_fast(clock):
    done = ("silhouettes", "carving", "coloring")
    for moment in work(clock, slowness=4.0, found_done=done):
        if moment.stage == "pose fitting" and moment.frame == FRAMES:
            stages = list(progress._EXPECTED)
            after = stages[stages.index("pose_fitting") + 1 :]
            expected = [progress._EXPECTED[stage] for stage in after]
            rest = sum(always + a_frame * FRAMES for always, a_frame in expected)
            assert moment.left_s == pytest.approx(4.0 * rest)


def test_a_frame_that_was_told_before_changes_nothing(clock):
    estimate = Estimate("okuri", FRAMES)
    clock[0] += 10
    first = estimate.move("silhouettes", 200)
    assert estimate.move("silhouettes", 100).share == first.share


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0, "less than a minute left"),
        (49, "less than a minute left"),
        (55, "about 1 min left"),
        (200, "about 3 min left"),
        (4 * 3600, "about 4.0 h left"),
    ],
)
def test_a_time_is_told_no_more_exactly_than_it_is_known(seconds, said):
    assert time_left(seconds) == said


def test_what_is_said_names_the_stage_and_the_time(clock):
    texts = [moment.said() for moment in work(clock, slowness=10.0)]
    assert "silhouettes 0/300 frames" in texts
    assert any(re.fullmatch(r"pose fitting 100/300 frames, about \d+ min left", t) for t in texts)
    assert texts[-1] == ASSEMBLING  # no time is left, so none is told


def test_who_watches_hears_and_nobody_else(clock):
    heard: list[Moment] = []
    moments = list(work(clock))
    show_watcher(moments[0])
    with watching(heard.append):
        show_watcher(moments[1])
    show_watcher(moments[2])
    assert heard == [moments[1]]
