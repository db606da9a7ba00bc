"""What a search page asks, as it stands in the address: every search can be shared as a link."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from urllib.parse import urlencode

from storage.schema import JOINTS, parse_frames
from tasks.retrieval.meaning.levels import LEVELS, level_thresholds
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.searching import SearchSettings
from tasks.retrieval.weighting import GREATEST_WEIGHT

MOST_MATCHES = 500
"""How many matches a page shows at most [matches]. Chosen: nobody reads more."""

_SHOWN = 40
"""How much of what means nothing is shown [characters]."""


@dataclass(frozen=True)
class Asking:
    """A query and its settings, as a page holds them."""

    take: str = ""
    file: str = ""
    """The key of a dropped file, in place of the take."""
    start: int | None = None
    end: int | None = None
    part: str = "whole"
    weights: Mapping[str, float] = field(default_factory=dict)
    """Only those that differ from the part's."""
    top: int = 10
    threshold: float | None = None
    mirror: bool = False
    path_weight: float = 0.0
    match: int = 1
    """The rank of the match that is shown."""
    searched: bool = False

    def settings(self) -> SearchSettings:
        """Return what a search compares."""
        return SearchSettings(
            part=self.part, weights=tuple(self.weights.items()), mirror=self.mirror,
            path_weight=self.path_weight, threshold=self.threshold, top=self.top,
        )  # fmt: skip

    def levels(self) -> dict[str, float]:
        """Return the distance of each level; none where no joint has weight."""
        try:
            return level_thresholds(self.settings())
        except ValueError:  # every weight is zero
            return {}

    def weight(self, joint: str) -> float:
        """Return the weight of a joint."""
        return self.weights.get(joint, 1.0 if joint in PARTS[self.part] else 0.0)

    def with_weight(self, joint: str, weight: float) -> "Asking":
        """Return this with another weight of a joint."""
        usual = 1.0 if joint in PARTS[self.part] else 0.0
        others = {name: value for name, value in self.weights.items() if name != joint}
        return replace(self, weights=others if weight == usual else {**others, joint: weight})

    def address(self) -> dict[str, str | None]:
        """Return the parameters of the address, None for those to leave out."""
        clip = None if self.start is None else f"{self.start}-{self.end}"
        return {
            "take": self.take or None,
            "clip": clip,
            "part": None if self.part == "whole" else self.part,
            "weights": ",".join(f"{joint}:{w:g}" for joint, w in self.weights.items()) or None,
            "top": None if self.top == Asking.top else str(self.top),
            "threshold": None if self.threshold is None else f"{self.threshold:g}",
            "mirror": "yes" if self.mirror else None,
            "path": f"{self.path_weight:g}" if self.path_weight else None,
            "search": "yes" if self.searched and not self.file else None,
            "match": str(self.match) if self.searched and self.match != 1 else None,
        }

    def report_address(self) -> str:
        """Return the parameters of the address of the report of this search."""
        values = {**self.address(), "file": self.file or None, "match": None}
        return urlencode({name: value for name, value in values.items() if value is not None})


def search_address(take: str, start: int, end: int) -> str:
    """Return the address, on this viewer, of a search with a clip."""
    return "/?" + urlencode({"take": take, "clip": f"{start}-{end}"})


def read_address(values: Mapping[str, str]) -> tuple[Asking, list[str]]:
    """Return what an address asks for, and what in it means nothing, as (parameter, value) texts.

    What cannot be understood is left at its usual value: a link that was cut still opens.
    """
    strange: list[str] = []
    start, end = None, None
    if "clip" in values:
        try:
            start, end = parse_frames(values["clip"])
        except ValueError:
            strange.append(f"clip={values['clip'][:_SHOWN]}")
    part = values.get("part", "whole")
    if part not in PARTS:
        strange.append(f"part={part[:_SHOWN]}")
        part = "whole"
    asking = Asking(
        take=values.get("take", "")[:200],
        file=values.get("file", "")[:_SHOWN],
        start=start,
        end=end,
        part=part,
        top=int(_number(values, strange, "top", Asking.top, 1, MOST_MATCHES)),
        mirror=values.get("mirror") == "yes",
        path_weight=_number(values, strange, "path", 0.0, 0.0, 100.0),
        match=int(_number(values, strange, "match", 1, 1, MOST_MATCHES)),
        searched=values.get("search") == "yes",
    )
    asking = _read_weights(asking, values.get("weights", ""), strange)
    return replace(asking, threshold=_threshold(values, strange, asking)), strange


def _threshold(values: Mapping[str, str], strange: list[str], asking: Asking) -> float | None:
    """Return the threshold of the address: a number, or the level that it names."""
    if (name := values.get("threshold", "")) in LEVELS:
        return asking.levels().get(name)
    return _number(values, strange, "threshold", 0, 1e-4, 10) or None


def _number(
    values: Mapping[str, str], strange: list[str], name: str, usual: float, low: float, high: float
) -> float:
    """Return a number of the address, or the usual one where it is none within its range."""
    if name not in values:
        return usual
    try:
        value = float(values[name])
    except ValueError:
        value = math.nan
    if low <= value <= high:
        return value
    strange.append(f"{name}={values[name][:_SHOWN]}")
    return usual


def _read_weights(asking: Asking, said: str, strange: list[str]) -> Asking:
    """Return what is asked with the weights JOINT:W, which commas part."""
    for text in filter(None, said.split(",")):
        joint, _, weight = text.partition(":")
        try:
            value = float(weight)
        except ValueError:
            value = math.nan
        if joint in JOINTS and 0 <= value <= GREATEST_WEIGHT:
            asking = asking.with_weight(joint, value)
        else:
            strange.append(f"weights={text[:_SHOWN]}")
    return asking
