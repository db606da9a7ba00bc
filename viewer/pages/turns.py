"""Which of the things that a visitor asked for is the newest: late answers to others are dropped.

What is asked for is answered when it is read, and one recording is read faster than another. So
whoever waits takes a turn before, and shows what came only if nobody has taken a turn since.
"""

from collections import Counter
from collections.abc import Callable


class Turns:
    """The turns of one page, by what is waited for."""

    def __init__(self) -> None:
        self._taken: Counter[str] = Counter()

    def take(self, what: str) -> Callable[[], bool]:
        """Return a function that says whether nobody has asked for the same since."""
        self._taken[what] += 1
        own = self._taken[what]
        return lambda: self._taken[what] == own
