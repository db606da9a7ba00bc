"""Work on many things at once, in as many threads as there are processors."""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from tasks.engine.progress import report

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

THREADS = os.cpu_count() or 1

_SHARES = 16  # of a thread: the last one to end keeps the others waiting for one of them at most

_AT_WORK: set[object] = set()
"""What is worked on just now in as many threads as there are processors."""

_CHANGED = threading.Condition()
"""Tells that this is other work, or that who waits is in a hurry."""


def side_by_side(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """Return `work` of each item, in order; who listens hears how many are done.

    A thread is handed some neighbors at a time: to hand over one costs a twentieth of a frame's
    fit, and more where threads wait for each other.
    """
    results: list[_Result] = []
    if len(items) < 2 or THREADS < 2:
        for item in items:
            results.append(work(item))
            report(len(results), len(items))
        return results
    size = max(1, len(items) // (_SHARES * THREADS))
    shares = [items[n : n + size] for n in range(0, len(items), size)]
    with _all_at_work(), ThreadPoolExecutor(THREADS) as pool:
        for done in pool.map(lambda share: [work(item) for item in share], shares):
            results += done
            report(len(results), len(items))
    return results


def wait_for_room(in_a_hurry: threading.Event) -> None:
    """Return when nothing in this process is worked on `side_by_side`, or at once in a hurry.

    So work that nobody waits for yet leaves the processors to what is waited for, and takes the one
    that stays idle where a stage goes from frame to frame.
    """
    with _CHANGED:
        _CHANGED.wait_for(lambda: not _AT_WORK or in_a_hurry.is_set())


def hurry(event: threading.Event) -> None:
    """Set an event, and let those go on that `wait_for_room` with it."""
    event.set()
    with _CHANGED:
        _CHANGED.notify_all()


@contextmanager
def _all_at_work() -> Iterator[None]:
    """Let others wait for room while all threads are at work inside."""
    work = object()
    with _CHANGED:
        _AT_WORK.add(work)
    try:
        yield
    finally:
        with _CHANGED:
            _AT_WORK.discard(work)
            _CHANGED.notify_all()
