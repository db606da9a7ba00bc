"""Store function from fitted poses to labeled voxels (digitization paper, 3.4.1 and 3.4.3).

The poses of all frames are known, so labels are made block by block: final ones by the pose of the
frame, provisional ones from the final ones of the frame before.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import read_block, write_block
from storage.formats.capture.capture import read_capture
from tasks.body.joint_tracks import ARM_LABELS, move_to_ends, track_stature
from tasks.body.labels.fields import BoneFields
from tasks.body.labels.final import label_carried, label_frame
from tasks.body.labels.provisional import label_provisionally
from tasks.body.labels.skin import label_skin, skin_table
from tasks.body.pose_fitting import PosingSettings, Refs
from tasks.capture.films import grid_of
from tasks.engine.threads import THREADS, side_by_side
from tasks.geometry.voxel_lines import VoxelLines, labeled_centers, lines_of
from tasks.geometry.voxels import voxel_centers
from tasks.reconstruction.voxel_frames import VoxelFrames


def label_block(
    archive: str, capture: str, digest: str, hulls: Refs, colors: Refs, initial: dict[str, Any],
    fitted: dict[str, Any], into: str, start: int, end: int, settings: PosingSettings,
) -> dict[str, Any]:  # fmt: skip
    """Write labels and joints of the frames from `start` to before `end` as a block.

    Parameters
    ----------
    fitted
        As `fit_take` returned it.
    archive, capture, digest, hulls, colors, initial, into, settings
        As for `fit_take`.

    Returns
    -------
    dict
        As `storage.blocks.write_block`; the arrays are `provisional_label` and `label` (voxel,),
        and `joint` (time, 21, 3), m, with the finger tips where the voxels end.
    """
    begun = time.monotonic()
    source = read_capture(Path(capture))
    place = open_archive(archive).place
    frames = VoxelFrames(place, grid_of(source), hulls, colors)
    fit, first = read_block(place, fitted), read_block(place, initial)
    share = np.bincount(first["label"], minlength=12)[1:].astype(np.float64)
    share /= share.sum()
    stature_m = source.stature_m or track_stature(fit["joint"])
    reach_m = settings.provisional.reach_m(source.stature_m, source.fps)
    least_m2, is_skin = settings.provisional.least_skin_m2, skin_table(fit)

    def label(own: NDArray[np.int64]) -> dict[str, list[NDArray]]:
        found: dict[str, list[NDArray]] = {"joint": [], "provisional_label": [], "label": []}
        lines, final = _final(frames, max(int(own[0]) - 1, 0), fit)
        for frame in own:
            before = (lines, final)
            lines, final = _final(frames, int(frame), fit)
            provisional = final
            if frame and before[1].any():
                skin = label_skin(
                    frames, frame, lines, fit["seen"][frame], is_skin,
                    reach_m=reach_m, least_m2=least_m2,
                )  # fmt: skip
                provisional = label_provisionally(
                    lines, *before, share, settings.provisional, skin_label=skin
                )
            center, tips = labeled_centers(frames.grid, lines, final, ARM_LABELS)
            joints = fit["joint"][frame]
            ends = move_to_ends(joints, center, tips, settings.ends, stature_m=stature_m)
            for name, value in zip(found, (ends, provisional, final), strict=True):
                found[name].append(value)
        return found

    parts = side_by_side(label, np.array_split(np.arange(start, end), min(THREADS, end - start)))
    whole = {name: [value for part in parts for value in part[name]] for name in parts[0]}
    arrays = {name: np.concatenate(values) for name, values in whole.items() if name != "joint"}
    arrays["joint"] = np.stack(whole["joint"])
    return write_block(place, into, (start, end), arrays, begun)


def _final(
    frames: VoxelFrames, frame: int, fit: dict[str, NDArray]
) -> tuple[VoxelLines, NDArray[np.uint8]]:
    """Return a frame's voxels and their final labels."""
    lines = lines_of(frames.hull(frame))
    if not lines.voxels:
        return lines, np.zeros(0, np.uint8)
    if "blob_mean" in fit:
        center = voxel_centers(frames.grid, frames.index(frame))
        return lines, label_frame(
            center, lines, fit["blob_mean"][frame], fit["blob_inverse"][frame]
        )
    fields = BoneFields(
        fit["field_begin"], fit["field_sides"], fit["field_distance"], int(fit["field_most"])
    )
    return lines, label_carried(lines, fields, fit["turn"][frame], fit["shift"][frame])
