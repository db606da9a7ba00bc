"""Choose the frame that a take begins with: whole, of one person, with stretched arms.

Performers hold the pose for some frames. Together these tell what the hull of one of them has lost.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cc3d
import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from tasks.body.initial.arms import UPPER_SHARE, Arms, measure_arms, missing_reach
from tasks.body.initial.held_hulls import (
    OWN,
    beyond_others,
    farthest_lost,
    frames_around,
    held_crop,
    pieces_of_body,
)
from tasks.engine.settings import Count, Positive, Share, check_ranges
from tasks.engine.threads import side_by_side
from tasks.geometry.sides import cut_off_at
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, join_runs, voxel_centers, voxel_index

WAY_OUT = "begin with the arms stretched sideways, or place the joints in initial.json"
"""What to do about a take without such a frame."""

CELL = 0.02
"""Edge of the cubes by which frames are compared [heights of the performer]. A finger's
thickness."""

CLEARLY = 0.02
"""How much higher a later frame's score must be for the frame to be taken. Chosen by eye on the
shared captures; not measured."""

LEAST_VOXELS = 500
"""Voxels below which a frame shows nobody. Chosen by eye on the shared captures; not measured."""

WITHOUT_HANDS = 0.5
"""What is left of the score of a frame that has lost a hand [share]. Chosen by eye on the shared
captures; not measured."""

ROUGHEST = 0.1
"""How far an arm's bare part may be from its line [half spans]. Chosen by eye on the shared
captures; not measured."""

SMOOTH = 0.03
"""How far an arm's bare part usually is from its line [half spans]. Chosen by eye on the shared
captures; not measured."""

ROUGH_SCORE = 0.3
"""What is left of the score of a frame whose arms are rough [share]. Chosen by eye on the shared
captures; not measured."""

SLOPE_COST = 0.5
"""What an arm of the steepest slope takes off the score [share]. Chosen by eye on the shared
captures; not measured."""

CLOTHED_SCORE = 0.5
"""What is left of the score of a frame whose arms hide in hanging cloth [share]. Chosen by eye on
the shared captures; not measured."""

LOOKS_A_SECOND = 6.0
"""How often a later frame is looked at [1/s]. A pose that is asked for is held for longer; chosen
by eye on the shared captures, not measured."""

FEW = 2000
"""How many voxels tell whether a frame is worth a closer look [voxels]. Chosen by eye on the shared
captures; not measured."""

NEARLY = 0.9
"""Share of an arm's least reach with which a frame is looked at closely. The few voxels end before
the finger tips."""

LEAST_LATER = 0.5
"""Score from which a later frame is taken. Where the pose was held it was 0.69 and more in eighteen
captures, while dancing 0.24 at most in ten."""


@dataclass(frozen=True)
class InitialModelSettings:
    """Everything that changes an initial model, and nothing that does not.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    search_s: Positive = 1.0
    """Frames that begin within this time are looked at. The pose is held at the beginning."""
    frames: Count = 8
    """How many frames of the first `search_s` are looked at, evenly spread. Neighbors differ
    little."""
    reach: Positive = 0.35
    """How far from the middle an arm reaches at least [heights of the performer]. Stretched ones
    reach 0.45 to 0.57 (crouching), hanging ones 0.2."""
    steepest: Positive = 0.36
    """Largest slope of an arm from straight sideways [tangent]. 20 degrees; chosen by eye on
    the shared captures, not measured."""
    least_inside: Share = 0.75
    """How much of the bones' lengths lies in the hull at least. Less is no body: 0.94 to 1 where
    the arms are stretched, 0.42 to 0.58 with a fan or an umbrella in the hand, or two people in
    one."""
    held_s: Positive = 0.067
    """Frames so much earlier and later tell what a frame has lost. At 30 Hz two of each: errors in
    silhouettes come and go in that time, and who begins to dance moves by a few voxels."""
    most_lost: Positive = 0.08
    """How far a part that a frame has lost reaches from what it has, when it counts fully against
    the frame [heights of the performer]. Three quarters of a hand, which is 0.108 long; half as
    far counts hardly (0.94 of the score is left)."""
    second_person: Share = 0.35
    """Voxels of a second piece from which it is another person and no speck, as a share of the
    first piece. Chosen by eye on the shared captures; not measured."""

    def __post_init__(self) -> None:
        check_ranges(self)

    @property
    def looked_at_s(self) -> float:
        """How much of a take an initial model needs, s: the frames searched and those around them.

        Twice `held_s` is more than the frames after the last one span, so that rounding to whole
        frames leaves none of them out.
        """
        return self.search_s + 2.0 * self.held_s


