"""Captures that doubt is learned from, and others that it is only measured on.

They are chosen by what loses a body: kimonos whose sleeves hang from the wrists, arms that cross
and fold, turns, lunges and low stances, six and eight cameras, performers of 1.1 to 1.85 m. No
motion of the shared captures is among them, and no stretch of motion is in both tables.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tasks.studio.cameras import RingSettings
from tests.benchmarks.bodies.captures import CHILD, NOISY, Plan, film_plans

FRAMES = 130
"""Of each capture: half a second of stretched arms, the way into the dance, and three seconds of
it. Chosen: some thirty of them are filmed and digitized in a quarter of an hour."""

_SIX, _SEVEN = (RingSettings(cameras=count) for count in (6, 7))


def _robe(dance: str, first: int = 0, **others: Any) -> Plan:
    """Return a plan of a dance in a kimono whose sleeves hang from the wrists."""
    return Plan(dance, first, "furisode", **others)


TUNING = {
    "t-fold": _robe("folding"),
    "t-fold-six": _robe("folding-mirrored", ring=_SIX, scale=0.85),
    "t-lunge": _robe("lunging"),
    "t-low-six": _robe("low", ring=_SIX),
    "t-turn": _robe("turn-left"),
    "t-indian-06": _robe("indian/indian_06.bvh", 1400, scale=1.05),
    "t-indian-06-six": _robe("indian/indian_06.bvh", 2000, ring=_SIX),
    "t-indian-08": _robe("indian/indian_08.bvh", 300, scale=1.16),
    "t-indian-08-six": _robe("indian/indian_08.bvh", 900, ring=_SIX),
    "t-indian-13-child": _robe("indian/indian_13.bvh", 300, shape=CHILD),
    "t-martial-03": _robe("martial/martial_03.bvh", 300, scale=1.1),
    "t-martial-03-six": _robe("martial/martial_03.bvh", 1000, ring=_SIX),
    "t-martial-04": _robe("martial/martial_04.bvh", 300, scale=0.95, spoilers=NOISY),
    "t-martial-06-six": _robe("martial/martial_06.bvh", 300, ring=_SIX),
    "t-salsa-01": _robe("salsa/salsa_01.bvh", 300),
    "t-salsa-02-spin": _robe("salsa/salsa_02.bvh", 300, spin=14.0),
    "t-salsa-17-six": _robe("salsa/salsa_17.bvh", 300, ring=_SIX, scale=1.12),
    "t-salsa-18-kimono": Plan("salsa/salsa_18.bvh", 300, "kimono", ring=_SIX),
    "t-child-six": Plan("salsa/salsa_20.bvh", 300, shape=CHILD, ring=_SIX),
    "t-fitting": Plan("martial/martial_03.bvh", 1700, ring=_SIX),
    "t-fold-child": _robe("folding", scale=0.7),
    "t-lunge-six": _robe("lunging", ring=_SIX, scale=0.75),
    "t-turn-six": _robe("turn-left", ring=_SIX, scale=0.85),
    "t-indian-13-six": _robe("indian/indian_13.bvh", 1400, ring=_SIX),
    "t-martial-06-late": _robe("martial/martial_06.bvh", 2500, ring=_SIX),
    "t-martial-04-six": _robe("martial/martial_04.bvh", 500, ring=_SIX, scale=1.1),
    "t-salsa-03-six": _robe("salsa/salsa_03.bvh", 900, ring=_SIX),
    "t-salsa-16-six": _robe("salsa/salsa_16.bvh", 200, ring=_SIX, spin=10.0),
    "t-salsa-05-child": _robe("salsa/salsa_05.bvh", 700, shape=CHILD),
    "t-indian-08-child": _robe("indian/indian_08.bvh", 700, shape=CHILD, ring=_SIX),
    "t-wrapping": _robe("wrapping"),
    "t-raising-mirrored-six": _robe("raising-mirrored", ring=_SIX, scale=0.75, spoilers=NOISY),
    "t-low-seven": _robe("low-mirrored", ring=_SEVEN, scale=0.9),
    "t-turn-seven": _robe("turn-left", ring=_SEVEN, scale=0.7),
    "t-salsa-02-late": _robe("salsa/salsa_02.bvh", 1300, ring=_SEVEN, spoilers=NOISY),
    "t-salsa-16": _robe("salsa/salsa_16.bvh", 600),
    "t-salsa-18-six": _robe("salsa/salsa_18.bvh", 1000, ring=_SIX),
    "t-indian-06-seven": _robe(
        "indian/indian_06.bvh", 1350, ring=_SEVEN, scale=0.85, spoilers=NOISY
    ),
    "t-martial-03-kimono": Plan("martial/martial_03.bvh", 500, "kimono", ring=_SIX, shape=CHILD),
    "t-wrapping-six": _robe("wrapping", ring=_SIX, scale=0.8),
    "t-raising-kimono": Plan("raising-mirrored", 0, "kimono", ring=_SEVEN),
    "t-low-no-start": _robe("low-mirrored", ring=_SIX, opening=False),
    "t-fold-no-start": _robe("folding", opening=False, scale=0.9),
}
"""Captures that the weights of doubt are fitted on."""

MEASURED = {
    "m-fold": _robe("folding-mirrored", scale=1.1),
    "m-fold-six": _robe("folding", ring=_SIX),
    "m-lunge-six": _robe("lunging-mirrored", ring=_SIX, scale=0.8),
    "m-turn-six": _robe("turn-right", ring=_SIX),
    "m-indian-06": _robe("indian/indian_06.bvh", 900),
    "m-indian-08": _robe("indian/indian_08.bvh", 1500, ring=_SIX),
    "m-indian-13": _robe("indian/indian_13.bvh", 900, scale=1.1),
    "m-indian-08-child": _robe("indian/indian_08.bvh", 2100, shape=CHILD),
    "m-martial-03": _robe("martial/martial_03.bvh", 2300),
    "m-martial-04-six": _robe("martial/martial_04.bvh", 900, ring=_SIX),
    "m-martial-06": _robe("martial/martial_06.bvh", 1000, scale=1.16),
    "m-salsa-01-spin": _robe("salsa/salsa_01.bvh", 600, spin=14.0),
    "m-salsa-03-six": _robe("salsa/salsa_03.bvh", 300, ring=_SIX, scale=0.9),
    "m-salsa-20-kimono": Plan("salsa/salsa_20.bvh", 600, "kimono", spoilers=NOISY),
    "m-child": Plan("salsa/salsa_18.bvh", 600, shape=CHILD),
}
"""Captures that nothing is fitted on."""


def make_doubt_captures(folder: Path, data: Path, plans: Mapping[str, Plan]) -> dict[str, Path]:
    """Film the captures that are not there yet; return their folders by name."""
    return film_plans(folder, data, plans, FRAMES)
