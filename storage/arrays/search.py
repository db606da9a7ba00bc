"""The search array of a take by itself, as it is written when the take is published.

    index/<take>/<version>.<format>.npy    float32 (row, sample), mapped into memory on a disk
    index/<take>/<version>.<format>.json   whose array it is, its shape and its checks

Many of them are gathered in a segment of the index (`storage.index.segments`) and removed then.
What the rows mean is the business of `tasks.retrieval.normalization`; `PACKING` counts up
whenever they change, so that arrays of an older shosa are rebuilt and never misread.
"""

import io
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import google_crc32c
import numpy as np
from numpy.typing import NDArray

from storage.errors import ArchiveError
from storage.places import (
    Place,
    delete_files,
    list_files,
    read_file,
    regular_file,
    told,
    write_file,
)
from storage.provenance import digest_bytes

PACKING = 1
ADVICE = "run `shosa index` on the archive"
"""What to do where the index, or a search array, is not what it should be."""


def search_array_path(take: str, version: str) -> str:
    """Return where the packed array of a version lives in the archive."""
    return f"index/{take}/{version}.{PACKING}.npy"


@dataclass(frozen=True)
class _Label:
    """What stands beside a search array: whose it is, and what tells that it is whole."""

    take: str
    version: str
    shape: list[int]
    sha256: str
    """Of the file. `verify` recomputes it."""
    crc32c: int
    """Of the values. It is recomputed whenever they are searched, as fast as they are read."""


def write_search_array(place: Place, take: str, version: str, rows: NDArray[np.float32]) -> str:
    """Write the packed rows (row, sample) of a version; return their SHA-256."""
    values = np.ascontiguousarray(rows, np.float32)
    content = io.BytesIO(array_head(values.shape) + values.tobytes())
    digest = digest_bytes(content.getbuffer())
    label = _Label(take, version, list(values.shape), digest, _check(values))
    path = search_array_path(take, version)
    write_file(place, path, content.getvalue())
    write_file(place, _label_path(path), json.dumps(asdict(label)).encode())
    return digest


def open_search_array(place: Place, take: str, version: str) -> NDArray[np.float32]:
    """Return the packed rows (row, sample) of a version: mapped on a disk, fetched elsewhere.

    A mapping keeps a file open; who opens many takes reads them.

    Raises
    ------
    ArchiveError
        If they are missing, damaged or of another take; `shosa index` makes them anew.
    """
    return _open(place, take, version, mapped=True)


def read_search_array(place: Place, take: str, version: str) -> NDArray[np.float32]:
    """Return the packed rows (row, sample) of a version in memory; raises as the above."""
    return _open(place, take, version, mapped=False)


def search_array_digest(place: Place, take: str, version: str) -> str:
    """Return the SHA-256 that is written beside the search array of a version."""
    return _read_label(place, take, version).sha256


def search_digest(rows: NDArray[np.float32]) -> str:
    """Return the SHA-256 of the file of a search array with these rows."""
    values = np.ascontiguousarray(rows, np.float32)
    return digest_bytes(array_head(values.shape) + values.tobytes())


def verify_search_array(place: Place, take: str, version: str) -> list[str]:
    """Recompute the digest of a take's search array, and return the fault as a sentence."""
    try:
        label = _read_label(place, take, version)
        content = read_file(place, search_array_path(take, version))
        whole = digest_bytes(content) == label.sha256
        if whole:
            open_search_array(place, take, version)
    except FileNotFoundError:
        return [_missing(take)]
    except ValueError as error:
        return [f"the search array of take {take!r} has changed ({error}); {ADVICE}"]
    return [] if whole else [_changed(take)]


def lying_search_arrays(place: Place) -> dict[tuple[str, str], int]:
    """Return the size of each search array of a take by itself, by take and version."""
    found = {}
    for file in list_files(place, "index"):
        parts = file.path.split("/")
        version = parts[-1].removesuffix(f".{PACKING}.npy")
        if len(parts) == 3 and version != parts[-1] and "." not in parts[1] + version:
            found[parts[1], version] = file.size
    return found


def remove_search_arrays(place: Place, versions: Iterable[tuple[str, str]]) -> None:
    """Remove the search arrays of versions of takes, which a segment holds now."""
    paths = [search_array_path(take, version) for take, version in versions]
    delete_files(place, [each for path in paths for each in (path, _label_path(path))])


def array_head(shape: tuple[int, ...], dtype: str = "<f4") -> bytes:
    """Return what the .npy file of values of that shape begins with."""
    head = io.BytesIO()
    about = {"descr": dtype, "fortran_order": False, "shape": tuple(shape)}
    np.lib.format.write_array_header_1_0(head, about)
    return head.getvalue()


def _open(place: Place, take: str, version: str, *, mapped: bool) -> NDArray[np.float32]:
    """Return the packed rows of a version, which are known to be its own and whole."""
    try:
        label = _read_label(place, take, version)
        shape = label.shape[0], label.shape[1]
        rows = _open_rows(place, search_array_path(take, version), shape, mapped=mapped)
    except FileNotFoundError as error:
        raise ArchiveError(_missing(take)) from error
    except ValueError as error:
        raise ArchiveError(
            f"the search array of take {take!r} is damaged ({error}); {ADVICE}"
        ) from error
    if _check(rows) != label.crc32c:
        raise ArchiveError(_changed(take))
    return rows


def _open_rows(
    place: Place, path: str, shape: tuple[int, int], *, mapped: bool
) -> NDArray[np.float32]:
    """Return the values of a search array of that shape; ValueError where the file has another."""
    head = array_head(shape)
    size = len(head) + 4 * shape[0] * shape[1]
    if place.folder and mapped:
        with told(f"read {place.url(path)}"):
            file = regular_file(place.folder / path)
            found, begin = file.stat().st_size, _first_bytes(file, len(head))
            if (found, begin) == (size, head):
                return np.memmap(file, np.float32, "r", offset=len(head), shape=shape)
    else:
        content = read_file(place, path)
        found, begin = len(content), content[: len(head)]
        if (found, begin) == (size, head):
            return np.frombuffer(content, np.float32, offset=len(head)).reshape(shape)
    if found != size:
        raise ValueError(f"it has {found} bytes where {size} are wanted")
    raise ValueError(f"its head is not that of float32 values {shape}")


def _first_bytes(file: Path, count: int) -> bytes:
    with file.open("rb") as opened:
        return opened.read(count)


def _read_label(place: Place, take: str, version: str) -> _Label:
    """Return what stands beside the search array of a version; ValueError if it is another's."""
    content = read_file(place, _label_path(search_array_path(take, version)))
    try:
        label = _Label(**json.loads(content))
    except (ValueError, TypeError, RecursionError):
        raise ValueError("it is of an older shosa, or the file beside it is damaged") from None
    if (label.take, label.version) != (take, version):
        raise ValueError(f"it is that of take {label.take!r}, version {label.version}")
    if not isinstance(label.shape, list) or [*map(type, label.shape)] != [int, int]:
        raise ValueError(f"its shape is said to be {label.shape!r}")
    if min(label.shape) < 1:
        raise ValueError(f"its shape is said to be {label.shape}")
    return label


def _label_path(path: str) -> str:
    return path.removesuffix(".npy") + ".json"


def _check(values: NDArray[np.float32]) -> int:
    return google_crc32c.value(values.reshape(-1).view(np.uint8))  # type: ignore[arg-type]


def _missing(take: str) -> str:
    return f"take {take!r} has no search array; {ADVICE}"


def _changed(take: str) -> str:
    return f"the search array of take {take!r} has changed; {ADVICE}"