@dataclass(frozen=True, eq=False)
class Candidate:
    """A frame with its person's voxels and arms."""

    frame: int
    index: NDArray[np.int32]
    is_body: NDArray[np.bool_]
    body: NDArray[np.int64]
    """(voxel, 3) index of the person's voxels, with those put back that the frame has lost."""
    arms: Arms
    lost: float
    """How far from the frame's own voxels a part is that it has lost, in heights of the
    performer."""
    score: float


def best_frame(
    runs: VoxelRuns, grid: VoxelGrid, rate_hz: float, settings: InitialModelSettings
) -> Candidate:
    """Return the whole frame that shows stretched arms best.

    Parameters
    ----------
    runs, grid
        The take's hulls and what was carved.
    rate_hz
        Frames a second.
    settings
        What is looked at, and what counts as stretched.

    Raises
    ------
    InputError
        If there is none: what was seen instead, and what to do.
    """
    count = min(runs.frames, max(1, round(settings.search_s * rate_hz)))
    frames = np.unique(np.linspace(0, count - 1, min(settings.frames, count)).astype(int))
    looked: list[Candidate] = []
    seen: list[tuple[int, str]] = []

    def look(frame: int) -> Candidate | str:
        around = frames_around(frame, runs.frames, round(settings.held_s * rate_hz))
        return _look_at(runs, grid, frame, around, settings)

    for frame, found in zip(frames.tolist(), side_by_side(look, frames.tolist()), strict=True):
        if isinstance(found, str):
            seen.append((frame, found))
        else:
            looked.append(found)
    if not looked:
        raise InputError(
            f"no frame of the first {settings.search_s:g} s shows one whole person with stretched "
            f"arms: {first_of_each_kind(seen) or 'there are no frames'}; {WAY_OUT}"
        )
    best, *others = _without_what_is_lost(looked, settings)
    for found in others:
        best = found if found.score > best.score + CLEARLY else best
    return best


def _without_what_is_lost(
    looked: Sequence[Candidate], settings: InitialModelSettings
) -> list[Candidate]:
    """Return the frames with their scores lowered by what each has lost and others show."""
    height = max(float(np.ptp(one.body[:, 1])) for one in looked)
    lacks = beyond_others([one.body for one in looked], max(1, round(CELL * height))) / height
    lost = [max(one.lost, lack) for one, lack in zip(looked, lacks.tolist(), strict=True)]
    return [
        replace(one, lost=far, score=one.score * math.exp(-((far / settings.most_lost) ** 4)))
        for one, far in zip(looked, lost, strict=True)
    ]


def _look_at(
    runs: VoxelRuns, grid: VoxelGrid, frame: int, around: Sequence[int],
    settings: InitialModelSettings,
) -> Candidate | str:  # fmt: skip
    """Return a frame with its arms, or what is wrong with it."""
    index = voxel_index(runs, frame)
    if len(index) < LEAST_VOXELS:
        return f"there are only {len(index)} voxels"
    crop, begin = held_crop(runs, frame, around)
    pieces = np.asarray(cc3d.connected_components(crop > 0, connectivity=26))
    held = np.argwhere(crop)
    piece = pieces[tuple(held.T)]
    sizes = np.sort(np.bincount(piece)[1:])[::-1]
    if fault := _second_person(sizes, settings):
        return fault
    keeps = pieces_of_body(held, piece, grid.voxel_m)
    held = held[keeps[piece]]
    is_own = crop[tuple(held.T)] == OWN
    is_body = keeps[pieces[tuple((index - begin).T)]]
    body = held + begin
    height = max(float(np.ptp(body[:, 1])), 1.0) * grid.voxel_m
    lost = farthest_lost(body, is_own) * grid.voxel_m / height
    if lost <= CELL:  # the flicker of a hull's surface
        body = body[is_own]
    if fault := _outside(body, grid):
        return fault
    point = voxel_centers(grid, body)
    arms = measure_arms(point, grid.voxel_m)
    if arms is None:
        return f"nothing reaches to two sides of a performer {height:.2f} m high"
    score = _judge(arms, height, settings)
    if isinstance(score, str):
        return score
    if missing_reach(point, arms) > 1.0:
        score *= WITHOUT_HANDS
    return Candidate(frame, index, is_body, body, arms, lost, score)


def first_of_each_kind(seen: Sequence[tuple[int, str]]) -> str:
    """Return what is wrong with frames, by their numbers: one of each kind, and how many it is of.

    What differs in its numbers only is of one kind.
    """
    kinds: dict[str, list[tuple[int, str]]] = {}
    for frame, text in seen:
        kinds.setdefault(re.sub(r"\d+(\.\d+)?", "", text), []).append((frame, text))
    told = ((len(same) - 1, *same[0]) for same in kinds.values())
    return "; ".join(
        f"in frame {frame} {text}{f' (and so in {more} more)' if more else ''}"
        for more, frame, text in told
    )


