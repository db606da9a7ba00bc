"""Write the list of kernels that are compiled ahead: every one that a stage or a search calls.

    python -m tests.kernels

A small capture is digitized and searched. What its stages call from Python is listed, with the
types of the arguments; what kernels call is compiled with them.
"""

import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from flows import chain
from storage import create_archive
from storage.blocks import Written
from storage.formats.capture.capture import read_capture
from storage.recordings import Recording, digest_capture
from tasks.engine.compiling import KERNELS, write_types
from tasks.retrieval.answering import answer_query
from tasks.retrieval.gathering import gather_segments
from tasks.retrieval.indexing import index_take
from tasks.retrieval.searching import SearchSettings
from tasks.settings import Settings, settings_of_stages
from tasks.takes.assembling import assemble_take
from tasks.takes.publishing import publish_take
from tests.figures.posed_captures import film_posed

SEARCHING = "searching"


def list_kernels(folder: Path) -> dict[str, dict[str, str]]:
    """Return the kernels that are called, by stage: `module:function` and its types."""
    capture, location = film_posed(folder / "posed"), str(folder / "archive")
    create_archive(location)
    source = read_capture(capture)
    recording = Recording(
        str(capture), digest_capture(capture), source.take, source.metadata, kind="capture"
    )
    settings, stages = Settings(), {}
    with called_kernels() as called:

        def note(stage: str) -> None:
            if called:
                stages.setdefault(stage, {}).update(called)
            called.clear()

        def run(function: Callable[..., Written], **parameters: Any) -> Written:
            written = function(**parameters)
            note(parameters["into"].split("/")[2].split("-")[1])
            return written

        blocks, notes = chain.digitize(location, recording, settings, run=run, tell=lambda *_: None)
        draft = assemble_take(
            location, recording.path, recording.digest, recording.take, blocks,
            settings=settings_of_stages(settings), changed={}, code="", notes=notes,
        )  # fmt: skip
        index_take(location, draft["take"], draft["version"])
        publish_take(location, draft, over=0)
        note("assembling")
        gather_segments(location)
        for path_weight in (0.0, 0.5):
            asked = SearchSettings(path_weight=path_weight)
            answer_query(location, f"{source.take}:0-9", asked)
        note(SEARCHING)
    return {SEARCHING: stages.pop(SEARCHING), **stages}


@contextmanager
def called_kernels() -> Iterator[dict[str, str]]:
    """Yield what fills with the kernels that Python calls for the first time, and their types."""
    called: dict[str, str] = {}
    original = Dispatcher._compile_for_args

    def compile_for_args(self: Any, *values: Any, **named: Any) -> Any:
        if self.py_func.__module__.startswith("tasks."):
            name = f"{self.py_func.__module__}:{self.py_func.__name__}"
            called[name] = write_types([self.typeof_pyval(value) for value in values])
        return original(self, *values, **named)

    Dispatcher._compile_for_args = compile_for_args
    try:
        yield called
    finally:
        Dispatcher._compile_for_args = original


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        listed = list_kernels(Path(made))
    KERNELS.write_text(json.dumps(listed, indent=1) + "\n", "utf-8")
