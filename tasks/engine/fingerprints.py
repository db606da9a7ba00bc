"""Names for "the same computation": a digest of the code, the settings and the inputs.

The code counts, not its text: comments, docstrings, line breaks and spaces do not change what is
computed, so that an archive is not digitized again after an edit to them. What is digested are
the names and values of the syntax tree; nothing of it depends on the version of Python, unless a
version gives the same text another tree.
"""

import ast
import functools
import hashlib
import inspect
import json
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

_OURS = ("tasks", "storage")
"""The packages whose code counts; what others compute is taken as it is."""

_PARSING = threading.Lock()
"""Takes are digitized in several threads, and `ast.parse` in two of them at once can fail in
Python 3.11 (python/cpython issue 106905)."""

_KEPT = Path(__file__).with_name("__pycache__") / "parsed"
"""What was parsed, beside the compiled kernels: a file a text, named by the digest of the text and
of this module's. To parse all of ours takes longer than to list ten thousand takes."""


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


def code_behind(*modules: str) -> str:
    """Return a SHA-256 of the code of `modules` and of every module of ours that they stand on."""
    return _digest_of_all(tuple(map(_source_digest, modules)))


@functools.cache
def _digest_of_all(digests: tuple[str, ...]) -> str:
    """Hash digests, once a process: a listing of 100,000 takes asks for each."""
    return hashlib.sha256("".join(digests).encode()).hexdigest()


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
        waiting.extend(_look_into(path.read_bytes())[1])
    return found


def code_digest(source: bytes) -> str:
    """Return a SHA-256 of a module's code, the same whatever its comments and docstrings say."""
    return _look_into(source)[0]


@functools.cache
def _source_digest(module: str) -> str:
    """Hash the sources behind a module, once a process."""
    digest = hashlib.sha256()
    for name, path in sorted(source_files(module).items()):
        digest.update(f"{name} {code_digest(path.read_bytes())} ".encode())
    return digest.hexdigest()


def _module_file(name: str) -> Path | None:
    """Find the file of a module of ours without importing it."""
    if name in sys.modules:
        return Path(inspect.getfile(sys.modules[name]))
    stem = Path(__file__).parents[2].joinpath(*name.split("."))
    return next((p for p in (stem.with_suffix(".py"), stem / "__init__.py") if p.is_file()), None)


@functools.cache
def _look_into(source: bytes) -> tuple[str, frozenset[str]]:
    """Return what `_parse` does, parsed once for all processes where a file can be written."""
    key = hashlib.sha256(Path(__file__).read_bytes())
    key.update(hashlib.sha256(source).digest())
    kept = _KEPT / f"{key.hexdigest()}.json"
    with suppress(OSError, ValueError, KeyError, TypeError):  # none yet, or damaged
        known = json.loads(kept.read_bytes())
        return known["code"], frozenset(known["imports"])
    code, names = _parse(source)
    with suppress(OSError):  # what cannot be kept is parsed by each process
        kept.parent.mkdir(parents=True, exist_ok=True)
        beside = kept.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
        beside.write_text(json.dumps({"code": code, "imports": sorted(names)}), "utf-8")
        beside.replace(kept)
    return code, names


def _parse(source: bytes) -> tuple[str, frozenset[str]]:
    """Return the digest of a module's code, and the names of ours that it imports at any depth."""
    with _PARSING:
        tree = ast.parse(source)
    said: list[str] = []
    names: set[str] = set()
    _spell(tree, said, names)
    return hashlib.sha256("".join(said).encode()).hexdigest(), frozenset(names)


def _spell(node: Any, said: list[str], names: set[str]) -> None:
    """Append what a part of a syntax tree says, and add to `names` what it imports of ours."""
    if isinstance(node, ast.AST):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names.update(name for name in _imported(node) if name.split(".")[0] in _OURS)
        said.append(f"{type(node).__name__}(")
        for field in node._fields:
            value = getattr(node, field, None)
            # versions of Python differ in which fields there are to be empty
            if value is not None and value != []:
                said.append(f"{field}=")
                _spell(value, said, names)
        said.append(")")
    elif isinstance(node, list):
        said.append("[")
        for each in node:
            if not _is_docstring(each):
                _spell(each, said, names)
        said.append("]")
    else:
        said.append(f"{node!a},")


def _is_docstring(node: Any) -> bool:
    """Return whether a statement is a text only, below a function's or a field's name."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _imported(node: ast.Import | ast.ImportFrom) -> list[str]:
    """Return the modules that an import names; of `from a import b`, a and what may be one, a.b."""
    names = [each.name for each in node.names]
    if isinstance(node, ast.Import):
        return names
    return [node.module or "", *(f"{node.module}.{name}" for name in names)]


def _plain(value: Any) -> Any:
    """Return `value` as JSON can hold it."""
    if is_dataclass(value) and not isinstance(value, type):
        return {type(value).__name__: asdict(value)}
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"cannot fingerprint {value!r} of type {type(value).__name__}")
