"""The search arrays of all takes, made anew."""

import logging

from prefect import flow, task
from prefect.cache_policies import NO_CACHE
from prefect.task_runners import ThreadPoolTaskRunner

from flows.dashboard import count_teller
from storage import open_archive
from tasks.retrieval.indexing import index_take

logger = logging.getLogger(__name__)

_TAKES_A_BLOCK = 64  # about three seconds of takes of a minute; a task run costs 60 ms


@flow(
    name="index_archive",
    flow_run_name="index {archive}",
    task_runner=ThreadPoolTaskRunner(max_workers=2),  # type: ignore[arg-type]
)
def index_archive(archive: str) -> list[str]:
    """Make the search arrays of every take anew; return each fault as a sentence."""
    records, damaged = open_archive(archive).readable_records()
    versions = [(each.take, each.version) for each in records if "motion" in each.stages]
    blocks = [versions[i : i + _TAKES_A_BLOCK] for i in range(0, len(versions), _TAKES_A_BLOCK)]
    tell_done = count_teller(f"{len(versions)} takes of {archive}", len(versions))
    runs = [index_block.submit(archive, block) for block in blocks]
    faults: list[str] = []
    done = 0
    for block, run in zip(blocks, runs, strict=True):
        faults += run.result()
        done += len(block)
        tell_done(done)
    logger.info("indexed %d takes of %s", len(versions) - len(faults), archive)
    return [*damaged.values(), *faults]


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
