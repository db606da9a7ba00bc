"""Captures of known truth that poses are measured on: many dances, bodies, clothes and cameras.

They were chosen before any was digitized, and all are reported. None shows a motion that is
under one of the shared captures.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.stage.bodies import Clothes
from tasks.studio.stage.scenes import Spoilers
from tests.benchmarks.bodies.dances import (
    STUDIO,
    on_floor,
    read_dance,
    reshape,
    spin,
    studio_dance,
    with_opening,
)

FRAMES = 150


@dataclass(frozen=True)
class Plan:
    """What a capture shows, and how it is filmed."""

    dance: str
    """A file below mocap, or a dance of the studio's own."""
    first: int = 0
    """Frame of the file, at the rate that it says."""
    clothes: Clothes = "fitting"
    scale: float = 1.0
    """Of the whole body; of the shared motion, 1.59 m tall."""
    shape: tuple[float, float, float, float] | None = None
    """Legs, trunk, arms and head relative to those of the motion."""
    spin: float = 0.0
    """Degrees a frame added to the dance's own turning, at most."""
    opening: bool = True
    """Whether it begins with arms stretched."""
    rate_hz: float = 30.0
    ring: RingSettings = field(default_factory=RingSettings)
    backdrop: Literal["green", "grey"] = "green"
    spoilers: Spoilers = field(default_factory=Spoilers)


CHILD = (0.62, 0.75, 0.68, 0.95)  # 1.1 m: short legs, a large head
NOISY = Spoilers(noise=5.0, flicker=0.02, drift=0.04, shadow=0.45)

PLANS = {
    "indian-fitting": Plan("indian/indian_08.bvh", 400),
    "indian-kimono": Plan("indian/indian_13.bvh", 300, "kimono"),
    "salsa-six-cameras": Plan("salsa/salsa_01.bvh", 500, ring=RingSettings(cameras=6)),
    "salsa-kimono-twelve": Plan(
        "salsa/salsa_02.bvh", 700, "kimono", ring=RingSettings(cameras=10, overhead=2)
    ),
    "salsa-kimono-noise": Plan("salsa/salsa_17.bvh", 300, "kimono", spoilers=NOISY),
    "martial-fitting": Plan("martial/martial_03.bvh", 900),
    "martial-grey": Plan("martial/martial_04.bvh", 300, backdrop="grey", spoilers=NOISY),
    "salsa-tall-kimono": Plan("salsa/salsa_18.bvh", 500, "kimono", scale=1.1),
    "salsa-small": Plan("salsa/salsa_03.bvh", 600, scale=0.85),
    "indian-child": Plan("indian/indian_08.bvh", 1400, shape=CHILD),
    "spin-fitting": Plan("indian/indian_13.bvh", 900, spin=20.0),
    "spin-kimono": Plan("salsa/salsa_20.bvh", 600, "kimono", spin=12.0),
    "okuri-kimono": Plan("okuri", clothes="kimono"),
    "child-fitting": Plan("child"),
    "salsa-half-rate": Plan("salsa/salsa_05.bvh", 700, "kimono", rate_hz=15.0),
    "six-cameras-kimono-small": Plan(
        "indian/indian_08.bvh", 1000, "kimono", scale=0.9, ring=RingSettings(cameras=6)
    ),
}  # fmt: skip
"""By name, in the order of the table."""


def dance_of(plan: Plan, data: Path, frames: int = FRAMES) -> NDArray[np.float64]:
    """Return the joints (time, 21, 3), m, of what a capture shows."""
    opening = round(0.5 * plan.rate_hz) + round(0.7 * plan.rate_hz) if plan.opening else 0
    if plan.dance in STUDIO:
        danced = plan.scale * studio_dance(plan.dance, plan.rate_hz, frames)
        return with_opening(danced, plan.rate_hz, frames) if plan.opening else danced
    recorded_hz = 60.0 if plan.dance.startswith("salsa") else 120.0
    every = round(recorded_hz / plan.rate_hz)
    danced = frames - opening
    position = read_dance(data / "mocap" / plan.dance, plan.first, every, danced) * plan.scale
    if plan.shape:
        legs, trunk, arms, head = plan.shape
        position = reshape(position, legs=legs, trunk=trunk, arms=arms, head=head)
    position = on_floor(spin(position, plan.spin))
    return with_opening(position, plan.rate_hz, frames) if plan.opening else position


def make_captures(folder: Path, data: Path, only: Sequence[str] = ()) -> dict[str, Path]:
    """Film the captures that are not there yet; return their folders by name."""
    return film_plans(folder, data, PLANS, FRAMES, only)


def film_plans(
    folder: Path, data: Path, plans: Mapping[str, Plan], frames: int, only: Sequence[str] = ()
) -> dict[str, Path]:
    """Film what some plans show and is not there yet; return the folders of captures by name."""
    found = {}
    for seed, (name, plan) in enumerate(plans.items()):
        if only and name not in only:
            continue
        found[name] = folder / name
        if (folder / f"{name}_truth.npz").exists():
            continue
        position = dance_of(plan, data, frames)
        center = position.reshape(-1, 3)
        middle = (center.min(axis=0) + center.max(axis=0)) / 2.0
        reach = np.ptp(center[:, [0, 2]], axis=0).max() / 2.0
        ring = replace(plan.ring, radius_m=max(plan.ring.radius_m, 3.2 + reach))
        film_capture(
            folder / name,
            position,
            plan.rate_hz,
            cameras=generate_cameras(ring, center_m=middle, seed=seed),
            settings=FilmSettings(
                clothes=plan.clothes, backdrop=plan.backdrop, spoilers=plan.spoilers
            ),
            metadata={"title": name, "performer": "generated"},
            seed=seed,
        )
    return found
