"""Groups of arrays that are written piece after piece, each a whole shard."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import ZstdCodec

from storage.places import Place, zarr_store

ZSTD = ZstdCodec(level=3)  # before shuffling: labels and runs come out smaller so
AS_IT_COMES: Any = {"write_empty_chunks": True}  # else each value is first compared with the fill


def new_group(place: Place, folder: str, name: str, **attributes: Any) -> zarr.Group:
    """Make a group of the version in `folder`, which has none of this name."""
    store = zarr_store(place, folder)
    return zarr.create_group(store, path=name, zarr_format=3, attributes=attributes)


def write_time(group: zarr.Group, frames: int, rate_hz: float) -> None:
    """Write the time of each frame, seconds."""
    write_whole(group, "time", np.arange(frames) / rate_hz, ("time",), units="s")


def write_whole(
    group: zarr.Group, name: str, values: NDArray, dims: tuple[str, ...], **attributes: Any
) -> None:
    """Write an array that is small enough for one piece."""
    group.create_array(
        name,
        data=values,
        chunks=values.shape,
        compressors=[ZSTD],
        dimension_names=dims,
        attributes=attributes,
    )


def regrouped(parts: Iterable[NDArray], length: int) -> Iterator[tuple[int, NDArray]]:
    """Yield the entries of all parts, `length` at a time, each time with the first one's place.

    What was yielded is written over by what comes next.
    """
    start, held, group = 0, 0, np.empty(0)
    for part in parts:
        if not len(group):
            group = np.empty((length, *part.shape[1:]), part.dtype)
        while len(part):
            taken, part = part[: length - held], part[length - held :]
            group[held : held + len(taken)] = taken
            held += len(taken)
            if held == length:
                yield start, group
                start, held = start + held, 0
    if held:
        yield start, group[:held]
