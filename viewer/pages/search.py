"""The search page: mark a clip, choose joints, press Search, watch query and match dance."""

import json
import math
import time
from asyncio import get_running_loop, to_thread
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from fastapi import Request
from nicegui import ui

from storage.errors import UnknownNameError
from storage.schema import JOINTS
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.searching import Match
from viewer.answers import find_others
from viewer.asking import Asking, read_address
from viewer.holdings import FILE, Holdings, Motion, matching, performer_of, title_of
from viewer.pages.components import (
    Chooser,
    Curves,
    Timeline,
    give,
    made,
    make_stage,
    say,
    tag,
)
from viewer.pages.found import Found
from viewer.pages.search_form import THRESHOLD_STEP, SearchForm
from viewer.pages.shell import Shell, Site, begin_page
from viewer.pages.turns import Turns
from viewer.pairing import BODY, listed, listed_so_far, pair, shown_motion

MOST_LISTED = 60
"""How many recordings the chooser shows at a time. More are found by typing."""
FIRST_CLIP_S = 2.0
"""How long the clip is that a recording is first shown with [s]. A movement of a dance."""

_SO_FAR_EVERY_S = 0.3
"""How often at most the list of a search that goes on is drawn anew [s]. As one can read along."""

TELLING_JOINTS = ("RWrist", "LWrist", "RFoot", "LFoot", "Head")
"""Of which compared joint the curves are shown unasked: the first of these."""


async def search_page(site: Site, request: Request) -> None:
    """Build the page for one visitor."""
    shell = begin_page(site, request, "search")
    asking, strange = read_address(request.query_params)
    page = SearchPage(site.holdings, shell, asking)
    page.build(request.query_params)
    await ui.context.client.connected()
    with shell.telling():
        await page.begin(strange)


