"""What a stage's settings say of themselves: range, unit, meaning, and how they were chosen.

A stage's settings are a frozen dataclass. A field's type carries its range (`Positive`, `Share`),
its name or its docstring the unit, the first sentence of the docstring its meaning, and the rest
how it was chosen:

    reach_m: Positive = 0.6
    '''How far from the shoulder a hand may be. Arms of 1.6 m are 0.55 to 0.65.'''
    fall: Share = 0.3
    '''How much less may be seen [share of the frame before]. Chosen on four rendered captures.'''

Everything that reads, prints or checks a setting by its name takes it from there.
"""

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt

Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Share = Annotated[float, Ge(0), Le(1)]
Finite = Annotated[float, Lt(math.inf)]
"""Any number but NaN and infinity."""
Count = Annotated[int, Ge(1)]
CountOrNone = Annotated[int, Ge(0)]
"""A number of things that may be 0."""

_UNITS = {
    "m": "m", "m2": "m²", "s": "s", "px": "px", "hz": "Hz", "deg": "degrees", "rad": "rad",
}  # fmt: skip
_UNIONS = (Union, UnionType)
_BOUNDS = {Gt: "larger than {}", Ge: "{} or more", Lt: "below {}", Le: "at most {}"}


@dataclass(frozen=True)
class Setting:
    """What there is to know of a setting."""

    name: str
    """As a settings file writes it, with the tables that it stands in: `carving.min_cameras`."""
    value: Any
    unit: str
    """Empty where there is none, for a name or a number of things."""
    accepted: str
    """The values it may have, in words."""
    meaning: str
    """A sentence."""
    reason: str
    """How the default was chosen; empty where nothing is said."""


def check_ranges(settings: Any) -> None:
    """Refuse settings of which a number is not finite or out of its range.

    Raises
    ------
    ValueError
        With every fault, and the range of each.
    """
    faults = []
    for name, kind in field_kinds(type(settings)).items():
        value = getattr(settings, name)
        if not is_dataclass(value) and not is_accepted(value, kind):
            faults.append(f"{name} is {value!r}, it must be {accepted_values(kind)}")
    if faults:
        raise ValueError("; ".join(faults))


def is_accepted(value: Any, kind: Any) -> bool:
    """Return whether a value is of a field's type and in its range."""
    base, bounds = _parts(kind)
    if get_origin(base) in _UNIONS:
        return any(is_accepted(value, each) for each in get_args(base))
    if get_origin(base) is Literal:
        return value in get_args(base)
    if base is float:
        right = isinstance(value, (int, float)) and not isinstance(value, bool)
        right = right and math.isfinite(value)
    elif base is int:
        right = isinstance(value, int) and not isinstance(value, bool)
    else:
        return base is Any or not isinstance(base, type) or isinstance(value, base)
    return right and all(_holds(value, bound) for bound in bounds)


def accepted_values(kind: Any) -> str:
    """Return in words which values a field of a type may have."""
    base, bounds = _parts(kind)
    if get_origin(base) is Literal:
        return "one of " + ", ".join(f'"{name}"' for name in get_args(base))
    if get_origin(base) in _UNIONS:
        kinds = [each for each in get_args(base) if each is not type(None)]
        return " or ".join([accepted_values(each) for each in kinds])
    name = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
    said = [_BOUNDS[type(b)].format(f"{_limit(b):g}") for b in bounds if _limit(b) != math.inf]
    return " ".join([name.get(base, str(base)), " and ".join(said)]).strip()


def list_settings(settings: Any, within: str = "") -> Iterator[Setting]:
    """Yield every setting of a dataclass of settings, then those of the dataclasses inside it.

    Parameters
    ----------
    settings
        An instance; its values are given.
    within
        What stands before the names, `pose_fitting.` for instance.
    """
    said = _docstrings(type(settings))
    values = {name: getattr(settings, name) for name in field_kinds(type(settings))}
    for name, kind in field_kinds(type(settings)).items():
        value = values[name]
        if is_dataclass(value):
            continue
        meaning, reason, unit = parse_docstring(said.get(name, ""))
        unit = unit or _unit_of(name, kind)
        yield Setting(f"{within}{name}", value, unit, accepted_values(kind), meaning, reason)
    for name, value in values.items():
        if is_dataclass(value):
            yield from list_settings(value, f"{within}{name}.")


@cache
def field_kinds(kind: type) -> dict[str, Any]:
    """Return the type of each field of a dataclass, with its range."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in fields(kind)}


@cache
def _docstrings(kind: type) -> dict[str, str]:
    """Return the docstring below each field of a dataclass."""
    [body] = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(body, ast.ClassDef)
    said = {}
    for field, below in zip(body.body, body.body[1:], strict=False):
        match field, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str(text))):
                said[name] = inspect.cleandoc(text)
    return said


def parse_docstring(text: str) -> tuple[str, str, str]:
    """Return meaning, reason and unit of a docstring; the unit is empty where none is said."""
    text = " ".join(text.split())
    meaning, _, reason = re.sub(r"(?<=[.!?]) ", "\n", text, count=1).partition("\n")
    unit = re.search(r" ?\[([^\]]+)\](?=[.]?$)", meaning)
    return (meaning.replace(unit[0], ""), reason, unit[1]) if unit else (meaning, reason, "")


def _unit_of(name: str, kind: Any) -> str:
    """Return the unit that a name or a type tells."""
    if kind == Share:
        return "share"
    return _UNITS.get(name.rsplit("_", 1)[-1], "") if "_" in name else ""


def _parts(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the type below an annotation, and its bounds."""
    if get_origin(kind) is Annotated:
        base, *bounds = get_args(kind)
        return base, tuple(bounds)
    return kind, ()


def _limit(bound: Any) -> float:
    """Return the number that a bound is at."""
    return next(getattr(bound, side) for side in ("gt", "ge", "lt", "le") if hasattr(bound, side))


def _holds(value: float, bound: Any) -> bool:
    """Return whether a number keeps a bound."""
    limit = _limit(bound)
    return bool(
        {Gt: value > limit, Ge: value >= limit, Lt: value < limit, Le: value <= limit}[type(bound)]
    )
