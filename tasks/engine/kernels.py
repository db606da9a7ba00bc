"""Compiled kernels, kept on disk until an edit to any file that they stand on.

What a kernel calls and what it takes as a constant is compiled into it, from other files too, but
numba's `cache=True` looks at the kernel's own file only: after an edit elsewhere, the old code
runs on. A kernel of ours is therefore kept together with the digests of the code in its file and
in every file of ours behind it, and counts only where all of them are as they were. A comment may
change in the files behind it; after any edit to its own file, numba compiles it anew.

A wheel may carry kernels, compiled for the oldest processor that they are to run on
(`python -m tests.wheel`). They count where this one has all that they use, and the code, Python and
numba are those that they were made with, also where nothing can be written to.

numba has no public way to say so for some kernels and not for all packages. `FunctionCache`,
`IndexDataCacheFile`, `CompileResultCacheImpl` and the `_cache` of a dispatcher are its own;
tests/tasks/engine/test_kernels.py tells when they change.
"""

import errno
import functools
import hashlib
import json
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.registry import cpu_target

from tasks.engine.fingerprints import code_digest, source_files

CARRIED = Path(__file__).with_name("carried")
"""Where a wheel has kernels: a folder a package, and `TARGET`."""
TARGET = "target.json"
"""What they were made for and from, as of `made_for`."""

_NOT_FROM_C: dict[str, Any] = {"no_cfunc_wrapper": True}
"""Nobody calls a kernel from C; what would be called costs its compiling."""

_Target = tuple[str, str, str]
"""The system, the processor, and its features, each with a + before it, between commas."""


def njit(*, cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return numba's decorator of that name, whose `cache` notices edits to other files of ours.

    A function with `fastmath` becomes a part of every kernel that calls it. Else each has a copy,
    which rounds as the compiler ordered its sums there; a process that compiles calls the copy that
    it made first, and one that loads the kernel calls the kernel's own.

    Parameters
    ----------
    cache
        Keep what is compiled, where numba would, for the next process.
    options
        Those of `numba.njit`.
    """
    inlined: dict[str, Any] = {"forceinline": True} if options.get("fastmath") else {}

    def compiled(function: Callable[..., Any]) -> Any:
        kernel: Any = numba.njit(**_NOT_FROM_C | inlined | options)(function)
        if cache and kernel is not function:  # as it is with NUMBA_DISABLE_JIT=1
            with suppress(RuntimeError):  # no folder can be written to: compiled in each process
                kernel._cache = _KernelCache(function)
        return kernel

    return compiled


def folder_of(kernel: Any) -> Path | None:
    """Return the folder in which what is compiled of a kernel is kept; None where it is not."""
    path = getattr(getattr(kernel, "_cache", None), "cache_path", None)
    return Path(path) if path and path != _Nowhere.PATH else None


def processor() -> _Target:
    """Return what numba compiles for."""
    target: Any = cpu_target
    return target.target_context.codegen().magic_tuple()


def made_for() -> dict[str, Any]:
    """Return, as JSON, what kernels that this process compiles are made for and from."""
    return {
        "target": list(processor()),
        "python": sys.version.split()[0].rpartition(".")[0],
        "numba": numba.__version__,
        "sources": digest_of_all(),
    }


@functools.cache
def carried_target() -> _Target | None:
    """Return for what the kernels are compiled that came with this package; None without any.

    None also where they are of another Python, numba or code, or this processor lacks something.
    """
    try:
        made = json.loads((CARRIED / TARGET).read_text("utf-8"))
        system, name, features = made.pop("target")
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None
    here = made_for()
    here_system, _, here_features = here.pop("target")
    there_are = set(here_features.split(","))
    if made != here or system != here_system or not there_are.issuperset(features.split(",")):
        return None
    return system, name, features


@functools.cache
def digest_of_all() -> str:
    """Return the digest of every file of ours, as it was when this process began."""
    return hashlib.sha256(b"\0".join(_SOURCES[name] for name in sorted(_SOURCES))).hexdigest()


def _read_sources() -> dict[str, bytes]:
    """Return the text of every file of ours, by the name of its module."""
    root = Path(__file__).parents[2]
    sources = {}
    for package in ("tasks", "storage"):
        for path in (root / package).rglob("*.py"):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            sources[name.removesuffix(".__init__")] = path.read_bytes()
    return sources


_SOURCES = _read_sources()
"""Read before any kernel is imported: what is edited while this process runs is not what it
compiles. Only the files behind the kernels that are called are digested, which takes longer."""


@functools.cache
def _digest_of(module: str) -> str:
    """Return the digest of the code of `module`, empty where its file came later."""
    return code_digest(_SOURCES[module]) if module in _SOURCES else ""


@functools.cache
def _text_digest_of(module: str) -> str:
    """Return the digest of the text of `module`, which all its kernels share."""
    return hashlib.sha256(_SOURCES.get(module, b"")).hexdigest()


@functools.cache
def _digests_behind(module: str) -> dict[str, str]:
    """Return the digests of `module` and of all that it imports of ours."""
    return {name: _digest_of(name) for name in source_files(module)}


class _Nowhere:
    """Where kernels are kept if no folder can be written to; a wheel may carry some."""

    PATH = str(Path(__file__).with_name("nowhere"))

    def __init__(self, line: int) -> None:
        self._line = line

    @classmethod
    def from_function(cls, function: Callable[..., Any], _file: str) -> "_Nowhere":
        return cls(function.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        return self.PATH

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return str(self._line)

    def ensure_cache_path(self) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))


class _KernelFiles(CompileResultCacheImpl):
    """What numba writes of a kernel and reads again, with the digests of its sources."""

    _locator_classes = (*CompileResultCacheImpl._locator_classes, _Nowhere)

    def __init__(self, py_func: Callable[..., Any]) -> None:
        super().__init__(py_func)
        self._module = py_func.__module__

    def reduce(self, cres: Any) -> dict[str, Any]:
        return {"sources": _digests_behind(self._module), "compiled": super().reduce(cres)}

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        match payload:
            case {"sources": dict(sources), "compiled": compiled}:
                # a file that came later has none, so what stands on it is compiled anew
                if all(digest and digest == _digest_of(name) for name, digest in sources.items()):
                    return super().rebuild(target_context, compiled)
        return None  # not found, for numba: it compiles, and writes over what is there


class _Carried:
    """What stands for numba's compiler where it only says what it compiles for."""

    def magic_tuple(self) -> _Target | None:
        return carried_target()


class _KernelCache(FunctionCache):
    """numba's cache of one function, in files of that kind, and in those that a wheel carries."""

    _impl_class = _KernelFiles

    def __init__(self, py_func: Callable[..., Any]) -> None:
        super().__init__(py_func)
        # not the time of its file: what is installed has another one
        stamp = _text_digest_of(py_func.__module__)
        files = {"filename_base": self._impl.filename_base, "source_stamp": stamp}
        self._cache_file = IndexDataCacheFile(cache_path=self._cache_path, **files)
        carried = CARRIED / py_func.__module__.rpartition(".")[0]
        self._carried = IndexDataCacheFile(cache_path=str(carried), **files)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # of a damaged file pickle may raise anything
            return None

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super()._load_overload(sig, target_context)
        if found is None and carried_target() is not None:
            data = self._carried.load(self._index_key(sig, _Carried()))
            found = None if data is None else self._impl.rebuild(target_context, data)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError:  # a disk that is full: it is compiled again in the next process
            return
        except Exception:  # the index is damaged: it is written anew
            self.flush()
            super().save_overload(sig, data)
