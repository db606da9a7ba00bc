"""What OpenCV's FileStorage writes, as YAML or XML: names with matrices, numbers, texts, lists.

Read here and not by OpenCV, which loses the leading zeros of names and ends the program on some
damaged files.
"""

import math
import re
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from storage.errors import InputError
from storage.formats.calibration.parts import number, numbers_in, parse_xml, some

WANTED = "a YAML or XML file as OpenCV writes it"
_DEEPEST = 8
_KEY = re.compile(r"""("[^"]*"|'[^']*'|[^\s:#\[{"'-][^:]*?|-[^\s:]+)\s*:(?:\s+(.*)|$)""")


def parse_storage(path: Path, text: str) -> dict[str, Any]:
    """Return the entries of a file: arrays, floats, texts, lists, and tables of the same.

    Raises
    ------
    InputError
        A line or element cannot be read, or a matrix has other than rows times columns numbers.
    """
    faults: list[str] = []
    if text.lstrip().startswith("<"):
        entries = _children(parse_xml(path, text, WANTED), faults, 0)
    else:
        lines = _joined_lines(text, faults)
        entries = _table(lines, faults, 0) if lines else {}
    if faults:
        raise InputError(f"{path} cannot be read: {'; '.join(some(faults))}; bring {WANTED}")
    return entries


def _joined_lines(text: str, faults: list[str]) -> list[tuple[int, str]]:
    """Return the indent and the text of each line, lists in brackets on one line."""
    lines: list[tuple[int, str]] = []
    open_list: list[str] = []
    for line in text.split("\n"):
        bare = line.strip()
        if open_list:
            open_list.append(bare)
        elif not bare or bare.startswith(("%", "#")) or bare in ("---", "..."):
            continue
        else:
            lines.append((len(line) - len(line.lstrip(" ")), bare))
            open_list = [bare] if "[" in bare else []
        if open_list and "]" in open_list[-1]:
            lines[-1] = (lines[-1][0], " ".join(open_list))
            open_list = []
    if open_list:
        faults.append(f"the list of {open_list[0][:40]!r} does not end")
    return lines


def _table(lines: list[tuple[int, str]], faults: list[str], depth: int) -> dict[str, Any]:
    """Return the entries of lines, those of a deeper indent belonging to the one before."""
    entries: dict[str, Any] = {}
    if depth > _DEEPEST:
        faults.append(f"tables lie more than {_DEEPEST} deep in each other")
        return entries
    at, indent = 0, lines[0][0]
    while at < len(lines):
        here, line = lines[at]
        found = _KEY.match(line)
        end = at + 1
        while end < len(lines) and (
            lines[end][0] > here or (lines[end][0] == here and lines[end][1].startswith("- "))
        ):
            end += 1
        if found is None or here != indent:
            faults.append(f"the line {line[:60]!r} is not understood")
        else:
            key = found[1].strip("\"'")
            if key in entries:
                faults.append(f"{key!r} comes more than once")
            entries[key] = _value(key, found[2] or "", lines[at + 1 : end], faults, depth)
        at = end
    return entries


def _value(key: str, word: str, below: list[tuple[int, str]], faults: list[str], depth: int) -> Any:
    """Return what stands behind a key and below it."""
    text = key == "names"  # whose leading zeros count
    if word.startswith("!!"):
        word = word.partition(" ")[2].strip()
    if below and not word:
        if all(line.startswith("- ") for _, line in below):
            return [_scalar(line[2:].strip(), text=text) for _, line in below]
        table = _table(below, faults, depth + 1)
        return _matrix(key, table, faults) if _is_matrix(table) else table
    if below:
        faults.append(f"the lines below {key!r} are not understood")
    if word.startswith("["):
        inside = word[1:].partition("]")[0]
        words = [part.strip() for part in inside.split(",") if part.strip()]
        return [_scalar(part, text=text) for part in words]
    return _scalar(word)


def _scalar(word: str, *, text: bool = False) -> float | str:
    """Return a number, or the text of a word; what is quoted is a text."""
    if len(word) > 1 and word[0] in "\"'" and word[-1] == word[0]:
        return word[1:-1]
    word = word.partition(" #")[0].strip()
    value = number(word)
    return word if text or math.isnan(value) else value


def _is_matrix(table: dict[str, Any]) -> bool:
    return "data" in table and ({"rows", "cols"} <= table.keys() or "sizes" in table)


def _matrix(key: str, table: dict[str, Any], faults: list[str]) -> np.ndarray | None:
    """Return the numbers of a matrix, in its rows and columns where it has one channel."""
    data, sizes = table["data"], table.get("sizes", [table.get("rows"), table.get("cols")])
    values = [data] if isinstance(data, float) else data
    sizes = [sizes] if isinstance(sizes, float) else sizes
    if not isinstance(values, list) or not all(isinstance(value, float) for value in values):
        faults.append(f"the data of {key!r} are not numbers")
        return None
    if not isinstance(sizes, list) or not all(
        isinstance(count, float) and 0 <= count < 1e6 for count in sizes
    ):
        faults.append(f"{key!r} has no number of rows and columns")
        return None
    channels = number("".join(re.findall(r"^\d+", str(table.get("dt", "")))) or "1")
    if math.prod(sizes) * channels != len(values):
        by = " by ".join(f"{count:g}" for count in (*sizes, channels))
        faults.append(f"{key!r} has {len(values)} numbers, not {by} (rows, columns, channels)")
        return None
    shape = [int(count) for count in sizes] if channels == 1 else [-1]
    return np.array(values, np.float64).reshape(shape)


def _children(element: Element, faults: list[str], depth: int) -> dict[str, Any]:
    """Return the entries of an XML element."""
    entries: dict[str, Any] = {}
    if depth > _DEEPEST:
        faults.append(f"elements lie more than {_DEEPEST} deep in each other")
        return entries
    for child in element:
        if child.tag in entries and child.tag != "_":
            faults.append(f"{child.tag!r} comes more than once")
        if len(child):
            inside = _children(child, faults, depth + 1)
            value = _matrix(child.tag, inside, faults) if _is_matrix(inside) else inside
        else:
            value = _xml_scalar(child.text)
        entries[child.tag] = value
    return entries


def _xml_scalar(text: str | None) -> Any:
    """Return a number, a list of numbers, or a text."""
    bare = (text or "").strip()
    if bare.startswith('"'):
        names = [quoted or plain for quoted, plain in re.findall(r'"([^"]*)"|(\S+)', bare)]
        return names[0] if len(names) == 1 else names
    values = numbers_in(bare)
    words = bare.lower().split()
    if len(values) != len(words) or any(
        np.isnan(value) and "nan" not in word for value, word in zip(values, words, strict=True)
    ):
        return bare
    return values[0] if len(values) == 1 else values
