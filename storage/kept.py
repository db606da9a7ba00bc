"""Arrays of blocks, kept in memory by the digest of the block for the stages that read them next.

Files are written all the same, so that a run that is killed is gone on with, and machines share
them; what is kept only saves reading, digesting and unpacking them again. What is given out is a
copy: whoever reads may write to it.
"""

import os
import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence

from numpy.typing import NDArray

VARIABLE = "SHOSA_KEPT_MB"
"""The variable of the environment that names the limit [MB]."""

_USUAL_MB = 240
"""What is kept where nobody says [MB]. Some 360 frames of eight cameras of 320 x 240; a longer take
is read again anyway, and 1500 frames hold less than 900 MB."""

_MB = 1_000_000


class Kept:
    """Arrays of blocks, the latest used ones, as many as a limit allows."""

    def __init__(self) -> None:
        self._blocks: OrderedDict[str, dict[str, NDArray]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    def keep(self, digest: str, arrays: Mapping[str, NDArray]) -> None:
        """Keep a copy of the arrays of a block, and let go of those that were used longest ago."""
        limit, size = kept_limit(), _size(arrays)
        if size > limit:
            return
        copied = {name: array.copy() for name, array in arrays.items()}
        with self._lock:
            self._let_go(digest)
            self._blocks[digest] = copied
            self._bytes += size
            while self._bytes > limit:
                self._let_go(next(iter(self._blocks)))

    def find(self, digest: str, names: Sequence[str] | None) -> dict[str, NDArray] | None:
        """Return copies of the arrays of a block, or of those that are named; None if not kept."""
        with self._lock:
            arrays = self._blocks.get(digest)
            if arrays is None:
                return None
            self._blocks.move_to_end(digest)
        return {name: arrays[name].copy() for name in names or arrays}

    def discard(self, digests: Iterable[str]) -> None:
        """Let go of blocks that nobody reads any more."""
        with self._lock:
            for digest in digests:
                self._let_go(digest)

    def _let_go(self, digest: str) -> None:
        self._bytes -= _size(self._blocks.pop(digest, {}))


KEPT = Kept()
"""Those of this process."""


def kept_limit() -> int:
    """Return how much is kept at most [bytes].

    Raises
    ------
    ValueError
        If what the environment says is no number of megabytes that this machine has.
    """
    given = os.environ.get(VARIABLE, "").strip()
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if not given:
        return min(_USUAL_MB * _MB, there // 4)
    if not given.isdecimal() or int(given) * _MB > there:
        raise ValueError(
            f"{VARIABLE}={given} should be megabytes from 0, which keeps nothing in memory between "
            f"stages, to the {there // _MB:,} that this machine has; set it so, or unset it"
        )
    return int(given) * _MB


def _size(arrays: Mapping[str, NDArray]) -> int:
    return sum(array.nbytes for array in arrays.values())
