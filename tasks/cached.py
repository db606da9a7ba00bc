"""The stages as Prefect tasks: what is cached, and how a hit is checked, in one table.

Prefect's own cache keys miss an edit to a function that the task calls, and serve a hit after
what it wrote was deleted. Here the key names the code behind the stage, its settings and the
digests of its inputs, and a hit counts only if what the stage wrote is still there and intact.
Two runs that meet on one take may both compute it; publication lets one of them win. (Prefect's
file locks would make one wait, and make it wait for ever after the other was killed.)
"""

import functools
from collections.abc import Callable
from typing import Any, cast, get_type_hints

from prefect import Task, task
from prefect.cache_policies import CacheKeyFnPolicy
from prefect.context import TaskRunContext
from prefect.transactions import CommitMode, transaction
from pydantic import TypeAdapter

from storage import open_archive
from storage.blocks import Block, Written, has_block
from tasks.body.final_labeling import label_block
from tasks.body.initial_model import model_take
from tasks.body.joint_tracks import track_take
from tasks.body.pose_fitting import fit_take
from tasks.body.provisional_labeling import label_block_provisionally
from tasks.engine.fingerprints import fingerprint
from tasks.motion.importing import import_take, is_imported
from tasks.reconstruction.carving import carve_block
from tasks.reconstruction.coloring import color_block
from tasks.reconstruction.silhouettes import extract_block
from tasks.retrieval.indexing import index_take, is_indexed


def run_once(function: Callable[..., Any], **parameters: Any) -> Any:
    """Run a stage as its Prefect task, unless nothing changed since it ran with these parameters.

    Parameters
    ----------
    function
        The store function of a stage; one of those in the table below.
    parameters
        What it is called with: keywords that JSON or a dataclass can hold.

    Returns
    -------
    Whatever the function returns, or has returned.
    """
    stage, is_intact = _STAGES[function]
    adapter = TypeAdapter(get_type_hints(function)["return"])
    # by itself Prefect keeps no result until the task that called this one has succeeded too
    with transaction(commit_mode=CommitMode.EAGER):
        state = stage(**parameters, return_state=True)
        result = adapter.validate_python(state.result())
        if state.name != "Cached" or is_intact(result, **parameters):
            return result
        again = stage.with_options(refresh_cache=True)(**parameters)
        return adapter.validate_python(again)


def _cached(name: str, function: Callable[..., Any]) -> Task[..., Any]:
    """Return a store function as a task that keeps its results as JSON."""

    def key(_: TaskRunContext, parameters: dict[str, Any]) -> str:
        # a capture is named by its digest, wherever its folder is
        return fingerprint(function, {k: v for k, v in parameters.items() if k != "capture"})

    def run_name(parameters: dict[str, Any]) -> str:
        return f"{name} of {_work(parameters)}"

    adapter = TypeAdapter(get_type_hints(function)["return"])

    @functools.wraps(function)  # for Prefect, which reads the names of the parameters
    def run(*values: Any, **parameters: Any) -> Any:
        return adapter.dump_python(function(*values, **parameters), mode="json")

    return task(
        name=name,
        task_run_name=cast(Any, run_name),  # its type wants the method of a class, not a name
        cache_policy=CacheKeyFnPolicy(cache_key_fn=key),
        persist_result=True,
        result_serializer="json",
    )(run)


def _work(parameters: dict[str, Any]) -> str:
    """Say what a task works on: a take, and its frames where they are not all."""
    if "into" not in parameters:
        return parameters.get("take") or parameters["recording"].take
    take = parameters["into"].split("/")[1]
    match parameters:
        case {"start": start, "end": end} | {"silhouettes": Block(start=start, end=end)}:
            return f"{take}, frames {start}-{end - 1}"
    return take


def _is_there(written: Written, archive: str, **_: Any) -> bool:
    """Say whether a block that a stage wrote is still there, every byte of it."""
    return has_block(open_archive(archive).place, written.block)


_STAGES: dict[Callable[..., Any], tuple[Task[..., Any], Callable[..., bool]]] = {
    function: (_cached(name, function), is_intact)
    for name, function, is_intact in (
        ("silhouettes", extract_block, _is_there),
        ("carving", carve_block, _is_there),
        ("coloring", color_block, _is_there),
        ("initial model", model_take, _is_there),
        ("pose fitting", fit_take, _is_there),
        ("final labeling", label_block, _is_there),
        ("provisional labeling", label_block_provisionally, _is_there),
        ("joint tracks", track_take, _is_there),
        ("importing", import_take, is_imported),
        ("indexing", index_take, is_indexed),
    )
}
"""The name of each stage on the dashboard, and what a hit of it is checked by."""
