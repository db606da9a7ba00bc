"""Which take each content became, so that the same content is never taken in twice.

    sources/<digest>.json    the take that the content with this SHA-256 became

Beside these are the copies of records (`storage.records`).
"""

import json
import re

from storage.places import Place, is_of_system, list_files, read_file, write_file
from storage.records import Record, read_record


def remember_source(place: Place, record: Record) -> None:
    """Write which take a content became."""
    content = json.dumps({"take": record.take}).encode()
    write_file(place, _path(record.source["digest"]), content)


def take_of_content(place: Place, digest: str) -> str | None:
    """Return the take that this content became, if the take still says so."""
    take = _read(place, _path(digest))
    record = read_record(place, take) if take else None
    return take if record and record.source["digest"] == digest else None


def list_sources(place: Place) -> dict[str, str | None]:
    """Return which take each content became, by the path of its file; None where it is damaged."""
    found: dict[str, str | None] = {}
    for file in list_files(place, "sources"):
        if file.path.count("/") == 1 and not is_of_system(file.path):
            found[file.path] = _read(place, file.path)
    return found


def _read(place: Place, path: str) -> str | None:
    """Return the take that the file of a content in sources/ names, or None where it names none."""
    try:
        take = json.loads(read_file(place, path))["take"]
    except (FileNotFoundError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return take if isinstance(take, str) and re.fullmatch(r"[\w-]+", take) else None


def _path(digest: str) -> str:
    return f"sources/{digest}.json"