def why_not_whole(
    index: NDArray[np.integer], grid: VoxelGrid, settings: InitialModelSettings
) -> str:
    """Return why voxels (voxel, 3) are not one whole person, or "" where they are."""
    if len(index) < LEAST_VOXELS:
        return f"there are only {len(index)} voxels"
    begin = index.min(axis=0)
    crop = np.zeros(np.ptp(index, axis=0) + 1, np.uint8)
    crop[tuple((index - begin).T)] = 1
    pieces = np.asarray(cc3d.connected_components(crop, connectivity=26))
    sizes = np.sort(np.bincount(pieces[crop > 0])[1:])[::-1]
    return _second_person(sizes, settings) or _outside(index, grid)


def _second_person(sizes: NDArray[np.integer], settings: InitialModelSettings) -> str:
    """Return what is wrong where the second of pieces, the largest first, is large, else ""."""
    if len(sizes) < 2 or sizes[1] <= settings.second_person * sizes[0]:
        return ""
    return (
        f"there are two large pieces of {sizes[0]} and {sizes[1]} voxels, as of two people "
        "or of one that is torn apart (one person at a time can be digitized)"
    )


def _outside(body: NDArray[np.integer], grid: VoxelGrid) -> str:
    """Return what is wrong where voxels (voxel, 3) touch a side of the volume, else ""."""
    for axis, end in cut_off_at(body, grid.shape):
        return (
            f"the performer is partly outside the volume ({(body[:, axis] == end).sum()} voxels "
            f"touch its side at {'xyz'[axis]} = {grid.origin_m[axis] + end * grid.voxel_m:.2f} m; "
            "enlarge the [volume])"
        )
    return ""


def best_later_frame(
    hulls: Sequence[VoxelRuns], grid: VoxelGrid, rate_hz: float, settings: InitialModelSettings
) -> Candidate | None:
    """Return the frame after the first `search_s` that shows stretched arms best, None where none.

    Arms that are stretched while dancing are not held: such a frame has to be a good one.

    Parameters
    ----------
    hulls
        Of the whole take, a single frame each; they may be made when they are asked for.
    grid, rate_hz, settings
        As for `best_frame`.
    """
    best = None
    begun = round(settings.search_s * rate_hz)
    for frame in range(begun, len(hulls), max(1, round(rate_hz / LOOKS_A_SECOND))):
        if not _may_stretch(hulls[frame], settings):
            continue
        around = frames_around(frame, len(hulls), round(settings.held_s * rate_hz))
        first, last = min(frame, *around), max(frame, *around)
        runs = join_runs([hulls[n] for n in range(first, last + 1)])
        found = _look_at(runs, grid, frame - first, [n - first for n in around], settings)
        if isinstance(found, str):
            continue
        score = found.score * math.exp(-((found.lost / settings.most_lost) ** 4))
        if score > max(LEAST_LATER, best.score if best else 0.0):
            best = replace(found, frame=frame, score=score)
    return best


def _may_stretch(hull: VoxelRuns, settings: InitialModelSettings) -> bool:
    """Return whether the upper part of a hull reaches to two opposite sides; few voxels tell."""
    index = voxel_index(hull, 0, step=max(1, int(hull.length.sum(dtype=np.int64)) // FEW))
    if len(index) < FEW // 2:
        return False
    height = index[:, 1] - index[:, 1].min()
    upper = index[height > (1.0 - UPPER_SHARE) * height.max()][:, [0, 2]]
    flat = upper - np.median(upper, axis=0)
    farthest = flat[np.argmax((flat**2).sum(axis=1))]
    along = flat @ farthest / max(float(np.linalg.norm(farthest)), 1.0)
    least = NEARLY * settings.reach * height.max()
    return bool(along.max() > least and along.min() < -least)


def _judge(arms: Arms, height: float, settings: InitialModelSettings) -> float | str:
    """Return the score 0 to 1 of stretched arms, or what they are instead."""
    if arms.half_span_m < settings.reach * height:
        return (
            f"the arms reach {arms.half_span_m:.2f} m to each side of a performer {height:.2f} m "
            f"high, where {settings.reach * height:.2f} m or more are wanted"
        )
    if arms.rough_m > ROUGHEST * arms.half_span_m:
        return "no straight line of an arm shows on both sides"
    if arms.slope > settings.steepest:
        degrees = math.degrees(math.atan(arms.slope))
        return f"an arm is not straight sideways but {degrees:.0f} degrees off"
    straight = 1.0 - SLOPE_COST * arms.slope / settings.steepest
    smooth = math.exp(-0.5 * (arms.rough_m / (SMOOTH * arms.half_span_m)) ** 2)
    shown = min(1.0, CLOTHED_SCORE + arms.thin)
    return straight * (ROUGH_SCORE + (1.0 - ROUGH_SCORE) * smooth) * shown
