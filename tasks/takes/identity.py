"""What a take was made from: the recording, the settings, the code; and whether that is the same.

The archive remembers it in the take's record, so that any machine that meets the recording again
can tell. Another recording, or other settings, make the take anew; other code does so only when
somebody asks for it, because a new version of the program is no reason to compute an archive again.
"""

from collections.abc import Mapping
from typing import Any

from storage.archive import Archive
from storage.describing import own_metadata
from storage.index.entries import Entry
from storage.recordings import Recording
from storage.records import Record, read_record
from storage.upkeep.verification import damaged_files
from tasks.engine.fingerprints import code_behind

_CODE = {
    "capture": ("flows.chain", "tasks.takes.assembling"),
    "motion": ("tasks.motion.importing",),
}
"""The modules that make a take, by the kind of the recording."""


def code_of(kind: str) -> str:
    """Return the SHA-256 of the code that makes a take of a recording of this kind."""
    return code_behind(*_CODE["capture" if kind == "capture" else "motion"])


def why_anew(
    opened: Archive, recording: Recording, settings: Mapping[str, Any]
) -> tuple[str | None, Record | None]:
    """Say why a recording is to be taken in, if it is.

    Parameters
    ----------
    opened
        The archive.
    recording
        A motion file or a capture.
    settings
        Those that are not the defaults, by name.

    Returns
    -------
    reason
        The end of a sentence, or None where the archive has just this, intact.
    record
        What the take is now, None where there is none.
    """
    record = read_record(opened.place, recording.take)
    if record is None:
        return "the archive does not have it", None
    if record.source["digest"] != recording.digest:
        return "its content is another", record
    if differing := _differing(record, recording, settings):
        return f"{differing} differs from what the archive has", record
    if damaged_files(opened.place, record):
        return "what the archive has of it is damaged", record
    return None, record


def find_same(opened: Archive, recording: Recording, settings: Mapping[str, Any]) -> Record | None:
    """Return the record of a take that is just what a recording would become, intact, if it is.

    Asked before a recording is taken in, and again by the slower of two runs that took it in at
    once. The parameters are those of `why_anew`.
    """
    reason, record = why_anew(opened, recording, settings)
    return None if reason else record


def is_of_other_code(record: Record | Entry) -> bool:
    """Say whether a take was made by other code than that which runs."""
    return record.source.get("code") != code_of(record.source["kind"])


def made_by(record: Record | Entry) -> str:
    """Say by what a take was made that is not as usual: other code, settings; or nothing."""
    said = ["other code"] if is_of_other_code(record) else []
    if record.settings:
        said.append(f"{len(record.settings)} setting{'s' * (len(record.settings) > 1)}")
    return ", ".join(said)


def _differing(record: Record, recording: Recording, settings: Mapping[str, Any]) -> str | None:
    """Name what a take was made with and is not given now, or the other way round."""
    if recording.kind == "motion" and own_metadata(record) != recording.metadata:
        return "its metadata"  # those of a capture are part of its content
    if "code" not in record.source:  # a record of before, which does not hold all settings
        return None
    names = [
        name
        for name in {**record.settings, **settings}
        if record.settings.get(name) != settings.get(name)
    ]
    return f"the setting {', '.join(names)}" if names else None
