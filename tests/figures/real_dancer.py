"""One instant of a real dancer before eight cameras: where it is, and the marks of its tests."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("SHOSA_DATA", "../shared/data")) / "dancer8"

MARKS = [
    pytest.mark.data,
    pytest.mark.compiled,
    pytest.mark.skipif(not DATA.exists(), reason="needs the shared data/dancer8"),
]
