"""What a person sees on a terminal while a command runs: log lines, and below them a bar a take.

All of it goes to standard error, and bars only where that is a terminal.
"""

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from flows.progress import Moment, time_left, watching
from tasks.engine.progress import listening

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

_SOON_S = 0.5
"""How long a search may take before a bar is shown [s]. Chosen: what is over sooner needs none."""
_SETTLED_S = 3.0
"""How long work has to go on before a time is told [s]. Chosen: what compiles first looks slow."""
_LEAST_SHARE = 0.05
"""How much of it has to be done before a time is told [share]. Chosen, not measured."""
_NAME_WIDTH = 28
"""How much of a take's name is shown beside its bar [characters]. Chosen by eye: the bar and the
time left fit into 100 columns."""


class _Lines(logging.StreamHandler):
    """Our lines on standard error; other handlers of a logger are the dashboard's."""


def log_to_standard_error(*, quiet: bool, verbose: bool) -> None:
    """Let our modules speak on standard error, a line a message.

    What is not shown here the dashboard may show: it is for the handlers to choose.

    Parameters
    ----------
    quiet
        Only errors.
    verbose
        Also what the stages say.
    """
    of_flows = logging.DEBUG if verbose else logging.INFO
    of_stages = logging.INFO if verbose else logging.WARNING
    for name, level in (("flows", of_flows), ("tasks", of_stages)):
        lines = _Lines(sys.stderr)
        lines.setFormatter(logging.Formatter("%(message)s"))
        lines.setLevel(logging.ERROR if quiet else level)
        logger = logging.getLogger(name)
        others = [each for each in logger.handlers if not isinstance(each, _Lines)]
        logger.handlers[:] = [lines, *others]
        logger.setLevel(min(level, logging.INFO))
        logger.propagate = False


@contextmanager
def bars(*, quiet: bool) -> Iterator[None]:
    """Show a bar for each take that is digitized inside, where somebody may look at it.

    Parameters
    ----------
    quiet
        No bars.
    """
    if quiet or not sys.stderr.isatty():
        yield
        return
    from rich.console import Console  # rich comes with Prefect, which all that have bars need

    console = Console(stderr=True)
    if console.is_dumb_terminal:
        yield
        return
    with _new_progress(console) as progress, _lines_above(console), watching(_Bars(progress).move):
        yield


@contextmanager
def search_bar(*, quiet: bool) -> Iterator[Callable[[list[Any], int], None] | None]:
    """Yield what shows how far a search is, or None where nobody looks at it.

    It is called with the matches until then, and how many of them are certain.

    Parameters
    ----------
    quiet
        No bar.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    begun = time.monotonic()
    with ExitStack() as shown:
        bar: list[tuple[Progress, TaskID]] = []

        def tell(matches: list[Any], certain: int) -> None:
            if not bar:
                if time.monotonic() - begun < _SOON_S:
                    return
                from rich.console import Console  # a tenth of a second, only for a long search

                progress = shown.enter_context(_new_progress(Console(stderr=True)))
                bar.append((progress, progress.add_task("searching", total=1.0, said="")))
            [(progress, task)] = bar
            said = f"{len(matches)} matches so far, {certain} of them certain"
            share = certain / max(len(matches), 1)
            progress.update(task, completed=share, said=said, refresh=True)

        yield tell


@contextmanager
def work_bar(what: str, *, quiet: bool) -> Iterator[None]:
    """Show a bar, and how long it still takes, for work whose loops report how far they are.

    Parameters
    ----------
    what
        What is worked on.
    quiet
        No bar.
    """
    if quiet or not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    begun = time.monotonic()
    with _new_progress(Console(stderr=True)) as progress:
        task = progress.add_task(_short(what), total=1.0, said="")

        def hear(share: float) -> None:
            spent_s = time.monotonic() - begun
            told = spent_s >= _SETTLED_S and share >= _LEAST_SHARE
            said = time_left(spent_s * (1.0 - share) / share) if told else ""
            progress.update(task, completed=share, said=said, refresh=True)

        with listening(hear):
            yield


def _new_progress(console: "Console") -> "Progress":
    """Return the bars, none yet; they leave standard output alone."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TextColumn("{task.fields[said]}", markup=False),
        console=console,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )


class _Bars:
    """A bar for each take in the making, and one for all takes of the run where there are more."""

    def __init__(self, progress: "Progress") -> None:
        self._progress = progress
        self._shown: dict[str, TaskID] = {}
        self._lock = threading.Lock()

    def move(self, moment: Moment) -> None:
        """Show how far a take is; its bar goes when it is done."""
        with self._lock:
            known = self._shown.get(moment.take)
            if moment.share >= 1.0:
                if known is not None:
                    self._progress.remove_task(self._shown.pop(moment.take))
                return
            if known is None:
                known = self._progress.add_task(_short(moment.take or "all"), total=1.0, said="")
                self._shown[moment.take] = known
            self._progress.update(known, completed=moment.share, said=moment.said(), refresh=True)


@contextmanager
def _lines_above(console: "Console") -> Iterator[None]:
    """Print log lines above the bars, which would be torn otherwise."""

    class Above:
        def write(self, text: str) -> None:
            if line := text.rstrip("\n"):
                console.print(line, markup=False, highlight=False, soft_wrap=True)

        def flush(self) -> None:
            console.file.flush()

    handlers = [
        each
        for name in ("flows", "tasks")
        for each in logging.getLogger(name).handlers
        if isinstance(each, _Lines)
    ]
    before = [each.setStream(Above()) for each in handlers]
    try:
        yield
    finally:
        for handler, stream in zip(handlers, before, strict=True):
            if stream is not None:
                handler.setStream(stream)


def _short(name: str) -> str:
    """Return a name as it fits beside a bar."""
    return name if len(name) <= _NAME_WIDTH else name[: _NAME_WIDTH - 1] + "…"
