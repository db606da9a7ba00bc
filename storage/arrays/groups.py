"""Arrays of a take in and out of Zarr, as labelled xarray datasets."""

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray
from zarr.errors import UnstableSpecificationWarning
from zarr.storage import MemoryStore

from storage.arrays.published import PublishedFiles
from storage.errors import ArchiveError
from storage.places import Place, told, write_files, zarr_store
from storage.provenance import Provenance
from storage.schema import JOINTS, SPACE

# the names of joints stand in the attributes too, for readers that know no strings; for good,
# because catch_warnings is not safe beside other threads
warnings.simplefilter("ignore", UnstableSpecificationWarning)

_FRAMES_A_CHUNK = 8192  # 2 MB of positions: a few requests an hour of dance


def write_motion(
    place: Place,
    folder: str,
    *,
    position: NDArray[np.float32],
    filled: NDArray[np.bool_],
    rate_hz: float,
    attributes: dict[str, Any],
    provenance: Provenance,
) -> None:
    """Write the group `motion` of the version in `folder`.

    Parameters
    ----------
    position : (time, joint, space) float32
        Metres, y up; NaN where a joint is missing.
    filled : (time, joint) bool
        True where a gap was filled.
    """
    frames = len(position)
    motion = xarray.Dataset(
        {
            "position": (("time", "joint", "space"), position, {"units": "m"}),
            "filled": (("time", "joint"), filled),
        },
        coords={
            "time": ("time", np.arange(frames) / rate_hz, {"units": "s"}),
            "joint": list(JOINTS),
            "space": list(SPACE),
        },
        attrs={
            "joints": list(JOINTS),  # string arrays are not in the v3 specification
            "rate_hz": rate_hz,
            **attributes,
            "provenance": provenance.attributes(),
        },
    )
    write_group(place, folder, "motion", motion, frames_a_chunk=_FRAMES_A_CHUNK)


def write_group(
    place: Place,
    folder: str,
    group: str,
    dataset: xarray.Dataset,
    *,
    frames_a_chunk: int | None = None,
) -> None:
    """Write a group of the version in `folder`, which has none of this name.

    Parameters
    ----------
    frames_a_chunk
        How many frames of an array over `time` are stored in a piece; by default all.
    """
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        kept: dict[str, Any] = {}
        if variable.dtype.kind == "f":
            kept["_FillValue"] = None
        if name not in dataset.coords and variable.dims[:1] == ("time",) and frames_a_chunk:
            kept["chunks"] = (min(variable.shape[0], frames_a_chunk), *variable.shape[1:])
        encoding[str(name)] = kept
    with told(f"write {place.url(folder)}"), _written_at_once(place, folder) as store:
        dataset.to_zarr(
            store,
            group=group,
            mode="w-",
            zarr_format=3,
            consolidated=False,
            encoding=encoding,
        )


@contextmanager
def _written_at_once(place: Place, folder: str) -> Iterator[Any]:
    """Give a store that is written to a folder.

    Zarr asks an object store dozens of times for a small group, one after another. So that is made
    in memory first, and its files go out side by side.
    """
    if place.folder is not None:
        yield zarr_store(place, folder)
        return
    made: dict[str, Any] = {}
    yield MemoryStore(made)
    write_files(place, {f"{folder}/{name}": made[name].to_bytes() for name in made})


def open_group(
    place: Place,
    folder: str,
    group: str,
    files: Mapping[str, Mapping[str, Any]] | None = None,
) -> xarray.Dataset:
    """Return a group of the version in `folder`, its arrays read when they are used.

    Parameters
    ----------
    files
        What its record says of its files, by which they are compared; None before it has one.

    Raises
    ------
    ArchiveError
        If it is damaged; reading its arrays may raise it too.
    """
    with opening(place, folder):
        store = open_store(place, folder, files)
        return xarray.open_zarr(store, group=group, consolidated=False, chunks=None)


def open_store(place: Place, folder: str, files: Mapping[str, Mapping[str, Any]] | None) -> Any:
    """Return the version in `folder` as a store that Zarr reads; `files` as of `open_group`."""
    if files is None:
        return zarr_store(place, folder, read_only=True)
    return PublishedFiles(place, folder, files)


@contextmanager
def opening(place: Place, folder: str) -> Iterator[None]:
    """Turn what Zarr says of groups that are missing or no groups into an ArchiveError."""
    with told(f"read {place.url(folder)}"):
        try:
            yield
        except ArchiveError:
            raise
        except (FileNotFoundError, KeyError, TypeError, ValueError) as error:
            raise ArchiveError(
                f"{place.url(folder)} cannot be opened ({' '.join(str(error).split())}); "
                f"`shosa verify` names what is damaged of take {folder.split('/')[1]!r}"
            ) from error
