"""What an archive holds, as the pages need it: its records at hand, takes kept open.

An archive of 10,000 takes is not listed anew for every letter that is typed. What is listed is a
snapshot, made anew where it is older than `FRESH_S`; a take is looked up in the archive itself.
"""

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.archive import Take
from storage.describing import describe_take
from storage.errors import ArchiveError, InputError, UnknownNameError
from storage.index.catalogue import Listing
from storage.index.entries import Entry
from storage.records import Record
from storage.schema import JOINTS
from tasks.motion.stature import DEFAULT_STATURE_M, joints_present
from tasks.retrieval.opening import read_packed_takes
from tasks.retrieval.segments import PackedTake

if TYPE_CHECKING:
    from tasks.motion.importing import ImportSettings

FRESH_S = 5.0
"""How long a listing of the archive is good [s]. Chosen: less than a person takes to notice."""
_TAKES_OPEN = 48
"""How many takes are kept open [takes]. Opening one takes a tenth of a second."""
_FILES_HELD = 8
"""How many dropped files are remembered [files]. Their motion is held in memory."""
_PACKED_HELD = 256
"""How many search arrays are kept open [takes]. They are mapped, not in memory."""
_FRAMES_HELD = 4
"""How many frames of voxels are held while body models are corrected [frames]."""
_FILMS_OPEN = 8
"""How many takes' films are remembered [takes]. Looking through one takes seconds."""
_PICTURES_HELD = 64
"""How many pieces of films are held [pieces]. One has some 300 kB."""
FILE = "file"
"""What stands in an address in place of a version where the motion is of a dropped file."""

_Held = TypeVar("_Held")


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion that a page shows: of a take, or of a file that was dropped on the page."""

    name: str
    version: str
    title: str
    performer: str
    frames: int
    rate_hz: float
    stature_m: float
    joints_present: tuple[str, ...]
    position: Any
    """(time, 21, 3) m; sliced by frames, read when it is sliced. None where only voxels are."""
    has_voxels: bool
    file: str | None = None
    """Where a dropped file was put, for a search."""


class Holdings:
    """The takes of one archive, and the files that were dropped on its pages."""

    def __init__(self, location: str, uploads: Path) -> None:
        """Open the archive, which must be there; `uploads` is an empty folder for dropped files."""
        self.archive = open_archive(location)
        self.location = self.archive.location
        self.uploads = uploads
        self._lock = threading.Lock()
        self._listing_lock = threading.Lock()
        self._listing: tuple[float, Listing] | None = None
        self._takes: OrderedDict[Any, Take] = OrderedDict()
        self._motions: OrderedDict[Any, Motion] = OrderedDict()
        self._frames: OrderedDict[Any, Any] = OrderedDict()
        self._packed: OrderedDict[Any, Any] = OrderedDict()
        self._palettes: OrderedDict[Any, Any] = OrderedDict()
        self._films: OrderedDict[Any, Any] = OrderedDict()
        self._pictures: OrderedDict[Any, Any] = OrderedDict()
        self._files: OrderedDict[str, Motion] = OrderedDict()

    def records(self) -> tuple[list[Entry], dict[str, str]]:
        """Return what every take is now, and what is wrong with those that cannot be read.

        Raises
        ------
        InputError, ArchiveError, PlaceError
            If the archive is not there any more, or is damaged.
        """
        with self._listing_lock:
            held = self._listing
            if held is None or time.monotonic() - held[0] > FRESH_S:
                found = open_archive(self.location).listing(held[1] if held else None)
                held = self._listing = (time.monotonic(), found)
            return held[1].entries, held[1].faults

    def records_at_hand(self) -> list[Entry]:
        """Return the takes as they were listed last, at once: for each letter that is typed."""
        held = self._listing
        return held[1].entries if held is not None else self.records()[0]

    def describe(self, name: str, said: Mapping[str, str], over: int) -> Record:
        """Give a take other words; raises as `describe_take`."""
        record = describe_take(open_archive(self.location), name, said, over=over)
        with self._listing_lock:
            self._listing = None
        return record

    def take(self, name: str, version: str | None = None) -> Take:
        """Return a take as it is now, or an older version that some page still shows.

        Raises
        ------
        UnknownNameError, ArchiveError
            If there is no such take, or not in this version.
        """
        if version is not None and (held := self._takes.get((name, version))) is not None:
            return held  # its words may be older, its data are not
        found = open_archive(self.location).take(name)
        if version is not None and found.record.version != version:
            raise ArchiveError(
                f"take {name!r} has been replaced by a newer version; load the page again"
            )
        key = (name, found.record.version)
        if (held := self._takes.get(key)) is not None and held.record.number != found.record.number:
            with self._lock:
                self._takes.pop(key, None)
        return self._hold(self._takes, key, lambda: found, _TAKES_OPEN)

    def motion(self, name: str, version: str | None = None) -> Motion:
        """Return the motion of a take, or of a dropped file (`version` is `FILE`).

        Raises
        ------
        UnknownNameError, ArchiveError
            If it is not there, or damaged.
        """
        if version == FILE:
            if (held := self._files.get(name)) is None:
                raise UnknownNameError("that file is not held any more; drop it on the page again")
            return held
        take = self.take(name, version)
        key = (name, take.record.version, take.record.number)
        return self._hold(self._motions, key, lambda: _motion_of(take), _TAKES_OPEN)

    def packed(self, record: Record | Entry) -> PackedTake:
        """Return a take as the search reads it: opened and checked once, mapped on a disk.

        Raises
        ------
        ArchiveError
            If it has no motion, or its search array is missing or damaged.
        """

        def read() -> PackedTake:
            found, faults = read_packed_takes(self.archive.place, [record])
            if faults:
                raise ArchiveError(faults[record.take])
            return found[0]

        return self._hold(self._packed, (record.take, record.version), read, _PACKED_HELD)

    def add_file(self, name: str, content: bytes) -> Motion:
        """Keep a motion file for searches; return its motion.

        Raises
        ------
        InputError
            If no motion can be read from it.
        """
        key = secrets.token_urlsafe(9)
        shown = Path(name).name[:80] or "file"
        path = self.uploads / f"{key}{Path(shown).suffix.lower()}"
        path.write_bytes(content)
        try:
            motion = motion_of_file(path, key, shown)
        except InputError as error:
            said = str(error).replace(str(path), shown)  # its place here is nobody's business
            path.unlink(missing_ok=True)
            raise InputError(said) from error
        with self._lock:
            self._files[key] = motion
            while len(self._files) > _FILES_HELD:
                _, old = self._files.popitem(last=False)
                Path(str(old.file)).unlink(missing_ok=True)
        return motion

    def held_voxels(self, take: Take, frame: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the centers (voxel, 3) m of a frame's voxels, and which are on the surface."""

        def read() -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
            voxels = take.voxels(frame)
            return voxels["center"].values, voxels["is_surface"].values

        key = (take.name, take.record.version, frame)
        return self._hold(self._frames, key, read, _FRAMES_HELD)

    def films(self, take: Take, make: Callable[[], _Held]) -> _Held:
        """Return the films of a take's capture, looked through once."""
        return self._hold(self._films, (take.name, take.record.version), make, _FILMS_OPEN)

    def film_pictures(self, key: tuple[str, str, int, str], make: Callable[[], _Held]) -> _Held:
        """Return the pictures of some frames of films, made once while they are looked at."""
        return self._hold(self._pictures, key, make, _PICTURES_HELD)

    def palette(self, take: Take, make: Callable[[], _Held]) -> _Held:
        """Return the colors that a take is shown with, made once."""
        return self._hold(self._palettes, (take.name, take.record.version), make, _TAKES_OPEN)

    def _hold(
        self, held: OrderedDict[Any, Any], key: Any, make: Callable[[], _Held], most: int
    ) -> _Held:
        """Return what is held under `key`, made if need be; the longest unused is forgotten."""
        with self._lock:
            if key in held:
                held.move_to_end(key)
                return held[key]
        made = make()
        with self._lock:
            held[key] = made
            held.move_to_end(key)
            while len(held) > most:
                held.popitem(last=False)
        return made


