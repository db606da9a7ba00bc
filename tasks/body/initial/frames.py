"""Choose the frame that a take begins with: whole, of one person, with stretched arms.

Performers hold the pose for some frames, which tell what the hull of one of them has lost.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cc3d
import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from tasks.body.initial.arms import Arms, measure_arms, missing_reach
from tasks.body.initial.held_hulls import (
    OWN,
    beyond_others,
    farthest_lost,
    frames_around,
    held_crop,
    pieces_of_body,
)
from tasks.geometry.sides import cut_off_at
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_index

WAY_OUT = "begin with the arms stretched sideways, or place the joints in initial.json"
"""What to do about a take without such a frame."""
_CELL = 0.02  # how finely frames are compared, in heights: a finger's thickness


@dataclass(frozen=True)
class InitialModelSettings:
    """Everything that changes an initial model, and nothing that does not.

    Raises
    ------
    ValueError
        If a number is not finite or not larger than 0.
    """

    search_s: float = 1.0
    """Frames that begin in this time are looked at: the pose is held at the beginning."""
    frames: int = 8
    """How many of them are looked at, evenly spread: neighbors differ little."""
    reach: float = 0.35
    """An arm reaches at least so far from the middle, in heights of the performer: stretched
    ones reach 0.45 to 0.57 (crouching), hanging ones 0.2."""
    steepest: float = 0.36
    """Tangent of the largest angle of an arm from straight sideways, 20 degrees."""
    least_inside: float = 0.75
    """Share of the bones' lengths that lies in the hull. Less is no body: 0.94 to 1 where the arms
    are stretched, 0.42 to 0.58 with a fan or an umbrella in the hand, or two people in one."""
    held_s: float = 0.067
    """Frames so much earlier and later tell what a frame has lost, at 30 Hz two of each: errors in
    silhouettes come and go in that time, and who begins to dance moves by a few voxels."""
    most_lost: float = 0.08
    """A part that a frame has lost, to so far from what it has, counts against it; half as far does
    hardly (0.94 of the score). In heights: of a hand, 0.108 long, three quarters."""
    second_person: float = 0.35
    """A second piece with so large a share of the first is another person, not a speck."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} {value} must be a finite number larger than 0")


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
    """How far from the frame's own voxels something is that it has lost, in heights."""
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
    looked, seen = [], {}
    for frame in frames.tolist():
        around = frames_around(frame, runs.frames, round(settings.held_s * rate_hz))
        found = _look_at(runs, grid, frame, around, settings)
        if isinstance(found, str):
            seen.setdefault(found, frame)
        else:
            looked.append(found)
    if not looked:
        what = "; ".join(f"in frame {frame} {text}" for text, frame in seen.items())
        raise InputError(
            f"no frame of the first {settings.search_s:g} s shows one whole person with stretched "
            f"arms: {what or 'there are no frames'}; {WAY_OUT}"
        )
    best, *others = _without_what_is_lost(looked, settings)
    for found in others:
        best = found if found.score > best.score + 0.02 else best
    return best


def _without_what_is_lost(
    looked: Sequence[Candidate], settings: InitialModelSettings
) -> list[Candidate]:
    """Return the frames with scores that count what each has lost, of the others' parts too."""
    height = max(float(np.ptp(one.body[:, 1])) for one in looked)
    lacks = beyond_others([one.body for one in looked], max(1, round(_CELL * height))) / height
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
    if len(index) < 500:
        return f"there are only {len(index)} voxels"
    crop, begin = held_crop(runs, frame, around)
    pieces = np.asarray(cc3d.connected_components(crop > 0, connectivity=26))
    held = np.argwhere(crop)
    piece = pieces[tuple(held.T)]
    sizes = np.sort(np.bincount(piece)[1:])[::-1]
    if len(sizes) > 1 and sizes[1] > settings.second_person * sizes[0]:
        return (
            f"there are two large pieces of {sizes[0]} and {sizes[1]} voxels, as of two people "
            "or of one that is torn apart (one person at a time can be digitized)"
        )
    keeps = pieces_of_body(held, piece, grid.voxel_m)
    held = held[keeps[piece]]
    is_own = crop[tuple(held.T)] == OWN
    is_body = keeps[pieces[tuple((index - begin).T)]]
    body = held + begin
    height = max(float(np.ptp(body[:, 1])), 1.0) * grid.voxel_m
    lost = farthest_lost(body, is_own) * grid.voxel_m / height
    if lost <= _CELL:  # the flicker of a hull's surface
        body = body[is_own]
    for axis, end in cut_off_at(body, grid.shape):
        return (
            f"the performer is partly outside the volume ({(body[:, axis] == end).sum()} voxels "
            f"touch its side at {'xyz'[axis]} = {grid.origin_m[axis] + end * grid.voxel_m:.2f} m; "
            "enlarge the [volume])"
        )
    point = voxel_centers(grid, body)
    arms = measure_arms(point, grid.voxel_m)
    if arms is None:
        return f"nothing reaches to two sides of a performer {height:.2f} m high"
    score = _judge(arms, height, settings)
    if isinstance(score, str):
        return score
    if missing_reach(point, arms) > 1.0:
        score *= 0.5
    return Candidate(frame, index, is_body, body, arms, lost, score)


def _judge(arms: Arms, height: float, settings: InitialModelSettings) -> float | str:
    """Return the score 0 to 1 of stretched arms, or what they are instead."""
    if arms.half_span_m < settings.reach * height:
        return (
            f"the arms reach {arms.half_span_m:.2f} m to each side of a performer {height:.2f} m "
            f"high, where {settings.reach * height:.2f} m or more are wanted"
        )
    if arms.rough_m > 0.1 * arms.half_span_m:
        return "no straight line of an arm shows on both sides"
    if arms.slope > settings.steepest:
        degrees = math.degrees(math.atan(arms.slope))
        return f"an arm is not straight sideways but {degrees:.0f} degrees off"
    straight = 1.0 - 0.5 * arms.slope / settings.steepest
    smooth = math.exp(-0.5 * (arms.rough_m / (0.03 * arms.half_span_m)) ** 2)
    shown = min(1.0, 0.5 + arms.thin)
    return straight * (0.3 + 0.7 * smooth) * shown
