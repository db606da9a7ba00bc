"""Kernels compiled ahead: in small packages of the name `tasks`, and the list of our own."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from numba import types
from numba.core.dispatcher import Dispatcher

from tasks.engine import compiling, kernels
from tests import wheel
from tests.conftest import ROOT
from tests.tasks.engine.test_kernels import edit, start, write_package

pytestmark = [pytest.mark.compiled, pytest.mark.slow]

LIST = {
    "first": {"tasks.calling:call": "(int64,)"},
    "pose_fitting": {"tasks.helping:twice": "(int64,)", "tasks.gone:away": "(int64,)"},
    "last": {"tasks.helping:twice": "(unicode_type,)"},  # as a kernel once was called
}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The folder of a package whose kernels are compiled ahead, and what was told."""
    folder = write_package(tmp_path_factory.mktemp("compiled") / "tasks")
    for name in ("compiling", "threads", "progress"):
        shutil.copy(ROOT / "tasks" / "engine" / f"{name}.py", folder / "engine" / f"{name}.py")
    (folder / "engine" / "kernels.json").write_text(json.dumps(LIST))
    return folder, run(folder, "-m", "tasks.engine.compiling")


def run(package, *arguments, **environment):
    """Run Python beside a package; return its lines."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "COVERAGE_"))}
    inherited["PYTHONDONTWRITEBYTECODE"] = "1"  # which would hide what `edit` does
    done = subprocess.run(
        [sys.executable, *arguments], cwd=package.parent, env=inherited | environment,
        capture_output=True, text=True,
    )  # fmt: skip
    assert not done.returncode, done.stderr
    return done.stdout.splitlines()


SAY = """
from tasks.engine.compiling import are_compiled, compiling_beside
print(are_compiled())
with compiling_beside(print):
    pass
"""
WAITING = """
import threading
from contextvars import ContextVar
from tasks.engine.compiling import are_compiled, compiling_beside
print(are_compiled())
over, who = threading.Event(), ContextVar("who", default="nobody")
who.set("watched")
def tell(done, total):
    print(done, total, who.get())
    if done == total:
        over.set()
with compiling_beside(tell):
    with compiling_beside(None):  # of another take: one process is enough
        assert over.wait(1800)
"""
LOADING = """
import threading
from tasks.engine.compiling import loading_beside
with loading_beside():
    for each in threading.enumerate():
        if each is not threading.current_thread():
            each.join()
