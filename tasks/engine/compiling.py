"""Kernels compiled ahead, in processes of their own: once after an installation.

A stage compiles a kernel when it is called first, so the first capture would wait for all of them,
one after another. Here they are compiled beside the first stages, from a list of the kernels that
are called from Python and of the types that they are called with (`kernels.json`). The list is no
promise: what is missing in it is compiled by the stage, what is too much in it costs its time.

    python -m tasks.engine.compiling           compile all, on all processors
    python -m tasks.engine.compiling --beside  leave one processor to whoever started this
"""

import gc
import hashlib
import importlib
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, suppress
from contextvars import copy_context
from pathlib import Path
from typing import Any

from numba import types
from numba.core.errors import NumbaError

from tasks.engine import kernels
from tasks.engine.threads import THREADS

KERNELS = Path(__file__).with_name("kernels.json")
"""By stage, those of a search first, then in the order of the chain: `module:function`, and the
types of its arguments in numba's words. `python -m tests.kernels` writes it."""

BESIDE = "--beside"
_BESIDE = threading.Lock()
"""Held while another process compiles for this one."""
_FIRST = "pose_fitting"
"""The stage whose kernels come first [name]: the dearest, and needed late."""

Tell = Callable[[int, int], None]
"""Is told how many kernels are compiled, and of how many."""


def read_list(path: Path = KERNELS) -> dict[str, dict[str, str]]:
    """Return the types of each kernel, by stage and `module:function`."""
    return json.loads(path.read_text("utf-8"))


def are_compiled() -> bool:
    """Say whether the kernels of this code are compiled, here or in the wheel that it came with.

    Where compiling is switched off or nothing can be kept, there is nothing to compile ahead.
    """
    mark = _mark()
    return mark is None or mark.exists() or kernels.carried_target() is not None


@contextmanager
def compiling_beside(tell: Tell) -> Iterator[None]:
    """Let the kernels be compiled in other processes while the work inside goes on.

    Nothing happens where they are compiled already. What goes wrong in these processes costs time
    only: the work compiles what it calls.

    Parameters
    ----------
    tell
        Is called in a thread of its own, with the variables of this one, after each kernel.
    """
    if not _BESIDE.acquire(blocking=False):  # for another take of this process
        yield
        return
    with ExitStack() as ended:
        ended.callback(_BESIDE.release)
        if not are_compiled():
            ended.enter_context(_other_process(tell))
        yield


@contextmanager
def loading_beside() -> Iterator[None]:
    """Let the kernels that are compiled be loaded in a thread while the work inside goes on.

    That is for work that waits for others: it takes the processor time of a stage.
    """
    ended = threading.Event()

    def load() -> None:
        for kernels_of in read_list().values():
            for kernel in kernels_of.items():
                if ended.is_set():
                    return
                _compile(*kernel)

    if _mark() is None or not are_compiled():
        yield
        return
    thread = threading.Thread(target=load)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def _other_process(tell: Tell) -> Iterator[None]:
    """Compile in another process as long as the work inside takes; by then it has what it needs."""
    last = (1, 1)

    def hear(done: int, total: int) -> None:
        nonlocal last
        last = (done, total)
        tell(done, total)

    command = [sys.executable, "-m", __name__, BESIDE]
    root = str(Path(__file__).parents[2])
    with subprocess.Popen(
        command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        here = copy_context()  # of who watches this thread
        listener = threading.Thread(target=here.run, args=(_listen, process, hear), daemon=True)
        listener.start()
        try:
            yield
        finally:
            process.terminate()
            listener.join()
            if last[0] < last[1]:
                tell(last[1], last[1])


def compile_all(tell: Tell, processes: int) -> None:
    """Compile every listed kernel for this processor, and keep it.

    The poses come first, as the dearest, and then what is before them, from the end of the chain:
    who starts at its beginning meanwhile compiles the others, and meets this process once.

    Parameters
    ----------
    tell
        Is called after each kernel, or each stage where several processes compile.
    processes
        How many compile at once.
    """
    mark, groups = _mark(), read_list()
    stages = list(groups)
    at = stages.index(_FIRST)
    stages = [_FIRST, *reversed(stages[at + 1 :]), *reversed(stages[:at])]
    total = sum(map(len, groups.values()))
    done = 0
    tell(done, total)
    if processes == 1:
        for stage in stages:
            kernels_of = list(groups[stage].items())
            for kernel in kernels_of if stage == _FIRST else kernels_of[::-1]:
                _compile(*kernel)
                done += 1
                tell(done, total)
    else:
        # a stage's kernels share what they call, and what numba has learned of it
        with ProcessPoolExecutor(processes) as pool:
            for job in as_completed([pool.submit(_compile_stage, groups[each]) for each in stages]):
                done += job.result()
                tell(done, total)
    if mark is not None:
        mark.touch()


def _compile_stage(kernels_of: dict[str, str]) -> int:
    """Compile the kernels of a stage; return how many there are."""
    for kernel in kernels_of.items():
        _compile(*kernel)
    return len(kernels_of)


def _compile(name: str, arguments: str) -> None:
    """Compile a kernel for some types of arguments, unless it is kept; leave what is not there."""
    module, function = name.split(":")
    # it was renamed, or takes other types: the stage compiles it
    with suppress(ImportError, AttributeError, NumbaError):
        getattr(importlib.import_module(module), function).compile(_read_types(arguments))


def write_types(arguments: Sequence[Any]) -> str:
    """Return numba's types of a kernel's arguments as a text that `compile_all` reads."""
    return f"({', '.join(map(_written, arguments))},)"


def _written(kind: Any) -> str:
    """Return a type as Python's text that makes it of `numba.types`."""
    if isinstance(kind, types.NamedTuple):
        made = f"{kind.instance_class.__module__}:{kind.instance_class.__qualname__}"
        return f"_Named({write_types(kind.types)}, {made!r})"
    if isinstance(kind, types.UniTuple):
        return f"UniTuple({_written(kind.dtype)}, {kind.count})"
    if isinstance(kind, types.Tuple):
        return f"Tuple({write_types(kind.types)})"
    return repr(kind)


def _read_types(text: str) -> tuple[Any, ...]:
    """Return the types that `write_types` wrote."""

    def named(kinds: tuple[Any, ...], made: str) -> types.NamedTuple:
        module, _, name = made.partition(":")
        return types.NamedTuple(kinds, getattr(importlib.import_module(module), name))

    return eval(text, {**vars(types), "_Named": named})  # of a file of this package


def _mark() -> Path | None:
    """Return the file that is there when all is compiled; None where nothing is kept."""
    folder = kernels.folder_of(_probe)
    if folder is None:
        return None
    made = json.dumps([kernels.made_for(), KERNELS.read_text("utf-8")])
    return folder / f"compiled-{hashlib.sha256(made.encode()).hexdigest()[:16]}"


@kernels.njit(cache=True)
def _probe() -> int:
    """Be a kernel, whose folder is where kernels of this package are kept; never called."""
    return 0


def _listen(process: "subprocess.Popen[str]", tell: Tell) -> None:
    """Tell what a process says of its progress, until it ends."""
    for line in process.stdout or ():
        with suppress(ValueError):
            done, total = map(int, line.split())
            tell(done, total)


def main() -> None:
    """Compile, and print after each kernel how many are done, and of how many."""
    gc.disable()  # a twelfth of the time, of a process that ends when all is compiled
    compile_all(_print, max(1, THREADS - 1) if BESIDE in sys.argv[1:] else THREADS)


def _print(done: int, total: int) -> None:
    """Tell who started this process."""
    sys.stdout.write(f"{done} {total}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
