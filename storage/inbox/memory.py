"""What a scan knows of an inbox from the scans before it: in the archive, away from its takes.

inbox/<key>.json     the recordings that were seen, and what became of them
inbox/<key>/<n>      who scans it now (`storage.inbox.lock`)

If it is lost, every recording is read once more, and found to be in the archive.
"""

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Literal

from storage.inbox.listing import Inbox, list_waiting
from storage.places import Place, read_file, write_file

State = Literal["waiting", "in", "started", "refused", "failed"]

FIRST_PAUSE_S, LONGEST_PAUSE_S = 60.0, 3600.0
"""How long what failed waits until it is tried again: twice as long each time [s]. Chosen: a store
that is away for a moment is met again soon, and a full disk is not asked all day."""


@dataclass(frozen=True)
class Seen:
    """What is known of a recording in an inbox."""

    stamp: str
    state: State
    """"waiting" to settle, "in" the archive, "started" in a run of its own, or what went wrong."""
    since_s: float
    """When it came to be so, by the clock of the machine that saw it [s since 1970]."""
    tries: int = 0
    """How often it has failed."""
    run: str = ""
    """The run that was started for it."""


def read_memory(place: Place, inbox: Inbox) -> dict[str, Seen]:
    """Return what is known of the recordings of an inbox, by name; what is damaged is not known."""
    try:
        known = json.loads(read_file(place, _path(inbox)))["recordings"]
        return {name: Seen(**fields) for name, fields in known.items()}
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def write_memory(place: Place, inbox: Inbox, known: Mapping[str, Seen]) -> None:
    """Write what is known of the recordings of an inbox.

    Raises
    ------
    PlaceError
        If the archive cannot be written.
    """
    said = {
        name: {field: value for field, value in asdict(seen).items() if value not in ("", 0)}
        for name, seen in known.items()
    }
    content = {"inbox": inbox.location, "recordings": said}
    write_file(place, _path(inbox), json.dumps(content).encode())


def look_now(place: Place, inbox: Inbox, settle_s: float) -> tuple[dict[str, Seen], list[str]]:
    """List an inbox, remember what was seen, and return it as `look` does; raises as both do."""
    known = read_memory(place, inbox)
    after, ready = look(known, list_waiting(inbox), now_s=time.time(), settle_s=settle_s)
    if after != known:
        write_memory(place, inbox, after)
    return after, ready


def look(
    known: Mapping[str, Seen], stamps: Mapping[str, str], *, now_s: float, settle_s: float
) -> tuple[dict[str, Seen], list[str]]:
    """Return what is known after a look, and the names of what is to be taken in now.

    A recording has settled when two looks at least `settle_s` apart saw the same stamp. Where the
    clock was set back in between, the wait begins anew.

    Parameters
    ----------
    known
        From the look before.
    stamps
        Of what is there now.
    now_s, settle_s
        The time, and how long a recording has to be unchanged.
    """
    if not stamps and known:
        return dict(known), []  # a disk that is not mounted looks like this
    after: dict[str, Seen] = {}
    ready = []
    for name, stamp in stamps.items():
        seen = known.get(name)
        if seen is None or seen.stamp != stamp:
            seen = Seen(stamp, "waiting", now_s)
        elif now_s < seen.since_s:
            seen = replace(seen, since_s=now_s)
        after[name] = seen
        if seen.state in ("waiting", "failed"):
            pause_s = settle_s if seen.state == "waiting" else pause_after(seen.tries)
            if now_s - seen.since_s >= pause_s:
                ready.append(name)
    return after, ready


def pause_after(tries: int) -> float:
    """Return how long what has failed so often waits [s]."""
    return min(FIRST_PAUSE_S * 2.0 ** max(tries - 1, 0), LONGEST_PAUSE_S)


def _path(inbox: Inbox) -> str:
    return f"inbox/{inbox.key}.json"
