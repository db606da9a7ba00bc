"""Voxels of a take in and out of Zarr, ragged over time.

    voxels        for frame t:
                  runs      run_offset[t]     to run_offset[t + 1]:      run_start, run_length
                  voxels    voxel_offset[t]   to voxel_offset[t + 1]:    is_surface, labels
                  surface   surface_offset[t] to surface_offset[t + 1]:  color, camera

The number of voxel (x, y, z) is `(x * ny + y) * nz + z`. A run is a stretch of occupied voxels
along z: the number of its first voxel, and how many they are. The voxels of a frame, in order of
their numbers, are those of its runs; its surface voxels are those of them with `is_surface`.
"""

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import xarray
import zarr
from numpy.typing import NDArray

from storage.arrays.groups import open_store, opening
from storage.arrays.pieces import AS_IT_COMES, ZSTD, new_group, regrouped, write_time, write_whole
from storage.places import Place, told, zarr_store
from storage.schema import NO_CAMERA, SPACE

_CHUNK = 1 << 18  # values read at once: a few frames of a performer
_SHARD = 1 << 22  # values in a file
_WRITERS = 2  # arrays that are written at a time, whole shards each: two shards are in memory

RAGGED: dict[str, tuple[str, str, tuple[int, ...]]] = {
    "run_start": ("run", "uint32", ()),
    "run_length": ("run", "uint16", ()),
    "is_surface": ("voxel", "bool", ()),
    "provisional_label": ("voxel", "uint8", ()),
    "label": ("voxel", "uint8", ()),
    "color": ("surface", "uint8", (3,)),
    "camera": ("surface", "uint8", ()),
}
"""The ragged arrays: what they go over, their type, and what each entry is."""

_OVER = ("run", "voxel", "surface")
"""What the ragged arrays go over."""


def write_voxels(
    place: Place,
    folder: str,
    offsets: Mapping[str, NDArray[np.int64]],
    parts: Mapping[str, Iterable[NDArray]],
    *,
    attributes: Mapping[str, Any],
    array_attributes: Mapping[str, dict[str, Any]],
    rate_hz: float,
) -> None:
    """Write the group `voxels` of the version in `folder`.

    Parameters
    ----------
    offsets
        (frame + 1,) by `run`, `voxel` and `surface`.
    parts
        Stretches of each ragged array, in order, by its name in `RAGGED`.
    attributes
        `origin_m`, `voxel_m`, `shape` and `provenance` among them.
    array_attributes
        By the name of an array: where it comes from another stage than the runs, `provenance`.
    """
    frames = len(offsets["run"]) - 1
    with told(f"write {place.url(folder)}"):
        group = new_group(place, folder, "voxels", rate_hz=rate_hz, **attributes)
        write_time(group, frames, rate_hz)
        for over, offset in offsets.items():
            write_whole(group, f"{over}_offset", offset.astype(np.int64), ("edge",))
    write_ragged(place, folder, offsets, parts, array_attributes)


def write_ragged(
    place: Place,
    folder: str,
    offsets: Mapping[str, NDArray[np.int64]],
    parts: Mapping[str, Iterable[NDArray]],
    array_attributes: Mapping[str, dict[str, Any]],
) -> None:
    """Add ragged arrays to the group `voxels` of the version in `folder`; as `write_voxels`."""
    with told(f"write {place.url(folder)}"):
        group = zarr.open_group(
            zarr_store(place, folder), path="voxels", mode="r+", use_consolidated=False
        )
        arrays = {
            name: _new_ragged(group, name, offsets, array_attributes.get(name)) for name in parts
        }

        def fill(name: str) -> None:
            array: Any = arrays[name]
            for start, part in regrouped(parts[name], array.shards[0]):
                array[start : start + len(part)] = part

        with ThreadPoolExecutor(_WRITERS) as pool:
            list(pool.map(fill, parts))


def read_voxels(voxels: zarr.Group, frame: int) -> xarray.Dataset:
    """Return the voxels of a frame, in the order of their numbers.

    Returns
    -------
    xarray.Dataset
        Over `voxel`: `center (voxel, space)` m, `index (voxel, axis)`, `is_surface`,
        `color (voxel, rgb)` and `camera` (zero and 255 but on the surface), and `label` and
        `provisional_label` where these stages have run.

    Raises
    ------
    IndexError
        If there is no such frame.
    """
    number = _read_numbers(voxels, frame)
    shape = _shape(voxels)
    index = np.stack(np.unravel_index(number, shape), axis=1).astype(np.int32)
    origin = np.asarray(voxels.attrs["origin_m"], np.float64)
    is_surface = _read_ragged(voxels, "is_surface", frame)
    color = np.zeros((len(number), 3), np.uint8)
    camera = np.full(len(number), NO_CAMERA, np.uint8)
    color[is_surface] = _read_ragged(voxels, "color", frame)
    camera[is_surface] = _read_ragged(voxels, "camera", frame)
    labels = {
        name: ("voxel", _read_ragged(voxels, name, frame))
        for name in ("label", "provisional_label")
        if name in voxels
    }
    center = origin + index * float(voxels.attrs["voxel_m"])  # type: ignore[arg-type]
    return xarray.Dataset(
        {
            "center": (("voxel", "space"), center, {"units": "m"}),
            "index": (("voxel", "axis"), index),
            "is_surface": ("voxel", is_surface),
            "color": (("voxel", "rgb"), color),
            "camera": ("voxel", camera),
            **labels,
        },
        coords={"space": list(SPACE)},
        attrs={
            "frame": frame,
            **{name: voxels.attrs[name] for name in ("origin_m", "voxel_m", "shape")},
        },
    )


