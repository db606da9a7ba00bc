"""What a stage has made of a block of frames, between two tasks: a file below work/.

    work/<take>/<name>.npz.zst    arrays by name

A block is written in one atomic operation, under a name that says all that it was made from, and
is read only if its SHA-256 is the one that its writer gave. So a run can be killed anywhere, and
the next one goes on where it was; when the take is published, its blocks go.
"""

import io
from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from numcodecs.zstd import Zstd
from numpy.typing import NDArray

from storage.errors import ArchiveError
from storage.places import Place, delete_files, list_files, read_file, write_file
from storage.provenance import digest_bytes

_ZSTD = Zstd(level=1)


def write_block(place: Place, path: str, arrays: Mapping[str, NDArray]) -> str:
    """Write arrays under `path` and return their SHA-256; equal arrays give equal bytes."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **dict(sorted(arrays.items())))
    packed = bytes(_ZSTD.encode(content.getbuffer()))
    write_file(place, path, packed)
    return digest_bytes(packed)


def read_block(place: Place, path: str, digest: str) -> dict[str, NDArray]:
    """Return the arrays under `path`.

    Raises
    ------
    ArchiveError
        If they are gone, or not what was written.
    """
    try:
        packed = read_file(place, path)
    except FileNotFoundError:
        packed = b""
    if digest_bytes(packed) != digest:
        raise ArchiveError(f"{place.url(path)} was changed or removed during the run; run it again")
    with np.load(io.BytesIO(_ZSTD.decode(packed)), allow_pickle=False) as arrays:
        return dict(arrays)


def has_block(place: Place, path: str, digest: str) -> bool:
    """Say whether what was written under `path` is still there, every byte of it."""
    try:
        return digest_bytes(read_file(place, path)) == digest
    except FileNotFoundError:
        return False


def discard_blocks(place: Place, take: str) -> None:
    """Remove the blocks of a take, as far as that goes."""
    with suppress(OSError):
        delete_files(place, [file.path for file in list_files(place, f"work/{take}")])