def motion_of_file(
    path: Path, key: str, title: str, settings: "ImportSettings | None" = None
) -> Motion:
    """Return the motion of a file that is in no archive; raises an InputError if it has none."""
    from tasks.motion.importing import ImportSettings, read_joint_track

    track, _ = read_joint_track(path, settings or ImportSettings())
    present = joints_present(track.position)
    return Motion(
        key, FILE, title, "", len(track.position), track.rate_hz,
        track.stature_m or DEFAULT_STATURE_M,
        tuple(name for name, is_in in zip(JOINTS, present, strict=True) if is_in),
        track.position, False, str(path),
    )  # fmt: skip


def title_of(record: Record | Entry) -> str:
    """Return what a take is called on a page."""
    return str(record.metadata.get("title") or record.take)


def performer_of(record: Record | Entry) -> str:
    """Return who dances in a take, as the pages show it."""
    return str(record.metadata.get("performer") or "")


def matching(records: Sequence[Entry], words: str) -> list[Entry]:
    """Return the takes in whose name, title, performer or other metadata all the words are."""
    wanted = words.casefold().split()
    if not wanted:
        return list(records)

    def text(record: Record | Entry) -> str:
        said = (record.take, record.source["kind"], *map(str, record.metadata.values()))
        return " ".join(said).casefold()

    return [record for record in records if all(word in text(record) for word in wanted)]


def _motion_of(take: Take) -> Motion:
    """Return the motion of a take, without positions where its pose was not fitted."""
    record = take.record
    position, stature_m = None, None
    if "motion" in record.stages:
        dataset = take.motion
        position, stature_m = _Frames(dataset["position"]), dataset.attrs["stature_m"]
    return Motion(
        take.name, record.version, title_of(record), performer_of(record),
        record.frames, record.rate_hz, float(stature_m or DEFAULT_STATURE_M),
        tuple(record.joints_present), position, "voxels" in record.stages,
    )  # fmt: skip


class _Frames:
    """An array of an archive that is read when it is sliced."""

    def __init__(self, array: Any) -> None:
        self._array = array

    def __getitem__(self, frames: slice) -> NDArray[np.float32]:
        return np.asarray(self._array[frames].values)
