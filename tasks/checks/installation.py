"""Try what an installation stands on: each check returns what it saw, and raises what is wrong."""

import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from storage import create_archive
from storage.kept import kept_limit
from storage.schema import JOINTS
from tasks.retrieval.normalization import INDEX_RATE_HZ, ROWS
from tasks.retrieval.searching import Query, SearchSettings, search_takes
from tasks.retrieval.segments import PackedTake

_FREE_BYTES_MIN = 2e9
"""Room that an archive wants at least [bytes]. A few takes with voxels; chosen, not measured."""


def check_compiler() -> str:
    """Search a generated take for a clip of itself."""
    rows = np.random.default_rng(0).normal(size=(ROWS, 90)).astype(np.float32)
    present = np.ones(len(JOINTS), bool)
    begin = time.perf_counter()
    take = PackedTake(name="a", rows=rows, rate_hz=INDEX_RATE_HZ, frames=90, joints_present=present)
    query = Query(rows=rows[:, 30:60], joints_present=present)
    [match] = search_takes(query, [take], SearchSettings(top=1)).matches
    if (match.start, match.end, match.distance) != (30, 59, 0.0):
        raise RuntimeError(f"a clip did not find itself but {match}; reinstall numba")
    return f"the search kernel compiles and finds ({time.perf_counter() - begin:.1f} s)"


def check_kernel_cache() -> str:
    """Look whether compiled kernels can be kept between runs."""
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[2] / "tasks")
    if not os.access(folder, os.W_OK):
        raise RuntimeError(
            f"{folder} cannot be written to, so every start compiles anew; set NUMBA_CACHE_DIR "
            "to a directory of yours"
        )
    return f"compiled kernels are kept below {folder}"


def check_memory() -> str:
    """Look how much a digitization may keep in memory between its stages."""
    return f"up to {kept_limit() / 1e6:.0f} MB are kept in memory between stages"


def check_disk() -> str:
    """Look whether there is room in the current directory."""
    free = shutil.disk_usage(".").free
    if free < _FREE_BYTES_MIN:
        raise RuntimeError(f"only {free / 1e9:.1f} GB are free here; make room for an archive")
    return f"{free / 1e9:.0f} GB free in the current directory"


def check_archive() -> str:
    """Make an archive, and open it."""
    with tempfile.TemporaryDirectory() as folder:
        create_archive(Path(folder, "archive"))
    return "an archive can be made and opened"
