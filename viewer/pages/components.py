"""The parts of a page that are drawn by JavaScript, and plain HTML controls."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import nicegui
from nicegui import ui

from tasks.rendering.views import SEGMENT_COLORS
from viewer.pairing import BODY

_STATIC = Path(__file__).parents[1] / "static"
_OURS = {"shosa": str(_STATIC / "shosa")}
_THREE = {
    **_OURS,
    "nicegui-scene": str(Path(nicegui.__file__).parent / "elements" / "scene" / "dist"),
}


FIRST_VALUE = "^value"
"""The property of an input that only says what it begins with: what is typed is never undone."""


class Stage(ui.element, component=_STATIC / "stage.js", esm=_THREE):
    """Query and match as they dance, with the controls of playing."""


class Timeline(ui.element, component=_STATIC / "timeline.js", esm=_OURS):
    """A take as a bar, with a clip to be dragged."""


class Curves(ui.element, component=_STATIC / "curves.js", esm=_OURS):
    """A joint over time, and why a match is near."""


class Results(ui.element, component=_STATIC / "results.js", esm=_OURS):
    """The matches of a search."""


class Chooser(ui.element, component=_STATIC / "chooser.js", esm=_OURS):
    """A recording chosen from a list that is filtered here."""


class Takes(ui.element, component=_STATIC / "takes.js"):
    """The recordings of an archive."""


class Films(ui.element, component=_STATIC / "films.js", esm=_OURS):
    """The films of a capture, in step with the stage."""


class BodyEditor(ui.element, component=_STATIC / "body.js", esm=_OURS):
    """The joints and boundaries of a body model, to be dragged."""


def give(element: ui.element, **values: Any) -> None:
    """Give a component new values, and let the browser know."""
    for name, value in values.items():
        element._props[name] = value
    element.update()


def made(kind: type[ui.element], **values: Any) -> ui.element:
    """Return a component with its values."""
    element = kind()
    give(element, **values)
    return element


def make_stage(texts: Mapping[str, str], show: Mapping[str, Any]) -> ui.element:
    """Return a stage on which nobody dances yet; `show` is how it is arranged at first."""
    return made(
        Stage, score=None, body=BODY, texts=dict(texts), show=dict(show),
        segments=SEGMENT_COLORS.tolist(),
    )  # fmt: skip


def tag(name: str, text: str = "", classes: str = "", **attributes: Any) -> ui.element:
    """Return an HTML element with a text; nothing in the text is taken for HTML."""
    element = ui.element(name)
    if text:
        element._text = text
    if classes:
        element.classes(classes)
    for key, value in attributes.items():
        element._props[key.rstrip("_").replace("_", "-")] = value
    return element


def say(element: ui.element, text: str) -> None:
    """Give an element another text."""
    element._text = text
    element.update()


def button(
    text: str, on_click: Callable[..., Any], classes: str = "", **attributes: Any
) -> ui.element:
    """Return a button."""
    made_ = tag("button", text, classes, type="button", **attributes)
    made_.on("click", on_click, args=[])
    return made_


def field(kind: str, value: Any, on_change: Callable[[str], Any], **attributes: Any) -> ui.element:
    """Return an input that calls `on_change` with its text when it was changed."""
    # the value last: a slider rounds it to the steps that it knows of by then
    element = tag("input", type=kind, **attributes, **{FIRST_VALUE: value})
    element.on(
        "change", lambda event: on_change(str(event.args)), js_handler="(e) => emit(e.target.value)"
    )
    return element


def check(
    text: str, *, value: bool, on_change: Callable[[bool], Any], **attributes: Any
) -> ui.element:
    """Return a box to tick, with its label."""
    with tag("label", classes="pick") as label:
        box = tag("input", type="checkbox", checked=value, **attributes)
        box.on(
            "change",
            lambda event: on_change(bool(event.args)),
            js_handler="(e) => emit(e.target.checked)",
        )
        tag("span", text)
    return label
