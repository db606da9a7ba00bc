"""Read the file that says which markers make a joint (`--map`).

A line a joint: `RHip = "RH"`, or `RHip = ["RASI", "RPSI"]` for the middle of markers.
"""

from difflib import get_close_matches
from pathlib import Path
from typing import Any

from storage.errors import InputError
from storage.formats.encodings import normalized
from storage.formats.toml_text import read_toml
from storage.schema import JOINTS

JointMap = tuple[tuple[str, tuple[str, ...]], ...]

_WANTED = 'a TOML file with a line a joint, such as RHip = "RH" or RHip = ["RASI", "RPSI"]'


def read_joint_map(path: Path) -> JointMap:
    """Return each joint of the file with the markers whose middle it is.

    Raises
    ------
    InputError
        The file cannot be read, is not TOML, names no joint, or names joints that there are
        not or markers that are no names; all such lines are said at once.
    """
    table = read_toml(path, _WANTED)
    faults = [fault for joint, value in table.items() for fault in _faults(joint, value)]
    if not table:
        faults.append("no joint is named")
    if faults:
        raise InputError(f"{path} cannot be used: {'; '.join(faults)}; bring {_WANTED}")
    return tuple(
        (joint, tuple(map(normalized, [value] if isinstance(value, str) else value)))
        for joint, value in table.items()
    )


def _faults(joint: str, value: object) -> list[str]:
    faults = []
    if joint not in JOINTS:
        folded = {name.casefold(): name for name in JOINTS}
        near = [folded[name] for name in get_close_matches(joint.casefold(), folded, n=3)]
        faults.append(f"{joint!r} is no joint; {_or(near or JOINTS)} is")
    names: list[Any] = value if isinstance(value, list) else [value]
    if not names or not all(isinstance(name, str) and name.strip() for name in names):
        faults.append(f"{joint} = {value!r} is neither a marker's name nor a list of names")
    elif len(set(map(normalized, names))) < len(names):
        faults.append(f"{joint} = {value!r} names a marker twice")
    return faults


def _or(names: list[str] | tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
