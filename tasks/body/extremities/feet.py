"""Find the feet in every frame of a take by the colors that they have in the first frames.

A skirt or a kimono hides the legs but ends above the feet. Where the feet differ in color from what
is above them they are found as hands are (`places`), and the knees follow.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.colors import color_cells, count_colors, log_ratio
from tasks.body.anatomy.identity import find_exchanged
from tasks.body.anatomy.skin import SurfaceFrame, separability
from tasks.body.extremities.candidates import LEAST_OWN, MOST_OWN, find_lumps
from tasks.body.extremities.cells import gather_cells
from tasks.body.extremities.moves import Motion
from tasks.body.extremities.paths import FARTHEST_ASIDE, PACE_HZ, best_paths
from tasks.engine.kernels import njit
from tasks.engine.settings import Count, NotNegative, Positive, check_ranges

Floats = NDArray[np.float64]


KNOWN_FROM = 0.5
"""Logarithm of how much likelier a color is on a foot from which it is recognized [nats]. Chosen by
eye on the shared captures; not measured."""

LEAST_SEED = 0.01
"""Foot's colors of a cell that lumps are looked for around [as of the initial foot]. As of a hand,
`CandidateSettings.least_seed`."""

TAKEN = 3.0
"""What it costs, on top of what is told, that the initial model has the feet for each other [nats].
By their sides the feet of a whole take cost 7 to 40 nats less as they are than exchanged where they
were right, in rendered captures."""

STAYED = 0.1
"""How far feet move at most that stand as they did in the initial frame [statures]. What their
sides tell there the initial model has heard."""

ENOUGH_MASS = 2.0
"""By what a foot's colors are multiplied before less than all of them costs. Half a foot may be
hidden; chosen by eye on the shared captures, not measured."""


@dataclass(frozen=True)
class FootSettings:
    """Everything that changes where feet are found; lengths in statures.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    cell: Positive = 0.0125
    """Edge of a cell of the surface [statures]. 2 cm, as for hands."""

    radius: Positive = 0.05
    """Radius of the ball that holds most of a foot [statures]. 8 cm; what is so near the line from
    heel to toe is a foot, too."""

    apart: Positive = 0.05
    """Least distance of two feet's middles [statures]. A foot's width."""

    highest: Positive = 0.4
    """How far above the lowest voxel a foot is looked for [statures]. Higher, skin is a hand's; a
    foot kicked higher is not seen."""

    least_mass: NotNegative = 0.2
    """Foot's colors in the ball below which there is none [as of the initial foot]. Chosen by eye
    on the shared captures; not measured."""

    most: Count = 5
    """Most places that are looked at in a frame. Chosen by eye on the shared captures; not
    measured."""

    unseen: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which a foot is not seen [nats]. As of a hand."""

    none: NotNegative = 3.0
    """Cost of a frame (at 30 Hz) in which a foot is where none of its colors are [nats]. As of a
    hand."""

    side: NotNegative = 0.06
    """Cost of a frame (at 30 Hz) in which a foot is as far on the other side as feet typically are
    on their own [nats]. Less than of a hand, for who stands with crossed legs stands so for
    long."""

    typical_side: Positive = 0.06
    """How far to its side a foot typically is [statures]. As far as the hip."""

    together: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which both feet are one lump [nats]. As of hands."""

    motion: Motion = field(default_factory=Motion)
    """How feet move."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class FootColors:
    """What colors the feet have that the legs have not."""

    ratio: NDArray[np.float32]
    """(cell of `anatomy.colors`,) logarithm of how much likelier a color is on a foot."""

    known: float
    """Share of the feet's voxels that are recognized less that of the legs'; of 0 colors say
    nothing."""

    mass: float
    """The sum of the ratios of one foot's voxels in the first frames."""

    place: Floats
    """(2, 3) the middle of the right and the left foot in the first frames, m."""


