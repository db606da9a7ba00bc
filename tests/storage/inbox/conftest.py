"""An empty inbox beside an archive, and what is dropped into it."""

import pytest

from storage import create_archive
from storage.inbox.listing import open_inbox


@pytest.fixture
def archive(tmp_path):
    return create_archive(tmp_path / "archive")


@pytest.fixture
def inbox(tmp_path, archive):
    folder = tmp_path / "inbox"
    folder.mkdir()
    return open_inbox(str(folder), archive.location)


def put(inbox, name, content=b"x"):
    path = inbox.folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def put_capture(inbox, name="cap"):
    put(inbox, f"{name}/capture.toml")
    put(inbox, f"{name}/videos/one.mp4")
    return inbox.folder / name
