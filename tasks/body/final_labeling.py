"""Stage: the segment of every voxel, by the pose of its frame (digitization paper, 3.4.3).

The poses of all frames are known, so labels are made block by block.
"""

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Block, Written, read_block, write_block
from storage.formats.capture.capture import capture_of
from tasks.body.labels.fields import BoneFields
from tasks.body.labels.final import label_carried, label_frame
from tasks.capture.films import grid_of
from tasks.engine.threads import side_by_side
from tasks.geometry.voxel_lines import lines_of
from tasks.geometry.voxels import voxel_centers, voxel_numbers
from tasks.reconstruction.voxel_frames import VoxelFrames


def label_block(
    archive: str, capture: str, digest: str, hulls: Sequence[Block], initial: Block,
    fitted: Block, into: str, start: int, end: int, still: Block | None = None,
) -> Written:  # fmt: skip
    """Write the final labels of the frames from `start` to before `end` as a block.

    Parameters
    ----------
    archive, capture, digest, into
        As for `model_take`.
    hulls
        What `carve_block` wrote, in the order of the frames.
    initial, fitted
        What `model_take` and `fit_take` wrote.
    still
        What `find_still_take` wrote: voxels that belong to no segment.

    Returns
    -------
    Written
        The arrays are `label` (voxel,), 0 to 11, and `offset` (frame + 1,) of a frame's voxels.
    """
    begun = time.monotonic()
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(capture_of(capture, digest)), hulls, still=still)
    fit = read_block(place, fitted)

    def label(frame: int) -> NDArray[np.uint8]:
        if "blob_mean" in fit and frame == initial.start:
            own = fit["initial_label"]  # the paper's labels of t = 0 are placed, not computed
        else:
            own = _label_frame(frames, frame, fit)
        kept = frames.kept(frame)
        if kept is None:
            return own
        whole = np.zeros(len(kept), np.uint8)
        whole[kept] = own
        return whole

    labels = side_by_side(label, range(start, end))
    arrays = {
        "label": np.concatenate(labels),
        "offset": np.cumsum([0, *map(len, labels)]).astype(np.int64),
    }
    return write_block(place, into, (start, end), arrays, begun)


def _label_frame(frames: VoxelFrames, frame: int, fit: dict[str, NDArray]) -> NDArray[np.uint8]:
    """Return the final labels of a frame by what its pose has made ready."""
    lines = lines_of(frames.hull(frame))
    if not lines.voxels:
        return np.zeros(0, np.uint8)
    if "blob_mean" in fit:
        center = voxel_centers(frames.grid, frames.index(frame))
        return label_frame(center, lines, fit["blob_mean"][frame], fit["blob_inverse"][frame])
    fields = BoneFields(
        fit["field_begin"], fit["field_sides"], fit["field_distance"], int(fit["field_most"])
    )
    staying, stays = fit["staying"], None
    if len(staying):
        stays = np.isin(voxel_numbers(frames.hull(frame)), staying, assume_unique=True)
    return label_carried(lines, fields, fit["turn"][frame], fit["shift"][frame], stays)
