"""Run the stages of digitizing on a capture, by their store functions, and time each."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from storage import create_archive, open_archive
from storage.blocks import block_path, read_block
from storage.errors import ArchiveError, InputError
from storage.formats.capture.capture import Capture, read_capture
from storage.places import Place
from storage.recordings import digest_capture
from tasks.body.labeling import label_block
from tasks.body.pose_fitting import PosingSettings, fit_take, model_take
from tasks.capture.films import block_ranges, grid_of
from tasks.geometry.voxels import voxel_centers
from tasks.reconstruction.carving import CarvingSettings, carve_block
from tasks.reconstruction.coloring import ColoringSettings, color_block
from tasks.reconstruction.silhouettes import SilhouetteSettings, extract_block
from tasks.reconstruction.voxel_frames import VoxelFrames
from tests.benchmarks.pose_scores import joint_errors, label_accuracy, score_joints

Refs = list[dict[str, Any]]
SCORED_EVERY = 5
"""Labels are scored in every so many frames."""


@dataclass
class Voxels:
    """A capture and the colored voxels that were made of it."""

    archive: str
    capture: Path
    source: Capture
    digest: str
    blocks: dict[str, Refs] = field(default_factory=dict)
    """Of the stages silhouettes, carving and coloring, in the order of the frames."""

    @property
    def place(self) -> Place:
        return open_archive(self.archive).place

    @property
    def frames(self) -> VoxelFrames:
        return VoxelFrames(
            self.place, grid_of(self.source), self.blocks["carving"], self.blocks["coloring"]
        )

    def shared(self, stage: str, first: int = 0) -> dict[str, Any]:
        """Return the arguments that all stages take."""
        into = block_path(self.source.take, self.digest, stage, first)
        return {
            "archive": self.archive, "capture": str(self.capture), "digest": self.digest,
            "into": into,
        }  # fmt: skip


def make_voxels(
    archive: Path,
    capture: Path,
    *,
    spoil: Callable[[Voxels, dict[str, Any]], dict[str, Any]] | None = None,
) -> Voxels:
    """Digitize a capture up to colored voxels into an archive, which is made if need be.

    Parameters
    ----------
    archive, capture
        Folders.
    spoil : function, optional
        Returns other silhouettes instead of a block of them, as `extract_block` returned it.
    """
    if not archive.exists():
        create_archive(str(archive))
    source = read_capture(capture)
    made = Voxels(str(archive), capture, source, digest_capture(capture))
    blocks: dict[str, Refs] = {"silhouettes": [], "carving": [], "coloring": []}
    for start, end in block_ranges(source):
        films = extract_block(
            **made.shared("silhouettes", start), start=start, end=end, settings=SilhouetteSettings()
        )
        films = spoil(made, films) if spoil else films
        hulls = carve_block(
            **made.shared("carving", start), silhouettes=films, settings=CarvingSettings(),
        )  # fmt: skip
        colors = color_block(
            **made.shared("coloring", start), silhouettes=films, hulls=hulls,
            settings=ColoringSettings(),
        )  # fmt: skip
        for stage, block in zip(blocks, (films, hulls, colors), strict=True):
            blocks[stage].append(block)
    return replace(made, blocks=blocks)


def describe(voxels: Voxels, truth: Path) -> dict[str, Any]:
    """Return where voxels are, as JSON can hold it; see `recall`."""
    return {
        "archive": voxels.archive, "capture": str(voxels.capture), "digest": voxels.digest,
        "blocks": voxels.blocks, "truth": str(truth),
    }  # fmt: skip


def recall(said: dict[str, Any]) -> Voxels:
    """Return the voxels that `describe` told of."""
    capture = Path(said["capture"])
    return Voxels(said["archive"], capture, read_capture(capture), said["digest"], said["blocks"])


def pose(
    voxels: Voxels, truth_path: Path, settings: PosingSettings, *, labels: bool = True
) -> dict[str, Any]:
    """Return the scores of a capture's poses and labels, and what each stage took.

    Returns
    -------
    dict
        As `score_joints`; `labels` accuracy; `ms` processor time a frame of each stage;
        or `refused`, the sentence with which a stage refused the capture.
    """
    spent: dict[str, float] = {}

    def run(stage: str, function: Any, *, first: int = 0, **more: Any) -> dict[str, Any]:
        begun = time.process_time()
        block = function(
            **voxels.shared(f"{stage}-{os.getpid()}", first), hulls=voxels.blocks["carving"],
            colors=voxels.blocks["coloring"], **more,
        )  # fmt: skip
        spent[stage] = spent.get(stage, 0.0) + time.process_time() - begun
        return block

    try:
        initial = run("initial_model", model_take)
        fitted = run("pose", fit_take, initial=initial, settings=settings)
        blocks = [
            run(
                "labels", label_block, first=start, initial=initial, fitted=fitted, start=start,
                end=end, settings=settings,
            )
            for start, end in block_ranges(voxels.source)
        ] if labels else []  # fmt: skip
    except (InputError, ArchiveError) as error:
        return {"refused": str(error)}
    truth = {name: value for name, value in np.load(truth_path).items() if name != "masks"}
    step = round(float(truth["fps"]) / voxels.source.fps)
    for name in ("joints", "verts"):
        truth[name] = truth[name][::step]
    fit = read_block(voxels.place, fitted)
    read = [read_block(voxels.place, block) for block in blocks]
    position = np.concatenate([block["joint"] for block in read]) if read else fit["joint"]
    score = score_joints(joint_errors(position, truth), fit["doubtful"])
    if labels:
        label = np.concatenate([block["label"] for block in read])
        score["labels"] = label_accuracy(_labelled(voxels, label), truth)
    frames = len(position)
    score |= {"frames": frames, "confidence": initial["confidence"], "initial": initial["frame"]}
    return score | {"ms": {stage: 1e3 * total / frames for stage, total in spent.items()}}


def _labelled(voxels: Voxels, label: np.ndarray) -> Any:
    """Yield centers, labels and number of every few frames."""
    frames, begin = voxels.frames, 0
    for frame in range(len(frames)):
        index = frames.index(frame)
        end = begin + len(index)
        if frame % SCORED_EVERY == 1:
            yield voxel_centers(frames.grid, index), label[begin:end], frame
        begin = end
