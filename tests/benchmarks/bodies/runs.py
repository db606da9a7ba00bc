"""Run the stages of digitizing on a capture, by their store functions, and time each."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flows import chain
from storage import create_archive, open_archive
from storage.blocks import Block, Written, read_block, write_block
from storage.errors import ArchiveError, InputError
from storage.formats.capture.capture import Capture, capture_of, read_capture
from storage.places import Place
from storage.recordings import Recording, digest_capture
from tasks.capture.films import grid_of
from tasks.geometry.voxels import join_runs, voxel_centers
from tasks.reconstruction.silhouettes import extract_block
from tasks.reconstruction.voxel_frames import VoxelFrames
from tasks.settings import Settings
from tasks.takes.beginning import Blocks
from tests.benchmarks.bodies.scores import joint_errors, label_accuracy, score_joints

SCORED_EVERY = 5
"""Labels are scored in every so many frames."""


@dataclass
class Voxels:
    """A capture and the colored voxels that were made of it."""

    archive: str
    recording: Recording
    blocks: Blocks
    """Of the stages silhouettes, carving and coloring, in the order of the frames."""

    @property
    def source(self) -> Capture:
        return capture_of(self.recording.path, self.recording.digest)

    @property
    def place(self) -> Place:
        return open_archive(self.archive).place

    @property
    def frames(self) -> VoxelFrames:
        hulls, colors = (
            [each.block for each in self.blocks[stage]] for stage in ("carving", "coloring")
        )
        return VoxelFrames(self.place, grid_of(self.source), hulls, colors)


def make_voxels(
    archive: Path,
    capture: Path,
    *,
    spoil: Callable[[str, Capture, Written], Written] | None = None,
) -> Voxels:
    """Digitize a capture up to colored voxels into an archive, which is made if need be.

    Parameters
    ----------
    archive, capture
        Folders.
    spoil : function, optional
        Given the archive, the capture and what `extract_block` wrote, writes other silhouettes.
    """
    if not archive.exists():
        create_archive(str(archive))
    source = read_capture(capture)
    recording = Recording(
        str(capture), digest_capture(capture), source.take, source.metadata, kind="capture"
    )

    def run(function: Any, **parameters: Any) -> Written:
        written = function(**parameters)
        return (
            spoil(str(archive), source, written) if spoil and function is extract_block else written
        )

    blocks, _ = chain.make_voxels(
        str(archive), recording, Settings(), run=run, tell=lambda _stage, _end: None
    )
    return Voxels(str(archive), recording, blocks)


def describe(voxels: Voxels, truth: Path) -> dict[str, Any]:
    """Return where voxels are, as JSON can hold it; see `recall`."""
    return {**asdict(voxels), "truth": str(truth)}


def recall(said: dict[str, Any]) -> Voxels:
    """Return the voxels that `describe` told of."""
    blocks = {
        stage: [Written(Block(**part["block"]), part["seconds"]) for part in parts]
        for stage, parts in said["blocks"].items()
    }
    return Voxels(said["archive"], Recording(**said["recording"]), blocks)


def only_frames(voxels: Voxels, order: Sequence[int], name: str) -> Voxels:
    """Return the voxels of some frames in another order, as if no others had been filmed.

    `name` tells their blocks from those of other choices.
    """
    frames, place, begun = voxels.frames, voxels.place, time.monotonic()
    hulls = join_runs([frames.hull(frame) for frame in order])
    is_surface, color, camera = zip(*(frames.surface(frame) for frame in order), strict=True)
    arrays = {
        "carving": {"start": hulls.start, "length": hulls.length, "offset": hulls.offset},
        "coloring": {
            "is_surface": np.concatenate(is_surface),
            "color": np.concatenate(color),
            "camera": np.concatenate(camera),
            "offset": np.cumsum([0, *map(len, color)]).astype(np.int64),
        },
    }
    blocks = {
        stage: [
            write_block(
                place, f"{voxels.blocks[stage][0].block.path}.{name}", (0, len(order)), own, begun
            )
        ]
        for stage, own in arrays.items()
    }
    return Voxels(voxels.archive, voxels.recording, blocks)


def pose(
    voxels: Voxels, truth_path: Path, settings: Settings, order: Sequence[int] | None = None
) -> dict[str, Any]:
    """Return the scores of a capture's poses and labels, and what each stage took.

    Parameters
    ----------
    order
        The frames of the capture that the voxels are of, where they are not all in their order.

    Returns
    -------
    dict
        As `score_joints`; `labels` accuracy; `ms` processor time a frame of each stage;
        or `refused`, the sentence with which a stage refused the capture.
    """
    spent: dict[str, float] = {}

    def run(function: Any, *, into: str, **parameters: Any) -> Written:
        begun = time.process_time()
        # of this process: others pose the same voxels with other settings
        written = function(into=into.replace(".npz", f"-{os.getpid()}.npz"), **parameters)
        stage = function.__module__.rsplit(".", 1)[-1]
        spent[stage] = spent.get(stage, 0.0) + time.process_time() - begun
        return written

    try:
        blocks = chain.make_poses(
            voxels.archive, voxels.recording, voxels.blocks, settings,
            run=run, tell=lambda _stage, _end: None,
        )  # fmt: skip
    except (InputError, ArchiveError) as error:
        return {"refused": str(error)}
    truth = {name: value for name, value in np.load(truth_path).items() if name != "masks"}
    step = round(float(truth["fps"]) / voxels.source.fps)
    for name in ("joints", "verts"):
        truth[name] = truth[name][::step]
        if order is not None:
            truth[name] = truth[name][list(order)]

    def read(stage: str, name: str) -> np.ndarray:
        parts = [read_block(voxels.place, each.block, [name])[name] for each in blocks[stage]]
        return np.concatenate(parts)

    position = read("joint_tracks", "position")
    score = score_joints(joint_errors(position, truth), read("pose_fitting", "doubtful"))
    score["labels"] = label_accuracy(
        labelled(voxels, read("final_labeling", "label"), SCORED_EVERY), truth
    )
    [initial] = blocks["initial_model"]
    confidence = float(read_block(voxels.place, initial.block)["confidence"])
    frames = len(position)
    score |= {"frames": frames, "confidence": confidence, "initial": initial.block.start}
    return score | {"ms": {stage: 1e3 * total / frames for stage, total in spent.items()}}


def labelled(voxels: Voxels, label: np.ndarray, every: int) -> Any:
    """Yield centers, labels and number of each `every`-th frame."""
    frames, begin = voxels.frames, 0
    for frame in range(len(frames)):
        index = frames.index(frame)
        end = begin + len(index)
        if frame % every == 1:
            yield voxel_centers(frames.grid, index), label[begin:end], frame
        begin = end
