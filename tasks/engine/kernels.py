"""Compiled kernels, kept on disk until an edit to any file that they stand on.

What a kernel calls and what it takes as a constant is compiled into it, from other files too, but
numba's `cache=True` looks at the kernel's own file only: after an edit elsewhere, the old code
runs on. A kernel of ours is therefore kept together with the digests of the code in its file and
in every file of ours behind it, and counts only where all of them are as they were. A comment may
change in the files behind it; after any edit to its own file, numba compiles it anew.

numba has no public way to say so for some kernels and not for all packages. `FunctionCache`,
`CompileResultCacheImpl` and the `_cache` of a dispatcher are its own;
tests/tasks/engine/test_kernels.py tells when they change.
"""

import functools
import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.registry import cpu_target

from tasks.engine.fingerprints import code_digest, source_files


def njit(*, cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return numba's decorator of that name, whose `cache` notices edits to other files of ours.

    Parameters
    ----------
    cache
        Keep what is compiled, where numba would, for the next process.
    options
        Those of `numba.njit`.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        kernel: Any = numba.njit(**options)(function)
        if cache and kernel is not function:  # as it is with NUMBA_DISABLE_JIT=1
            with suppress(RuntimeError):  # no folder can be written to: compiled in each process
                kernel._cache = _KernelCache(function)
        return kernel

    return compiled


def folder_of(kernel: Any) -> Path | None:
    """Return the folder in which what is compiled of a kernel is kept; None where it is not."""
    path = getattr(getattr(kernel, "_cache", None), "cache_path", None)
    return Path(path) if path else None


def processor() -> tuple[str, ...]:
    """Return what numba compiles for: system, processor and its features."""
    target: Any = cpu_target
    return target.target_context.codegen().magic_tuple()


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
def _digests_behind(module: str) -> dict[str, str]:
    """Return the digests of `module` and of all that it imports of ours."""
    return {name: _digest_of(name) for name in source_files(module)}


class _KernelFiles(CompileResultCacheImpl):
    """What numba writes of a kernel and reads again, with the digests of its sources."""

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


class _KernelCache(FunctionCache):
    """numba's cache of one function, in files of that kind."""

    _impl_class = _KernelFiles
