"""The stages as Prefect tasks: what is cached, and how a hit is checked, in one table.

Prefect's own cache keys miss an edit to a function that the task calls, and serve a hit after
what it wrote was deleted. Here the key names the code behind the stage, its settings and the
digests of its inputs, and a hit counts only if what the stage wrote is still there and intact.
Two runs that meet on one take may both compute it; publication lets one of them win. (Prefect's
file locks would make one wait, and make it wait for ever after the other was killed.)
"""

from collections.abc import Callable
from typing import Any

from prefect import Task, task
from prefect.cache_policies import CacheKeyFnPolicy
from prefect.context import TaskRunContext
from prefect.transactions import CommitMode, transaction

from storage import open_archive
from storage.blocks import has_block
from tasks.body.labeling import label_block
from tasks.body.pose_fitting import fit_take, model_take
from tasks.engine.fingerprints import fingerprint
from tasks.motion.importing import import_take, is_imported
from tasks.reconstruction.carving import carve_block
from tasks.reconstruction.coloring import color_block
from tasks.reconstruction.silhouettes import extract_block
from tasks.retrieval.indexing import index_take, is_indexed


def cached(
    function: Callable[..., Any], *, run_name: str, is_intact: Callable[..., bool]
) -> Callable[..., Any]:
    """Return a store function as a task that is skipped when nothing it depends on changed.

    Parameters
    ----------
    function
        Called with keywords that JSON or a dataclass can hold; returns JSON.
    run_name
        How a run is called on the dashboard; parameters in braces.
    is_intact
        Called with the result and the keywords of a hit: whether what the stage wrote is still
        there and unchanged.
    """

    def key(_: TaskRunContext, parameters: dict[str, Any]) -> str:
        return fingerprint(function, parameters)

    stage: Task[..., Any] = task(
        name=function.__name__,
        task_run_name=run_name,
        cache_policy=CacheKeyFnPolicy(cache_key_fn=key),
        persist_result=True,
        result_serializer="json",
    )(function)

    def run(**parameters: Any) -> Any:
        # by itself Prefect keeps no result until the task that called this one has succeeded too
        with transaction(commit_mode=CommitMode.EAGER):
            return _run(parameters)

    def _run(parameters: dict[str, Any]) -> Any:
        state = stage(**parameters, return_state=True)
        result = state.result()
        if state.name != "Cached" or is_intact(result, **parameters):
            return result
        return stage.with_options(refresh_cache=True)(**parameters)

    return run


def _is_there(block: dict[str, Any], archive: str, **_: Any) -> bool:
    """Say whether a block that a stage wrote is still there, every byte of it."""
    return has_block(open_archive(archive).place, block)


extract_block_once = cached(extract_block, run_name="silhouettes {into}", is_intact=_is_there)
carve_block_once = cached(carve_block, run_name="carve {into}", is_intact=_is_there)
color_block_once = cached(color_block, run_name="color {into}", is_intact=_is_there)
model_take_once = cached(model_take, run_name="initial model {into}", is_intact=_is_there)
fit_take_once = cached(fit_take, run_name="fit {into}", is_intact=_is_there)
label_block_once = cached(label_block, run_name="label {into}", is_intact=_is_there)
import_take_once = cached(import_take, run_name="import {recording.take}", is_intact=is_imported)
index_take_once = cached(index_take, run_name="index {take}", is_intact=is_indexed)
