"""Write docs/constants.md from the code: every setting and every numeric constant of `tasks`.

    python -m tests.documents

A setting tells of itself in its dataclass (`tasks.engine.settings`), a constant in the docstring
below it or in the comment beside or above it: the first sentence is the meaning, with the unit in
square brackets at its end, the rest is the source.
"""

import ast
import importlib
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, get_type_hints

from tasks.engine.settings import Setting, list_settings, parse_docstring

ROOT = Path(__file__).parent.parent
CONSTANTS = ROOT / "docs" / "constants.md"
COMMAND = "python -m tests.documents"

_HEAD = f"""# Settings and constants

Written by `{COMMAND}`; edit the docstrings in the code, not this file.

The first part has every setting of every stage, with its default. The second part has every
numeric constant of `tasks`, module by module. A unit that is left out is that of a bare number or
is told by the name (`_m`, `_s`, `_px`).
"""


@dataclass(frozen=True)
class Constant:
    """What there is to know of a numeric constant of a module."""

    module: str
    """The path of its file."""
    name: str
    value: str
    """As the code writes it."""
    unit: str
    meaning: str
    """Empty where nothing is said."""
    source: str


def main() -> None:
    """Write docs/constants.md."""
    CONSTANTS.write_text(write_constants(), encoding="utf-8")


def write_constants() -> str:
    """Return docs/constants.md as the code has it now."""
    lines = [_HEAD, "## Settings", ""]
    for kind in find_settings():
        lines += _settings_of(kind)
    lines += ["## Constants", ""]
    for module, constants in groupby(find_constants(), lambda each: each.module):
        lines += [f"### {module}", "", *_table(("constant", "value", "unit", "meaning", "source"))]
        lines += [
            _row(f"`{c.name}`", f"`{c.value}`", c.unit, c.meaning, c.source) for c in constants
        ]
        lines.append("")
    return "\n".join(lines)


def find_settings() -> list[type]:
    """Return the dataclasses of settings in `tasks` that stand in no other, the outermost first.

    Those of the stages stand in `tasks.settings.Settings` where that exists, and then the names
    of their settings are those of a settings file.
    """
    kinds = []
    for path, text in _modules():
        for node in ast.parse(text).body:
            if isinstance(node, ast.ClassDef) and node.name.endswith("Settings"):
                kinds.append(getattr(importlib.import_module(_name(path)), node.name))
    kinds = [kind for kind in kinds if is_dataclass(kind)]
    inside = {hint for kind in kinds for hint in _field_types(kind)}
    outer = [kind for kind in kinds if kind not in inside]
    return sorted(outer, key=lambda kind: kind.__module__.count("."))


def settings_of(kind: type) -> list[Setting]:
    """Return the settings of a dataclass with their defaults."""
    return list(list_settings(kind()))


def find_constants() -> list[Constant]:
    """Return every numeric constant of the modules of `tasks`, in the order of the files."""
    return [each for path, text in _modules() for each in constants_of(path, text)]


def constants_of(path: str, text: str) -> list[Constant]:
    """Return the numeric constants of a module, in its order."""
    constants = []
    statements = ast.parse(text).body
    comments = _comments(text)
    for node, below in zip(statements, [*statements[1:], None], strict=True):
        for name, value in _numbers(node):
            meaning, source, unit = parse_docstring(_said(node, below, comments))
            written = " ".join(ast.unparse(value).split())
            constants.append(Constant(path, name, written, unit, meaning, source))
    return constants


def _settings_of(kind: type) -> Iterator[str]:
    """Yield the tables of a dataclass of settings, one a dataclass inside it."""
    within = f"{kind.__module__}.{kind.__qualname__}"
    tables: dict[str, list[Setting]] = {}
    for each in settings_of(kind):
        tables.setdefault(each.name.rpartition(".")[0], []).append(each)
    for table, settings in tables.items():
        yield f"### `[{table}]` in {within}" if table else f"### {within}"
        yield ""
        yield from _table(("setting", "default", "unit", "accepted", "meaning", "reason"))
        for each in settings:
            name, value = each.name.rpartition(".")[2], _written(each.value)
            about = each.unit, each.accepted, each.meaning, each.reason
            yield _row(f"`{name}`", f"`{value}`", *about)
        yield ""


