"""What is known of a recording: facts, words that can be changed, where one goes from there."""

from asyncio import to_thread
from collections.abc import Awaitable, Callable, Sequence
from urllib.parse import quote

from nicegui import ui

from storage.errors import ConflictError
from storage.records import Record
from storage.schema import JOINTS
from tasks.exporting.models import MOST_FRAMES
from viewer.asking import search_address
from viewer.holdings import Holdings, title_of
from viewer.pages.components import FIRST_VALUE, button, say, tag
from viewer.pages.shell import Shell

_MOST_DOUBTS = 40
"""How many stretches of doubtful frames are listed."""
STAGES = ("silhouettes", "voxels", "labels", "body", "pose", "motion")
"""The stages whose state is shown, in their order."""
EXPORTS = ("bvh", "trc", "c3d", "csv", "glb")
"""The kinds of file in which a take's joints are offered."""
USUAL_FIELDS = ("title", "performer")
"""The fields that can be filled in though a recording says nothing of them."""
MORE_FIELDS = (
    "creator", "contributor", "date", "description", "subject", "coverage", "language", "relation",
    "rights",
)  # fmt: skip
"""Names of Dublin Core that are offered for a further field."""


class About:
    """The facts of one recording at a time."""

    def __init__(
        self,
        holdings: Holdings,
        shell: Shell,
        described: Callable[[str], Awaitable[None]],
        run_address: Callable[[str], str] | None,
    ) -> None:
        """Build the place where the page stands.

        Parameters
        ----------
        described
            Called with the name of a take that has other words now.
        run_address
            Returns where the runs of a take are told; None where that is not known.
        """
        self.holdings, self.shell, self.described = holdings, shell, described
        self.run_address = run_address
        self.place = tag("div", classes="about")

    def show(self, record: Record, doubts: Sequence[Sequence[int]]) -> None:
        """Show what is known of a recording."""
        self.place.clear()
        with self.place:
            with tag("div") as words:
                self.show_words(words, record)
            with tag("div"):
                self.show_stages(record, doubts)
                tag("h2", self.shell.texts["go_on"])
                self.show_links(record)
            with tag("div"):
                tag("h2", self.shell.texts["save_as"])
                self.show_files(record)
                tag("h2", self.shell.texts["said"])
                if record.notes:
                    with tag("ul"):
                        for note in record.notes:
                            tag("li", note)
                else:
                    tag("small", self.shell.texts["nothing_said"])

    def show_words(self, words: ui.element, record: Record) -> None:
        """Show the facts and words of a recording."""
        texts = self.shell.texts
        words.clear()
        with words:
            with tag("h2", title_of(record)):
                button(
                    texts["edit"], lambda: self.edit_words(words, record), "plain",
                    data_control="edit",
                )  # fmt: skip
            seconds = f"{record.frames / record.rate_hz:.1f} s"
            facts = {
                texts["take"]: record.take,
                texts["length"]: f"{record.frames:,} · {seconds} · {record.rate_hz:g} Hz",
                texts["made_from"]: f"{record.source['kind']}, {record.source['name']}",
                **{
                    texts.get(f"field_{name}", name): value
                    for name, value in record.metadata.items()
                    if name != "title"
                },
                texts["version"]: f"{record.number}, {record.published[:16].replace('T', ' ')}",
            }
            with tag("dl"):
                for name, value in facts.items():
                    tag("dt", str(name))
                    tag("dd", str(value))

    def edit_words(self, words: ui.element, record: Record) -> None:
        """Show the words of a recording as fields to be changed."""
        texts = self.shell.texts
        shown = {
            name: str(value)
            for name, value in (dict.fromkeys(USUAL_FIELDS, "") | record.metadata).items()
            if not isinstance(value, dict | list)
        }
        typed: dict[str, str] = {}
        added = {"name": "", "text": ""}
        words.clear()
        with words:
            tag("h2", texts["edit_title"])
            with tag("div", classes="words"):
                for name, value in shown.items():
                    with tag("label"):
                        tag("span", texts.get(f"field_{name}", name))
                        _typing(value, lambda text, name=name: typed.update({name: text}), name)
                with tag("label"):
                    _typing("", lambda text: added.update(name=text), "+name", texts["new_field"])
                    _typing("", lambda text: added.update(text=text), "+text")
                with tag("datalist", id="more-fields"):
                    for name in MORE_FIELDS:
                        tag("option", value=name)
            fault = tag("p", role="alert", classes="empty")

            async def save() -> None:
                said = {name: text for name, text in typed.items() if text != shown[name]}
                if added["name"].strip() or added["text"].strip():
                    said[added["name"].strip()] = added["text"]
                try:
                    await to_thread(self.holdings.describe, record.take, said, record.number)
                except Exception as error:
                    told = (
                        texts["changed_meanwhile"]
                        if isinstance(error, ConflictError)
                        else self.shell.fault_text(error)
                    )
                    say(fault, told)
                    fault.classes(remove="empty")
                    return
                await self.described(record.take)

            with tag("div", classes="links"):
                button(texts["save"], save, "main", data_control="save-words")
                button(
                    texts["cancel"], lambda: self.show_words(words, record), data_control="cancel"
                )
            tag("small", texts["words_only"])

    def show_stages(self, record: Record, doubts: Sequence[Sequence[int]]) -> None:
        """Show what was made of a recording, and which frames are doubtful."""
        tag("h2", self.shell.texts["stages"])
        with tag("div", classes="stages"):
            for stage in STAGES if record.source["kind"] == "capture" else ("motion",):
                tag(
                    "span",
                    self.shell.texts[f"stage_{stage}"],
                    "done" if stage in record.stages else "not",
                )
        missing = [joint for joint in JOINTS if joint not in record.joints_present]
        if missing and "motion" in record.stages:
            tag("small", self.shell.text("missing", joints=", ".join(missing)))
        if doubts:
            tag("h2", self.shell.text("doubtful", count=sum(b - a + 1 for a, b in doubts)))
            with tag("div", classes="links"):
                for first, last in doubts[:_MOST_DOUBTS]:
                    text = f"{first}-{last}" if first != last else f"{first}"
                    shown = tag("button", text, "plain", data_doubt=str(first))
                    shown.on("click", js_handler=f"() => window.shosa.seekFrame({first})")

    def show_links(self, record: Record) -> None:
        """Show where one goes from here."""
        texts, name = self.shell.texts, quote(record.take, safe="")
        with tag("div", classes="links"):
            if "motion" in record.stages:
                long = min(record.frames - 1, round(2 * record.rate_hz))
                start = (record.frames - 1 - long) // 2
                address = search_address(record.take, start, start + long)
                tag("a", texts["search_like"], href=address, data_link="search")
            if "voxels" in record.stages:
                tag("a", texts["correct_body"], href=f"/body?take={name}", data_link="body")
            if self.run_address is not None and record.source["kind"] == "capture":
                tag(
                    "a", texts["its_runs"], href=self.run_address(record.take), target="_blank",
                    rel="noopener", data_link="runs",
                )  # fmt: skip

    def show_files(self, record: Record) -> None:
        """Show the files that a recording can be saved as."""
        texts, name = self.shell.texts, quote(record.take, safe="")
        with tag("div", classes="links"):
            if "motion" in record.stages:
                for kind in EXPORTS:
                    address = f"/export/{name}.{kind}"
                    tag("a", kind.upper(), href=address, download="", data_link=kind)
            if "voxels" in record.stages:
                for what in ("view", "voxels"):
                    title = self.shell.text(f"save_{what}_title", count=MOST_FRAMES)
                    pressed = tag(
                        "button", texts[f"save_{what}"], "plain", title=title, data_link=what
                    )
                    pressed.on(
                        "click",
                        js_handler=f"() => window.shosa.saveFromStage('{what}', {MOST_FRAMES})",
                    )


def _typing(value: str, changed: Callable[[str], object], name: str, hint: str = "") -> ui.element:
    """Return a text field that tells every letter, so that a press of Save has them all."""
    more = {"list": "more-fields"} if name == "+name" else {}
    element = tag(
        "input", type="text", placeholder=hint, data_field=name, **more, **{FIRST_VALUE: value}
    )
    element.on(
        "input", lambda event: changed(str(event.args)), js_handler="(e) => emit(e.target.value)"
    )
    return element
