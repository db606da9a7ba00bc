"""The files of a segment of the index: the packed rows of many takes, and their summaries.

    index/all.segments/<segment>.json         its label: which takes, where, and what checks them
    index/all.segments/<segment>.rows.npy     float32 (row, sample), take after take
    index/all.segments/<segment>.<name>.npy   a summary of the rows, whatever a search makes of it

A file is written once under a name that no other has, and never changed. The label holds a CRC-32C
of each row over each block of samples, and of each piece of a summary, so that a search checks what
it reads and nothing else.
"""

import base64
import json
import secrets
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import google_crc32c
import numpy as np
from numpy.typing import NDArray

from storage.arrays.search import ADVICE, PACKING, array_head
from storage.errors import ArchiveError, DamagedSegmentError
from storage.index.caching import drop_local_file, local_file
from storage.index.entries import Entry, entries_of, entry_columns
from storage.places import Place, read_file, told, write_file
from storage.provenance import digest_bytes

FOLDER = "index/all.segments"
"""Where the files of all segments are. No take is called so: no name of a take has a dot."""
FORMAT = 1
BLOCK = 4096
"""How many samples of a row are checked at once [samples]. Chosen: 16 kB, a second at 30 Hz is 30
of them."""
PIECE = 1 << 20
"""How much of a summary has one checksum [bytes]. Chosen: a tenth of a millisecond."""
_ROWS = "rows"


@dataclass(frozen=True)
class Stored:
    """A file of a segment as its label describes it."""

    path: str
    dtype: str
    shape: tuple[int, ...]
    crc32c: NDArray[np.uint32]
    """(block, row) of the rows; (piece,) of a summary."""

    @property
    def head(self) -> bytes:
        """What the file begins with."""
        return array_head(self.shape, self.dtype)

    @property
    def size(self) -> int:
        """How large the file is [bytes]."""
        return len(self.head) + int(np.prod(self.shape)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True, eq=False)
class Label:
    """What a segment holds; its own digest stands in the manifest of a snapshot."""

    path: str
    entries: list[Entry]
    stamps: list[Any]
    """(take,) By which it is known that a take is still what its entry says; None where not."""
    first: NDArray[np.int64]
    """(take,) The sample at which each take begins."""
    samples: NDArray[np.int64]
    """(take,) How many it has; 0 where it has no motion."""
    rows: Stored
    summaries: dict[str, Stored]
    summarized: int
    """What kind of summaries they are; 0 for none."""

    @property
    def files(self) -> list[str]:
        """The paths of all its files."""
        return [self.path, self.rows.path, *(each.path for each in self.summaries.values())]


class OpenSegment:
    """The arrays of a segment, mapped, and what checks them; no part is believed unchecked."""

    def __init__(self, place: Place, label: Label) -> None:
        """Open the rows; raises a DamagedSegmentError where they are missing or cut."""
        self.label = label
        self._place = place
        self.rows: NDArray[np.float32] = _map(place, label, label.rows)
        self.summaries = _Summaries(place, label)
        self._whole = np.zeros(len(label.rows.crc32c), bool)

    def check(self, first: int, last: int) -> None:
        """Check the samples from `first` to before `last`, in all rows.

        Raises
        ------
        DamagedSegmentError
            If they are not what was written.
        """
        for block in range(first // BLOCK, -(-last // BLOCK)):
            if not self._whole[block]:
                if not self._is_whole(block):
                    drop_local_file(self._place, self.label.rows.path)
                    raise _damaged(self.label, f"{self.label.rows.path} has changed")
                self._whole[block] = True

    def damaged_blocks(self) -> list[int]:
        """Return which blocks of samples are not what was written."""
        return [block for block in range(len(self._whole)) if not self._is_whole(block)]

    def damaged(self) -> NDArray[np.bool_]:
        """Return in which takes something has changed, (take,)."""
        touched = np.zeros(len(self.label.first), bool)
        ends = self.label.first + self.label.samples
        for block in self.damaged_blocks():
            touched |= (self.label.first < (block + 1) * BLOCK) & (ends > block * BLOCK)
        return touched

    def _is_whole(self, block: int) -> bool:
        wanted = self.label.rows.crc32c[block]
        return bool(np.array_equal(_block_checks(self.rows, block), wanted))


class _Summaries(Mapping[str, NDArray]):
    """The summaries of a segment by name, each checked when it is first asked for."""

    def __init__(self, place: Place, label: Label) -> None:
        self._place, self._label = place, label
        self._read: dict[str, NDArray] = {}

    def __getitem__(self, name: str) -> NDArray:
        if name not in self._read:
            stored = self._label.summaries[name]
            values = _map(self._place, self._label, stored, summary=name)
            if not np.array_equal(_piece_checks(values), stored.crc32c):
                drop_local_file(self._place, stored.path)
                raise _damaged(self._label, f"{stored.path} has changed", summary=name)
            self._read[name] = values
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._label.summaries)

    def __len__(self) -> int:
        return len(self._label.summaries)


