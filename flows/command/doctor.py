"""Examine an installation: what works, what does not, and what to do about it."""

import importlib
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import requires, version
from pathlib import Path

from storage.provenance import shosa_version

_FREE_BYTES_MIN = 2e9
_MODULES = {
    "numpy": "numpy",
    "numba": "numba",
    "scipy": "scipy",
    "zarr": "zarr",
    "xarray": "xarray",
    "obstore": "obstore",
    "opencv-contrib-python-headless": "cv2",
    "prefect": "prefect",
}


@dataclass(frozen=True)
class Finding:
    """One thing that was examined."""

    good: bool
    text: str


def examine_installation() -> list[Finding]:
    """Try everything that shosa stands on, and say what came of it."""
    findings = [_python()]
    findings += [_library(package, module) for package, module in _MODULES.items()]
    findings += [_tried(check) for check in (_compiler, _compiled_code_is_kept, _disk, _archive)]
    findings += list(_prefect())
    return findings


def _python() -> Finding:
    """Say which Python and machine this is."""
    text = (
        f"Python {platform.python_version()} ({sys.executable}), shosa {shosa_version()}, "
        f"{os.cpu_count()} cores"
    )
    return Finding(sys.version_info >= (3, 11), text)


def _library(package: str, module: str) -> Finding:
    """Import a library and compare its version with what shosa asks for."""
    wanted = next(
        (r for r in requires("shosa") or () if r.split(";")[0].startswith(package)), package
    )
    try:
        importlib.import_module(module)
        return Finding(True, f"{package} {version(package)} (wanted {wanted})")
    except Exception as error:  # whatever a broken library raises is the finding
        advice = "run `make setup` again, in an environment of its own"
        return Finding(False, f"{package} cannot be imported: {error}; {advice}")


def _tried(check: Callable[[], str]) -> Finding:
    """Run a check that returns what it saw and raises what is wrong."""
    try:
        return Finding(True, check())
    except Exception as error:  # whatever is broken is the finding
        return Finding(False, f"{check.__name__.strip('_').replace('_', ' ')}: {error}")


def _compiler() -> str:
    """Search a generated take for a clip of itself."""
    import numpy as np

    from tasks.retrieval.normalization import ROWS
    from tasks.retrieval.searching import PackedTake, Query, SearchSettings, search_takes

    rows = np.random.default_rng(0).normal(size=(ROWS, 90)).astype(np.float32)
    present = np.ones(21, bool)
    begin = time.perf_counter()
    take = PackedTake(name="a", rows=rows, rate_hz=30.0, frames=90, joints_present=present)
    query = Query(rows=rows[:, 30:60], joints_present=present)
    [match] = search_takes(query, [take], SearchSettings(top=1)).matches
    if (match.start, match.end, match.distance) != (30, 59, 0.0):
        raise RuntimeError(f"a clip did not find itself but {match}; reinstall numba")
    return f"the search kernel compiles and finds ({time.perf_counter() - begin:.1f} s)"


def _compiled_code_is_kept() -> str:
    """Look whether compiled kernels can be kept between runs."""
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[2] / "tasks")
    if not os.access(folder, os.W_OK):
        raise RuntimeError(
            f"{folder} cannot be written to, so every start compiles anew; set NUMBA_CACHE_DIR "
            "to a directory of yours"
        )
    return f"compiled kernels are kept below {folder}"


def _disk() -> str:
    """Look whether there is room in the current directory."""
    free = shutil.disk_usage(".").free
    if free < _FREE_BYTES_MIN:
        raise RuntimeError(f"only {free / 1e9:.1f} GB are free here; make room for an archive")
    return f"{free / 1e9:.0f} GB free in the current directory"


def _archive() -> str:
    """Make an archive, and open it."""
    from storage import create_archive

    with tempfile.TemporaryDirectory() as folder:
        create_archive(Path(folder, "archive"))
    return "an archive can be made and opened"


def _prefect() -> Iterator[Finding]:
    """Say where flows report to."""
    try:
        from prefect.settings import PREFECT_API_URL

        url = PREFECT_API_URL.value()
    except Exception as error:  # whatever a broken library raises is the finding
        yield Finding(False, f"Prefect's settings cannot be read: {error}")
        return
    if url:
        yield Finding(True, f"flows report to the Prefect server at {url}")
    else:
        text = "no Prefect server is set: each flow starts one of its own (about 20 s); "
        yield Finding(True, text + "`prefect server start` and PREFECT_API_URL save that")
