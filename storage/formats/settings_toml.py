"""Read a file of settings: TOML with a table a stage, `digitize.toml` in a capture.

```toml
[silhouettes]
rule = "crcb"
[pose_fitting]
method = "paper"
```
What the tables may hold is known by `tasks.settings`.
"""

import tomllib
from pathlib import Path
from typing import Any

from storage.errors import InputError
from storage.formats.reading import read_bytes

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
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is no regular file; bring {_WANTED}")
    if path.is_file() and path.stat().st_size > _MOST_BYTES:
        raise InputError(f"{path} is longer than {_MOST_BYTES:,} bytes; bring {_WANTED}")
    data = read_bytes(path, _WANTED)
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not in UTF-8 ({error.reason}); bring {_WANTED}") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path} is no TOML ({error}); bring {_WANTED}") from error


def read_capture_settings(folder: Path) -> dict[str, Any]:
    """Return the tables of a capture's `digitize.toml`, none where it has no such file.

    Raises
    ------
    InputError
        As `read_settings_tables`.
    """
    path = folder / SETTINGS_FILE
    return read_settings_tables(path) if path.exists() or path.is_symlink() else {}
