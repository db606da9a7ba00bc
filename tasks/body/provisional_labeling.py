"""Stage: the provisional segment of every voxel, by the frame before (digitization paper, 3.4.1).

A voxel takes the final label of the nearest voxel of the frame before. The method `paper` fits
poses to these very labels, frame by frame; with `joint`, which needs none, they are made when
the final labels are there.
"""

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Block, Written, read_block, write_block
from storage.formats.capture.capture import capture_of
from tasks.body.labels.provisional import ProvisionalSettings, label_provisionally
from tasks.body.labels.skin import label_skin, skin_table
from tasks.capture.films import grid_of
from tasks.engine.threads import side_by_side
from tasks.geometry.voxel_lines import lines_of
from tasks.reconstruction.voxel_frames import VoxelFrames


def label_block_provisionally(
    archive: str, capture: str, digest: str, hulls: Sequence[Block], colors: Sequence[Block],
    initial: Block, fitted: Block, labels: Sequence[Block], into: str, start: int, end: int,
    settings: ProvisionalSettings, still: Block | None = None,
) -> Written:  # fmt: skip
    """Write the provisional labels of the frames from `start` to before `end` as a block.

    The frame before is the last one that has voxels; where there is none, final labels are taken.

    Parameters
    ----------
    archive, capture, digest, hulls, colors, into
        As for `model_take`.
    initial, fitted
        What `model_take` and `fit_take` wrote.
    labels
        What `label_block` wrote of all frames to before `end` at least, in their order.
    settings
        How volumes are restored, and how far skin moves.
    still
        As for `label_block`. What has no final label has no provisional one.

    Returns
    -------
    Written
        The array is `provisional_label` (voxel,), 0 to 11.
    """
    begun = time.monotonic()
    source = capture_of(capture, digest)
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(source), hulls, colors, still)
    stature_m = float(read_block(place, initial, ["stature_m"])["stature_m"])
    fit = read_block(place, fitted, ["initial_label", "seen", "skin_hand", "skin_face"])
    share = np.bincount(fit["initial_label"], minlength=12)[1:].astype(np.float64)
    share /= share.sum()
    reach_m = settings.reach_m(stature_m, source.fps)
    is_skin = skin_table(fit)
    final = _final_labels(archive, labels, start, end)
    before = _frames_before(final, start, end)

    def label(frame: int) -> NDArray[np.uint8]:
        lines, previous = lines_of(frames.hull(frame)), before[frame]
        if previous is None or not lines.voxels:
            return final[frame]
        skin = label_skin(
            frames, frame, lines, fit["seen"][frame], is_skin,
            reach_m=reach_m, least_m2=settings.least_skin_m2,
        )  # fmt: skip
        kept, kept_before = frames.kept(frame), frames.kept(previous)
        known = final[previous] if kept_before is None else final[previous][kept_before]
        found = label_provisionally(
            lines, lines_of(frames.hull(previous)), known, share, settings, skin_label=skin
        )
        whole = np.zeros_like(final[frame])
        whole[slice(None) if kept is None else kept] = found
        whole[final[frame] == 0] = 0
        return whole

    arrays = {"provisional_label": np.concatenate(side_by_side(label, range(start, end)))}
    return write_block(place, into, (start, end), arrays, begun)


def _final_labels(
    archive: str, labels: Sequence[Block], start: int, end: int
) -> dict[int, NDArray[np.uint8]]:
    """Return the final labels of some frames, and of the last one before them that has voxels."""
    place, final = open_archive(archive).place, {}
    for block in reversed([block for block in labels if block.start < end]):
        if block.end <= start and any(final[n].any() for n in final if n < start):
            break
        read = read_block(place, block)
        offset = read["offset"]
        for n in range(block.end - block.start):
            final[block.start + n] = read["label"][offset[n] : offset[n + 1]]
    return final


def _frames_before(
    final: dict[int, NDArray[np.uint8]], start: int, end: int
) -> dict[int, int | None]:
    """Return the last frame before each of some frames that has labeled voxels, None where none."""
    last: int | None = None
    before: dict[int, int | None] = {}
    for frame in range(min(final), end):
        if frame >= start:
            before[frame] = last
        if final[frame].any():
            last = frame
    return before
