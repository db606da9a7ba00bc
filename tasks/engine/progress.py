"""How far a stage has come: its loops tell, whoever listens hears, and the result is the same.

A listener belongs to the thread that it was set in (and to what runs in a copy of its context), so
takes that are digitized side by side do not mix, and a worker process that nobody listens in tells
nobody. What a thread tells that a stage has started itself is not heard: `side_by_side` tells for
its threads.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_Hear = Callable[[float], None]

_LISTENER: ContextVar[_Hear | None] = ContextVar("listener", default=None)

EVERY_S = 1.0
"""How long a listener is left in peace after it was told something [s]. One reads no faster."""


def report(done: float, total: float) -> None:
    """Tell who listens that so much of the work in hand is done.

    Parameters
    ----------
    done, total
        Frames, turns, or whatever the work is counted in; inside `within`, of that share.
    """
    hear = _LISTENER.get()
    if hear is not None and total > 0:
        hear(min(max(done / total, 0.0), 1.0))


@contextmanager
def within(begin: float, end: float) -> Iterator[None]:
    """Let what is reported inside count from one share of the work to another, 0 to 1.

    It may be inside another one. At its end this share is done, whatever was reported in it.
    """
    outer = _LISTENER.get()
    if outer is None:
        yield
        return
    hear = outer  # as a name that cannot be None
    token = _LISTENER.set(lambda share: hear(begin + (end - begin) * share))
    try:
        yield
    finally:
        _LISTENER.reset(token)
    hear(end)


@contextmanager
def listening(hear: _Hear, *, every_s: float = EVERY_S) -> Iterator[None]:
    """Let `hear` be told, in this thread, how much of what runs inside is done.

    Parameters
    ----------
    hear
        Is given a share from 0 to 1: larger than the one before, and no more often than
        `every_s`. Inside another listener only the inner one hears.
    every_s
        Seconds; 0 for every report.
    """
    last_s, most = time.monotonic(), 0.0

    def tell(share: float) -> None:
        nonlocal last_s, most
        now_s = time.monotonic()
        if share > most and now_s - last_s >= every_s:
            last_s, most = now_s, share
            hear(share)

    token = _LISTENER.set(tell)
    try:
        yield
    finally:
        _LISTENER.reset(token)
