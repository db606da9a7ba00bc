"""Write what needs no pose of a version of a take: cameras, silhouettes, colored voxels.

It is two thirds of what a take is written from, and on two processors one of them waits while the
body is followed from frame to frame. So it can be begun when the voxels are colored, in a thread of
its own, and `assemble_take` adds the rest. The files are the same as when they are written last.
"""

import hashlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.arrays.cameras import write_cameras
from storage.arrays.silhouettes import write_silhouettes
from storage.arrays.voxels import write_voxels
from storage.blocks import Written, read_block
from storage.errors import InputError
from storage.formats.capture.capture import Capture, capture_of
from storage.places import Place, list_files
from storage.provenance import Provenance
from storage.publication import discard_version, new_version, version_folder
from storage.schema import NO_CAMERA
from tasks.capture.films import grid_of, largest_image

Blocks = dict[str, list[Written]]
"""What the tasks of a stage wrote, in the order of the frames, by the name of the stage."""

Begin = Callable[[Blocks], "Future[Begun]"]
"""Begins a version from the blocks of colored voxels, once, and returns what it becomes."""


class GivenUpError(Exception):
    """A version is not written any further, for nobody wants it."""


@dataclass(frozen=True, eq=False)
class Begun:
    """A version of a take that lacks what needs a pose."""

    version: str
    """The folder below takes/<take>/ that holds it."""
    offsets: Mapping[str, NDArray[np.int64]]
    """(frame + 1,) by `run`, `voxel` and `surface`: where those of each frame begin, and the last
    end."""
    files: frozenset[str]
    """What was written, as paths of the archive."""

    def is_there(self, place: Place, take: str) -> bool:
        """Say whether all of it is still there: after a day, `gc` takes it for left behind."""
        return self.files <= _files(place, take, self.version)


def begin_take(
    archive: str,
    capture: str,
    digest: str,
    take: str,
    blocks: Blocks,
    settings: Mapping[str, dict[str, Any]],
    *,
    given_up: threading.Event | None = None,
) -> Begun:
    """Write the cameras, silhouettes and colored voxels of a new version of a take.

    Parameters
    ----------
    archive, capture, digest, take, settings
        As for `assemble_take`.
    blocks
        Of `silhouettes`, `carving` and `coloring` at least.
    given_up
        Is set by whoever does not want the version any more.

    Raises
    ------
    InputError
        If the hull is empty in every frame.
    GivenUpError
        If it was given up; nothing is left of it, as after any other error.
    """
    source = capture_of(capture, digest)
    place = open_archive(archive).place
    offsets = _offsets(place, blocks)
    if not offsets["voxel"][-1]:
        raise InputError(
            f"{capture}: no voxel is inside the silhouettes in any frame; `shosa doctor {capture}` "
            "shows what the cameras see of the volume"
        )
    version = new_version(place, take)
    try:
        provenances = provenances_of(blocks, settings, capture, digest)
        _write_groups(
            place, source, version_folder(take, version), blocks, offsets, provenances,
            given_up or threading.Event(),
        )  # fmt: skip
    except BaseException:
        discard_version(place, take, version)
        raise
    return Begun(version, offsets, _files(place, take, version))


@contextmanager
def beginning_beside(
    archive: str, capture: str, digest: str, take: str, settings: Mapping[str, dict[str, Any]]
) -> Iterator[Begin]:
    """Yield what begins a version in a thread of its own while the work inside goes on.

    Where the work inside fails, what was begun is given up and removed. What it cannot be begun
    with is raised where its result is asked for.

    Parameters
    ----------
    archive, capture, digest, take, settings
        As for `assemble_take`.
    """
    given_up = threading.Event()
    begun: list[Future[Begun]] = []
    with ThreadPoolExecutor(1) as beside:

        def begin(blocks: Blocks) -> Future[Begun]:
            if not begun:
                begun.append(
                    beside.submit(
                        begin_take, archive, capture, digest, take, dict(blocks), settings,
                        given_up=given_up,
                    )
                )  # fmt: skip
            return begun[0]

        try:
            yield begin
        except BaseException:
            given_up.set()
            for each in begun:
                if each.exception() is None:
                    discard_version(open_archive(archive).place, take, each.result().version)
            raise


