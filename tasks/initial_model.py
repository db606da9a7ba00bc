"""Find the joints and labels that a take begins with (digitization paper, section 3.3).

The performer begins with the arms stretched sideways. The paper does not say how the voxels of
that frame get their segments; here joints are read off the hull's shape, from published
proportions where clothes hide them, and each voxel takes the bone it is nearest to. Whoever
wants to places the joints by hand instead (`initial.json`). What a performer wears and how the
legs stand are free; the arms have to show.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cc3d
import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.geometry.initial_shape import (
    FOREARM_SHARE,
    HIP_SHARE,
    SHOULDER_SHARE,
    UPPER_ARM_SHARE,
    Arms,
    Trunk,
    measure_arms,
    measure_trunk,
    vote_facing,
)
from tasks.geometry.initial_shape_labels import NEEDED, complete_joints, label_points
from tasks.geometry.initial_shape_legs import find_feet, measure_depths, measure_leg
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, padded_crop, voxel_centers, voxel_index

_WAY_OUT = "begin with the arms stretched sideways, or place the joints in initial.json"


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
    second_person: float = 0.35
    """A second piece with so large a share of the first is another person, not a speck."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} {value} must be a finite number larger than 0")


@dataclass(frozen=True, eq=False)
class InitialModel:
    """The joints and labels of the frame that a take begins with."""

    frame: int
    """The frame whose voxels are labelled."""
    position: NDArray[np.float64]
    """(21, 3) metres, joints as in `storage.schema.JOINTS`; NaN where not found."""
    label: NDArray[np.uint8]
    """(voxel,) segment 1 to 11 of that frame's voxels, in order; 0 for specks off the body."""
    confidence: float
    """0 to 1: how well the shape was what is expected of stretched arms."""
    notes: tuple[str, ...]
    """What to know about it, a sentence each."""


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A frame with its person's voxels and arms."""

    frame: int
    index: NDArray[np.int32]
    is_body: NDArray[np.bool_]
    arms: Arms
    score: float


def find_initial_model(
    runs: VoxelRuns,
    grid: VoxelGrid,
    rate_hz: float,
    *,
    surfaces: Sequence[tuple[NDArray[np.integer], NDArray[np.uint8]]] | None = None,
    stature_m: float | None = None,
    settings: InitialModelSettings | None = None,
) -> InitialModel:
    """Return the joints and labels of the frame that shows stretched arms best.

    Parameters
    ----------
    runs
        The take's hulls; at least those of the first second.
    grid
        What was carved.
    rate_hz
        Frames a second.
    surfaces : sequence of ((surface voxel, 3) index, (surface voxel, 3) RGB)
        The colored surface of each frame (as `SurfaceColors`), at least of those looked at:
        the face tells best which way the performer looks. Optional.
    stature_m
        The performer's height, where known; else it is measured.
    settings
        What is looked at, and what counts as stretched.

    Raises
    ------
    InputError
        No frame shows one whole person with stretched arms: what was seen, and what to do.
    ValueError
        The hulls are not on this grid, or the rate or stature is no positive number.
    """
    settings = settings or InitialModelSettings()
    if runs.shape != grid.shape:
        raise ValueError(f"hulls on a grid of {runs.shape} were given with one of {grid.shape}")
    for name, value in (("rate_hz", rate_hz), ("stature_m", stature_m)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} {value} must be a finite number larger than 0")
    best = _best_frame(runs, grid, rate_hz, settings)
    colored = None
    if surfaces is not None and best.frame < len(surfaces):
        index, color = surfaces[best.frame]
        colored = (voxel_centers(grid, index), color)
    point = voxel_centers(grid, best.index[best.is_body])
    joints, vote, notes = _find_joints(point, best, grid, colored, stature_m)
    label = np.zeros(len(best.index), np.uint8)
    label[best.is_body] = label_points(point, joints)
    position = np.array([joints.get(name, np.full(3, np.nan)) for name in JOINTS])
    confidence = float(np.clip(best.score * (0.4 + 0.6 * min(1.0, 2.0 * vote)), 0.0, 1.0))
    return InitialModel(best.frame, position, label, confidence, tuple(notes))


