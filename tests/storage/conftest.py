"""What tests of the index share."""

import numpy as np
import pytest

from storage import create_archive
from storage.index import snapshots
from tasks.retrieval import gathering
from tests.figures.archives.packed_takes import PlainTakes


@pytest.fixture(autouse=True)
def forget():
    """Let nothing that was read before hide what lies on the disk."""
    snapshots._held.clear()


@pytest.fixture
def takes(tmp_path):
    return PlainTakes(create_archive(tmp_path / "archive").place)


@pytest.fixture
def small(monkeypatch):
    """Segments of a few takes, so that there are many."""
    monkeypatch.setattr(gathering, "SEGMENT", 256)
    monkeypatch.setattr(gathering, "_STALE", 2)


@pytest.fixture
def summarized(monkeypatch):
    """A summary is made and kept: the mean of each row over 16 samples."""

    def summarize(rows):
        return {"mean": np.nan_to_num(rows).reshape(len(rows), -1, 16).mean(axis=2)}

    monkeypatch.setattr(gathering, "summarize_rows", summarize)
