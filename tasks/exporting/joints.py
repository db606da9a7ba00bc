"""Write a take's joints for other programs: TRC, C3D, CSV, GLB, or BVH by a fitted skeleton."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.errors import InputError
from storage.formats.motion.bvh import write_bvh
from storage.formats.motion.c3d import write_c3d
from storage.formats.motion.joint_csv import write_joint_csv
from storage.formats.motion.trc import write_trc
from storage.places import told
from storage.schema import JOINTS
from tasks.exporting.models import write_joint_glb
from tasks.exporting.skeletons import fit_skeleton

logger = logging.getLogger(__name__)

_WRITERS = {
    ".trc": write_trc,
    ".c3d": write_c3d,
    ".csv": write_joint_csv,
    ".glb": write_joint_glb,
}
EXPORT_SUFFIXES = (*_WRITERS, ".bvh")
"""What a take can be written as."""


def write_joint_track(path: Path, position: NDArray[np.floating], rate_hz: float) -> list[str]:
    """Write a joint track, in the format of the path's suffix.

    Parameters
    ----------
    position : (time, 21, 3) float
        Metres, y up; NaN where a joint is missing. A joint that is never there is left out.

    Returns
    -------
    list of str
        What the format could not hold, a sentence each: a BVH file has bones of constant
        length and no gaps.

    Raises
    ------
    InputError
        If the suffix is none of `EXPORT_SUFFIXES`, or no joint is there.
    PlaceError
        If the file cannot be written; nothing is left of it then.
    """
    suffix = path.suffix.lower()
    if suffix not in EXPORT_SUFFIXES:
        raise InputError(
            f"{path} should end in one of {', '.join(EXPORT_SUFFIXES)}: that is what a take's "
            "joints can be written as (voxels: .ply; what the body was measured by: .json)"
        )
    there = np.asarray(np.isfinite(position).all(axis=2).any(axis=0))
    names = [joint for joint, is_there in zip(JOINTS, there.tolist(), strict=True) if is_there]
    if not names:
        raise InputError(f"none of these frames has a joint, so {path} would be empty")
    notes = []
    if len(names) < len(JOINTS):
        notes.append(f"left out, because never there: {', '.join(sorted({*JOINTS} - {*names}))}")
    with told(f"write {path}"):
        if suffix == ".bvh":
            notes += _write_skeleton(path, position, rate_hz)
        else:
            _WRITERS[suffix](path, position[:, there], names, rate_hz)
    return notes


def export_take(
    archive: str, take: str, file: str, *, clip: tuple[int, int] | None = None
) -> list[str]:
    """Write a take, or the clip of it between two frames (inclusive), to `file`.

    Returns
    -------
    list of str
        What was written, and what the format could not hold.

    Raises
    ------
    UnknownNameError, InputError, PlaceError
        If the take is not there, the clip is not within it, or the file cannot be written.
    """
    opened = open_archive(archive).take(take)
    motion = opened.motion
    frames = opened.record.frames
    start, end = clip or (0, frames - 1)
    if end >= frames:
        raise InputError(f"take {take!r} has the frames 0-{frames - 1}; {start}-{end} goes beyond")
    position = motion["position"].values[start : end + 1]
    notes = write_joint_track(Path(file), position, opened.record.rate_hz)
    return [f"{file}: {len(position)} frames at {opened.record.rate_hz:g} Hz", *notes]


def _write_skeleton(path: Path, position: NDArray[np.floating], rate_hz: float) -> list[str]:
    """Write a BVH file, and say how far it is from the joints."""
    skeleton, error = fit_skeleton(position, JOINTS)
    write_bvh(
        path,
        skeleton.names,
        skeleton.parents,
        skeleton.offset,
        skeleton.root_position,
        skeleton.rotation,
        rate_hz,
    )
    return [
        f"bones of constant length follow the joints to {1000 * error.mean_m:.2f} mm on average, "
        f"{1000 * error.p95_m:.2f} mm in 95 % and {1000 * error.max_m:.2f} mm at most"
    ]
