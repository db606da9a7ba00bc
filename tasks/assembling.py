"""Put the blocks of a digitized take together as a version of the take, ready to be published."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.archive import Archive
from storage.blocks import read_block
from storage.errors import InputError
from storage.formats.capture import Capture, read_capture
from storage.places import Place
from storage.provenance import Provenance
from storage.publication import (
    Record,
    damaged_files,
    describe_files,
    discard_version,
    new_version,
    read_record,
    version_folder,
)
from storage.recordings import digest_capture
from storage.voxel_arrays import write_cameras, write_silhouettes, write_voxels
from tasks.capture_films import grid_of, largest_image

_NO_CAMERA = 255

Blocks = dict[str, list[dict[str, Any]]]
"""What the tasks of a stage returned, in the order of the frames, by stage."""


def assemble_take(
    archive: str,
    capture: str,
    digest: str,
    take: str,
    blocks: Blocks,
    *,
    settings: dict[str, dict[str, Any]],
    identity: str,
    notes: Sequence[str],
) -> dict[str, Any]:
    """Write a version of a take from the blocks of its stages, without publishing it.

    Parameters
    ----------
    take
        What it is to be called.
    blocks
        Of `silhouettes`, `carving` and `coloring`.
    settings
        Of each stage, as JSON can hold them.
    identity
        What names this computation: capture, settings and code.
    notes
        What was found on the way, a sentence each.

    Returns
    -------
    dict
        The fields of its `Record`, as JSON can hold them.

    Raises
    ------
    InputError
        If the hull is empty in every frame, or the capture has changed since it was planned.
    """
    source = read_capture(Path(capture))
    opened = open_archive(archive)
    place = opened.place
    offsets = _offsets(place, blocks)
    empty = np.flatnonzero(np.diff(offsets["voxel"]) == 0)
    if len(empty) == source.frames:
        raise InputError(
            f"{capture}: no voxel is inside the silhouettes in any frame; `shosa doctor {capture}` "
            "shows what the cameras see of the volume"
        )
    if digest_capture(source.folder) != digest:
        raise InputError(f"{capture} changed while it was read; ingest it again when it is done")
    version = new_version(place, take)
    provenances = {
        "cameras": Provenance("calibration", {}, {capture: digest}),
        **_provenances(blocks, settings, capture, digest),
    }
    try:
        _write_groups(place, source, version_folder(take, version), blocks, offsets, provenances)
        files = describe_files(place, take, version)
    except BaseException:
        discard_version(place, take, version)
        raise
    draft = Record(
        take=take,
        version=version,
        number=0,
        source={
            "kind": "capture",
            "name": source.folder.name,
            "path": capture,
            "digest": digest,
            "identity": identity,
        },
        metadata=source.metadata,
        frames=source.frames,
        rate_hz=source.fps,
        joints_present=[],
        stages=["cameras", "silhouettes", "voxels"],
        files=files,
        notes=[*source.notes, *notes, *_empty_notes(empty, source.frames)],
    )
    return asdict(draft)


def is_digitized(opened: Archive, take: str, identity: str) -> bool:
    """Say whether a take is already what this computation would make of it, intact."""
    record = read_record(opened.place, take)
    return bool(
        record
        and record.source.get("identity") == identity
        and not damaged_files(opened.place, record)
    )


def _write_groups(
    place: Place,
    source: Capture,
    folder: str,
    blocks: Blocks,
    offsets: dict[str, NDArray[np.int64]],
    provenances: dict[str, Provenance],
) -> None:
    """Write the groups of a version."""
    write_cameras(place, folder, source.cameras, provenances["cameras"])
    rows, columns = largest_image(source.cameras)
    write_silhouettes(
        place,
        folder,
        _unpacked(place, blocks["silhouettes"], columns),
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
            "run_start": _arrays(place, blocks["carving"], "start"),
            "run_length": _arrays(place, blocks["carving"], "length"),
            **{
                name: _arrays(place, blocks["coloring"], name)
                for name in ("is_surface", "color", "camera")
            },
        },
        attributes={
            "origin_m": list(grid.origin_m),
            "voxel_m": grid.voxel_m,
            "shape": list(grid.shape),
            "no_camera": _NO_CAMERA,
            "provenance": provenances["carving"].attributes(),
        },
        array_attributes=dict.fromkeys(("is_surface", "color", "camera"), coloring),
        rate_hz=source.fps,
    )


def _provenances(
    blocks: Blocks, settings: dict[str, dict[str, Any]], capture: str, digest: str
) -> dict[str, Provenance]:
    """Return where the arrays of each stage come from; the digest of blocks is that of theirs."""
    made: dict[str, Provenance] = {}
    inputs = {capture: digest}
    for stage, parts in blocks.items():
        made[stage] = Provenance(
            stage, settings[stage], dict(inputs), seconds=sum(part["seconds"] for part in parts)
        )
        together = hashlib.sha256("".join(part["sha256"] for part in parts).encode())
        inputs[stage] = together.hexdigest()
    return made


def _offsets(place: Place, blocks: Blocks) -> dict[str, NDArray[np.int64]]:
    """Return where the runs, voxels and surface voxels of each frame begin, and the last end."""
    sizes: dict[str, list[NDArray[np.int64]]] = {"run": [], "voxel": [], "surface": []}
    for block in blocks["carving"]:
        runs = read_block(place, block)
        total = np.concatenate([[0], np.cumsum(runs["length"], dtype=np.int64)])
        sizes["run"].append(np.diff(runs["offset"]))
        sizes["voxel"].append(np.diff(total[runs["offset"]]))
    for block in blocks["coloring"]:
        sizes["surface"].append(np.diff(read_block(place, block)["offset"]))
    return {
        over: np.concatenate([[0], np.cumsum(np.concatenate(parts))])
        for over, parts in sizes.items()
    }


def _arrays(place: Place, parts: Sequence[dict[str, Any]], name: str) -> Iterator[NDArray]:
    """Yield an array of block after block."""
    return (read_block(place, block)[name] for block in parts)


def _unpacked(
    place: Place, parts: Sequence[dict[str, Any]], columns: int
) -> Iterator[NDArray[np.bool_]]:
    """Yield the silhouettes of some frames after another."""
    for block in parts:
        packed = read_block(place, block)["silhouette"]
        for first in range(0, len(packed), 8):
            bits = np.unpackbits(packed[first : first + 8], axis=-1, count=columns)
            yield bits.astype(np.bool_)


def _empty_notes(empty: NDArray[np.intp], frames: int) -> list[str]:
    """Say which frames have no voxels."""
    if not len(empty):
        return []
    ends = np.flatnonzero(np.diff(empty) > 1)
    firsts, lasts = empty[np.r_[0, ends + 1]], empty[np.r_[ends, len(empty) - 1]]
    ranges = [f"{a}-{b}" if a < b else f"{a}" for a, b in zip(firsts, lasts, strict=True)]
    shown = ", ".join(ranges[:10]) + (", ..." if len(ranges) > 10 else "")
    return [f"In {len(empty)} of {frames} frames no voxel is occupied: {shown}."]
