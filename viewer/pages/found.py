"""What a search found: its list, how it was found, and what to do where it is empty."""

from collections.abc import Awaitable, Callable
from typing import Any

from tasks.retrieval.answering import Answer
from viewer.pages.components import Results, button, give, made, say, tag
from viewer.pages.shell import Shell

_MOST_SKIPPED = 50
"""How many recordings that were not compared are named [takes]."""


class Found:
    """The list of matches, and the words about it."""

    def __init__(self, shell: Shell, choose: Callable[[int], Awaitable[None]]) -> None:
        """Build the list where the page stands; `choose` is called with the rank of a match."""
        self.shell, texts = shell, shell.texts
        with tag("section", classes="found") as self.place:
            with tag("div", classes="found-head"):
                tag("h2", texts["results"])
                self.summary = tag("span", aria_live="polite")
                self.detail = tag("small")
                self.waiting = tag("div", classes="progress empty")
                self.extras = tag("div")
            self.note = tag("div", texts["opening"], "found-note")
            self.offered = tag("div", classes="found-note empty")
            self.results = made(Results, matches=[], chosen=0, searching=False, texts=dict(texts))
            self.results.on("choose", lambda e: choose(int(e.args["rank"])))

    def say(self, text: str) -> None:
        """Show a sentence in place of a list, or nothing."""
        _show(self.note, text)

    def wait(self, takes: int) -> None:
        """Show that so many takes are searched."""
        self.waiting.classes(remove="empty")
        _show(self.summary, self.shell.text("searching", count=f"{takes:,}"))
        _show(self.detail, "")
        _show(self.note, "")
        self.offered.classes("empty")

    def list_so_far(self, rows: list[dict[str, Any]], certain: int) -> None:
        """List what a search has found until now; nothing of it can be chosen yet."""
        self.place.classes(remove="outdated")
        give(self.results, matches=rows, chosen=0, searching=True)
        _show(self.detail, self.shell.text("so_far", matches=len(rows), certain=certain))

    def give_up(self) -> None:
        """Show that nothing is searched any more, and nothing was found."""
        _show(self.summary, "")
        _show(self.detail, "")
        give(self.results, matches=[], chosen=0, searching=False)

    def list(self, answer: Answer, rows: list[dict[str, Any]], report: str) -> None:
        """List what was found; `report` is the address of the page to be saved."""
        self.place.classes(remove="outdated")
        seconds = f"{answer.seconds:.1f}"
        takes = len({match.take for match in answer.matches})
        name = {0: "summary_none", 1: "summary_one"}.get(len(rows), "summary")
        counted = self.shell.text(name, matches=len(rows), takes=takes, seconds=seconds)
        _show(self.summary, counted)
        counts = {"takes": f"{answer.searched_takes:,}", "frames": f"{answer.searched_frames:,}"}
        _show(self.detail, self.shell.text("searched", **counts))
        self.extras.clear()
        with self.extras:
            if rows:
                tag(
                    "a", self.shell.texts["report"], href=report, download="",
                    title=self.shell.texts["report_title"], data_link="report",
                )  # fmt: skip
            if answer.skipped:
                with tag("details"):
                    tag("summary", self.shell.text("skipped", count=len(answer.skipped)))
                    for take, why in list(answer.skipped.items())[:_MOST_SKIPPED]:
                        tag("div", f"{take}: {why}", "soft")
        give(self.results, matches=rows, chosen=0, searching=False)
        _show(self.note, "")

    def mark(self, *, outdated: bool) -> None:
        """Say whether the list is of another query than that which is asked now."""
        self.place.classes("outdated") if outdated else self.place.classes(remove="outdated")
        _show(self.note, self.shell.texts["outdated"] if outdated else "")

    def offer(self, text: str, act: Callable[[], Awaitable[None]]) -> None:
        """Offer to search again otherwise."""
        self.offered.clear()
        with self.offered:
            button(text, act, data_control="loosen")
        self.offered.classes(remove="empty")


def _show(element: Any, text: str) -> None:
    """Give an element a text; without one it takes no room."""
    element.classes(remove="empty") if text else element.classes("empty")
    say(element, text)
