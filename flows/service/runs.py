"""Runs that a scan of an inbox starts, so that it need not wait: any worker may take them."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any
from uuid import UUID

from prefect import State, get_client
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectNotFound

from flows.service.served import MOST_PATHS
from storage.archive import take_name
from storage.inbox.memory import Seen

DIGITIZE = "digitize/digitize"
"""The deployment that a scan starts for a capture, as flow and name."""
INGEST = "ingest/ingest"
"""The deployment that a scan starts for many motion files."""


def start_run(deployment: str, parameters: dict[str, Any], known: Mapping[str, Seen]) -> str:
    """Start a run for recordings once, however often this is called; return its number.

    Parameters
    ----------
    deployment
        Of the run, as flow and name.
    parameters
        Of the run.
    known
        What is known of the recordings, by name. When they were seen counts too: what was moved
        back from quarantine unchanged is tried again.
    """
    said = [f"{name}\0{s.stamp}\0{s.tries}\0{s.since_s}" for name, s in sorted(known.items())]
    run: Any = run_deployment(
        deployment,
        parameters=parameters,
        timeout=0,
        as_subflow=False,
        idempotency_key=hashlib.sha256(
            "\n".join(said).encode(errors="surrogateescape")
        ).hexdigest(),
    )
    return str(run.id)


def end_of_run(run: str) -> State[Any] | None:
    """Return the state of a run that was started; None where the server does not know it."""
    try:
        with get_client(sync_client=True) as client:
            return client.read_flow_run(UUID(run)).state
    except (ObjectNotFound, ValueError):  # another server, or its database was lost
        return None


def split_files(digests: Mapping[str, str]) -> list[list[str]]:
    """Return which motion files of an inbox are taken in by one run, in runs of about one size.

    Those of one content, and those that would be called the same, come into one run, which gives
    them their names: two runs at once would both give the same one. What finds no room with its
    like is left out, for the next scan.

    Parameters
    ----------
    digests
        Of the content of each file, by its path in the inbox; empty where it is not known.
    """
    runs = -(-len(digests) // MOST_PATHS)
    size = -(-len(digests) // max(1, runs))
    batches: list[list[str]] = []
    batch_of: dict[str, list[str]] = {}
    for name, digest in digests.items():
        likes = [f"named {take_name(PurePosixPath(name).stem)}", f"is {digest}" if digest else ""]
        batch = next((batch_of[like] for like in likes if like in batch_of), None)
        if batch is None:
            if not batches or len(batches[-1]) >= size:
                batches.append([])
            batch = batches[-1]
        elif len(batch) >= MOST_PATHS:
            continue
        batch.append(name)
        batch_of |= dict.fromkeys(filter(None, likes), batch)
    return batches


def run_names(known: Mapping[str, Seen]) -> dict[str, Sequence[str]]:
    """Return the recordings that are being taken in by runs, by the number of the run."""
    runs: dict[str, list[str]] = {}
    for name, seen in known.items():
        if seen.state == "started":
            runs.setdefault(seen.run, []).append(name)
    return dict(runs)
