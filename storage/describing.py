"""The words about a take that a person changes afterwards: its title, its performer, and others.

The data stay as they are: a new record of the same version says the new words. It keeps what the
recording itself says of the fields that were changed, so that the person's words stay when the
recording is taken in again, until the recording says something else of them.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from storage.archive import Archive
from storage.errors import ConflictError, InputError
from storage.provenance import now
from storage.publication import publish_record
from storage.records import Record

_LONGEST_NAME, _LONGEST_WORDS = 60, 4000
"""Longest name and text of a field [characters]. Chosen: a page of text."""
_NOT_WORDS = ("id", "stature_m")
"""What stands beside the words of a recording and is none of them."""


def describe_take(archive: Archive, take: str, said: Mapping[str, str], *, over: int) -> Record:
    """Publish other words about a take; return its record.

    Parameters
    ----------
    said
        The fields that change, by name; an empty text removes a field.
    over
        The number of the record that the person has read.

    Raises
    ------
    InputError
        If a field has no name, is none of the words, or is too long: every fault at once.
    ConflictError
        If somebody else has changed the take since; nothing is changed then.
    UnknownNameError, ArchiveError
        If there is no such take, or its record is damaged.
    """
    words = {name.strip(): " ".join(text.split()) for name, text in said.items()}
    if faults := [fault for name, text in words.items() if (fault := _fault(name, text))]:
        raise InputError("; ".join(faults))
    record = archive.take(take).record
    if record.number != over:
        raise ConflictError(
            f"somebody else has changed take {take!r} since this was opened (it is at version "
            f"{record.number}, this was {over}); nothing was saved: load the page again"
        )
    metadata, own = dict(record.metadata), own_metadata(record)
    for name, text in words.items():
        if text:
            metadata[name] = text
        else:
            metadata.pop(name, None)
    if metadata == record.metadata:
        return record
    described = replace(
        record, metadata=metadata, replaced=_replaced(own, metadata), number=over + 1,
        published=now(),
    )  # fmt: skip
    publish_record(archive.place, described)
    return described


def own_metadata(record: Record) -> dict[str, Any]:
    """Return the words of the recording itself, as it was taken in."""
    own = {**record.metadata, **record.replaced}
    return {name: value for name, value in own.items() if value is not None}


def keep_words(before: Record, metadata: Mapping[str, Any]) -> tuple[dict[str, Any], dict]:
    """Return the words of a recording with those that a person has changed, and what they replace.

    Where the recording says something else of a field than before, it is believed.

    Parameters
    ----------
    before
        What the take is so far.
    metadata
        What the recording says.
    """
    kept = dict(metadata)
    for name, own in before.replaced.items():
        if metadata.get(name) != own:
            continue
        if name in before.metadata:
            kept[name] = before.metadata[name]
        else:
            kept.pop(name, None)
    return kept, _replaced(metadata, kept)


def _replaced(own: Mapping[str, Any], metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the recording says of the fields that are other now, None where nothing."""
    names = {**own, **metadata}
    return {name: own.get(name) for name in names if own.get(name) != metadata.get(name)}


def _fault(name: str, text: str) -> str | None:
    """Return what is wrong with a field."""
    if not name or len(name) > _LONGEST_NAME or not name.isprintable() or name in _NOT_WORDS:
        return f"a field cannot be called {name[:_LONGEST_NAME]!r}; give it a word, such as place"
    if len(text) > _LONGEST_WORDS or not text.isprintable():
        return f"{name} is {len(text)} characters; {_LONGEST_WORDS} that can be read at most"
    return None
