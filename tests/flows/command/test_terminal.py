"""Log lines and bars share a terminal; elsewhere there are no bars; data stay what they are."""

import io
import logging
import re
import sys

import pytest

from flows.command import terminal as module
from flows.command.terminal import bars, log_to_standard_error, search_bar
from flows.progress import Moment, show_watcher


class Terminal(io.StringIO):
    def isatty(self):
        return True

    def text(self):
        """What was written, without the codes that move the cursor and set colors."""
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.getvalue())


@pytest.fixture(autouse=True)
def loggers():
    """Leave the loggers as they were."""
    names = ("flows", "tasks")
    before = [(logging.getLogger(n), logging.getLogger(n).handlers[:]) for n in names]
    levels = [(logger, logger.level, logger.propagate) for logger, _ in before]
    yield
    for logger, handlers in before:
        logger.handlers[:] = handlers
    for logger, level, propagate in levels:
        logger.setLevel(level)
        logger.propagate = propagate


@pytest.fixture
def use(monkeypatch):
    """A function that makes a stream the standard error, until the test ends."""
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "110")

    def use(stream):  # in the test itself: pytest sets its own before each
        monkeypatch.setattr(sys, "stderr", stream)
        return stream

    return use


def moment(share, take="okuri", left_s=200.0):
    return Moment(take, "pose fitting", 300 * share, 300, share, left_s)


def test_a_bar_a_take_stands_below_the_lines(use, capsys):
    terminal = use(Terminal())
    log_to_standard_error(quiet=False, verbose=False)
    with bars(quiet=False):
        show_watcher(moment(0.0))
        show_watcher(moment(0.5, take="x" * 99))
        show_watcher(moment(0.5))
        logging.getLogger("flows.ingestion").info("[1/2] a line with [markup] in it")
        show_watcher(moment(1.0))
        show_watcher(Moment("", "", 1, 2, 0.5, None))
    text = terminal.text()
    assert "[1/2] a line with [markup] in it\n" in text
    assert re.search(r"okuri +\S+ +50% +pose fitting 150/300 frames, about 3 min left", text)
    assert "x" * 27 + "…" in text
    assert "1 of 2 done" in text
    assert capsys.readouterr().out == ""


def test_lines_go_on_after_the_bars(use):
    terminal = use(Terminal())
    log_to_standard_error(quiet=False, verbose=False)
    with bars(quiet=False):
        show_watcher(moment(0.1))
    before = len(terminal.getvalue())
    logging.getLogger("flows").info("after")
    assert terminal.getvalue()[before:] == "after\n"
    show_watcher(moment(0.2))  # and nobody watches any more
    assert terminal.getvalue()[before:] == "after\n"


@pytest.mark.parametrize("why", ["quiet", "no terminal", "dumb"])
def test_there_are_no_bars_where_nobody_wants_or_can_see_them(use, monkeypatch, why):
    terminal = use(io.StringIO() if why == "no terminal" else Terminal())
    if why == "dumb":
        monkeypatch.setenv("TERM", "dumb")
    log_to_standard_error(quiet=why == "quiet", verbose=False)
    with bars(quiet=why == "quiet"):
        show_watcher(moment(0.5))
        logging.getLogger("flows").info("a line")
    assert terminal.getvalue() == ("" if why == "quiet" else "a line\n")


def test_an_error_takes_the_bars_away_and_gives_the_cursor_back(use):
    terminal = use(Terminal())
    log_to_standard_error(quiet=False, verbose=False)  # not to a stream of another test

    def fail():
        with bars(quiet=False):
            show_watcher(moment(0.5))
            raise KeyError("a fault")

    with pytest.raises(KeyError, match="a fault"):
        fail()
    assert "\x1b[?25h" in terminal.getvalue()


@pytest.mark.parametrize(
    ("options", "lines"),
    [
        ({"quiet": False, "verbose": False}, ["flows info", "tasks warning", "tasks error"]),
        ({"quiet": True, "verbose": False}, ["tasks error"]),
        (
            {"quiet": False, "verbose": True},
            ["flows debug", "flows info", "tasks info", "tasks warning", "tasks error"],
        ),
    ],
)
def test_the_terminal_shows_what_was_asked_and_other_handlers_at_least_what_is_told(
    use, options, lines
):
    """Other handlers are the dashboard's: it gets what our modules say, whatever is shown here."""
    terminal = use(Terminal())
    heard = []
    other = logging.Handler()
    other.emit = lambda record: heard.append(record.getMessage())
    for name in ("flows", "tasks"):
        logging.getLogger(name).handlers[:] = [other]
    for _ in range(2):  # as when a program calls the command twice
        log_to_standard_error(**options)
    for name, level in (
        ("flows", "debug"), ("flows", "info"), ("tasks", "info"), ("tasks", "warning"),
        ("tasks", "error"),
    ):  # fmt: skip
        getattr(logging.getLogger(name), level)(f"{name} {level}")
    assert terminal.getvalue().splitlines() == lines
    assert {"flows info", "tasks info", "tasks warning", "tasks error"} <= set(heard)


def test_a_search_that_takes_long_says_what_is_certain(use, monkeypatch):
    terminal = use(Terminal())
    with search_bar(quiet=False) as tell:
        tell(["a", "b"], 1)
    assert terminal.getvalue() == ""
    monkeypatch.setattr(module, "_SOON_S", 0.0)
    with search_bar(quiet=False) as tell:
        tell(["a", "b", "c", "d"], 1)
    assert "25% 4 matches so far, 1 of them certain" in terminal.text()


def test_a_search_that_nobody_looks_at_has_no_bar(use):
    use(io.StringIO())
    with search_bar(quiet=False) as tell:
        assert tell is None