from tasks.calling import call
print(len(call.stats.cache_hits), len(call.stats.cache_misses))
"""


def test_what_is_listed_is_compiled_and_a_kernel_that_is_gone_or_another_is_left(compiled):
    package, told = compiled
    counts = [int(line.split()[0]) for line in told]
    assert counts[0] == 0
    assert counts[-1] == 4
    assert counts == sorted(counts)
    assert start(package) == (25, 1, 0)
    assert run(package, "-c", SAY) == ["True"]  # and nothing is told, as nothing is compiled


def test_after_an_edit_it_is_not_compiled_any_more_and_again_beside_the_work(compiled, tmp_path):
    package = shutil.copytree(compiled[0], tmp_path / "tasks")
    edit(package / "constants.py", "FACTOR = 2", "FACTOR = 4")
    told = run(package, "-c", WAITING)
    assert told == ["False", *(f"{done} 4 watched" for done in range(5))]
    assert start(package) == (45, 1, 0)


def test_what_is_compiled_is_loaded_beside_the_work_and_nothing_else(compiled, tmp_path):
    assert run(compiled[0], "-c", LOADING) == ["1 0"]
    package = shutil.copytree(compiled[0], tmp_path / "tasks")
    edit(package / "constants.py", "FACTOR = 2", "FACTOR = 4")
    assert run(package, "-c", LOADING) == ["0 0"]


@pytest.mark.parametrize("content", ["{", "[]", '{"first": {}}', '{"pose_fitting": {"a": "b"}}'])
def test_a_list_that_is_broken_costs_nobody_the_take(compiled, tmp_path, content):
    package = shutil.copytree(compiled[0], tmp_path / "tasks")
    (package / "engine" / "kernels.json").write_text(content)
    assert run(package, "-c", SAY)[0] == "False"


def test_where_nothing_can_be_kept_kernels_work_and_none_is_compiled_ahead(monkeypatch):
    def refuse(function):
        raise RuntimeError(f"cannot cache function {function}: no locator available")

    def double(number):
        return 2 * number

    monkeypatch.setattr(kernels, "_KernelCache", refuse)
    kernel = kernels.njit(cache=True)(double)
    assert kernel(4) == 8
    monkeypatch.setattr(compiling, "_probe", kernel)
    assert compiling.are_compiled()


def test_types_are_written_and_read():
    kinds = (
        types.Array(types.uint8, 2, "F", readonly=True),
        types.UniTuple(types.Tuple((types.int64, types.float32[:, ::1])), 3),
        types.boolean,
    )
    assert compiling._read_types(compiling.write_types(kinds)) == kinds


def test_our_list_is_of_kernels_that_there_are_and_can_be_read():
    for stage in compiling.read_list().values():
        for name, arguments in stage.items():
            module, function = name.split(":")
            kernel = getattr(importlib.import_module(module), function)
            assert isinstance(kernel, Dispatcher)
            count = kernel.py_func.__code__.co_argcount
            kinds = compiling._read_types(arguments)
            assert len(kinds) == count
            assert compiling.write_types(kinds) == arguments


@pytest.fixture(scope="module")
def carried(compiled, tmp_path_factory):
    """The folder of a package that was installed from a wheel with kernels."""
    tree = tmp_path_factory.mktemp("carried")
    package = shutil.copytree(
        compiled[0], tree / "tasks", ignore=shutil.ignore_patterns("__pycache__")
    )
    wheel.carry_kernels(tree)
    for file in package.rglob("*.py"):
        os.utime(file, (1e9, 1e9))  # as installing does
    assert not list(package.rglob("__pycache__/*.nb?"))
    return package


def test_kernels_that_a_wheel_carries_are_not_compiled(carried, tmp_path):
    package = shutil.copytree(carried, tmp_path / "tasks")
    assert run(package, "-c", SAY) == ["True"]
    assert start(package) == (25, 1, 0)
    for file in (package / "engine" / "carried").rglob("*.nb?"):
        file.write_bytes(file.read_bytes()[:-20])
    assert start(package) == (25, 0, 1)


def close(package):
    """Make a copy of a package in which nothing can be kept; return what else that takes."""
    for folder in {file.parent for file in package.rglob("*.py")}:
        shutil.rmtree(folder / "__pycache__", ignore_errors=True)
        (folder / "__pycache__").write_text("no folder")
    return {"XDG_CACHE_HOME": os.devnull, "HOME": os.devnull}


def test_where_nothing_can_be_kept_kernels_of_a_wheel_are_taken(carried, tmp_path):
    package = shutil.copytree(carried, tmp_path / "tasks")
    nowhere = close(package)
    assert start(package, **nowhere) == (25, 1, 0)
    assert run(package, "-c", SAY, **nowhere) == ["True"]
    shutil.rmtree(package / "engine" / "carried")
    assert start(package, **nowhere) == (25, 0, 1)
    assert run(package, "-c", SAY, **nowhere) == ["True"]  # each process compiles what it calls


def test_two_first_runs_at_once_compile_the_same(compiled, tmp_path):
    package = shutil.copytree(
        compiled[0], tmp_path / "tasks", ignore=shutil.ignore_patterns("*.nb?", "compiled-*")
    )
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(lambda _: run(package, "-c", WAITING), range(2)))
    assert [lines[0] for lines in both] == ["False"] * 2
    assert start(package) == (25, 1, 0)
    assert not list(package.rglob("*.tmp.*"))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("numba", "0.1"),
        ("python", "3.9"),
        ("sources", "of before"),
        ("target", ["{system}", "of later", "+of-later"]),
        ("target", ["of another system", "generic", "{features}"]),
        ("target", "nothing"),
        ("target", None),
        ("target", 5),
    ],
)
def test_kernels_of_another_processor_or_program_do_not_count(monkeypatch, tmp_path, key, value):
    system, _, features = kernels.processor()
    feature = features.split(",")[0]
    made = kernels.made_for() | {"target": [system, "an older one", feature]}
    monkeypatch.setattr(kernels, "CARRIED", tmp_path)

    def counted(text):
        kernels.carried_target.cache_clear()
        (tmp_path / kernels.TARGET).write_text(text)
        return kernels.carried_target()

    assert counted(json.dumps(made)) == (system, "an older one", feature)
    if isinstance(value, list):
        value = [each.format(system=system, features=feature) for each in value]
    assert counted(json.dumps(made | {key: value})) is None
    assert counted(json.dumps(made)[:-5]) is None
    kernels.carried_target.cache_clear()


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_damaged_files_are_compiled_anew_and_written_again(compiled, tmp_path, kind):
    package = shutil.copytree(compiled[0], tmp_path / "tasks")
    for file in package.rglob(f"*.{kind}"):
        file.write_bytes(file.read_bytes()[:-20])
    assert start(package) == (25, 0, 1)
    assert start(package) == (25, 1, 0)
