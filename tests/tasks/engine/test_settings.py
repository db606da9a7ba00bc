"""What settings say of themselves, and what is refused."""

import math
from dataclasses import dataclass, field
from typing import Literal

import pytest

from tasks.engine.settings import (
    Count,
    NotNegative,
    Positive,
    Share,
    accepted_values,
    check_ranges,
    list_settings,
)


@dataclass(frozen=True)
class Inner:
    """Of a step."""

    fall: Share = 0.3
    """How much less may be seen. Chosen on two takes."""


@dataclass(frozen=True)
class Outer:
    """Of a stage."""

    reach_m: Positive = 0.6
    """How far a hand may be. Arms are 0.55 to 0.65."""
    speed: NotNegative = 5.0
    """How fast a hand moves [statures a second]. A punch is 5."""
    rings: Count = 20
    """Rings at most. More are wrong."""
    rule: Literal["chroma", "crcb"] = "chroma"
    """Which rule. The first measured better."""
    scale: Positive | None = None
    """Metres in a unit. Told by the file."""
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self) -> None:
        check_ranges(self)


def test_settings_tell_name_unit_meaning_and_reason():
    found = {each.name: each for each in list_settings(Outer(), "stage.")}
    assert list(found) == [
        "stage.reach_m", "stage.speed", "stage.rings", "stage.rule", "stage.scale",
        "stage.inner.fall",
    ]  # fmt: skip
    assert (found["stage.reach_m"].unit, found["stage.reach_m"].value) == ("m", 0.6)
    assert found["stage.speed"].unit == "statures a second"
    assert found["stage.speed"].meaning == "How fast a hand moves."
    assert found["stage.speed"].reason == "A punch is 5."
    assert found["stage.inner.fall"].unit == "share"
    assert found["stage.rings"].accepted == "a whole number 1 or more"
    assert found["stage.rule"].accepted == 'one of "chroma", "crcb"'


def test_all_faults_are_told_at_once_with_their_ranges():
    with pytest.raises(ValueError, match="larger than 0") as refused:
        Outer(reach_m=0.0, speed=math.nan, rings=2.5, rule="hue", scale=-1.0)  # type: ignore[arg-type]
    for name in ("reach_m", "speed", "rings", "rule", "scale"):
        assert f"{name} is " in str(refused.value)


@pytest.mark.parametrize("value", [True, "1", None, math.inf, -math.inf])
def test_what_is_no_number_is_no_number(value):
    with pytest.raises(ValueError, match=r"reach_m is .*, it must be a number larger than 0"):
        Outer(reach_m=value)


def test_a_whole_number_is_a_number_too():
    assert Outer(reach_m=1, speed=0).reach_m == 1


def test_ranges_are_said_in_words():
    assert accepted_values(Share) == "a number 0 or more and at most 1"