def learn_feet(
    frames: Sequence[SurfaceFrame],
    joints: Mapping[str, Floats],
    stature_m: float,
    settings: FootSettings,
) -> FootColors | None:
    """Return the colors of the feet of frames that stand as the joints say.

    Parameters
    ----------
    frames
        Of the initial model, or near it.
    joints : mapping of (3,) float64
        Metres, by name; both feet's toes and ankles or heels are wanted.
    stature_m
        The performer's height.
    settings
        What is a foot.

    Returns
    -------
    FootColors or None
        None where the joints have no feet, or no foot shows.
    """
    names = [side + name for side in "RL" for name in ("Heel", "Foot")]
    if not all(np.isfinite(joints.get(name, np.nan)).all() for name in names):
        return None
    ends = [(joints[side + "Heel"], joints[side + "Foot"]) for side in "RL"]
    cells, kinds, places = [], [], []
    for frame in frames:
        own = frame.camera != NO_CAMERA
        center = frame.center[own]
        if not len(center):
            continue
        low = center[:, 1] < center[:, 1].min() + settings.highest * stature_m
        kind = np.full(len(center), -1)
        kind[low] = 0
        for number, (heel, toe) in enumerate(ends, 1):
            way = np.subtract(toe, heel)
            along = np.clip((center - heel) @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
            away = np.linalg.norm(center - heel - along[:, None] * way, axis=1)
            kind[low & (away < settings.radius * stature_m)] = number
        if (kind == 1).any() and (kind == 2).any():
            cells.append(color_cells(frame.color[own]))
            kinds.append(kind)
            places.append([center[kind == number].mean(0) for number in (1, 2)])
    if not places:
        return None
    cell, kind = np.concatenate(cells), np.concatenate(kinds)
    feet, legs = cell[kind > 0], cell[kind == 0]
    ratio = np.clip(log_ratio(count_colors(feet), count_colors(legs)), LEAST_OWN, MOST_OWN)
    known = separability(ratio, feet, legs, least=KNOWN_FROM)
    mass = float(np.maximum(ratio[feet], 0.0).sum()) / (2 * len(cells))
    place = np.median(np.array(places), axis=0)
    return FootColors(ratio.astype(np.float32), known, max(mass, 1.0), place)


def find_feet_of(
    frame: SurfaceFrame, colors: FootColors, stature_m: float, settings: FootSettings
) -> tuple[Floats, Floats]:
    """Return where a foot could be (candidate, 3), m, and how much of it shows (candidate,).

    1 is as much as in the first frames.
    """
    low = _find_low(frame.center, frame.camera, settings.highest * stature_m)
    if not len(low):
        return np.empty((0, 3)), np.empty(0)
    ratio = colors.ratio[color_cells(frame.color[low])].astype(np.float64)
    cells = gather_cells(frame.center[low], ratio[None], settings.cell * stature_m)
    _, place, mass = find_lumps(
        cells, 0, colors.mass, settings.radius * stature_m, settings.apart * stature_m,
        (LEAST_SEED, settings.least_mass, settings.most),
    )  # fmt: skip
    return place, mass


def choose_feet(
    candidates: Sequence[tuple[Floats, Floats]],
    colors: FootColors,
    face: Floats,
    facing: Floats,
    rate_hz: float,
    stature_m: float,
    initial_frame: int,
    settings: FootSettings,
    exchange_cost: Callable[[], float] | None = None,
) -> tuple[Floats, Floats, bool]:
    """Return where the right and the left foot are, by one best path of both (Viterbi).

    Parameters
    ----------
    candidates
        As `find_feet_of` returned them, a frame each.
    colors
        Of the feet.
    face, facing : (time, 3) float64
        Where the face is, m, and where it looks; NaN where unseen.
    rate_hz, stature_m, initial_frame
        Of the take.
    settings
        What is likely.
    exchange_cost
        Tells what it costs that the feet were taken for each other in the initial frame, on top of
        `TAKEN` [nats]; asked where the take speaks for it. Without it, they surely were not.

    Returns
    -------
    position : (time, 2, 3) float64
        Metres; NaN where a foot is not seen.
    weight : (time, 2) float64
        0 to 1: how sure that is.
    taken : bool
        Whether the feet were taken for each other in the initial frame.
    """
    pace = PACE_HZ / rate_hz
    spot = [place / stature_m for place, _ in candidates]
    costs = []
    for (place, mass), seen, front in zip(candidates, face, facing, strict=True):
        side = _aside(place, seen, front, stature_m, settings)
        own = colors.known * settings.none * (1.0 - np.clip(ENOUGH_MASS * mass, 0.0, 1.0))
        costs.append(((own + side) * pace, (own - side) * pace))
    position, weight, _ = best_paths(
        (spot, spot),
        ([right for right, _ in costs], [left for _, left in costs]),
        (colors.place[0] / stature_m, colors.place[1] / stature_m),
        initial_frame,
        1.0 / rate_hz,
        settings.motion,
        (settings.unseen * pace, settings.unseen * pace),
        together=settings.together * pace,
    )
    sides = [
        _aside(places * stature_m, seen, front, stature_m, settings)
        for places, seen, front in zip(position, face, facing, strict=True)
    ]
    aside = 2.0 * pace * (np.array(sides) @ [1.0, -1.0])
    first, last = _still_around(position, initial_frame)
    aside[first:last] = 0.0

    def exchanged_at(cost: float) -> NDArray[np.bool_]:
        return find_exchanged(position, aside, rate_hz, initial_frame, cost)

    exchanged = exchanged_at(TAKEN if exchange_cost else np.inf)
    if exchange_cost and exchanged[initial_frame]:
        exchanged = exchanged_at(TAKEN + exchange_cost())
    position[exchanged], weight[exchanged] = position[exchanged, ::-1], weight[exchanged, ::-1]
    return position * stature_m, weight * colors.known, bool(exchanged[initial_frame])


def _still_around(position: Floats, frame: int) -> tuple[int, int]:
    """Return the first of the frames around one in which feet stand as they do in it, and the end.

    `position` is (time, 2, 3) in statures.
    """
    away = np.linalg.norm(position - position[frame], axis=2)
    moved = (away > STAYED).any(axis=1)
    before, after = np.flatnonzero(moved[:frame]), np.flatnonzero(moved[frame:])
    first = int(before[-1]) + 1 if len(before) else 0
    return first, frame + int(after[0]) if len(after) else len(position)


def _aside(
    place: Floats, face: Floats, facing: Floats, stature_m: float, settings: FootSettings
) -> Floats:
    """Return (place,) what a frame at 30 Hz costs a right foot, and gains a left one, by sides."""
    left = np.array([facing[2], 0.0, -facing[0]])
    aside = np.nan_to_num((place - face) @ left / stature_m / settings.typical_side)
    return settings.side * np.clip(aside, -FARTHEST_ASIDE, FARTHEST_ASIDE)


@njit(cache=True, nogil=True)
def _find_low(center: Any, camera: Any, height: Any) -> Any:
    """Return which voxels have their own color and are less than a height above the lowest."""
    least = np.inf
    for n in range(len(center)):
        if camera[n] != NO_CAMERA:
            least = min(least, center[n, 1])
    low = np.empty(len(center), np.int64)
    found = 0
    for n in range(len(center)):
        if camera[n] != NO_CAMERA and center[n, 1] < least + height:
            low[found] = n
            found += 1
    return low[:found]
