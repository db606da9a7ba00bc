"""Where the shared recordings are that benchmarks measure on."""

import os
from pathlib import Path


def data_folder() -> Path:
    """Return the folder that SHOSA_DATA names, by default the one beside the project."""
    return Path(os.environ.get("SHOSA_DATA", "../shared/data")).absolute()
