"""Work on many things at once, in as many threads as there are processors."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from tasks.engine.progress import report

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

THREADS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""The processors that this process may use, which can be fewer than there are (`taskset`)."""

_SHARES = 16  # of a thread: the last one to end keeps the others waiting for one of them at most


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
    with ThreadPoolExecutor(THREADS) as pool:
        for done in pool.map(lambda share: [work(item) for item in share], shares):
            results += done
            report(len(results), len(items))
    return results
