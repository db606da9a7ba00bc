"""Find the joints and labels that a take begins with (digitization paper, section 3.3).

The performer begins with the arms stretched sideways. The paper does not say how the voxels of
that frame get their segments; here joints are read off the hull's shape, from published
proportions where clothes hide them, and each voxel takes the bone it is nearest to. Whoever
wants to places the joints by hand instead (`initial.json`). What a performer wears and how the
legs stand are free; the arms have to show. The pose is held for some frames, which tell what the
hull of one of them has lost.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cc3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.geometry.doubts import cut_off_at
from tasks.geometry.held_hulls import (
    OWN,
    beyond_others,
    farthest_lost,
    frames_around,
    held_crop,
    pieces_of_body,
)
from tasks.geometry.initial_shape import Arms, measure_arms, missing_reach
from tasks.geometry.initial_shape_joints import bones_inside, find_joints
from tasks.geometry.initial_shape_labels import NEEDED, complete_joints, label_points
from tasks.geometry.initial_shape_picture import draw_from
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_index

_WAY_OUT = "begin with the arms stretched sideways, or place the joints in initial.json"
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
class InitialModel:
    """The joints and labels of the frame that a take begins with."""

    frame: int
    """The frame whose voxels are labelled."""
    position: NDArray[np.float64]
    """(21, 3) metres, joints as in `storage.schema.JOINTS`; NaN where not found."""
    label: NDArray[np.uint8]
    """(voxel,) segment 1 to 11 of that frame's voxels, in order; 0 for specks off the body."""
    confidence: float
    """0 to 1: how well the shape was what is expected of stretched arms, and how whole it was."""
    notes: tuple[str, ...]
    """What to know about it, a sentence each."""


@dataclass(frozen=True, eq=False)
class _Candidate:
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


