"""Put the blocks of a digitized take together as a version of the take, ready to be published."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.arrays.groups import write_motion
from storage.arrays.poses import write_body, write_pose
from storage.arrays.voxels import write_ragged
from storage.blocks import Written, read_block
from storage.errors import InputError
from storage.formats.capture.capture import Capture, capture_of
from storage.places import Place
from storage.provenance import Provenance
from storage.publication import describe_files, discard_version, version_folder
from storage.recordings import digest_capture
from storage.records import Record
from storage.schema import JOINTS
from tasks.body.anatomy.segments import pose_in_parents
from tasks.body.anatomy.shape import measure_body
from tasks.capture.films import grid_of
from tasks.geometry.voxels import voxel_centers
from tasks.motion.stature import joints_present, take_stature
from tasks.reconstruction.voxel_frames import VoxelFrames
from tasks.takes.beginning import Begun, Blocks, arrays_of, begin_take, provenances_of

logger = logging.getLogger(__name__)

_DOUBTS = {
    "unmeasured": "The body was measured with little confidence, so the pose is doubtful in {}: "
    "correct the joints that `shosa export ARCHIVE TAKE initial.json` writes, with a picture.",
    "cut_off": "The performer touches a side of the volume in {}: what is beyond is missing; "
    "enlarge the [volume].",
    "unexplained": "Voxels belong to no segment in {}: a limb that the pose has lost, another "
    "person, or something held.",
    "hidden": "A hand was not seen for long in {}: where it is is a guess.",
    "hands_unsure": "The right and the left hand could as well be the other way round in {}.",
    "feet_unsure": "The right and the left foot could as well be the other way round in {}.",
    "doubtful": "The pose is doubtful in {}.",
}

_TOLD = 0.005
"""From which share of the voxels on it is told that they belong to no segment [share]. Less are
specks; the least of things, a sword, is 0.01. Chosen, not measured."""

_POSE = ("position", "rotation", "quality", "doubt", "doubtful")
"""What the group `pose` takes from the fit as it is; the method `paper` tells no doubt."""

_LABELS = {"provisional_label": "provisional_labeling", "label": "final_labeling"}
"""The stage of each array of labels."""


def assemble_take(
    archive: str,
    capture: str,
    digest: str,
    take: str,
    blocks: Blocks,
    *,
    settings: dict[str, dict[str, Any]],
    changed: dict[str, Any],
    code: str,
    notes: Sequence[str],
    begun: Begun | None = None,
) -> dict[str, Any]:
    """Write a version of a take from the blocks of its stages, without publishing it.

    Parameters
    ----------
    take
        What it is to be called.
    blocks
        Of `silhouettes`, `carving` and `coloring`, and where a pose was fitted of
        `initial_model`, `pose_fitting`, `final_labeling`, `provisional_labeling` and
        `joint_tracks`.
    settings
        Of each stage that has some, as JSON can hold them.
    changed
        Which of them are not the defaults, by name.
    code
        The digest of the code that made the blocks, to be remembered.
    notes
        What was found on the way, a sentence each.
    begun
        The version, where what needs no pose of it is written; by default, or where it was removed
        since, a new one.

    Returns
    -------
    dict
        The fields of its `Record`, as JSON can hold them.

    Raises
    ------
    InputError
        If the hull is empty in every frame, or the capture has changed since it was planned.
    """
    source = capture_of(capture, digest)
    opened = open_archive(archive)
    place = opened.place
    if digest_capture(source.folder) != digest:
        raise InputError(f"{capture} changed while it was read; ingest it again when it is done")
    spent = {stage: sum(part.seconds for part in parts) for stage, parts in blocks.items()}
    said = ", ".join(f"{stage.replace('_', ' ')} {seconds:.1f}" for stage, seconds in spent.items())
    logger.info("%s: seconds of each stage: %s", take, said)
    if begun is None or not begun.is_there(place, take):
        begun = begin_take(archive, capture, digest, take, blocks, settings)
    version, empty = begun.version, np.flatnonzero(np.diff(begun.offsets["voxel"]) == 0)
    provenances = provenances_of(blocks, settings, capture, digest)
    joints_there: list[str] = []
    try:
        folder = version_folder(take, version)
        _write_labels(place, folder, blocks, begun, provenances)
        if "joint_tracks" in blocks:
            joints_there = _write_body(place, source, folder, blocks, provenances)
        files = describe_files(place, take, version)
    except BaseException:
        discard_version(place, take, version)
        raise
    draft = Record(
        take=take,
        version=version,
        number=0,
        source={
            "kind": "capture",
            "name": source.folder.name,
            "path": capture,
            "digest": digest,
            "code": code,
        },
        metadata=source.metadata,
        frames=source.frames,
        rate_hz=source.fps,
        joints_present=joints_there,
        stages=["cameras", "silhouettes", "voxels"]
        + (["labels", "body", "pose", "motion"] if "joint_tracks" in blocks else []),
        files=files,
        notes=[
            *source.notes,
            *notes,
            *_empty_notes(empty, source.frames),
            *_pose_notes(place, blocks),
        ],
        settings=changed,
    )
    return asdict(draft)


def _write_labels(
    place: Place, folder: str, blocks: Blocks, begun: Begun, provenances: dict[str, Provenance]
) -> None:
    """Add the labels that there are to the voxels of a version."""
    labeled = {name: stage for name, stage in _LABELS.items() if stage in blocks}
    if labeled:
        write_ragged(
            place,
            folder,
            begun.offsets,
            {name: arrays_of(place, blocks[stage], name) for name, stage in labeled.items()},
            {
                name: {"provenance": provenances[stage].attributes()}
                for name, stage in labeled.items()
            },
        )


def _write_body(
    place: Place,
    source: Capture,
    folder: str,
    blocks: Blocks,
    provenances: dict[str, Provenance],
) -> list[str]:
    """Write body, pose and motion of a version; return the joints that are there."""
    [initial], [fitted], [tracked] = (
        [written.block for written in blocks[stage]]
        for stage in ("initial_model", "pose_fitting", "joint_tracks")
    )
    start, fit = read_block(place, initial), read_block(place, fitted)
    still = [each.block for each in blocks.get("still_things", ())]
    hulls = [each.block for each in blocks["carving"]]
    frames = VoxelFrames(place, grid_of(source), hulls, still=still[0] if still else None)
    center = voxel_centers(frames.grid, frames.index(initial.start))
    shape = measure_body(center, fit["initial_label"], fit["initial_joint"]).shape
    write_body(
        place,
        folder,
        {
            "centroid": shape.centroid,
            "axes": shape.axes,
            "variance": shape.variance,
            "offset": shape.offset,
            "joint_offset": shape.joint,
            "volume_share": shape.volume_share,
            "initial_joint": fit["initial_joint"],
        },
        attributes={
            "initial_frame": initial.start,
            "confidence": round(float(start["confidence"]), 3),
            **_said_of_guess(start),
        },
        provenance=provenances["initial_model"],
    )
    local_position, local_rotation = pose_in_parents(fit["position"], fit["rotation"])
    write_pose(
        place,
        folder,
        {
            **{name: fit[name] for name in _POSE if name in fit},
            "local_position": local_position,
            "local_rotation": local_rotation,
        },
        rate_hz=source.fps,
        attributes={},
        provenance=provenances["pose_fitting"],
    )
    track, filled = (read_block(place, tracked)[name] for name in ("position", "filled"))
    stature_m = source.stature_m or take_stature(track)
    write_motion(
        place,
        folder,
        position=track,
        filled=filled,
        rate_hz=source.fps,
        attributes={
            "source": {"kind": "capture", "name": source.folder.name},
            "metadata": source.metadata,
            "stature_m": stature_m,
            "stature_source": "given in capture.toml" if source.stature_m else "from the joints",
            "marker_set": "fitted pose",
            "notes": [],
        },
        provenance=provenances["joint_tracks"],
    )
    there = joints_present(track)
    return [joint for joint, present in zip(JOINTS, there, strict=True) if present]


def _said_of_guess(start: Mapping[str, NDArray]) -> dict[str, Any]:
    """Return what is told of a body that was guessed, nothing of one that was measured."""
    if "guessed_from" not in start:
        return {}
    return {
        "guessed_from": start["guessed_from"].tolist(),
        "facing_margin": round(float(start["facing_margin"]), 3),
        "guesses_apart_m": round(float(start["guesses_apart_m"]), 3),
    }


def _pose_notes(place: Place, blocks: Blocks) -> list[str]:
    """Say how sure the initial model is, and which frames are doubtful."""
    if "joint_tracks" not in blocks:
        return []
    fit = read_block(place, blocks["pose_fitting"][0].block)
    [initial] = blocks["initial_model"]
    start = read_block(place, initial.block)
    confidence, guessed = float(start["confidence"]), "guessed_from" in start
    notes = [
        f"The body was {'guessed' if guessed else 'measured'} in frame {initial.block.start}, "
        f"with a confidence of {confidence:.2f}.",
        *initial.notes,
        *(note for each in blocks.get("still_things", ()) for note in each.notes),
        *_label_notes(place, blocks["final_labeling"]),
    ]
    for name, said in _DOUBTS.items():
        frames = np.flatnonzero(fit.get(name, ()))  # `paper` has fewer reasons
        if len(frames):
            notes.append(said.format(f"{len(frames)} frames ({_ranges(frames)})"))
    return notes


def _label_notes(place: Place, labels: Sequence[Written]) -> list[str]:
    """Say how much of a take belongs to no segment, where it is much."""
    voxels, none = [], []
    for part in labels:
        read = read_block(place, part.block)
        voxels.append(np.diff(read["offset"]))
        frames = np.split(read["label"], read["offset"][1:-1])
        none += [len(frame) - np.count_nonzero(frame) for frame in frames]
    of, own = np.concatenate(voxels), np.array(none)
    share = own.sum() / max(int(of.sum()), 1)
    if share < _TOLD:
        return []
    frames = np.flatnonzero(own > _TOLD * of)
    return [
        f"{share:.1%} of the voxels belong to no segment (label 0), in {len(frames)} frames "
        f"({_ranges(frames)}): what stands beside the performer, is held in a hand, or is far from "
        "the body."
    ]


def _empty_notes(empty: NDArray[np.intp], frames: int) -> list[str]:
    """Say which frames have no voxels."""
    if not len(empty):
        return []
    return [f"In {len(empty)} of {frames} frames no voxel is occupied: {_ranges(empty)}."]


def _ranges(numbers: NDArray[np.intp]) -> str:
    """Return frames as ranges, the first ten of them."""
    ends = np.flatnonzero(np.diff(numbers) > 1)
    firsts, lasts = numbers[np.r_[0, ends + 1]], numbers[np.r_[ends, len(numbers) - 1]]
    ranges = [f"{a}-{b}" if a < b else f"{a}" for a, b in zip(firsts, lasts, strict=True)]
    return ", ".join(ranges[:10]) + (", ..." if len(ranges) > 10 else "")
