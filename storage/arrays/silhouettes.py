"""Silhouettes of a take in and out of Zarr: `silhouette` (time, camera, row, column)."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from storage.arrays.groups import open_group
from storage.arrays.pieces import AS_IT_COMES, ZSTD, new_group, regrouped, write_time
from storage.places import Place, told
from storage.provenance import Provenance

_PICTURES_BYTES = 1 << 25  # of silhouettes in a file
_PICTURES_READ = 8  # frames of a camera read at once


def write_silhouettes(
    place: Place,
    folder: str,
    blocks: Iterable[NDArray[np.bool_]],
    shape: tuple[int, int, int, int],
    *,
    cameras: Sequence[str],
    rate_hz: float,
    provenance: Provenance,
) -> None:
    """Write the group `silhouettes` of the version in `folder`, a block after another.

    Parameters
    ----------
    blocks
        (time, camera, row, column) bool: the frames in their order.
    shape
        Of all of them together.
    """
    frames, count, rows, columns = shape
    held = max(1, min(frames, _PICTURES_BYTES // (count * rows * columns)))
    read = min(held, _PICTURES_READ)
    held -= held % read
    with told(f"write {place.url(folder)}"):
        group = new_group(
            place, folder, "silhouettes", cameras=list(cameras), rate_hz=rate_hz,
            provenance=provenance.attributes(),
        )  # fmt: skip
        write_time(group, frames, rate_hz)
        array = group.create_array(
            "silhouette",
            shape=shape,
            dtype="bool",
            chunks=(read, 1, rows, columns),
            shards=(held, count, rows, columns),
            compressors=[ZSTD],
            dimension_names=("time", "camera", "row", "column"),
            config=AS_IT_COMES,
        )
        for start, part in regrouped(blocks, held):
            array[start : start + len(part)] = part


def open_silhouettes(
    place: Place, folder: str, files: Mapping[str, Mapping[str, Any]] | None = None
) -> xarray.DataArray:
    """Return `(time, camera, row, column)` bool, read when it is used; `files` as `open_group`."""
    dataset = open_group(place, folder, "silhouettes", files)
    return dataset["silhouette"].assign_coords(camera=dataset.attrs["cameras"])
