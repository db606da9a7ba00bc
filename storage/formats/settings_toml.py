"""Read a file of settings: TOML with a table a stage, `digitize.toml` in a capture.

```toml
[silhouettes]
rule = "crcb"
[pose_fitting]
method = "paper"
```
What the tables may hold is known by `tasks.settings`.
"""

from pathlib import Path
from typing import Any

from storage.errors import InputError
from storage.formats.toml_text import NotTomlError, read_toml

SETTINGS_FILE = "digitize.toml"
"""The settings of one capture, in its folder."""

_MOST_BYTES = 1 << 20
"""Longer than any file of settings [bytes]. All settings with their meanings are some 60 kB."""
_WANTED = "a TOML file such as `shosa settings` prints"


def read_settings_tables(path: Path) -> dict[str, Any]:
    """Return the tables of a file of settings, as they stand there.

    Raises
    ------
    InputError
        If it is no file, cannot be read, is far too long, or is no TOML.
    """
    try:
        return read_toml(path, _WANTED, most=_MOST_BYTES)
    except NotTomlError as error:
        raise InputError(f"{path} is no TOML ({error.reason}); bring {_WANTED}") from error


def read_capture_settings(folder: Path) -> dict[str, Any]:
    """Return the tables of a capture's `digitize.toml`, none where it has no such file.

    Raises
    ------
    InputError
        As `read_settings_tables`.
    """
    path = folder / SETTINGS_FILE
    return read_settings_tables(path) if path.exists() or path.is_symlink() else {}
