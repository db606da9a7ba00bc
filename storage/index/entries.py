"""What a listing says of a take: its record without the table of its files.

Many entries are kept as columns, in which what many takes share stands once.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from storage.records import Record

_SHARED = ("joints_present", "stages", "notes", "settings", "source")
"""The fields that many takes have in common [names]."""
_OWN = ("name", "path", "digest")
"""What each take has by itself of its source [names]."""


class Entry(NamedTuple):
    """A take as a listing shows it; each field is that of its `Record`, and not to be changed."""

    take: str
    version: str
    number: int
    source: dict[str, str]
    metadata: dict[str, Any]
    frames: int
    rate_hz: float
    joints_present: list[str]
    stages: list[str]
    notes: list[str]
    settings: dict[str, Any]
    published: str
    bytes: int
    """Of all files of the version."""


def entry_of(record: Record) -> Entry:
    """Return what a listing says of a take."""
    size = sum(file["bytes"] for file in record.files.values())
    return Entry._make([*(getattr(record, name) for name in Entry._fields[:-1]), size])


def entry_columns(entries: Sequence[Entry]) -> dict[str, Any]:
    """Return entries as columns that JSON can hold."""
    columns: dict[str, Any] = dict.fromkeys(Entry._fields, ())
    columns |= dict(zip(Entry._fields, map(list, zip(*entries, strict=True)), strict=False))
    sources = columns["source"]
    own = {name: [source[name] for source in sources] for name in _OWN}
    columns["source"] = [{k: v for k, v in each.items() if k not in _OWN} for each in sources]
    return {
        **{name: _shared(at) if name in _SHARED else at for name, at in columns.items()},
        "sources": own,
    }


def entries_of(columns: Mapping[str, Any]) -> list[Entry]:
    """Return the entries that `entry_columns` made columns of."""
    unfolded = {
        name: [columns[name]["of"][at] for at in columns[name]["at"]]
        if name in _SHARED
        else columns[name]
        for name in Entry._fields
    }
    own = [columns["sources"][name] for name in _OWN]
    unfolded["source"] = [
        {**shared, "name": name, "path": path, "digest": digest}
        for shared, name, path, digest in zip(unfolded["source"], *own, strict=True)
    ]
    return [Entry._make(row) for row in zip(*unfolded.values(), strict=True)]


def _shared(values: Iterable[Any]) -> dict[str, list[Any]]:
    """Return the values that differ, and which of them stands at each place."""
    seen: dict[str, int] = {}
    at = [seen.setdefault(json.dumps(value), len(seen)) for value in values]
    return {"of": [json.loads(text) for text in seen], "at": at}
