"""What a stage has made of a block of frames, between two tasks: a file below work/.

    work/<take>/<name>.npz    arrays by name, of some consecutive frames, each compressed by itself
    work/<take>/<name>.json   what its writer gave back, by which whoever comes next finds it

A block is written in one atomic operation, under a name that says all that it was made from, and
is read only if its SHA-256 is the one that its writer gave. So a run can be killed anywhere, and
the next one, on whatever machine, goes on where it was; when the take is published, its blocks go.
"""

import io
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass

import numpy as np
from numcodecs.zstd import Zstd
from numpy.typing import NDArray

from storage.errors import ArchiveError
from storage.kept import KEPT
from storage.places import Place, delete_files, read_file, write_file
from storage.provenance import digest_bytes

_ZSTD = Zstd(level=1)
_LONGEST_HEAD = 1 << 16  # of a .npy file
_DIGITS = 12
"""How much of a digest stands in a name [hexadecimal digits]. Two of a thousand million names are
then equal with a probability of 0.2 %, and of one capture there are some hundred."""


@dataclass(frozen=True)
class Block:
    """What finds the arrays of some frames again, and tells whether they are what was written."""

    path: str
    """In the archive."""
    start: int
    """The first frame."""
    end: int
    """The frame after the last one."""
    sha256: str
    """Equal arrays give an equal one."""


@dataclass(frozen=True)
class Written:
    """What a stage gives back: the block that it wrote, how long that took, what is to be said."""

    block: Block
    seconds: float
    notes: tuple[str, ...] = ()
    """A sentence each."""


def write_block(
    place: Place,
    path: str,
    frames: tuple[int, int],
    arrays: Mapping[str, NDArray],
    begun: float,
    *,
    notes: Sequence[str] = (),
) -> Written:
    """Write the arrays of the frames from one to before another; return what finds them again.

    Parameters
    ----------
    place, path
        Where.
    frames
        The first frame, and the one after the last.
    arrays
        By name.
    begun
        When the stage began, of `time.monotonic()`.
    notes
        What is to be said of the block, a sentence each.
    """
    content, names = io.BytesIO(), sorted(arrays)
    with ThreadPoolExecutor() as pool:
        packed_arrays = pool.map(_packed, (arrays[name] for name in names))
        np.savez(content, allow_pickle=False, **dict(zip(names, packed_arrays, strict=True)))
    packed = content.getvalue()
    write_file(place, path, packed)
    block = Block(path, *frames, digest_bytes(packed))
    KEPT.keep(block.sha256, arrays)
    return Written(block, round(time.monotonic() - begun, 3), tuple(notes))


def read_block(
    place: Place, block: Block, names: Sequence[str] | None = None
) -> dict[str, NDArray]:
    """Return the arrays of a block, or those of them that are named.

    Raises
    ------
    ArchiveError
        If they are gone, or not what was written.
    """
    if (kept := KEPT.find(block.sha256, names)) is not None:
        return kept
    try:
        packed = read_file(place, block.path)
    except FileNotFoundError:
        packed = b""
    if digest_bytes(packed) != block.sha256:
        raise ArchiveError(
            f"{place.url(block.path)} was changed or removed during the run; run it again"
        )
    with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
        wanted = {name: arrays[name] for name in names or arrays.files}
    with ThreadPoolExecutor() as pool:
        return dict(zip(wanted, pool.map(_unpacked, wanted.values()), strict=True))


def _packed(array: NDArray) -> NDArray[np.uint8]:
    """Return an array as the compressed bytes of a .npy file."""
    content = io.BytesIO()
    np.save(content, array, allow_pickle=False)
    return np.frombuffer(_ZSTD.encode(content.getbuffer()), np.uint8)


def _unpacked(packed: NDArray[np.uint8]) -> NDArray:
    """Return the array that was packed."""
    content = bytearray(_ZSTD.decode(packed))  # not `bytes`, which no array may be written to
    head = io.BytesIO(content[:_LONGEST_HEAD])
    assert np.lib.format.read_magic(head) == (1, 0)
    shape, by_columns, kind = np.lib.format.read_array_header_1_0(head)
    values = np.frombuffer(content, kind, offset=head.tell())
    return values.reshape(shape, order="F" if by_columns else "C")


def remember_block(place: Place, written: Written) -> None:
    """Let whoever comes next find a block, by its path alone."""
    content = json.dumps(asdict(written), ensure_ascii=False, allow_nan=False).encode()
    write_file(place, _memory_path(written.block.path), content)


def find_block(place: Place, path: str) -> Written | None:
    """Return what was written at a path, or None where it is not there, every byte of it."""
    try:
        fields = json.loads(read_file(place, _memory_path(path)))
        block = Block(**fields["block"])
        written = Written(block, float(fields["seconds"]), tuple(fields["notes"]))
        whole = block.path == path and digest_bytes(read_file(place, path)) == block.sha256
    except (FileNotFoundError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return written if whole else None


def block_path(take: str, digest: str, stage: str, start: int) -> str:
    """Return where the block of a stage that begins at frame `start` lives in the archive.

    `digest` is that of the capture.
    """
    return f"work/{take}/{digest[:_DIGITS]}-{stage}-{start:08d}.npz"


def keyed_path(path: str, key: str) -> str:
    """Return the path of a block with the key in it of what it is made from."""
    return f"{path.removesuffix('.npz')}-{key[:_DIGITS]}.npz"


def discard_blocks(place: Place, blocks: Iterable[Block]) -> None:
    """Remove blocks that nobody needs any more, as far as that goes."""
    blocks = list(blocks)
    KEPT.discard(block.sha256 for block in blocks)
    with suppress(OSError):
        paths = {block.path for block in blocks}
        delete_files(place, sorted(paths | {_memory_path(path) for path in paths}))


def _memory_path(path: str) -> str:
    return f"{path.removesuffix('.npz')}.json"
