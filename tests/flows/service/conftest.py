"""An inbox and an archive beside it, and what a scan of it says."""

import pytest

from storage import open_archive
from storage.inbox.listing import open_inbox
from storage.inbox.memory import read_memory

BROKEN = b"PathFileType\t4\n"


@pytest.fixture
def folder(tmp_path):
    """An empty inbox."""
    folder = tmp_path / "inbox"
    folder.mkdir()
    return folder


@pytest.fixture
def scan(tmp_path, folder):
    """A function that scans the inbox once; returns the state of the run."""
    from flows.service.inbox import scan_inbox

    def run(settle_s=0.0, **options):
        return scan_inbox(
            str(tmp_path / "archive"), str(folder), settle_s, return_state=True, **options
        )

    return run


def takes(tmp_path):
    """The takes of the archive."""
    return open_archive(tmp_path / "archive").takes()


def known(tmp_path, folder):
    """What is known of each recording of the inbox."""
    archive = open_archive(tmp_path / "archive")
    memory = read_memory(archive.place, open_inbox(str(folder), archive.location))
    return {name: seen.state for name, seen in memory.items()}