def label_from_joints(
    runs: VoxelRuns, grid: VoxelGrid, frame: int, position: NDArray[np.floating]
) -> NDArray[np.uint8]:
    """Return the label 1 to 11 (voxel,) of a frame's voxels, by the joints alone.

    Parameters
    ----------
    runs, grid
        The hulls and what was carved.
    frame
        Which hull.
    position : (21, 3) float
        Joints of that frame, metres; waist, wrists, ankles and heels may be NaN.

    Raises
    ------
    ValueError
        There is no such frame, or one of the other joints is missing.
    """
    joints = {name: np.asarray(p, np.float64) for name, p in zip(JOINTS, position, strict=True)}
    missing = [name for name in NEEDED if not np.isfinite(joints[name]).all()]
    if missing:
        raise ValueError(f"voxels cannot be labelled without {', '.join(missing)}; place them")
    return label_points(voxel_centers(grid, voxel_index(runs, frame)), complete_joints(joints))


def _best_frame(
    runs: VoxelRuns, grid: VoxelGrid, rate_hz: float, settings: InitialModelSettings
) -> _Candidate:
    """Return the frame that shows stretched arms best, or say what was seen instead."""
    count = min(runs.frames, max(1, round(settings.search_s * rate_hz)))
    frames = np.unique(np.linspace(0, count - 1, min(settings.frames, count)).astype(int))
    best, seen = None, {}
    for frame in frames.tolist():
        found = _look_at(runs, grid, frame, settings)
        if isinstance(found, str):
            seen.setdefault(found, frame)
        elif best is None or found.score > best.score + 0.02:
            best = found
    if best is None:
        what = "; ".join(f"in frame {frame} {text}" for text, frame in seen.items())
        raise InputError(
            f"no frame of the first {settings.search_s:g} s shows one whole person with stretched "
            f"arms: {what or 'there are no frames'}; {_WAY_OUT}"
        )
    return best


def _look_at(
    runs: VoxelRuns, grid: VoxelGrid, frame: int, settings: InitialModelSettings
) -> _Candidate | str:
    """Return a frame with its arms, or what is wrong with it."""
    index = voxel_index(runs, frame)
    if len(index) < 500:
        return f"there are only {len(index)} voxels"
    crop, begin = padded_crop(runs, frame)
    pieces = np.asarray(cc3d.connected_components(crop, connectivity=26))
    piece = pieces[tuple((index - begin).T)]
    sizes = np.sort(np.bincount(piece)[1:])[::-1]
    if len(sizes) > 1 and sizes[1] > settings.second_person * sizes[0]:
        return (
            f"there are two large pieces of {sizes[0]} and {sizes[1]} voxels, as of two people "
            "or of one that is torn apart (one person at a time can be digitized)"
        )
    is_body = piece == np.argmax(np.bincount(piece)[1:]) + 1
    body = index[is_body]
    last = np.array(grid.shape) - 1
    for axis, ends in ((0, (0, last[0])), (1, (last[1],)), (2, (0, last[2]))):
        for end in ends:
            outside = int((body[:, axis] == end).sum())
            if outside > 3:
                return (
                    f"the performer is partly outside the volume ({outside} voxels touch its side "
                    f"at {'xyz'[axis]} = {grid.origin_m[axis] + end * grid.voxel_m:.2f} m; enlarge "
                    "the [volume])"
                )
    point = voxel_centers(grid, body)
    arms = measure_arms(point, grid.voxel_m)
    return _judge(frame, index, is_body, arms, float(np.ptp(point[:, 1])), settings)


