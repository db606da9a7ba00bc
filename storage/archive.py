"""An archive and its takes, as programs and notebooks see them."""

import difflib
import json
import os
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from storage.errors import ArchiveError, InputError, UnknownNameError
from storage.index.catalogue import Listing, list_takes
from storage.places import Place, create_file, list_names, open_place, read_file
from storage.provenance import now
from storage.publication import version_folder
from storage.records import (
    Record,
    published_takes,
    read_record,
    read_records,
)

if TYPE_CHECKING:
    import numpy as np
    import xarray
    import zarr
    from numpy.typing import NDArray

ARCHIVE_FORMAT = 1
_MARK = "archive.json"
_NAME = "shosa-archive"


@dataclass(frozen=True)
class Take:
    """One continuous recording, as it was when asked for: later versions do not change it."""

    place: Place
    record: Record

    @property
    def name(self) -> str:
        """The take's name in the archive."""
        return self.record.take

    @property
    def path(self) -> str:
        """Where its Zarr group lives: a path, or a URL."""
        return self.place.url(self.folder)

    @property
    def folder(self) -> str:
        """Where its Zarr group lives, inside the archive."""
        return version_folder(self.record.take, self.record.version)

    def check_there(self) -> None:
        """Raise an ArchiveError if its Zarr group is not there."""
        if not list_names(self.place, self.folder):
            raise ArchiveError(
                f"take {self.name!r} should be in {self.path}, where nothing is; "
                "put it back from a copy, or ingest the recording again"
            )

    @property
    def motion(self) -> "xarray.Dataset":
        """`position (time, joint, space)` in metres and `filled (time, joint)`, read on use."""
        return self._group("motion")

    @property
    def cameras(self) -> "xarray.Dataset":
        """`intrinsics`, `distortion`, `rotation`, `translation` and `image_size` a camera."""
        return self._group("cameras")

    @property
    def body(self) -> "xarray.Dataset":
        """The shape of the 11 segments and the joints it was measured with (Table 1)."""
        return self._group("body")

    @property
    def pose(self) -> "xarray.Dataset":
        """Position and rotation of each segment a frame, and which frames are doubtful."""
        return self._group("pose")

    @cached_property
    def silhouettes(self) -> "xarray.DataArray":
        """`(time, camera, row, column)` bool in the pixels of the videos, read on use."""
        from storage.arrays.silhouettes import open_silhouettes

        self._check_stage("silhouettes")
        return open_silhouettes(self.place, self.folder, self.record.files)

    def voxels(self, frame: int) -> "xarray.Dataset":
        """Return the performer's voxels in a frame, in the order of their numbers.

        Returns
        -------
        xarray.Dataset
            Over `voxel`: `center (voxel, space)` m, `index (voxel, axis)`, `is_surface`,
            `color (voxel, rgb)` and `camera` (zero and 255 but on the surface), and `label` and
            `provisional_label` where these stages have run.

        Raises
        ------
        ArchiveError
            If the take has no voxels.
        IndexError
            If there is no such frame.
        """
        from storage.arrays.voxels import read_voxels

        return read_voxels(self._voxels, frame)

    def surfaces(
        self, start: int, end: int
    ) -> "list[tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]]":
        """Return number, color and label of the surface voxels, a frame each, `end` not among them.

        Raises
        ------
        ArchiveError
            If the take has no voxels.
        IndexError
            If there are no such frames.
        """
        from storage.arrays.voxels import read_surfaces

        return read_surfaces(self._voxels, start, end)

    @property
    def grid(self) -> "tuple[tuple[int, int, int], tuple[float, float, float], float]":
        """The voxels' shape (x, y, z), the middle of the first one, m, and their size, m.

        Raises
        ------
        ArchiveError
            If the take has no voxels.
        """
        attrs: Any = self._voxels.attrs
        x, y, z = attrs["shape"]
        left, low, near = attrs["origin_m"]
        return (
            (int(x), int(y), int(z)),
            (float(left), float(low), float(near)),
            float(attrs["voxel_m"]),
        )

    def occupied(self, frame: int) -> "xarray.DataArray":
        """Return the dense view `(x, y, z)` bool of a frame; raises as `voxels`."""
        from storage.arrays.voxels import read_occupied

        return read_occupied(self._voxels, frame)

    def voxel_counts(self) -> "NDArray[np.int64]":
        """Return how many voxels are occupied in each frame, (time,); raises as `voxels`."""
        from storage.arrays.voxels import read_voxel_counts

        return read_voxel_counts(self._voxels)

    @cached_property
    def _voxels(self) -> "zarr.Group":
        from storage.arrays.voxels import open_voxels

        self._check_stage("voxels")
        return open_voxels(self.place, self.folder, self.record.files)

    def _group(self, name: str) -> "xarray.Dataset":
        from storage.arrays.groups import open_group  # xarray and Zarr: 0.6 s

        self._check_stage(name)
        return open_group(self.place, self.folder, name, self.record.files)

    def _check_stage(self, name: str) -> None:
        """Refuse to read what no stage has written."""
        if name not in self.record.stages:
            raise ArchiveError(
                f"take {self.name!r} has no {name}: made from {self.record.source['name']}, it has "
                f"{', '.join(self.record.stages) or 'nothing yet'}"
            )


