"""The index on disk: one plain array a take, opened by a search without decompressing or copying.

    index/<take>/<version>.<format>.npy    float32 (row, sample), mapped into memory on a disk
    index/<take>/<version>.<format>.json   its SHA-256, for `verify`

What the rows mean is the business of `tasks.retrieval.normalization`; `PACKING` counts up
whenever they change, so that arrays of an older shosa are rebuilt and never misread.
"""

import io
import json

import numpy as np
from numpy.typing import NDArray

from storage.errors import ArchiveError
from storage.files import check_regular
from storage.places import Place, read_file, told, write_file
from storage.provenance import digest_bytes

PACKING = 1


def search_array_path(take: str, version: str) -> str:
    """Return where the packed array of a version lives in the archive."""
    return f"index/{take}/{version}.{PACKING}.npy"


def write_search_array(place: Place, take: str, version: str, rows: NDArray[np.float32]) -> str:
    """Write the packed rows (row, sample) of a version; return their SHA-256."""
    content = io.BytesIO()
    np.lib.format.write_array(content, np.ascontiguousarray(rows), allow_pickle=False)
    digest = digest_bytes(content.getbuffer())
    path = search_array_path(take, version)
    write_file(place, path, content.getvalue())
    write_file(place, _digest_path(path), json.dumps({"sha256": digest}).encode())
    return digest


def open_search_array(place: Place, take: str, version: str) -> NDArray[np.float32]:
    """Return the packed rows (row, sample) of a version: mapped on a disk, fetched elsewhere.

    Raises
    ------
    ArchiveError
        If they are missing or damaged; `shosa index` makes them anew.
    """
    path = search_array_path(take, version)
    try:
        if place.folder:
            with told(f"read {place.url(path)}"):
                check_regular(place.folder / path)
            rows = np.load(place.folder / path, mmap_mode="r", allow_pickle=False)
        else:
            content = io.BytesIO(read_file(place, path))
            rows = np.lib.format.read_array(content, allow_pickle=False)
    except FileNotFoundError as error:
        raise ArchiveError(
            f"take {take!r} has no search array; run `shosa index` on the archive"
        ) from error
    except (ValueError, EOFError) as error:
        raise ArchiveError(
            f"the search array of take {take!r} is damaged ({error}); "
            "run `shosa index` on the archive"
        ) from error
    return rows


def verify_search_array(
    place: Place, take: str, version: str, digest: str | None = None
) -> list[str]:
    """Recompute the digest of a take's search array, and return the fault as a sentence.

    It is compared with `digest`, or where that is None with the one written beside the array.
    """
    path = search_array_path(take, version)
    try:
        expected = digest or json.loads(read_file(place, _digest_path(path)))["sha256"]
        found = digest_bytes(read_file(place, path))
    except FileNotFoundError:
        return [f"take {take!r} has no search array; run `shosa index` on the archive"]
    except (ValueError, KeyError, TypeError):
        expected, found = "", "unreadable"
    if found != expected:
        return [f"the search array of take {take!r} has changed; run `shosa index` on the archive"]
    return []


def _digest_path(path: str) -> str:
    return path.removesuffix(".npy") + ".json"