def _judge(
    frame: int,
    index: NDArray[np.int32],
    is_body: NDArray[np.bool_],
    arms: Arms | None,
    height: float,
    settings: InitialModelSettings,
) -> _Candidate | str:
    """Return a frame whose arms are stretched with its score, or what they are instead."""
    if arms is None or arms.half_span_m < settings.reach * height:
        reach = 0.0 if arms is None else arms.half_span_m
        return (
            f"the arms reach {reach:.2f} m to each side of a performer {height:.2f} m high, where "
            f"{settings.reach * height:.2f} m or more are wanted"
        )
    if arms.slope > settings.steepest or arms.rough_m > 0.1 * arms.half_span_m:
        degrees = math.degrees(math.atan(arms.slope))
        return f"an arm is not straight sideways but {degrees:.0f} degrees off or bent"
    straight = 1.0 - 0.5 * arms.slope / settings.steepest
    smooth = math.exp(-0.5 * (arms.rough_m / (0.03 * arms.half_span_m)) ** 2)
    shown = min(1.0, 0.5 + arms.thin)
    return _Candidate(frame, index, is_body, arms, straight * (0.3 + 0.7 * smooth) * shown)


def _find_joints(
    point: NDArray[np.float64],
    best: _Candidate,
    grid: VoxelGrid,
    colored: tuple[NDArray[np.float64], NDArray[np.uint8]] | None,
    stature_m: float | None,
) -> tuple[dict[str, NDArray[np.float64]], float, list[str]]:
    """Return the joints of a person's points, how sure the facing is, and notes."""
    arms = best.arms
    trunk = measure_trunk(point, arms, grid.voxel_m, stature_m)
    feet = find_feet(point, arms.left, trunk.hips, trunk.stature_m, grid.voxel_m)
    vote, witnesses = vote_facing(point, arms, trunk, feet, *(colored or (None, None)))
    if vote < 0:
        arms, feet = arms.turned(), feet[::-1]
    notes = ["Wrists, waist and hips were placed by the proportions of a body."]
    if witnesses:
        notes.append(f"Which way the performer faces was told by {' and '.join(witnesses)}.")
    if abs(vote) < 0.2:
        notes.append("Which way the performer faces is doubtful: check right and left.")
    if len(feet) < 2:
        notes.append("The feet could not be told apart: the legs are a guess.")
        feet = [feet[0], feet[0]]
    joints = _place_arms(arms, trunk)
    cells = best.index[best.is_body]
    begin = cells.min(axis=0) - 1
    crop = np.zeros(cells.max(axis=0) - begin + 2, np.uint8)
    crop[tuple((cells - begin).T)] = 1
    depths = measure_depths(crop, voxel_centers(grid, begin), grid.voxel_m)
    for side, name in enumerate("RL"):
        hip = trunk.hips + (2 * side - 1) * HIP_SHARE * trunk.stature_m * arms.left
        leg = measure_leg(feet[side], hip, arms.front, depths, trunk.stature_m)
        joints |= {f"{name}Hip": hip, f"{name}Knee": leg.knee, f"{name}Ankle": leg.ankle}
        joints |= {f"{name}Heel": leg.heel, f"{name}Foot": leg.toe}
    return joints, abs(vote), notes


def _place_arms(arms: Arms, trunk: Trunk) -> dict[str, NDArray[np.float64]]:
    """Return the joints of head, spine and arms."""
    joints = {"Head": trunk.head, "Neck": trunk.neck, "Waist": trunk.waist}
    arm = 1.0 - SHOULDER_SHARE
    elbow = SHOULDER_SHARE + UPPER_ARM_SHARE * arm
    for side, name in enumerate("RL"):
        joints[f"{name}Shoulder"] = arms.along(side, SHOULDER_SHARE)
        joints[f"{name}Elbow"] = arms.along(side, elbow)
        joints[f"{name}Wrist"] = arms.along(side, elbow + FOREARM_SHARE * arm)
        joints[f"{name}Fin"] = arms.tip[side]
    return joints