def _written(value: Any) -> str:
    """Return a value as it is written in a settings file."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _table(heads: tuple[str, ...]) -> list[str]:
    """Return the head of a table."""
    return [_row(*heads), _row(*["---"] * len(heads))]


def _row(*cells: str) -> str:
    """Return a row of a table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _modules() -> Iterator[tuple[str, str]]:
    """Yield the path and the text of every module of `tasks`."""
    for path in sorted((ROOT / "tasks").rglob("*.py")):
        yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def _name(path: str) -> str:
    """Return the name by which a file is imported."""
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _field_types(kind: type) -> list[Any]:
    """Return the types of a dataclass' fields."""
    hints = get_type_hints(kind)
    return [hints[field.name] for field in fields(kind)]


def _numbers(node: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Yield the names that a statement gives numbers, and the numbers."""
    match node:
        case ast.Assign(targets=[ast.Name(id=name)], value=value):
            pairs = [(name, value)]
        case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
            pairs = [(name, value)]
        case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
            pairs = [(ast.unparse(n), v) for n, v in zip(names, values, strict=True)]
        case _:
            return
    for name, value in pairs:
        upper = name.isupper() and name.replace("_", "").isidentifier()
        if upper and _is_numeric(value) and _has_number(value):
            yield name, value


def _is_numeric(value: ast.expr) -> bool:
    """Say whether an expression is made of numbers, their names and other constants."""
    match value:
        case ast.Constant(value=constant):
            return isinstance(constant, int | float | str) and not isinstance(constant, bool)
        case ast.Name(id=name):
            return name.isupper()
        case ast.UnaryOp(operand=operand):
            return _is_numeric(operand)
        case ast.BinOp(left=left, right=right):
            return _is_numeric(left) and _is_numeric(right)
        case ast.Tuple(elts=elements) | ast.List(elts=elements):
            return all(_is_numeric(each) for each in elements)
        case ast.Dict(keys=keys, values=values):
            return all(key is not None and _is_numeric(key) for key in keys) and all(
                _is_numeric(each) for each in values
            )
        case ast.Starred(value=inside):
            return _is_numeric(inside)
        case ast.Call(func=ast.Attribute(value=ast.Name(id="np" | "math")), args=arguments):
            return all(_is_numeric(each) for each in arguments if not _is_type(each))
    return False


def _is_type(argument: ast.expr) -> bool:
    """Say whether an argument is the type of an array, such as `np.float32`."""
    return isinstance(argument, ast.Attribute)


def _has_number(value: ast.expr) -> bool:
    """Say whether a number is written in an expression."""
    return any(
        isinstance(each, ast.Constant) and isinstance(each.value, int | float)
        for each in ast.walk(value)
    )


def _said(node: ast.stmt, below: ast.stmt | None, comments: dict[int, tuple[str, bool]]) -> str:
    """Return what the docstring below a constant says, or the comment beside or above it."""
    match below:
        case ast.Expr(value=ast.Constant(value=str(text))):
            return text
    last = node.end_lineno or node.lineno
    if last in comments:
        return _sentence(comments[last][0])
    above, line = [], node.lineno - 1
    while line in comments and comments[line][1]:
        above.insert(0, comments[line][0])
        line -= 1
    return _sentence(" ".join(above))


def _sentence(comment: str) -> str:
    """Return a comment as a docstring would say it; remarks to tools say nothing."""
    comment = comment.strip()
    if not comment or comment.startswith(("fmt:", "type:", "noqa")):
        return ""
    return comment[0].upper() + comment[1:] + "." * (comment[-1] not in ".!?")


def _comments(text: str) -> dict[int, tuple[str, bool]]:
    """Return the comment of each line that has one, and whether it has the line for itself."""
    return {
        token.start[0]: (token.string.lstrip("# "), not token.line[: token.start[1]].strip())
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    }


if __name__ == "__main__":
    main()
