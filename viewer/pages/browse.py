"""The browse page: every recording, what is known of it, and the dance itself."""

import contextlib
import json
from asyncio import to_thread
from collections.abc import Mapping
from typing import Any

import numpy as np
from fastapi import Request
from nicegui import ui

from storage.errors import ArchiveError
from storage.index.entries import Entry
from storage.schema import JOINTS
from viewer.holdings import matching, performer_of, title_of
from viewer.pages.about import About
from viewer.pages.components import FIRST_VALUE, Films, Takes, give, made, make_stage, say, tag
from viewer.pages.shell import Shell, Site, begin_page
from viewer.pages.turns import Turns
from viewer.pairing import shown_motion, strip_of

MOST_LISTED = 80
"""How many recordings are listed at a time. More are found by typing."""


async def browse_page(site: Site, request: Request) -> None:
    """Build the page for one visitor."""
    shell = begin_page(site, request, "browse")
    page = BrowsePage(site, shell)
    page.build(request.query_params)
    await ui.context.client.connected()
    with shell.telling():
        await page.begin(
            request.query_params.get("take", ""), request.query_params.get("words", "")
        )


class BrowsePage:
    """What one visitor sees."""

    def __init__(self, site: Site, shell: Shell) -> None:
        self.site, self.holdings, self.shell = site, site.holdings, shell
        self.words = ""
        self.turns = Turns()

    def build(self, values: Mapping[str, str]) -> None:
        """Build the parts of the page, still empty."""
        texts = dict(self.shell.texts)
        with tag("main", classes="browse"):
            with tag("section", classes="takes-side"):
                with tag("div", classes="takes-head"):
                    words = tag(
                        "input", type="text", **{FIRST_VALUE: values.get("words", "")},
                        placeholder=texts["filter"], aria_label=texts["filter"],
                        data_control="filter",
                    )  # fmt: skip
                    words.on(
                        "input", lambda e: self.filter(str(e.args)), throttle=0.15,
                        leading_events=False, js_handler="(e) => emit(e.target.value)",
                    )  # fmt: skip
                    self.count = tag("small", texts["opening"], aria_live="polite")
                self.takes = made(Takes, takes=[], chosen="", texts=texts)
                self.takes.on("choose", lambda e: self.choose(e.args["take"]))
            with tag("section", classes="shown"):
                show = {"single": True, "voxels": values.get("voxels")}
                with tag("div", classes="main-area"):
                    self.stage = make_stage(texts, show)
                    self.films = made(Films, motion=None, texts=texts)
                self.about = About(self.holdings, self.shell, self.described, self.site.run_address)

    async def begin(self, take: str, words: str) -> None:
        """List the recordings, and show one unless the visitor has chosen one meanwhile."""
        newest = self.turns.take("recording")
        first = await self.filter(words)
        records, damaged = await to_thread(self.holdings.records)
        take = take or first or (records[0].take if records else "")
        if not newest():
            return
        if take:
            await self.choose(take)
        else:
            self.shell.tell(self.shell.texts["empty_archive"])
        if damaged:
            self.shell.tell(" ".join(list(damaged.values())[:3]))

    async def filter(self, words: str) -> str:
        """List the recordings in which the words are; return the first one's name."""
        newest = self.turns.take("filter")
        self.words = words
        with self.shell.telling():
            if not words:
                await to_thread(self.holdings.records)
            records = await to_thread(self.holdings.records_at_hand)
            found = matching(records, words)
            rows = await to_thread(self.rows, found[:MOST_LISTED])
            if not newest():
                return ""
            give(self.takes, takes=rows)
            text = self.shell.text("recordings", count=f"{len(found):,}")
            if len(found) > len(rows):
                text += " · " + self.shell.text("more", count=f"{len(found) - len(rows):,}")
            say(self.count, text if found else self.shell.texts["none_found"])
            ui.run_javascript(f"window.shosa?.setAddress({json.dumps({'words': words or None})})")
            return found[0].take if found else ""
        return ""

    def rows(self, records: list[Entry]) -> list[dict[str, Any]]:
        """Return the rows of the list."""
        return [
            {
                "take": record.take,
                "title": title_of(record),
                "performer": performer_of(record),
                "seconds": f"{record.frames / record.rate_hz:.0f}",
                "kind": self.shell.texts["filmed"]
                if "voxels" in record.stages
                else record.source["kind"].upper(),
                "strip": self.strip(record),
            }
            for record in records
        ]

    def strip(self, record: Entry) -> str:
        """Return the picture of some poses of a recording, nothing where it has none."""
        with contextlib.suppress(ArchiveError):
            return strip_of(self.holdings.packed(record), 0, record.frames - 1)
        return ""

    async def choose(self, name: str) -> None:
        """Show a recording."""
        newest = self.turns.take("recording")
        with self.shell.telling():
            motion = await to_thread(self.holdings.motion, name)
            take = await to_thread(self.holdings.take, name)
            doubts = await to_thread(self.doubts, name)
            if not newest():
                return
            give(self.takes, chosen=name)
            is_filmed = take.record.source["kind"] == "capture"
            score = {
                "query": shown_motion(motion, 0, motion.frames - 1),
                "match": None,
                "strong": list(range(len(JOINTS))),
                "marks": doubts,
            }
            give(self.stage, score=score)
            give(self.films, motion=score["query"] if is_filmed else None)
            self.about.show(take.record, doubts)
            ui.run_javascript(f"window.shosa?.setAddress({json.dumps({'take': name})})")
            self.shell.tell("")

    async def described(self, name: str) -> None:
        """Show the words that a recording has now, here and in the list."""
        await self.filter(self.words)
        await self.choose(name)

    def doubts(self, name: str) -> list[list[int]]:
        """Return the stretches of frames of a take that its fit marked as doubtful."""
        take = self.holdings.take(name)
        if "pose" not in take.record.stages:
            return []
        doubtful = np.asarray(take.pose["doubtful"].values, np.bool_)
        edges = np.flatnonzero(np.diff(doubtful, prepend=False, append=False)).reshape(-1, 2)
        return [[int(first), int(end) - 1] for first, end in edges]