def read_voxel_counts(voxels: zarr.Group) -> NDArray[np.int64]:
    """Return how many voxels are occupied in each frame, (time,)."""
    offset: Any = voxels["voxel_offset"]
    return np.diff(np.asarray(offset[:], np.int64))


def read_surfaces(
    voxels: zarr.Group, start: int, end: int
) -> list[tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]]:
    """Return the surface voxels of the frames from `start` to before `end`, for showing them.

    Many frames at once are a tenth of the work of `read_voxels` for each.

    Returns
    -------
    list of (number, color, label)
        A frame each: the numbers of its surface voxels in order, their RGB (voxel, 3), and their
        final labels, zero where that stage has not run.

    Raises
    ------
    IndexError
        If there are no such frames.
    """
    edges = {over: np.asarray(voxels[f"{over}_offset"][start : end + 1]) for over in _OVER}  # type: ignore[index]
    if not 0 <= start < end or len(edges["run"]) != end - start + 1:
        last = int(voxels["run_offset"].shape[0]) - 2  # type: ignore[union-attr]
        raise IndexError(f"frames {start} to {end - 1} are not within the frames 0 to {last}")

    def part(name: str) -> NDArray[Any]:
        edge = edges[RAGGED[name][0]]
        array: Any = voxels[name]
        return np.asarray(array[int(edge[0]) : int(edge[-1])])

    number = _numbers_of_runs(part("run_start"), part("run_length"))
    is_surface, color = part("is_surface"), part("color")
    label = part("label") if "label" in voxels else np.zeros(len(number), np.uint8)
    voxel, surface = (edges[over] - edges[over][0] for over in ("voxel", "surface"))
    found = []
    for n in range(end - start):
        inside = slice(int(voxel[n]), int(voxel[n + 1]))
        shown = is_surface[inside]
        colors = color[int(surface[n]) : int(surface[n + 1])]
        found.append((number[inside][shown], colors, label[inside][shown]))
    return found


def read_occupied(voxels: zarr.Group, frame: int) -> xarray.DataArray:
    """Return the dense view of a frame, `(x, y, z)` bool, its coordinates in metres.

    Raises
    ------
    IndexError
        If there is no such frame.
    """
    shape = _shape(voxels)
    occupied = np.zeros(shape, np.bool_)
    occupied.reshape(-1)[_read_numbers(voxels, frame)] = True
    origin: Any = voxels.attrs["origin_m"]
    voxel_m: Any = voxels.attrs["voxel_m"]
    axes = {
        name: (name, start + np.arange(count) * voxel_m, {"units": "m"})
        for name, start, count in zip(SPACE, origin, shape, strict=True)
    }
    return xarray.DataArray(occupied, dims=SPACE, coords=axes, name="occupied")


def open_voxels(
    place: Place, folder: str, files: Mapping[str, Mapping[str, Any]] | None = None
) -> zarr.Group:
    """Return the group `voxels` of the version in `folder`; `files` as of `open_group`."""
    with opening(place, folder):
        store = open_store(place, folder, files)
        return zarr.open_group(store, path="voxels", mode="r", use_consolidated=False)


def _new_ragged(
    group: zarr.Group,
    name: str,
    offsets: Mapping[str, NDArray[np.int64]],
    attributes: dict[str, Any] | None,
) -> zarr.Array:
    """Make a ragged array of a group."""
    over, kind, entry = RAGGED[name]
    total = int(offsets[over][-1])
    chunk = max(1, min(total, _CHUNK))
    shard = chunk * max(1, min(-(-total // chunk), _SHARD // _CHUNK))
    return group.create_array(
        name,
        shape=(total, *entry),
        dtype=kind,
        chunks=(chunk, *entry),
        shards=(shard, *entry),
        compressors=[ZSTD],
        dimension_names=(over, *(("rgb",) if entry else ())),
        attributes=attributes,
        config=AS_IT_COMES,
    )


def _shape(voxels: zarr.Group) -> tuple[int, int, int]:
    x, y, z = voxels.attrs["shape"]  # type: ignore[misc]
    return int(x), int(y), int(z)  # type: ignore[arg-type]


def _read_numbers(voxels: zarr.Group, frame: int) -> NDArray[np.int64]:
    """Return the numbers of the voxels of a frame, in order."""
    start = _read_ragged(voxels, "run_start", frame)
    return _numbers_of_runs(start, _read_ragged(voxels, "run_length", frame))


def _numbers_of_runs(start: NDArray[Any], length: NDArray[Any]) -> NDArray[np.int64]:
    """Return the numbers of the voxels of runs, in order."""
    length = length.astype(np.int64)
    before = np.cumsum(length) - length
    return np.repeat(start.astype(np.int64) - before, length) + np.arange(length.sum())


def _read_ragged(voxels: zarr.Group, name: str, frame: int) -> NDArray[Any]:
    """Return a frame's part of a ragged array."""
    offset: Any = voxels[f"{RAGGED[name][0]}_offset"]
    if not 0 <= frame < offset.shape[0] - 1:
        raise IndexError(f"frame {frame} is not one of the frames 0 to {offset.shape[0] - 2}")
    first, end = offset[frame : frame + 2]
    array: Any = voxels[name]
    return np.asarray(array[int(first) : int(end)])