def find_initial_model(
    runs: VoxelRuns,
    grid: VoxelGrid,
    rate_hz: float,
    *,
    surfaces: Sequence[tuple[NDArray[np.integer], NDArray[np.uint8]]] | None = None,
    stature_m: float | None = None,
    settings: InitialModelSettings | None = None,
) -> InitialModel:
    """Return the joints and labels of the whole frame that shows stretched arms best.

    Joints are measured with what the frames around it have and it has lost; labels are of its own
    voxels.

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
    joints, sure, notes = find_joints(best.body, best.arms, grid, colored, stature_m)
    _refuse_what_is_no_body(best.frame, joints, voxel_centers(grid, best.body), grid, settings)
    label = np.zeros(len(best.index), np.uint8)
    label[best.is_body] = label_points(voxel_centers(grid, best.index[best.is_body]), joints)
    position = np.array([joints.get(name, np.full(3, np.nan)) for name in JOINTS])
    if best.lost > 0.5 * settings.most_lost:
        notes.append(
            "Parts of the body that other frames show are not in this frame's hull: what the "
            "frames around it have was put back."
        )
    confidence = float(np.clip(best.score * sure, 0.0, 1.0))
    return InitialModel(best.frame, position, label, confidence, tuple(notes))


def model_from_joints(
    runs: VoxelRuns,
    grid: VoxelGrid,
    position: NDArray[np.floating],
    *,
    frame: int | None = None,
    label: NDArray[np.integer] | None = None,
    farthest_m: float = 0.15,
) -> InitialModel:
    """Return the initial model of joints that a person placed (`initial.json`).

    Parameters
    ----------
    runs, grid
        The take's hulls and what was carved.
    position : (21, 3) float
        Joints of that frame, metres; waist, wrists, ankles and heels may be NaN and are put in
        by proportion.
    frame
        The frame they belong to; 0 where None.
    label : (voxel,) int
        Segments of that frame's voxels; made from the joints where None.
    farthest_m
        A joint farther than this from every voxel is not the performer's: a finger tip that the
        hull has lost is less far off, a body beside the hull farther.

    Raises
    ------
    InputError
        There is no such frame or nobody in it, joints are missing or outside the body, or the
        labels are not those of its voxels: every fault at once.
    """
    chosen = 0 if frame is None else frame
    if not 0 <= chosen < runs.frames:
        raise InputError(
            f"frame {chosen} of the initial model is not one of the take's frames 0 to "
            f"{runs.frames - 1}; correct `frame`"
        )
    point = voxel_centers(grid, voxel_index(runs, chosen))
    if not len(point):
        raise InputError(f"frame {chosen} of the initial model shows nobody; choose another frame")
    place = np.array(position, np.float64)
    joints = dict(zip(JOINTS, place, strict=True))
    faults = []
    missing = [name for name in NEEDED if not np.isfinite(joints[name]).all()]
    if missing:
        faults.append(f"{', '.join(missing)} must be placed")
    distance = KDTree(point).query(np.where(np.isfinite(place), place, 1e9))[0]
    found = np.asarray(np.isfinite(place).all(axis=1))
    for number in np.flatnonzero(found & (distance > farthest_m)):
        faults.append(
            f"{JOINTS[number]} is {distance[number]:.2f} m outside the body of frame {chosen}"
        )
    if label is not None and len(label) != len(point):
        faults.append(
            f"there are {len(label)} labels for {len(point)} voxels of frame {chosen} (leave them "
            "out and they are made from the joints)"
        )
    if faults:
        raise InputError(
            f"the initial model does not fit the take: {'; '.join(faults)}; correct initial.json"
        )
    whole = complete_joints(joints)
    notes = ["The joints were placed by a person (initial.json)."]
    if added := [name for name, is_in in zip(JOINTS, found.tolist(), strict=True) if not is_in]:
        notes.append(f"{', '.join(added)} were put in by the proportions of a body.")
    made = label_points(point, whole) if label is None else np.array(label, np.uint8)
    return InitialModel(chosen, np.array([whole[name] for name in JOINTS]), made, 1.0, tuple(notes))


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
            f"arms: {what or 'there are no frames'}; {_WAY_OUT}"
        )
    best, *others = _without_what_is_lost(looked, settings)
    for found in others:
        best = found if found.score > best.score + 0.02 else best
    return best


def _without_what_is_lost(
    looked: Sequence[_Candidate], settings: InitialModelSettings
) -> list[_Candidate]:
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
) -> _Candidate | str:  # fmt: skip
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
    return _Candidate(frame, index, is_body, body, arms, lost, score)


def _refuse_what_is_no_body(
    frame: int,
    joints: dict[str, NDArray[np.float64]],
    point: NDArray[np.float64],
    grid: VoxelGrid,
    settings: InitialModelSettings,
) -> None:
    """Refuse joints whose bones lie beside the voxels: something else was taken for the arms."""
    share = bones_inside(joints, point, grid.voxel_m)
    if share < settings.least_inside:
        raise InputError(
            f"only {share:.0%} of the bones that were found in frame {frame} lie inside the hull, "
            f"where {settings.least_inside:.0%} or more are wanted: something in the hands, a "
            f"second person or other clothes were taken for the arms; {_WAY_OUT}"
        )


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


def draw_initial_model(model: InitialModel, runs: VoxelRuns, grid: VoxelGrid) -> NDArray[np.uint8]:
    """Return a picture of the labelled voxels with the joints, from the front and the left.

    Returns
    -------
    (480, 960, 3) uint8
        RGB. Seen from the front the performer's left is on the right.

    Raises
    ------
    ValueError
        The model's labels are not those of its frame's voxels.
    """
    point = voxel_centers(grid, voxel_index(runs, model.frame))
    if len(point) != len(model.label) or not len(point):
        raise ValueError(
            f"a model of {len(model.label)} labels was given with {len(point)} voxels of frame "
            f"{model.frame}; pass the hulls it was made of, with somebody in that frame"
        )
    joints = dict(zip(JOINTS, model.position, strict=True))
    across = (joints["LShoulder"] - joints["RShoulder"]) * [1.0, 0.0, 1.0]
    left = across / max(float(np.linalg.norm(across)), 1e-9)
    back = -np.cross(left, [0.0, 1.0, 0.0])
    label = np.asarray(model.label, np.uint8)
    title = f"frame {model.frame}, confidence {model.confidence:.2f}"
    front = draw_from(point, label, joints, left, title)
    return np.concatenate([front, draw_from(point, label, joints, back, "from the left")], axis=1)
