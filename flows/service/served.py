"""What `shosa serve` was told to serve, as every process that it starts knows it."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

POOL = "shosa"
"""The work pool that a worker of every machine takes runs from."""
VARIABLE = "SHOSA_SERVED"
"""The variable by which the worker's processes know what is served; no form can change it."""

ENDED = "shosa.scan.ended"
"""The event by which a scan says that it is over."""


MOST_PATHS = 100
"""How many recordings one run takes in. Chosen: half a minute of work, and a page of a form."""


@dataclass(frozen=True)
class Served:
    """What `shosa serve` was told to serve, as every process that it starts knows it."""

    archive: str
    inboxes: list[str] = field(default_factory=list)
    roots: list[str] = field(default_factory=list)
    """What forms may name and links may lead to, the inboxes among them."""
    settle_s: float = 60.0
    every_s: float | None = 60.0
    cron: str | None = None
    limit: int = 2
    """Runs at once on this machine."""


class ServingError(OSError):
    """The server, or what it needs, cannot be started; the message says what to do."""


def tag_of(archive: str) -> str:
    """Return the tag of all runs for an archive, by which they are told from those of others."""
    return f"shosa-{hashlib.sha256(archive.encode()).hexdigest()[:12]}"


def write_served(served: Served) -> str:
    """Return what is served, for the variable `VARIABLE`."""
    return json.dumps(asdict(served))


def read_served(environment: Mapping[str, str] | None = None) -> Served:
    """Return what is served by the worker that started this process.

    Raises
    ------
    ServingError
        If no `shosa serve` did.
    """
    text = (os.environ if environment is None else environment).get(VARIABLE)
    if text is None:
        raise ServingError("this is run by the workers that `shosa serve` starts, and nothing else")
    return Served(**json.loads(text))
