"""Stage: the joints and labels that a take begins with (digitization paper, section 3.3).

They are found in a frame with stretched arms (`tasks.body.initial`), or a person placed them
(`initial.json`). What every later stage has to know of the performer is measured here, once.
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
from storage.formats.capture.capture import capture_of
from storage.formats.capture.initial import read_initial
from tasks.body.anatomy.shape import measure_body
from tasks.body.initial.frames import InitialModelSettings
from tasks.body.initial.search import InitialModel, find_initial_model, model_from_joints
from tasks.capture.films import grid_of
from tasks.geometry.voxels import join_runs, voxel_centers
from tasks.motion.stature import take_stature
from tasks.reconstruction.voxel_frames import VoxelFrames


def model_take(
    archive: str, capture: str, digest: str, hulls: Sequence[Block], colors: Sequence[Block],
    into: str, settings: InitialModelSettings,
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

    Returns
    -------
    Written
        The block is of the one frame that was taken; its arrays are `position` (21, 3), m,
        `label` of the frame's voxels, `confidence`, 0 to 1, and `stature_m`: as it was given, or
        measured on these joints. All later stages go by that stature.

    Raises
    ------
    InputError
        If no frame that is looked at shows one performer with stretched arms, or `initial.json`
        cannot be used.
    """
    begun = time.monotonic()
    source = capture_of(capture, digest)
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(source), hulls, colors)
    if source.initial:
        found = _given_model(source.initial, frames)
    else:
        first = range(min(len(frames), math.ceil(settings.looked_at_s * source.fps)))
        found = find_initial_model(
            join_runs([frames.hull(n) for n in first]),
            frames.grid,
            source.fps,
            surfaces=[_surface(frames, n) for n in first],
            stature_m=source.stature_m,
            settings=settings,
        )
    _check_measurable(found, frames, source.initial)
    arrays = {
        "position": found.position,
        "label": found.label,
        "confidence": np.array(found.confidence),
        "stature_m": np.array(source.stature_m or take_stature(found.position[None])),
    }
    at = (found.frame, found.frame + 1)
    return write_block(place, into, at, arrays, begun, notes=found.notes)


def _given_model(path: Path, frames: VoxelFrames) -> InitialModel:
    """Return the model that a person placed, checked against the voxels of its frame."""
    given = read_initial(path)
    frame = given.frame or 0
    if frame >= len(frames):
        raise InputError(f"{path} is of frame {frame}; the take has the frames 0-{len(frames) - 1}")
    hull = frames.hull(frame)
    try:
        found = model_from_joints(hull, frames.grid, given.position, frame=0, label=given.label)
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
