"""Names for "the same computation": a digest of the code, the settings and the inputs."""

import dis
import functools
import hashlib
import inspect
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, is_dataclass
from pathlib import Path
from types import CodeType
from typing import Any

_OURS = ("tasks", "storage")


def fingerprint(function: Callable[..., Any], parameters: dict[str, Any]) -> str:
    """Return a SHA-256 of `parameters`, and of every module of ours that `function` stands on.

    Parameters
    ----------
    function
        A module-level function; its module and all that this imports of ours count, also what
        is imported inside functions.
    parameters
        JSON values, paths and dataclasses.

    Raises
    ------
    TypeError
        If a parameter has no lasting name, an open array for instance.
    """
    digest = hashlib.sha256(_source_digest(function.__module__).encode())
    digest.update(function.__qualname__.encode())
    digest.update(json.dumps(parameters, default=_plain, sort_keys=True).encode())
    return digest.hexdigest()


def source_files(module: str) -> dict[str, Path]:
    """Return the file of `module` and of each module of ours that it imports, by name."""
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _module_file(name)
        if name in found or path is None:
            continue
        found[name] = path
        waiting.extend(_imported_names(path))
    return found


@functools.cache
def _source_digest(module: str) -> str:
    """Hash the sources behind a module, once a process."""
    digest = hashlib.sha256()
    for name, path in sorted(source_files(module).items()):
        digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()


def _module_file(name: str) -> Path | None:
    """Find the file of a module of ours without importing it."""
    if name in sys.modules:
        return Path(inspect.getfile(sys.modules[name]))
    stem = Path(__file__).parents[2].joinpath(*name.split("."))
    return next((p for p in (stem.with_suffix(".py"), stem / "__init__.py") if p.is_file()), None)


@functools.cache
def _imported_names(path: Path) -> frozenset[str]:
    """Return the names of ours that the file at `path` imports, at any depth.

    From its byte code: takes are digitized in several threads, and `ast.parse` in two of them at
    once can fail in Python 3.11 (python/cpython issue 106905).
    """
    names = set()
    waiting = [compile(path.read_bytes(), str(path), "exec", dont_inherit=True)]
    while waiting:
        code = waiting.pop()
        waiting += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
        module = ""
        for step in dis.get_instructions(code):
            if step.opname == "IMPORT_NAME":
                name = module = step.argval
            elif step.opname == "IMPORT_FROM":
                name = f"{module}.{step.argval}"
            else:
                continue
            if name.split(".")[0] in _OURS:
                names.add(name)
    return frozenset(names)


def _plain(value: Any) -> Any:
    """Return `value` as JSON can hold it."""
    if is_dataclass(value) and not isinstance(value, type):
        return {type(value).__name__: asdict(value)}
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"cannot fingerprint {value!r} of type {type(value).__name__}")
