"""Find the joints and labels that a take begins with (digitization paper, section 3.3).

The performer begins with the arms stretched sideways. The paper does not say how the voxels of that
frame get their segments. Here the hull's shape tells the joints, published proportions tell them
where clothes hide them, and each voxel takes the label of the bone it is nearest to. A person may
place the joints by hand instead (`initial.json`). Performers may wear anything and stand in any
way; only their arms have to show.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from storage.errors import InputError
from storage.schema import JOINTS
from tasks.body.anatomy.nearest_bones import PLACED_JOINTS, label_points
from tasks.body.anatomy.proportions import complete_joints
from tasks.body.initial.frames import WAY_OUT, Candidate, InitialModelSettings, best_frame
from tasks.body.initial.joints import bones_inside, find_joints
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_index

TOLD_FROM = 0.5
"""How much a frame must have lost for a note to say so [shares of `most_lost`]. Chosen by eye on
the shared captures; not measured."""

FARTHEST_M = 0.15
"""How far from every voxel a joint may be. A finger tip that the hull has lost is less far off, a
body beside the hull is farther."""

NOWHERE_M = 1e9
"""A coordinate far from every voxel. It stands for that of a joint that is not known."""


@dataclass(frozen=True, eq=False)
class InitialModel:
    """The joints and labels of the frame that a take begins with."""

    frame: int
    """The frame whose voxels are labelled."""
    position: NDArray[np.float64]
    """(21, 3) metres, joints as in `storage.schema.JOINTS`; NaN where not found."""
    label: NDArray[np.uint8]
    """(voxel,) segment 1 to 11 of that frame's voxels, in order; 0 for pieces off the body."""
    confidence: float
    """From 0 to 1: how well the shape fitted stretched arms, and how whole it was."""
    notes: tuple[str, ...]
    """What a user should know about the model, a sentence each."""


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

    Where that frame has lost a part, the frames around it lend theirs to measure the joints. The
    labels are of the frame's own voxels.

    Parameters
    ----------
    runs
        The take's hulls; at least those of the first `looked_at_s` of the settings.
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
    best = best_frame(runs, grid, rate_hz, settings)
    surface = None
    if surfaces is not None and best.frame < len(surfaces):
        surface = surfaces[best.frame]
    return model_of_frame(best, grid, surface, stature_m, settings)


def model_of_frame(
    best: Candidate,
    grid: VoxelGrid,
    surface: tuple[NDArray[np.integer], NDArray[np.uint8]] | None,
    stature_m: float | None,
    settings: InitialModelSettings,
) -> InitialModel:
    """Return the joints and labels of a frame with stretched arms.

    Parameters
    ----------
    best
        The frame.
    surface : ((surface voxel, 3) index, (surface voxel, 3) RGB), optional
        Its colored surface.
    grid, stature_m, settings
        As for `find_initial_model`.

    Raises
    ------
    InputError
        The joints are not those of a body.
    """
    colored = None
    if surface is not None:
        index, color = surface
        colored = (voxel_centers(grid, index), color)
    joints, sure, notes = find_joints(best.body, best.arms, grid, colored, stature_m)
    refuse_what_is_no_body(best.frame, joints, voxel_centers(grid, best.body), grid, settings)
    label = np.zeros(len(best.index), np.uint8)
    label[best.is_body] = label_points(voxel_centers(grid, best.index[best.is_body]), joints)
    position = np.array([joints.get(name, np.full(3, np.nan)) for name in JOINTS])
    if best.lost > TOLD_FROM * settings.most_lost:
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
    farthest_m: float = FARTHEST_M,
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
        A joint farther than this from every voxel is not the performer's.

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
    missing = [name for name in PLACED_JOINTS if not np.isfinite(joints[name]).all()]
    if missing:
        faults.append(f"{', '.join(missing)} must be placed")
    distance = KDTree(point).query(np.where(np.isfinite(place), place, NOWHERE_M))[0]
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
    missing = [name for name in PLACED_JOINTS if not np.isfinite(joints[name]).all()]
    if missing:
        raise ValueError(f"voxels cannot be labelled without {', '.join(missing)}; place them")
    return label_points(voxel_centers(grid, voxel_index(runs, frame)), complete_joints(joints))


def refuse_what_is_no_body(
    frame: int,
    joints: dict[str, NDArray[np.float64]],
    point: NDArray[np.float64],
    grid: VoxelGrid,
    settings: InitialModelSettings,
) -> None:
    """Refuse joints whose bones lie beside the voxels: they are not those of a body."""
    share = bones_inside(joints, point, grid.voxel_m)
    if share < settings.least_inside:
        raise InputError(
            f"only {share:.0%} of the bones that were found in frame {frame} lie inside the hull, "
            f"where {settings.least_inside:.0%} or more are wanted: something in the hands, a "
            f"second person or other clothes were taken for the arms; {WAY_OUT}"
        )
