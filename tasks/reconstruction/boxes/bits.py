"""Occupied voxels of a box as bits along z, and the runs that they are."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit
from tasks.geometry.voxels import VoxelRuns

WORD = 32
"""How many voxels along z a word of bits holds [voxels]."""

_FULL = 2**WORD - 1
"""A word of which every bit is set."""


def read_bits(
    words: NDArray[np.uint32], begin: NDArray[np.int64], shape: tuple[int, int, int]
) -> VoxelRuns:
    """Return the runs of one frame from a box of bits.

    Parameters
    ----------
    words : (x, y, word) uint32
        Bit k of word w is set where the voxel `begin[2] + 32 w + k` along z is occupied. No
        bit is set outside the grid.
    begin : (3,) int64
        Index in the grid of the box's first voxel.
    shape
        Number of voxels of the grid along x, y and z.
    """
    runs = _read_runs(words, begin, shape)
    start, length = runs[:, 0].astype(np.uint32), (runs[:, 1] - runs[:, 0]).astype(np.uint16)
    return VoxelRuns(start, length, np.array([0, len(runs)], np.int64), shape)


@njit(cache=True, nogil=True)
def _read_runs(words: Any, begin: Any, shape: Any) -> Any:
    """Return the first voxels of the runs of set bits and of what follows each, in order."""
    runs = np.empty((_count_runs(words), 2), np.int64)
    found = 0
    for x in range(words.shape[0]):
        for y in range(words.shape[1]):
            at = ((x + begin[0]) * shape[1] + y + begin[1]) * shape[2] + begin[2]
            before = 0
            for w in range(words.shape[2]):
                word = np.int64(words[x, y, w])
                changes = (word ^ (word << 1 | before)) & _FULL
                before = word >> (WORD - 1)
                bit = 0
                while changes:
                    if changes & 15 == 0:
                        changes >>= 4
                        bit += 4
                        continue
                    if changes & 1:
                        runs[found >> 1, found & 1] = at + w * WORD + bit
                        found += 1
                    changes >>= 1
                    bit += 1
            if before:
                runs[found >> 1, 1] = at + words.shape[2] * WORD
                found += 1
    return runs


@njit(cache=True, nogil=True, inline="always")
def _count_runs(words: Any) -> Any:
    """Return the number of runs of set bits."""
    found = 0
    for x in range(words.shape[0]):
        for y in range(words.shape[1]):
            before = 0
            for w in range(words.shape[2]):
                word = np.int64(words[x, y, w])
                starts = word & ~(word << 1 | before) & _FULL
                before = word >> (WORD - 1)
                while starts:
                    starts &= starts - 1
                    found += 1
    return found
