"""The search arrays of all takes, made anew."""

import logging
from typing import Any

from prefect import flow, task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State
from prefect.states import Completed, Failed
from prefect.task_runners import ThreadPoolTaskRunner

from flows.dashboard import count_teller
from storage import open_archive
from storage.errors import ArchiveError, PlaceError
from tasks.retrieval.gathering import gather_segments
from tasks.retrieval.indexing import index_take

logger = logging.getLogger(__name__)

_SAID = 5
"""How many faults a sentence names. Chosen: a paragraph on a page."""
_TAKES_A_BLOCK = 64  # about three seconds of takes of a minute; a task run costs 60 ms


def run_indexing(archive: str) -> list[str]:
    """Run the flow `index_archive`, and return each fault as a sentence."""
    flow: Any = index_archive  # pyright takes it for the function that it was
    faults = flow(archive, return_state=True).result(raise_on_failure=False)
    if isinstance(faults, Exception):
        raise faults
    return faults


@flow(
    name="index_archive",
    flow_run_name="index {archive}",
    task_runner=ThreadPoolTaskRunner(max_workers=2),  # type: ignore[arg-type]
    persist_result=False,
)
def index_archive(archive: str) -> State[list[str]]:
    """Make the search arrays of every take anew.

    Parameters
    ----------
    archive
        A directory or s3://bucket/prefix.

    Returns
    -------
    prefect.states.State
        With each fault as a sentence; Failed where there is one.
    """
    listing = open_archive(archive).listing()
    versions = [(each.take, each.version) for each in listing.entries if "motion" in each.stages]
    blocks = [versions[i : i + _TAKES_A_BLOCK] for i in range(0, len(versions), _TAKES_A_BLOCK)]
    tell_done = count_teller(f"{len(versions)} takes of {archive}", len(versions))
    runs = [index_block.submit(archive, block) for block in blocks]
    faults: list[str] = []
    done = 0
    for block, run in zip(blocks, runs, strict=True):
        faults += run.result()
        done += len(block)
        tell_done(done)
    try:
        faults += gather_segments(archive, anew=True)
    except (ArchiveError, PlaceError) as error:
        faults.append(f"the index was not gathered in segments: {error}")
    said = f"indexed {len(versions) - len(faults)} takes of {archive}"
    logger.info("%s", said)
    faults = [*listing.faults.values(), *faults]
    if faults:
        return Failed(message=f"{said}; {'; '.join(faults[:_SAID])}", data=faults)
    return Completed(message=said, data=faults)


@task(task_run_name="index from {block[0][0]}", cache_policy=NO_CACHE)
def index_block(archive: str, block: list[tuple[str, str]]) -> list[str]:
    """Index some takes; a bad one fails alone."""
    faults = []
    for take, version in block:
        try:
            index_take(archive, take, version)
        except Exception as error:  # whatever is wrong with one take, the others go on
            faults.append(f"take {take!r} cannot be indexed: {error or type(error).__name__}")
    return faults
