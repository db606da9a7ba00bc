"""Read TOML that anybody may have written: not too long, not too deep, numbers of usual size."""

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

from storage.errors import InputError
from storage.formats.reading import decode_toml, listed, read_bytes

_MOST_BYTES = 1 << 21
"""Longest file of TOML [bytes]. A calibration of a thousand cameras has half of it; a parser takes
seconds for more."""
_DEEPEST = 16
"""How deep tables, lists and dotted names may lie in each other. Ours have three levels; thousands
cost a parser gigabytes."""
_LARGEST = 2**63
"""Whole numbers must be below it, as TOML itself asks; longer ones cannot even be printed."""

_QUOTED = re.compile(
    r'#[^\n]*+|"""(?:[^"\\]|\\.|"(?!""))*+(?:"""|\Z)|\'\'\'(?:[^\']|\'(?!\'\'))*+(?:\'\'\'|\Z)'
    r"|\"(?:[^\"\\\n]|\\.)*+\"?|'[^'\n]*+'?",
    re.DOTALL,
)
"""A comment or a text, in which brackets and dots mean nothing."""
_DOTTED = re.compile(rf"(?<![^\s.,=\[\]{{}}])(?:[^\s.,=\[\]{{}}]++[ \t]*+\.[ \t]*+){{{_DEEPEST}}}")
_LONG_NUMBER = re.compile(r"([\w-]++)[ \t]*+=[^\n\"']*?[\d_]{4000}")


class NotTomlError(InputError):
    """A text is not TOML; `reason` says where."""

    def __init__(self, path: Path, reason: str, wanted: str) -> None:
        super().__init__(f"{path} is not TOML ({reason}); bring {wanted}")
        self.reason = reason


def read_toml(path: Path, wanted: str, *, most: int = _MOST_BYTES) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Parameters
    ----------
    path
        A regular file.
    wanted
        What should be there, for a message.
    most
        How long it may be [bytes].

    Raises
    ------
    InputError
        It cannot be read, is no regular file, is far too long, is not UTF-8 or not TOML.
    """
    if path.is_dir():
        raise InputError(f"{path} is no regular file, but a folder; bring {wanted}")
    data = read_bytes(path, wanted, most=most)
    text = decode_toml(path, data)
    return parse_toml(path, text, wanted)


def parse_toml(path: Path, text: str, wanted: str) -> dict[str, Any]:
    """Return the tables of a TOML text; raises as `read_toml`."""
    if len(text) > _MOST_BYTES:
        fault = f"it has {len(text):,} letters, at most {_MOST_BYTES:,} are read"
    else:
        fault = _depth_fault(text)
    if fault:
        raise InputError(f"{path} cannot be used: {fault}; bring {wanted}")
    try:
        tables = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise NotTomlError(path, _short(error), wanted) from error
    except ValueError as error:  # a number that is longer than Python reads
        found = _LONG_NUMBER.search(text)
        raise _huge(path, [found[1]] if found else []) from error
    if names := _names_of(tables, _is_huge):
        raise _huge(path, names)
    return tables


def plain_metadata(table: dict[str, Any], where: str) -> dict[str, Any]:
    """Return a table as strict JSON can hold it; dates become texts.

    Parameters
    ----------
    table
        As TOML has it.
    where
        The table and its file, for a message.

    Raises
    ------
    InputError
        A number is not finite: JSON has none such, and who reads the archive could not read it.
    """
    if names := _names_of(table, _is_endless):
        raise InputError(
            f"{listed(names)} in {where} is not a finite number, which no archive can hold; write "
            "a number, a text in quotes, or leave it out"
        )
    return json.loads(json.dumps(table, default=str, allow_nan=False))


def _depth_fault(text: str) -> str:
    """Return what is wrong where tables or names lie too deep in each other."""
    bare = _QUOTED.sub(lambda found: "" if found[0].startswith("#") else "q", text)
    if found := _DOTTED.search(bare):
        return f"the name that begins with {found[0][:20]!r} has more than {_DEEPEST} parts"
    depth = 0
    for bracket in re.finditer(r"[\[\]{}]", bare):
        depth += 1 if bracket[0] in "[{" else -1
        if depth > _DEEPEST:
            return f"lists or tables lie more than {_DEEPEST} deep in each other"
    return ""


def _names_of(value: Any, is_wrong: Any, within: str = "") -> list[str]:
    """Return the names of the values of tables for which `is_wrong` holds."""
    if isinstance(value, dict):
        return [
            name
            for key, inside in value.items()
            for name in _names_of(inside, is_wrong, f"{within}.{key}" if within else key)
        ]
    if isinstance(value, list):
        return list(
            dict.fromkeys(name for each in value for name in _names_of(each, is_wrong, within))
        )
    return [within[:80]] if is_wrong(value) else []


def _huge(path: Path, names: list[str]) -> InputError:
    under = f" under {listed(names)}" if names else ""
    return InputError(
        f"{path} has a whole number of too many digits{under}; write one of at most 18 digits, or "
        "a text in quotes"
    )


def _is_huge(value: Any) -> bool:
    return isinstance(value, int) and not -_LARGEST <= value < _LARGEST


def _is_endless(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _short(error: Exception) -> str:
    text = str(error)
    return text if len(text) <= 200 else f"{text[:200]}..."