class SearchPage:
    """What one visitor sees, and has asked."""

    def __init__(self, holdings: Holdings, shell: Shell, asking: Asking) -> None:
        self.holdings, self.shell, self.asking = holdings, shell, asking
        self.motion: Motion | None = None
        self.matches: list[Match] = []
        self.asked = asking
        self.busy = False
        self.turns = Turns()

    def build(self, values: Mapping[str, str]) -> None:
        """Build the parts of the page, still empty."""
        texts = dict(self.shell.texts)
        show = {
            "mode": values.get("mode"), "voxels": values.get("voxels"),
            "pinned": values.get("pinned") != "no", "warped": values.get("warped") != "no",
            "follow": values.get("follow") != "no",
        }  # fmt: skip
        joint = values.get("joint") if values.get("joint") in JOINTS else None
        with tag("main", classes="search"):
            with tag("section", classes="controls"):
                with tag("div", classes="controls-scroll"):
                    tag("h2", texts["step_recording"])
                    self.chooser = made(
                        Chooser, chosen={"title": ""}, options=[], more=0, texts=texts
                    )
                    self.chooser.on("filter", lambda e: self.filter(e.args["words"]))
                    self.chooser.on("choose", lambda e: self.choose(e.args["take"]))
                    self.chooser.on("file", lambda e: self.choose_file(e.args["key"]))
                    self.chooser.on("fault", lambda e: self.shell.tell(e.args["why"]))
                    with tag("h2", texts["step_clip"]):
                        self.length = tag("span")
                    self.clip_place = tag("div", title=texts["drag"])
                    self.form = SearchForm(self.shell, self.asking, self.changed)
                with tag("div", classes="controls-foot"):
                    self.press = tag(
                        "button", texts["search_button"], "main", data_control="search"
                    )
                    self.press.on("click", self.search, args=[])
            with tag("section", classes="main-area"):
                self.stage = make_stage(texts, show)
            with tag("section", classes="below"):
                self.curves = made(Curves, score=None, body=BODY, texts=texts, chosen=joint)
                self.joint_chosen = joint is not None
                self.curves.on("joint", self.keep_joint, args=[])
            self.found = Found(self.shell, self.open_match)

    async def begin(self, strange: Sequence[str]) -> None:
        """Show what the address asks for, unless the visitor has asked for something meanwhile."""
        newest, wanted = self.turns.take("recording"), self.asking
        records, damaged = await to_thread(self.holdings.records)
        told = []
        if strange:
            told.append(self.shell.text("left_out", what=", ".join(strange)))
        told += list(damaged.values())[:2]
        danced = [record.take for record in records if "motion" in record.stages]
        self.found.say(self.shell.texts["before_search"])
        motion = await to_thread(self.find_motion, wanted.take) if wanted.take else None
        if not danced and motion is None:
            self.shell.tell(" ".join([self.shell.texts["empty_archive"], *told]))
            return
        if wanted.take and motion is None:
            told.append(self.shell.text("unknown_take", take=wanted.take))
            wanted = replace(wanted, start=None, end=None, searched=False)
        if motion is None:
            motion = await to_thread(self.holdings.motion, danced[0])
        if not newest():
            return
        self.shell.tell(" ".join(told))
        self.show_motion(motion, (wanted.start, wanted.end))
        if wanted.searched:
            await self.search(rank=wanted.match)

    def find_motion(self, take: str) -> Motion | None:
        """Return the motion of a take, also of one newer than the listing; None if there is none.

        Raises
        ------
        ArchiveError
            If it is damaged.
        """
        try:
            motion = self.holdings.motion(take)
        except UnknownNameError:
            return None
        return None if motion.position is None else motion

    async def filter(self, words: str) -> None:
        """Give the chooser the recordings in which the words are."""
        newest = self.turns.take("filter")
        with self.shell.telling():
            if not words:  # the list was opened
                await to_thread(self.holdings.records)
            records = await to_thread(self.holdings.records_at_hand)
            if not newest():
                return
            found = [r for r in matching(records, words) if "motion" in r.stages]
            options = [
                {
                    "take": record.take,
                    "title": title_of(record),
                    "about": self.shell.text(
                        "about_take",
                        performer=f"{performer_of(record)} · " if performer_of(record) else "",
                        take=record.take,
                        seconds=f"{record.frames / record.rate_hz:.0f}",
                    ),
                }
                for record in found[:MOST_LISTED]
            ]
            give(self.chooser, options=options, more=len(found) - len(options))

    async def choose(self, take: str) -> None:
        """Show another recording."""
        newest = self.turns.take("recording")
        with self.shell.telling():
            motion = await to_thread(self.holdings.motion, take)
            if newest():
                self.shell.tell("")
                self.show_motion(motion)

    def choose_file(self, key: str) -> None:
        """Show a file that was dropped on the page, and search with the whole of it."""
        self.turns.take("recording")
        with self.shell.telling():
            motion = self.holdings.motion(key, FILE)
            self.shell.tell("")
            self.show_motion(motion)

    def show_motion(
        self, motion: Motion, clip: tuple[int | None, int | None] = (None, None)
    ) -> None:
        """Show a motion, with the clip that is asked for or a first one."""
        self.motion = motion
        last = motion.frames - 1
        start, end = clip
        if start is None or end is None:
            long = round(FIRST_CLIP_S * motion.rate_hz)
            start = 0 if motion.version == FILE else max(0, (last - long) // 2)
            end = last if motion.version == FILE else min(last, start + long)
        start = min(start, max(0, last - 1))
        end = max(min(end, last), min(start + 1, last))
        is_file = motion.version == FILE
        self.asking = replace(
            self.asking, take="" if is_file else motion.name, file=motion.name if is_file else "",
            start=start, end=end,
        )  # fmt: skip
        title = motion.title + (f" — {motion.performer}" if motion.performer else "")
        give(self.chooser, chosen={"title": title, "take": motion.name})
        self.clip_place.clear()
        with self.clip_place:
            texts = {
                name: self.shell.texts[name]
                for name in ("clip_start", "clip_end", "frames", "seconds")
            }
            timeline = made(
                Timeline, motion=shown_motion(motion, start, end), body=BODY, texts=texts
            )
            timeline.on("clip", lambda e: self.set_clip(int(e.args["first"]), int(e.args["last"])))
            timeline.on("fault", lambda e: self.shell.tell(str(e.args["why"])))
        self.show_query()
        self.changed(self.asking)

    def set_clip(self, first: int, last: int) -> None:
        """Take another clip of the recording."""
        self.asking = replace(self.asking, start=first, end=last)
        self.show_query()
        self.changed(self.asking)

    def show_query(self) -> None:
        """Let the stage dance the clip alone."""
        self.turns.take("stage")
        motion, start, end = self.motion, self.asking.start, self.asking.end
        assert motion is not None
        assert start is not None
        assert end is not None
        seconds = f"{(end - start) / motion.rate_hz:.1f}"
        say(self.length, self.shell.text("clip_of", seconds=seconds))
        self.show(
            {"query": shown_motion(motion, start, end), "match": None, "strong": self.strong()}
        )

    def keep_joint(self) -> None:
        """Keep the joint of the curves, which the visitor has chosen."""
        self.joint_chosen = True

    def strong(self) -> list[int]:
        """Return the joints with weight."""
        return [k for k, joint in enumerate(JOINTS) if self.asking.weight(joint) > 0]

    def changed(self, asking: Asking) -> None:
        """Take other settings; what is listed is then of another query."""
        clip_kept = replace(asking, start=self.asking.start, end=self.asking.end)
        parts_changed = asking.part != self.asking.part or asking.weights != self.asking.weights
        self.asking = replace(
            clip_kept, take=self.asking.take, file=self.asking.file, searched=False, match=1
        )
        self.form.asking = self.asking
        if parts_changed and self.motion is not None:
            self.show_query()
        self.write_address()
        self.tell_outdated()

    def tell_outdated(self) -> None:
        """Say where what is listed is of another query than that which is asked now."""
        same = replace(self.asked, searched=False, match=1) == self.asking
        if self.matches or (self.asked.searched and not same):
            self.found.mark(outdated=not same)

    async def search(self, _event: Any = None, *, rank: int = 1) -> None:
        """Search the archive, and open the best match if the query is still the same."""
        if self.busy or self.motion is None:
            return
        self.busy = True
        asking, motion = self.asking, self.motion
        try:
            self.shell.tell("")
            records = await to_thread(self.holdings.records_at_hand)
            self.press.props("disabled")
            self.found.wait(len(records))
            clip = (asking.start or 0, asking.end or 0)
            loop = get_running_loop()

            settings = asking.settings()
            told_s = -math.inf

            def tell(matches: list[Match], certain: int) -> None:
                nonlocal told_s
                if time.monotonic() - told_s > _SO_FAR_EVERY_S:
                    told_s = time.monotonic()
                    rows = listed_so_far(self.holdings, matches, certain, settings)
                    loop.call_soon_threadsafe(self.found.list_so_far, rows, certain)

            answer = await to_thread(find_others, self.holdings, motion, clip, settings, tell=tell)
            rows = await to_thread(listed, self.holdings, answer, self.shell.texts)
            self.asked = replace(asking, searched=True, match=rank)
            self.matches = answer.matches
            self.found.list(answer, rows, f"/report?{self.asked.report_address()}")
            if self.asking == asking:
                self.asking = self.asked
                await self.open_best(rank)
                if not self.matches and asking.threshold is not None:
                    await self.offer_nearest(asking, motion, clip)
            else:  # something else is asked by now; it stays as it is
                self.tell_outdated()
        except Exception as error:
            self.matches = []
            self.found.give_up()
            self.shell.tell_fault(error)
        finally:
            self.busy = False
            self.found.waiting.classes("empty")
            self.press.props(remove="disabled")

    async def offer_nearest(self, asking: Asking, motion: Motion, clip: tuple[int, int]) -> None:
        """Offer the threshold from which on there is a match, where a search found none."""
        wider = replace(asking.settings(), threshold=None, top=1)
        answer = await to_thread(find_others, self.holdings, motion, clip, wider)
        if not answer.matches or self.asking != self.asked:
            return
        enough = math.ceil(answer.matches[0].distance / THRESHOLD_STEP) * THRESHOLD_STEP

        async def loosen() -> None:
            self.form.set_threshold(f"{enough:.4f}")
            await self.search()

        self.found.offer(self.shell.text("loosen", value=f"{enough:g}"), loosen)

    async def open_best(self, rank: int) -> None:
        """Open a match of a new answer, or dance the clip alone where there is none."""
        if self.matches:
            await self.open_match(min(rank, len(self.matches)))
        else:
            self.found.say(self.advice())
            self.show_query()
        self.write_address()

    def advice(self) -> str:
        """Return what to loosen where nothing was found."""
        names = ["advice_threshold"] if self.asking.threshold is not None else []
        names += ["advice_path"] if self.asking.path_weight else []
        names += ["advice_part"] if set(PARTS[self.asking.part]) == set(JOINTS) else []
        names += ["advice_shorter", "advice_more"]
        said = self.shell.texts["and"].join(self.shell.texts[name] for name in names)
        return self.shell.text("nothing", advice=said)

    async def open_match(self, rank: int) -> None:
        """Show one match with the query that found it."""
        if not 1 <= rank <= len(self.matches) or self.motion is None:
            return
        newest, asked = self.turns.take("stage"), self.asked
        with self.shell.telling():
            motion = (
                self.holdings.motion(asked.file, FILE)
                if asked.file
                else await to_thread(self.holdings.motion, asked.take)
            )
            clip = (asked.start or 0, asked.end or 0)
            give(self.found.results, chosen=rank)
            match = self.matches[rank - 1]
            score = await to_thread(pair, self.holdings, motion, clip, match, asked.settings())
            if not newest():
                return
            self.show(score)
            self.asking = replace(self.asking, match=rank, searched=True)
            self.write_address()

    def show(self, score: dict[str, Any]) -> None:
        """Give the stage and the curves what they show."""
        give(self.stage, score=score)
        if not self.joint_chosen:
            compared = {JOINTS[k] for k in score["strong"]}
            joint = next(
                (j for j in TELLING_JOINTS if j in compared), min(compared, default="Head")
            )
            give(self.curves, chosen=joint)
        give(self.curves, score=score)

    def write_address(self) -> None:
        """Write what is asked into the address, so that it can be shared."""
        ui.run_javascript(f"window.shosa?.setAddress({json.dumps(self.asking.address())})")
