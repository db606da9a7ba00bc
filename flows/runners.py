"""Where the tasks of a flow run: in threads of this process, or on the workers of a Dask cluster.

In threads the blocks of a take go one after another: each stage works on its frames in as many
threads as there are processors, and two blocks at once were no faster on two of them. On a cluster
they go side by side, and a worker that is lost costs the block that it was at.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from prefect.context import hydrated_context, serialize_context
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from flows.clusters import THREADS, scheduler_address
from storage.blocks import Written
from tasks.cached import run_once

_TAKES_AT_ONCE = 2
"""In threads: one reads and writes while the other computes."""
_BLOCKS_FIRST = 10
"""Priority of blocks over takes that have not begun: else all takes would be begun at once."""


def task_runner(name: str) -> TaskRunner[Any]:
    """Return what runs the tasks of a flow.

    Parameters
    ----------
    name
        "threads"; "dask", for a cluster of this machine's processors; or "dask://HOST:PORT", for
        the scheduler of one that runs.

    Raises
    ------
    ValueError
        If it is none of these, or Dask is not installed.
    ConnectionError
        If no scheduler answers there.
    """
    if name == THREADS:
        return ThreadPoolTaskRunner(max_workers=_TAKES_AT_ONCE)
    address = scheduler_address(name)
    from prefect_dask.task_runners import DaskTaskRunner

    if address is None:
        return DaskTaskRunner(cluster_kwargs={"threads_per_worker": 1})
    return DaskTaskRunner(address=address)


def spread_blocks() -> Callable[..., Iterator[Written]] | None:
    """Return what runs a stage on many blocks side by side; None where this is no Dask worker."""
    distributed = sys.modules.get("distributed")
    if distributed is None:
        return None
    try:
        distributed.get_worker()
    except ValueError:
        return None
    return _run_on_workers


def _run_on_workers(
    function: Callable[..., Written], calls: Sequence[dict[str, Any]]
) -> Iterator[Written]:
    """Yield what a stage's store function returns for each set of keywords, in their order."""
    from distributed import worker_client

    context = serialize_context()
    with worker_client() as client:  # while it waits, another task has this worker's thread
        futures = [
            client.submit(_run_in, context, function, each, priority=_BLOCKS_FIRST, pure=False)
            for each in calls
        ]
        try:
            for future in futures:
                yield future.result()
        finally:
            client.cancel([future for future in futures if not future.done()])


def _run_in(
    context: dict[str, Any], function: Callable[..., Written], parameters: dict[str, Any]
) -> Written:
    """Run a stage's task as of the flow run that it was begun in, on another worker."""
    with hydrated_context(context):
        return run_once(function, **parameters)
