"""What to compare and what to list: the lower half of the search page's controls."""

from collections.abc import Callable
from dataclasses import replace

from nicegui import ui

from storage.schema import JOINTS
from tasks.motion.stature import DEFAULT_STATURE_M
from tasks.retrieval.meaning.levels import LEVELS
from tasks.retrieval.normalization import PARTS
from viewer.asking import MOST_MATCHES, Asking
from viewer.pages.components import button, check, field, give, say, tag
from viewer.pages.shell import Shell

_WIDEST = 0.3
"""The largest threshold of the slider [statures]. Poses so far apart have nothing in common."""
THRESHOLD_STEP = 0.005
"""From a place of the slider to the next [statures]."""


class SearchForm:
    """Parts, weights, threshold, number of matches, mirror and path; tells each change."""

    def __init__(self, shell: Shell, asking: Asking, changed: Callable[[Asking], None]) -> None:
        """Build the controls where the page stands; `changed` is called with what is asked now."""
        self.shell, self.asking, self.changed = shell, asking, changed
        self.parts: dict[str, ui.element] = {}
        self.sliders: dict[str, tuple[ui.element, ui.element]] = {}
        self.levels: dict[str, ui.element] = {}
        texts = shell.texts
        tag("h2", texts["step_joints"])
        with tag("div", classes="parts", role="group"):
            for part in PARTS:
                self.parts[part] = button(
                    texts[f"part_{part}"], lambda part=part: self.choose_part(part), data_part=part
                )
        with tag("details", data_fold="weights"):
            self.count = tag("summary")
            for joint in JOINTS:
                with tag("div", classes="weight"):
                    tag("span", joint)
                    slider = field(
                        "range", "1", lambda v, j=joint: self.set_weight(j, v), min="0", max="1",
                        step="0.1", aria_label=joint, data_joint=joint,
                    )  # fmt: skip
                    self.sliders[joint] = (slider, tag("output", "1.0"))
            button(texts["equal_weights"], lambda: self.choose_part(self.asking.part), "plain")
        with tag("div", classes="row"):
            tag("label", texts["threshold"])
            shown = (
                _WIDEST + THRESHOLD_STEP
                if asking.threshold is None
                else min(asking.threshold, _WIDEST)
            )
            self.threshold = field(
                "range", f"{shown:g}", self.set_threshold, min=f"{THRESHOLD_STEP}",
                max=f"{_WIDEST + THRESHOLD_STEP}", step=f"{THRESHOLD_STEP}",
                data_control="threshold", aria_label=texts["threshold"],
            )  # fmt: skip
        self.meaning = tag("small")
        with tag("div", classes="parts", role="group"):
            for level in LEVELS:
                self.levels[level] = button(
                    texts[f"level_{level}"], lambda level=level: self.choose_level(level),
                    title=texts[f"level_{level}_title"], data_level=level,
                )  # fmt: skip
        with tag("label", classes="row"):
            tag("span", texts["top"])
            field(
                "number", str(asking.top), self.set_top, min="1", max=str(MOST_MATCHES),
                data_control="top",
            )  # fmt: skip
        check(
            texts["mirror"], value=asking.mirror, data_control="mirror",
            on_change=lambda v: self.take(replace(self.asking, mirror=v)),
        )  # fmt: skip
        with tag("label", classes="row"):
            tag("span", texts["path_weight"])
            field(
                "range", f"{asking.path_weight:g}", self.set_path, min="0", max="1", step="0.05",
                data_control="path",
            )  # fmt: skip
        self.show()

    def choose_part(self, part: str) -> None:
        """Compare the joints of a part, all alike."""
        self.take(replace(self.asking, part=part, weights={}))

    def set_weight(self, joint: str, text: str) -> None:
        """Give a joint another weight."""
        self.take(self.asking.with_weight(joint, float(text)))

    def set_threshold(self, text: str) -> None:
        """Take another threshold; the last place of the slider means none."""
        value = round(float(text), 4)
        self.take(replace(self.asking, threshold=None if value > _WIDEST else value))

    def choose_level(self, level: str) -> None:
        """Take the threshold of a level, or none where it was chosen already."""
        reach = self.asking.levels().get(level)
        chosen = None if self.asking.threshold == reach else reach
        self.take(replace(self.asking, threshold=chosen))

    def set_top(self, text: str) -> None:
        """List another number of matches; what is no number is left as it was."""
        if text.isdigit() and int(text) >= 1:
            self.take(replace(self.asking, top=min(int(text), MOST_MATCHES)))

    def set_path(self, text: str) -> None:
        """Count where the dancer goes by this much."""
        self.take(replace(self.asking, path_weight=float(text)))

    def take(self, asking: Asking) -> None:
        """Take what is asked now, show it, and tell it; a level stays that level."""
        before = self.asking
        level = next((k for k, reach in before.levels().items() if reach == before.threshold), None)
        if level and asking.threshold == before.threshold:
            asking = replace(asking, threshold=asking.levels().get(level))
        self.changed(asking)
        self.asking = asking
        self.show()

    def show(self) -> None:
        """Let the controls show what is asked."""
        asking, texts = self.asking, self.shell
        for part, pressed in self.parts.items():
            chosen = part == asking.part and not asking.weights
            give(pressed, **{"aria-pressed": "true" if chosen else "false"})
        counted = 0
        for joint, (slider, output) in self.sliders.items():
            weight = asking.weight(joint)
            counted += weight > 0
            give(slider, value=f"{weight:g}")
            say(output, f"{weight:.1f}")
        say(self.count, texts.text("weights", count=counted))
        value = asking.threshold
        said = texts.texts["threshold_off"]
        if value is not None:
            cm = f"{100 * value * DEFAULT_STATURE_M:.0f}"
            said = texts.text("threshold_means", value=f"{value:g}", cm=cm)
        say(self.meaning, said)
        give(self.threshold, value=f"{_WIDEST + THRESHOLD_STEP if value is None else value:g}")
        levels = asking.levels()
        for level, pressed in self.levels.items():
            chosen = value is not None and value == levels.get(level)
            give(pressed, **{"aria-pressed": "true" if chosen else "false"})
