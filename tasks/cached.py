"""The stages as Prefect tasks: what is cached, and how a hit is checked, in one table.

Prefect's own cache lives on one machine, misses an edit to a function that the task calls, and
serves a hit after what it wrote was deleted. Here the archive remembers: what a stage writes goes
under a name made of the code behind the stage, its settings and the digests of its inputs, and
counts wherever it is found whole. So a second machine, or the next one after a power cut, goes on
where the first one was, and two runs with other settings never write over each other's blocks.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any, cast, get_type_hints

from prefect import Task, task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State
from prefect.states import Completed
from pydantic import TypeAdapter

from storage import open_archive
from storage.blocks import Block, Written, find_block, keyed_path, remember_block
from tasks.body.final_labeling import label_block
from tasks.body.initial_model import model_take
from tasks.body.joint_tracks import track_take
from tasks.body.pose_fitting import fit_take
from tasks.body.provisional_labeling import label_block_provisionally
from tasks.engine.fingerprints import fingerprint
from tasks.reconstruction.carving import carve_block
from tasks.reconstruction.coloring import color_block
from tasks.reconstruction.silhouettes import extract_block
from tasks.reconstruction.still_things import find_still_take
from tasks.retrieval.indexing import find_index, index_take

_CACHED = "Cached"
"""What Prefect calls a state that nothing was computed for [name]."""


def run_once(function: Callable[..., Any], **parameters: Any) -> Any:
    """Run a stage as its Prefect task, unless the archive holds what it would write.

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
    adapter = TypeAdapter(get_type_hints(function)["return"])
    state = _STAGES[function](**parameters, return_state=True)
    return adapter.validate_python(state.result())


def _cached(
    name: str, function: Callable[..., Any], run_or_find: Callable[..., tuple[Any, bool]]
) -> Task[..., Any]:
    """Return a store function as a task that looks into the archive before it computes."""

    def run_name(parameters: dict[str, Any]) -> str:
        return f"{name} of {_work(parameters)}"

    adapter = TypeAdapter(get_type_hints(function)["return"])
    signature = inspect.signature(function)

    @functools.wraps(function)  # for Prefect, which reads the names of the parameters
    def run(*values: Any, **parameters: Any) -> Any:
        result, found = run_or_find(function, signature.bind(*values, **parameters).arguments)
        plain = adapter.dump_python(result, mode="json")
        return _found(plain) if found else plain

    return task(
        name=name,
        task_run_name=cast(Any, run_name),  # its type wants the method of a class, not a name
        cache_policy=NO_CACHE,  # the archive remembers
        persist_result=False,
    )(run)


def _run_or_find_block(
    function: Callable[..., Written], parameters: dict[str, Any]
) -> tuple[Written, bool]:
    """Return the block of a stage, and whether it was there."""
    # a capture is named by its digest, wherever its folder is, and an archive by nothing
    named = {k: v for k, v in parameters.items() if k not in ("capture", "archive")}
    place = open_archive(parameters["archive"]).place
    into = keyed_path(parameters["into"], fingerprint(function, named))
    if (found := find_block(place, into)) is not None:
        return found, True
    written = function(**{**parameters, "into": into})
    remember_block(place, written)
    return written, False


def _run_or_find_index(
    function: Callable[..., str], parameters: dict[str, Any]
) -> tuple[str, bool]:
    """Return the digest of the search array of a version, and whether it was there."""
    found = find_index(**parameters)
    return (found, True) if found is not None else (function(**parameters), False)


def _found(result: Any) -> State[Any]:
    """Return the state of a task that had nothing to compute."""
    return Completed(name=_CACHED, message="The archive holds it already.", data=result)


def _work(parameters: dict[str, Any]) -> str:
    """Say what a task works on: a take, and its frames where they are not all."""
    if "into" not in parameters:
        return parameters["take"]
    take = parameters["into"].split("/")[1]
    match parameters:
        case {"start": start, "end": end} | {"silhouettes": Block(start=start, end=end)}:
            return f"{take}, frames {start}-{end - 1}"
    return take


_STAGES: dict[Callable[..., Any], Task[..., Any]] = {
    function: _cached(name, function, run_or_find)
    for name, function, run_or_find in (
        ("silhouettes", extract_block, _run_or_find_block),
        ("carving", carve_block, _run_or_find_block),
        ("coloring", color_block, _run_or_find_block),
        ("still things", find_still_take, _run_or_find_block),
        ("initial model", model_take, _run_or_find_block),
        ("pose fitting", fit_take, _run_or_find_block),
        ("final labeling", label_block, _run_or_find_block),
        ("provisional labeling", label_block_provisionally, _run_or_find_block),
        ("joint tracks", track_take, _run_or_find_block),
        ("indexing", index_take, _run_or_find_index),
    )
}
"""Each stage as a task, under the name that the dashboard shows, and how a hit is found."""