@dataclass(frozen=True)
class Archive:
    """An archive of takes in a directory or an object store."""

    place: Place

    @property
    def location(self) -> str:
        """Where it is, whatever the working directory: an absolute path, or a URL."""
        return str(self.place.folder or self.place.location)

    def takes(self) -> list[str]:
        """Return the names of all takes, sorted."""
        return published_takes(self.place)

    def records(self) -> list[Record]:
        """Return what every take is now, in the order of the names."""
        return read_records(self.place)

    def listing(self, before: Listing | None = None) -> Listing:
        """Return what every take is now, without the files of each, and whose record is damaged.

        It reads a few files, not a record a take. What was listed `before` and has not changed is
        not read again.
        """
        return list_takes(self.place, before)

    def take(self, name: str) -> Take:
        """Return the take called `name` as it is now.

        Raises
        ------
        UnknownNameError
            If there is none; the message gives the nearest names.
        """
        record = read_record(self.place, name)
        if record is None:
            raise UnknownNameError(
                f"the archive {self.place.location} has no take {name!r}"
                f"{nearest(name, self.takes())}"
            )
        return Take(self.place, record)


def open_archive(location: str | os.PathLike[str]) -> Archive:
    """Return the archive at `location`: a directory, or a URL such as s3://bucket/archive.

    Raises
    ------
    InputError
        If there is no archive.
    ArchiveError
        If a newer shosa made it, or its mark is damaged.
    """
    place = open_place(location)
    try:
        mark = json.loads(read_file(place, _MARK))
        number = mark["version"]
        if mark.get("format", _NAME) != _NAME or type(number) is not int or number < 1:
            raise ValueError(f"it has format {mark.get('format')!r} and version {number!r}")
    except FileNotFoundError:
        raise InputError(
            f"{os.fspath(location)!r} is not an archive: it has no {_MARK}; "
            "`shosa ingest` makes one"
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ArchiveError(
            f"{place.url(_MARK)} is damaged ({error}); it should read "
            f'{{"format": "{_NAME}", "version": {ARCHIVE_FORMAT}}}'
        ) from error
    if number > ARCHIVE_FORMAT:
        raise ArchiveError(
            f"the archive {place.location} has format {number} and this shosa reads up to "
            f"{ARCHIVE_FORMAT}; update shosa"
        )
    return Archive(place)


def create_archive(location: str | os.PathLike[str]) -> Archive:
    """Return the archive at `location`, made where there is none yet.

    Raises
    ------
    InputError
        If the directory holds other things.
    """
    place = open_place(location, make=True)
    names = list_names(place, "")
    if _MARK not in names:
        if strange := [name for name in names if not name.startswith(".")]:
            raise InputError(
                f"{os.fspath(location)!r} is not an archive and not empty (it holds "
                f"{', '.join(strange[:3])}{', ...' if len(strange) > 3 else ''}); "
                "name an archive, or a new directory"
            )
        mark = {"format": _NAME, "version": ARCHIVE_FORMAT, "created": now()}
        create_file(place, _MARK, json.dumps(mark, indent=1).encode())
    return open_archive(location)


def take_name(text: str) -> str:
    """Return `text` as the name of a take: lower case, words joined by hyphens.

    Raises
    ------
    InputError
        If nothing is left of it.
    """
    text = unicodedata.normalize("NFC", text).lower()
    name = re.sub(r"[^\w-]+", "-", text).strip("-_")
    if not name:
        raise InputError(f"{text!r} makes no name for a take; give one with letters or digits")
    return name


def nearest(name: str, names: Iterable[str]) -> str:
    """Return the end of a sentence that offers the names nearest to `name`, or nothing."""
    found = difflib.get_close_matches(name, list(names), n=3, cutoff=0.5)
    return f"; did you mean {' or '.join(found)}?" if found else ""
