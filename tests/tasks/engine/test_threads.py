"""Work on many things at once keeps their order, and does each once."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from tasks.engine import threads
from tasks.engine.threads import hurry, side_by_side, wait_for_room
from tests.conftest import HANGING_S


@pytest.mark.parametrize("count", [0, 1, 2, 7, 50, 333])
def test_each_is_worked_on_once_in_order(count):
    seen = []

    def work(n):
        seen.append(n)
        return n * n

    assert side_by_side(work, range(count)) == [n * n for n in range(count)]
    assert sorted(seen) == list(range(count))


def test_what_goes_wrong_is_raised():
    def work(n):
        if n == 40:
            raise ValueError("forty")

    with pytest.raises(ValueError, match="forty"):
        side_by_side(work, range(80))


def test_who_waits_for_room_goes_on_in_a_hurry_or_when_others_are_through(monkeypatch):
    monkeypatch.setattr(threads, "THREADS", 2)
    at_work, through = threading.Event(), threading.Event()
    calm, in_a_hurry = threading.Event(), threading.Event()

    def work(_):
        at_work.set()
        return through.wait(HANGING_S)

    with ThreadPoolExecutor(3) as pool:
        working = pool.submit(side_by_side, work, range(4))
        assert at_work.wait(HANGING_S)
        late, early = pool.submit(wait_for_room, calm), pool.submit(wait_for_room, in_a_hurry)
        hurry(in_a_hurry)
        early.result(HANGING_S)
        assert not late.done()
        through.set()
        assert all(working.result(HANGING_S))
        late.result(HANGING_S)
    wait_for_room(calm)