def _files(place: Place, take: str, version: str) -> frozenset[str]:
    """Return the paths of the files of a version."""
    return frozenset(file.path for file in list_files(place, version_folder(take, version)))


def provenances_of(
    blocks: Blocks, settings: Mapping[str, dict[str, Any]], capture: str, digest: str
) -> dict[str, Provenance]:
    """Return where the arrays of each stage come from; the digest of blocks is that of theirs."""
    made = {"cameras": Provenance("calibration", {}, {capture: digest})}
    inputs = {capture: digest}
    for stage, parts in blocks.items():
        made[stage] = Provenance(
            stage,
            settings.get(stage, {}),
            dict(inputs),
            seconds=sum(part.seconds for part in parts),
        )
        together = hashlib.sha256("".join(part.block.sha256 for part in parts).encode())
        inputs[stage] = together.hexdigest()
    return made


def arrays_of(place: Place, parts: Sequence[Written], name: str) -> Iterator[NDArray]:
    """Yield an array of block after block."""
    return (read_block(place, part.block, [name])[name] for part in parts)


def _write_groups(
    place: Place,
    source: Capture,
    folder: str,
    blocks: Blocks,
    offsets: Mapping[str, NDArray[np.int64]],
    provenances: Mapping[str, Provenance],
    given_up: threading.Event,
) -> None:
    """Write the groups of a version that need no pose."""

    def wanted(arrays: Iterator[NDArray]) -> Iterator[NDArray]:
        for array in arrays:
            if given_up.is_set():
                raise GivenUpError("the version is not wanted any more")
            yield array

    write_cameras(place, folder, source.cameras, provenances["cameras"], source.first_frames)
    rows, columns = largest_image(source.cameras)
    write_silhouettes(
        place,
        folder,
        wanted(_unpacked(place, blocks["silhouettes"], columns)),
        (source.frames, len(source.cameras), rows, columns),
        cameras=[camera.name for camera in source.cameras],
        rate_hz=source.fps,
        provenance=provenances["silhouettes"],
    )
    grid = grid_of(source)
    coloring = {"provenance": provenances["coloring"].attributes()}
    write_voxels(
        place,
        folder,
        offsets,
        {
            "run_start": wanted(arrays_of(place, blocks["carving"], "start")),
            "run_length": wanted(arrays_of(place, blocks["carving"], "length")),
            **{
                name: wanted(arrays_of(place, blocks["coloring"], name))
                for name in ("is_surface", "color", "camera")
            },
        },
        attributes={
            "origin_m": list(grid.origin_m),
            "voxel_m": grid.voxel_m,
            "shape": list(grid.shape),
            "no_camera": NO_CAMERA,
            "provenance": provenances["carving"].attributes(),
        },
        array_attributes=dict.fromkeys(("is_surface", "color", "camera"), coloring),
        rate_hz=source.fps,
    )


def _offsets(place: Place, blocks: Blocks) -> dict[str, NDArray[np.int64]]:
    """Return where the runs, voxels and surface voxels of each frame begin, and the last end."""
    sizes: dict[str, list[NDArray[np.int64]]] = {"run": [], "voxel": [], "surface": []}
    for written in blocks["carving"]:
        runs = read_block(place, written.block, ["length", "offset"])
        total = np.concatenate([[0], np.cumsum(runs["length"], dtype=np.int64)])
        sizes["run"].append(np.diff(runs["offset"]))
        sizes["voxel"].append(np.diff(total[runs["offset"]]))
    for written in blocks["coloring"]:
        sizes["surface"].append(np.diff(read_block(place, written.block, ["offset"])["offset"]))
    return {
        over: np.concatenate([[0], np.cumsum(np.concatenate(parts))])
        for over, parts in sizes.items()
    }


def _unpacked(place: Place, parts: Sequence[Written], columns: int) -> Iterator[NDArray[np.bool_]]:
    """Yield the silhouettes of some frames after another."""
    for part in parts:
        packed = read_block(place, part.block, ["silhouette"])["silhouette"]
        for first in range(0, len(packed), 8):
            bits = np.unpackbits(packed[first : first + 8], axis=-1, count=columns)
            yield bits.view(np.bool_)