def new_rows(rows: int, samples: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the content of a file of rows, missing (NaN) everywhere, and its values to be set."""
    head = array_head((rows, samples))
    content = np.empty(len(head) + 4 * rows * samples, np.uint8)
    content[: len(head)] = np.frombuffer(head, np.uint8)
    values = content[len(head) :].view(np.float32).reshape(rows, samples)
    values.fill(np.nan)
    return content, values


def write_segment(
    place: Place,
    entries: Sequence[Entry],
    stamps: Sequence[Any],
    spans: Sequence[tuple[int, int]],
    content: tuple[NDArray[np.uint8], NDArray[np.float32]],
    summaries: Mapping[str, NDArray],
    *,
    summarized: int,
) -> tuple[Label, str]:
    """Write the files of a new segment; return its label, and the SHA-256 of that.

    Parameters
    ----------
    spans
        Where each take begins, and how many samples it has.
    content
        From `new_rows`.
    """
    name = secrets.token_hex(8)
    file, rows = content
    blocks = -(-rows.shape[1] // BLOCK)
    checks = np.array([_block_checks(rows, block) for block in range(blocks)], np.uint32)
    checks = checks.reshape(blocks, rows.shape[0])
    stored = Stored(f"{FOLDER}/{name}.{_ROWS}.npy", "<f4", rows.shape, checks)
    write_file(place, stored.path, file.data)
    kept = {}
    for each, array in summaries.items():
        values = np.ascontiguousarray(array)
        about = Stored(
            f"{FOLDER}/{name}.{each}.npy", values.dtype.str, values.shape, _piece_checks(values)
        )
        write_file(place, about.path, about.head + values.tobytes())
        kept[each] = about
    first, samples = np.array(spans, np.int64).reshape(-1, 2).T
    label = Label(
        f"{FOLDER}/{name}.json", [*entries], [*stamps], first, samples, stored, kept, summarized
    )
    return label, _write_label(place, label)


def rewrite_label(
    place: Place, label: Label, entries: Sequence[Entry], stamps: Sequence[Any]
) -> tuple[Label, str]:
    """Write a new label of a segment, whose other files stay, with entries as they are now."""
    path = f"{FOLDER}/{secrets.token_hex(8)}.json"
    again = Label(
        path, [*entries], [*stamps], label.first, label.samples, label.rows, label.summaries,
        label.summarized,
    )  # fmt: skip
    return again, _write_label(place, again)


def read_label(place: Place, path: str, sha256: str) -> Label:
    """Return the label of a segment.

    Raises
    ------
    DamagedSegmentError
        If it is missing, or not what the manifest says.
    """
    try:
        content = read_file(place, path)
    except FileNotFoundError:
        raise DamagedSegmentError(f"{place.url(path)} is missing; {ADVICE}", path) from None
    except ArchiveError as error:  # a folder or a pipe
        raise DamagedSegmentError(f"{error}; {ADVICE}", path) from error
    if digest_bytes(content) != sha256:
        raise DamagedSegmentError(f"{place.url(path)} has changed; {ADVICE}", path)
    said = json.loads(content)
    files = {
        name: Stored(
            each["path"],
            each["dtype"],
            tuple(each["shape"]),
            np.frombuffer(base64.b64decode(each["crc32c"]), "<u4"),
        )
        for name, each in said["files"].items()
    }
    rows = files.pop(_ROWS)
    checks = rows.crc32c.reshape(-1, rows.shape[0])
    return Label(
        path=path,
        entries=entries_of(said["takes"]),
        stamps=said["stamps"],
        first=np.array(said["first"], np.int64),
        samples=np.array(said["samples"], np.int64),
        rows=Stored(rows.path, rows.dtype, rows.shape, checks),
        summaries=files,
        summarized=said["summarized"],
    )


def verify_segment(place: Place, label: Label) -> list[str]:
    """Recompute all checksums of a segment, and return each fault as a sentence."""
    faults = []
    for path in label.files:
        drop_local_file(place, path)  # an object store's file itself is checked
    try:
        opened = OpenSegment(place, label)
        if opened.damaged_blocks():
            takes = int(opened.damaged().sum())
            faults.append(
                f"the index is damaged: {label.rows.path} has changed, in {takes} of its "
                f"{len(label.entries)} takes; {ADVICE}"
            )
    except DamagedSegmentError as error:
        faults.append(str(error))
    summaries = _Summaries(place, label)
    for name in label.summaries:
        try:
            summaries[name]
        except DamagedSegmentError as error:
            faults.append(str(error))
    return faults


def _damaged(label: Label, what: str, *, summary: str | None = None) -> DamagedSegmentError:
    said = f"the index is damaged: {what}; {ADVICE}"
    return DamagedSegmentError(said, label.path, summary)


def _write_label(place: Place, label: Label) -> str:
    """Write a label; return its SHA-256."""
    files = {_ROWS: label.rows, **label.summaries}
    said = {
        "format": FORMAT,
        "packing": PACKING,
        "summarized": label.summarized,
        "files": {
            name: {
                "path": each.path,
                "dtype": each.dtype,
                "shape": each.shape,
                "crc32c": base64.b64encode(each.crc32c.astype("<u4").tobytes()).decode(),
            }
            for name, each in files.items()
        },
        "first": label.first.tolist(),
        "samples": label.samples.tolist(),
        "stamps": label.stamps,
        "takes": entry_columns(label.entries),
    }
    content = json.dumps(said, allow_nan=False).encode()
    write_file(place, label.path, content)
    return digest_bytes(content)


def _map(place: Place, label: Label, stored: Stored, *, summary: str | None = None) -> NDArray:
    """Return the values of a file, mapped; its head and its size are checked."""
    try:
        path = local_file(place, stored.path, stored.size)
        with told(f"read {place.url(stored.path)}"):
            found = path.stat().st_size
            with path.open("rb") as file:
                begin = file.read(len(stored.head))
            if (found, begin) == (stored.size, stored.head):
                if not np.prod(stored.shape):
                    return np.empty(stored.shape, stored.dtype)
                return np.memmap(
                    path, stored.dtype, "r", offset=len(stored.head), shape=stored.shape
                )
    except FileNotFoundError:
        raise _damaged(label, f"{stored.path} is missing", summary=summary) from None
    except ArchiveError as error:
        raise _damaged(label, str(error), summary=summary) from error
    said = f"{stored.path} has {found} bytes where {stored.size} are wanted"
    if found == stored.size:
        said = f"the head of {stored.path} is not that of {stored.dtype} values {stored.shape}"
    raise _damaged(label, said, summary=summary)


def _block_checks(rows: NDArray[np.float32], block: int) -> NDArray[np.uint32]:
    """Return the CRC-32C of each row over a block of samples."""
    part = rows[:, block * BLOCK : (block + 1) * BLOCK].view(np.uint8)
    return np.array([google_crc32c.value(row) for row in part], np.uint32)  # type: ignore[arg-type]


def _piece_checks(values: NDArray) -> NDArray[np.uint32]:
    """Return the CRC-32C of each piece of an array."""
    flat = values.reshape(-1).view(np.uint8)
    pieces = range(0, len(flat), PIECE)
    checks = [google_crc32c.value(flat[at : at + PIECE]) for at in pieces]  # type: ignore[arg-type]
    return np.array(checks, np.uint32)
