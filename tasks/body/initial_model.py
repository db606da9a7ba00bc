"""Stage: the joints and labels that a take begins with (digitization paper, section 3.3).

They are found in a frame with stretched arms (`tasks.body.initial`) at the beginning, or else
anywhere in the take; where there is no such frame they are guessed from several frames
(`tasks.body.guess`). Or a person placed them (`initial.json`). What every later stage has to know
of the performer is measured here, once.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Block, Written, write_block
from storage.errors import InputError
from storage.formats.capture.capture import Capture, capture_of
from storage.formats.capture.initial import read_initial
from storage.schema import JOINTS
from tasks.body.anatomy.nearest_bones import label_points
from tasks.body.anatomy.proportions import complete_joints
from tasks.body.anatomy.shape import measure_body
from tasks.body.guess.search import guess_body
from tasks.body.guess.single_frames import Shown
from tasks.body.initial.frames import (
    InitialModelSettings,
    best_later_frame,
    first_of_each_kind,
    why_not_whole,
)
from tasks.body.initial.search import (
    InitialModel,
    find_initial_model,
    model_from_joints,
    model_of_frame,
    refuse_what_is_no_body,
)
from tasks.capture.films import grid_of
from tasks.geometry.voxels import join_runs, voxel_centers
from tasks.motion.stature import take_stature
from tasks.reconstruction.voxel_frames import HullFrames, VoxelFrames

LOOKED_FOR = 64
"""How many frames are asked at most whether they show one whole person, for a guess [frames]."""

LEAST_FRAMES = 10
"""From how many such frames a body is guessed at least [frames]. One alone tells badly which way a
foot points; ten of ten captures were guessed from sixteen."""

CLEAR_MARGIN = 0.1
"""Margin of the facing from which it is clear [mean logarithm of the voxels' likelihoods]. Of 64
frames the facing was wrong in one, with a margin of 0."""


def model_take(
    archive: str, capture: str, digest: str, hulls: Sequence[Block], colors: Sequence[Block],
    into: str, settings: InitialModelSettings, still: Block | None = None,
) -> Written:  # fmt: skip
    """Find the joints and labels that a take begins with, or take them from `initial.json`.

    Parameters
    ----------
    archive
        Where the blocks are.
    capture, digest
        The folder, and the digest of what is in it.
    hulls, colors
        What `carve_block` and `color_block` wrote, in the order of the frames.
    into
        Path of the block in the archive.
    settings
        Where stretched arms are looked for, and what counts as stretched.
    still
        What `find_still_take` wrote: voxels that are left out.

    Returns
    -------
    Written
        The block is of the one frame that was taken; its arrays are `position` (21, 3), m,
        `label` of the voxels that the frame has without `still`, `confidence`, 0 to 1, and
        `stature_m`: as it was given, or
        measured on these joints. All later stages go by that stature. Where the body was guessed
        there are also `guessed_from` (frame,), the frames; `facing_margin`, how much likelier they
        are than with the body facing the other way, by the mean logarithm of the voxels'
        likelihoods; and `guesses_apart_m`, how far they differ.

    Raises
    ------
    InputError
        If no frame that is looked at shows one performer with stretched arms and the body cannot
        be guessed, or `initial.json` cannot be used.
    """
    begun = time.monotonic()
    source = capture_of(capture, digest)
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(source), hulls, colors, still)
    guessed: dict[str, NDArray] = {}
    if source.initial:
        found = _given_model(source.initial, frames)
    else:
        try:
            found = _model_at_the_beginning(frames, source, settings)
        except InputError as error:
            found = _later_model(frames, source, settings)
            if found is None:
                found, guessed = _guessed_model(frames, source, settings, str(error))
    _check_measurable(found, frames, source.initial)
    arrays = {
        "position": found.position,
        "label": found.label,
        "confidence": np.array(found.confidence),
        "stature_m": np.array(source.stature_m or take_stature(found.position[None])),
        **guessed,
    }
    at = (found.frame, found.frame + 1)
    return write_block(place, into, at, arrays, begun, notes=found.notes)


def _model_at_the_beginning(
    frames: VoxelFrames, source: Capture, settings: InitialModelSettings
) -> InitialModel:
    """Return the model of stretched arms with which the take begins."""
    first = range(min(len(frames), math.ceil(settings.looked_at_s * source.fps)))
    return find_initial_model(
        join_runs([frames.hull(n) for n in first]),
        frames.grid,
        source.fps,
        surfaces=[_surface(frames, n) for n in first],
        stature_m=source.stature_m,
        settings=settings,
    )


def _later_model(
    frames: VoxelFrames, source: Capture, settings: InitialModelSettings
) -> InitialModel | None:
    """Return the model of arms that are stretched later in the take; None where they are not."""
    best = best_later_frame(HullFrames(frames), frames.grid, source.fps, settings)
    if best is None:
        return None
    try:
        return model_of_frame(
            best, frames.grid, _surface(frames, best.frame), source.stature_m, settings
        )
    except InputError:  # the hull is no body's
        return None


def _guessed_model(
    frames: VoxelFrames, source: Capture, settings: InitialModelSettings, fault: str
) -> tuple[InitialModel, dict[str, NDArray]]:
    """Return the model of a body that is guessed from several frames, and how sure it is.

    `fault` is why there is none of stretched arms.
    """
    seen: list[tuple[int, str]] = []
    whole = []
    for frame in np.unique(np.linspace(0, len(frames) - 1, LOOKED_FOR).astype(int)).tolist():
        if why := why_not_whole(frames.index(frame), frames.grid, settings):
            seen.append((frame, why))
        else:
            whole.append(frame)
    if len(whole) < LEAST_FRAMES:
        what = f": {first_of_each_kind(seen)}" if seen else ""
        raise InputError(
            f"{fault}; nor can the body be guessed: {len(whole)} of the frames looked at show one "
            f"whole person, where {LEAST_FRAMES} or more are wanted{what}"
        )
    shown = Shown(HullFrames(frames), frames.grid, frames.surface)
    guess = guess_body(shown, source.fps, whole, source.stature_m)
    center = voxel_centers(frames.grid, frames.index(guess.frame))
    try:
        refuse_what_is_no_body(guess.frame, guess.joints, center, frames.grid, settings)
    except InputError as error:
        raise InputError(f"{fault}; nor can the body be guessed: {error}") from error
    notes = (
        "No frame shows stretched arms: a body of usual proportions was guessed from the frames "
        f"{', '.join(map(str, guess.looked_at))}, which differ by {100 * guess.apart_m:.0f} cm. "
        "Which way the performer faces is "
        f"{'clear' if guess.margin >= CLEAR_MARGIN else 'doubtful: check right and left'}.",
    )
    position = np.array([guess.joints[name] for name in JOINTS])
    label = label_points(center, complete_joints(guess.joints))
    return InitialModel(guess.frame, position, label, guess.confidence, notes), {
        "guessed_from": np.array(guess.looked_at),
        "facing_margin": np.array(guess.margin),
        "guesses_apart_m": np.array(guess.apart_m),
    }


def _given_model(path: Path, frames: VoxelFrames) -> InitialModel:
    """Return the model that a person placed, checked against the voxels of its frame."""
    given = read_initial(path)
    frame = given.frame or 0
    if frame >= len(frames):
        raise InputError(f"{path} is of frame {frame}; the take has the frames 0-{len(frames) - 1}")
    hull, label, kept = frames.hull(frame), given.label, frames.kept(frame)
    if label is not None and kept is not None and len(label) == len(kept):
        label = label[kept]  # a person labels all voxels, those of things among them
    try:
        found = model_from_joints(hull, frames.grid, given.position, frame=0, label=label)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return replace(found, frame=frame)


def _check_measurable(model: InitialModel, frames: VoxelFrames, path: Path | None) -> None:
    """Refuse a model in which a segment has too few voxels, or a joint is missing."""
    center = voxel_centers(frames.grid, frames.index(model.frame))
    try:
        measure_body(center, model.label, model.position)
    except ValueError as error:
        todo = (
            f"correct the joints in {path}"
            if path
            else "take smaller voxels (voxel_m under [volume]), or place the joints in initial.json"
        )
        raise InputError(
            f"the body cannot be measured in frame {model.frame}: {error}; {todo}"
        ) from error


def _surface(frames: VoxelFrames, frame: int) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Return index and color of the surface voxels of a frame."""
    is_surface, color, _ = frames.surface(frame)
    return frames.index(frame)[is_surface], color
