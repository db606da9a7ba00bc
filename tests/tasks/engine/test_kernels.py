"""Tests of tasks.engine.kernels: small packages of that name, started anew after an edit."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import tasks
from tasks.engine import kernels
from tests.conftest import ROOT

pytestmark = [pytest.mark.compiled, pytest.mark.slow]  # a new process and its compiling each

FILES = {
    "calling": """
from tasks.helping import ADDED, twice
from tasks.engine.kernels import njit

@njit(cache=True, nogil=True)
def call(number):
    return twice(number) + ADDED
""",
    "helping": """
from tasks.constants import ADDED, FACTOR
from tasks.engine.kernels import njit

@njit(cache=True, nogil=True)
def twice(number):
    "Double."
    return FACTOR * number * 1  # ours
""",
    "constants": "FACTOR = 2\nADDED = 5\n",
    "aside": "FACTOR = 2\n",
}

START = """
from tasks.calling import call
{before_the_call}
result = call(10)
print(result, sum(call.stats.cache_hits.values()), sum(call.stats.cache_misses.values()))
"""


@pytest.fixture
def package(tmp_path) -> Path:
    """The folder of a package with a kernel that stands on two other files."""
    return write_package(tmp_path / "tasks")


@pytest.fixture(scope="module")
def started(tmp_path_factory) -> Path:
    """The folder of such a package whose kernel is compiled and kept."""
    folder = write_package(tmp_path_factory.mktemp("started") / "tasks")
    assert start(folder) == (25, 0, 1)
    return folder


@pytest.fixture
def kept(started, tmp_path) -> Path:
    """A copy of it: what is kept moves with its files."""
    return shutil.copytree(started, tmp_path / "tasks")


def write_package(folder: Path) -> Path:
    (folder / "engine").mkdir(parents=True)
    for name in ("__init__", "engine/__init__", "engine/fingerprints", "engine/kernels"):
        shutil.copy(ROOT / "tasks" / f"{name}.py", folder / f"{name}.py")
    for name, text in FILES.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def start(package: Path, before_the_call: str = "", **environment: str) -> tuple[int, int, int]:
    """Call the kernel in a new process; return its result, and how often it was kept and not."""
    kept = os.environ.items()
    inherited = {name: text for name, text in kept if not name.startswith(("NUMBA_", "COVERAGE_"))}
    done = subprocess.run(
        [sys.executable, "-c", START.format(before_the_call=before_the_call)],
        cwd=package.parent,
        env=inherited | {"PYTHONDONTWRITEBYTECODE": "1"} | environment,
        capture_output=True,
        text=True,
    )
    assert not done.returncode, done.stderr
    result, kept, compiled = map(int, done.stdout.split())
    return result, kept, compiled


def edit(path: Path, old: str, new: str) -> None:
    """Edit a file so that neither its size nor its time shows it."""
    before = path.stat()
    assert len(old) == len(new)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.mark.parametrize(
    ("file", "old", "new", "result"),
    [("helping.py", "* 1", "* 3", 65), ("constants.py", "FACTOR = 2", "FACTOR = 4", 45)],
    ids=["helper", "constant of the helper"],
)
def test_an_edit_to_another_file_is_compiled(kept, file, old, new, result):
    edit(kept / file, old, new)
    assert start(kept) == (result, 0, 1)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("aside.py", "2", "3"),
        ("helping.py", "# ours", "# mine"),
        ("helping.py", "Double", "Repeat"),
    ],
    ids=["a file aside", "a comment", "a docstring"],
)
def test_nothing_is_compiled_again_without_an_edit_to_what_counts(kept, file, old, new):
    edit(kept / file, old, new)
    assert start(kept) == (25, 1, 0)


def test_what_was_compiled_before_an_edit_does_not_pass_for_the_edited(package):
    """A long run goes on with the code that it loaded, and keeps it as what it is."""
    change = f"import pathlib; path = pathlib.Path({str(package / 'helping.py')!r})\n"
    change += "path.write_text(path.read_text().replace('* 1', '* 3'))"
    assert start(package, before_the_call=change) == (25, 0, 1)
    assert start(package) == (65, 0, 1)
    assert start(package) == (65, 1, 0)


def test_what_numba_kept_without_us_is_not_taken(package):
    ours = (package / "engine/kernels.py").read_text()
    (package / "engine/kernels.py").write_text("from numba import njit\n")
    assert start(package) == (25, 0, 1)
    (package / "engine/kernels.py").write_text(ours)
    assert start(package) == (25, 0, 1)


def test_kernels_are_kept_where_the_user_says(package, tmp_path):
    chosen = str(tmp_path / "chosen")
    assert start(package, NUMBA_CACHE_DIR=chosen) == (25, 0, 1)
    assert start(package, NUMBA_CACHE_DIR=chosen) == (25, 1, 0)
    assert not list(package.rglob("*.nbi"))


SHARING = """
import numpy as np
from numba import njit  # ours keeps kernels of our own modules only
from tasks.body.blobs.blobs import gather_voxels, share_out

@njit(cache=True)
def share(voxels, blobs, sums):
    return share_out(voxels, blobs, 0.5, sums)

def call():
    rng = np.random.default_rng(0)
    looks = rng.uniform(0, 3, (7, 3)).astype(np.float32)
    voxels = gather_voxels(rng.uniform(0, 0.6, (3000, 3)), rng.integers(0, 7, 3000), looks)
    spread = 3 * rng.normal(size=(9, 3, 3))
    blobs = (
        rng.uniform(0, 0.6, (9, 3)),
        spread @ spread.transpose(0, 2, 1) + 20 * np.eye(3),
        np.full((9, 3), 0.5),
        rng.uniform(0.5, 2, 9).astype(np.float32),
        rng.integers(0, 3, 9),
    )
    sums = np.empty((9, 4))
    likelihood = share((voxels.count, voxels.points, voxels.likeness, voxels.boxes), blobs, sums)
    print(likelihood.hex(), sums.tobytes().hex(), sum(share.stats.cache_hits.values()))
"""
"""A kernel that has sums made with `fastmath`, in a helper too long to be inlined for its own
sake."""


def test_who_compiles_a_kernel_rounds_as_who_loads_it(tmp_path):
    (tmp_path / "sharing.py").write_text(SHARING)
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path / "kept"),
        "PYTHONPATH": os.pathsep.join((str(ROOT), str(tmp_path))),
    }
    told = [
        subprocess.run(
            [sys.executable, "-c", "import sharing; sharing.call()"],
            env=environment,
            capture_output=True,
            check=True,
            text=True,
        ).stdout.split()
        for _ in range(2)
    ]
    assert [each.pop() for each in told] == ["0", "1"]  # compiled, then loaded
    assert told[0] == told[1]


def test_the_files_behind_every_kernel_count():
    seen = 0
    for module in pkgutil.walk_packages(tasks.__path__, "tasks."):
        if module.name == "tasks.cached":  # has no kernels, and imports Prefect
            continue
        loaded = vars(importlib.import_module(module.name))
        used = [each for each in loaded.values() if isinstance(each, Dispatcher)]
        assert all(type(each._cache) is kernels._KernelCache for each in used), module.name
        files = kernels._digests_behind(module.name)
        assert files.keys() >= {each.py_func.__module__ for each in used}
        assert all(files.values())
        seen += len(used)
    assert seen > 150
