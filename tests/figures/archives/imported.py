"""Archives of motion files, taken in by the very functions that the flow calls, without Prefect."""

from pathlib import Path

from storage import create_archive
from storage.recordings import find_recordings, plan_takes
from tasks.motion.importing import ImportSettings, import_take
from tasks.retrieval.indexing import index_take
from tasks.takes.publishing import publish_take


def take_in_plainly(archive: str | Path, path: str | Path) -> str:
    """Take a motion file, or all in a folder, into an archive, made if need be; return where."""
    opened = create_archive(archive)
    for recording in plan_takes(opened, find_recordings([path])).recordings:
        draft = import_take(opened.location, recording, ImportSettings())
        index_take(opened.location, draft["take"], draft["version"])
        publish_take(opened.location, draft, over=0)
    return opened.location
