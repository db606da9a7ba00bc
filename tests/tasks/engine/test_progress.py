"""What a stage tells of its progress is heard by its own listener, in order, and by no other."""

import threading
from contextvars import copy_context

import pytest

from tasks.engine.progress import listening, report, within
from tasks.engine.threads import side_by_side
from tests.conftest import HANGING_S


@pytest.fixture
def heard():
    return []


def test_nobody_has_to_listen():
    report(1, 2)
    with within(0.0, 0.5):
        report(1, 2)
    assert side_by_side(abs, [-1, 2]) == [1, 2]


def test_reports_are_shares_of_the_work(heard):
    with listening(heard.append, every_s=0):
        for done in range(1, 5):
            report(done, 4)
    report(1, 2)  # after it, nobody listens any more
    assert heard == [0.25, 0.5, 0.75, 1.0]


def test_what_is_told_never_goes_back_and_stays_within_the_whole(heard):
    with listening(heard.append, every_s=0):
        for done, total in ((1, 2), (1, 4), (-3, 2), (0, 0), (7, 2), (1, 1)):
            report(done, total)
    assert heard == [0.5, 1.0]


def test_shares_inside_shares_count_in_their_place(heard):
    with listening(heard.append, every_s=0):
        with within(0.0, 0.5):
            report(1, 2)
            with within(0.5, 1.0):
                report(1, 2)
        with within(0.5, 1.0):
            pass  # tells nothing, and is done all the same
    assert heard == pytest.approx([0.25, 0.375, 0.5, 1.0])


def test_an_error_is_raised_and_ends_the_listening(heard):
    with pytest.raises(KeyError), listening(heard.append, every_s=0), within(0.0, 0.5):
        raise KeyError("a fault of the stage")
    report(1, 1)
    assert heard == []


def test_a_listener_is_left_in_peace(heard, monkeypatch):
    seconds = iter([0.0, 0.4, 0.8, 1.2, 1.6, 2.4])
    monkeypatch.setattr("tasks.engine.progress.time.monotonic", lambda: next(seconds))
    with listening(heard.append, every_s=1.0):
        for done in range(1, 6):
            report(done, 5)
    assert heard == [0.6, 1.0]


@pytest.mark.parametrize("count", [1, 3, 200])
def test_threads_of_a_stage_are_told_for(heard, count):
    with listening(heard.append, every_s=0):
        assert side_by_side(lambda n: n + 1, range(count)) == list(range(1, count + 1))
    assert heard == sorted(set(heard))
    assert heard[-1] == 1.0


def test_takes_side_by_side_do_not_mix():
    """Each thread runs in a copy of the context, as Prefect's do; both report at the same time."""
    heard = {"a": [], "b": []}
    meet = threading.Barrier(2, timeout=HANGING_S)

    def digitize(take, total):
        with listening(heard[take].append, every_s=0):
            for done in range(1, 5):
                meet.wait()
                report(done, total)

    threads = [
        threading.Thread(target=copy_context().run, args=(digitize, take, total))
        for take, total in (("a", 4), ("b", 8))
    ]
    with listening(lambda _: pytest.fail("the outer listener was told"), every_s=0):
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(HANGING_S)
    assert heard == {"a": [0.25, 0.5, 0.75, 1.0], "b": [0.125, 0.25, 0.375, 0.5]}


def test_a_thread_that_nobody_set_a_listener_for_tells_nobody(heard):
    with listening(heard.append, every_s=0):
        thread = threading.Thread(target=report, args=(1, 1))
        thread.start()
        thread.join(HANGING_S)
    assert heard == []
