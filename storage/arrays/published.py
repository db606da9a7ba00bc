"""The files of a published version as Zarr reads them: what its record says, byte for byte, or not.

Zarr takes a chunk that is missing for one of empty values, and decodes one that was changed, so
every file is compared with its record when it is first read. What the record does not name is not
there.
"""

import asyncio
from collections.abc import AsyncIterator, Iterable, Mapping
from typing import Any

from zarr.abc.store import (
    ByteRequest,
    OffsetByteRequest,
    RangeByteRequest,
    Store,
    SuffixByteRequest,
)
from zarr.core.buffer import Buffer, BufferPrototype

from storage.errors import ArchiveError
from storage.places import Place, read_file, read_range
from storage.provenance import digest_bytes


class PublishedFiles(Store):
    """The files of a version, each one whole or refused; nothing can be written.

    Parameters
    ----------
    place, folder
        Where the version is.
    files
        `bytes` and `sha256` of each, by its path in the version.
    """

    def __init__(self, place: Place, folder: str, files: Mapping[str, Mapping[str, Any]]) -> None:
        super().__init__(read_only=True)
        self._place, self._folder, self._files = place, folder, files
        self._compared: set[str] = set()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PublishedFiles) and (
            (self._place, self._folder, self._files) == (other._place, other._folder, other._files)
        )

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return a file, or a part of it."""
        if key not in self._files:
            return None
        content = await asyncio.to_thread(self._read, key, byte_range)
        return prototype.buffer.from_bytes(content)

    async def get_partial_values(
        self, prototype: BufferPrototype, key_ranges: Iterable[tuple[str, ByteRequest | None]]
    ) -> list[Buffer | None]:
        """Return parts of files."""
        return [await self.get(key, prototype, wanted) for key, wanted in key_ranges]

    async def exists(self, key: str) -> bool:
        """Say whether the version has such a file."""
        return key in self._files

    async def list(self) -> AsyncIterator[str]:
        """Yield all files."""
        for name in self._files:
            yield name

    async def list_prefix(self, prefix: str) -> AsyncIterator[str]:
        """Yield the files whose path begins so."""
        for name in self._files:
            if name.startswith(prefix):
                yield name

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """Yield the names of what is directly in a folder."""
        above = f"{prefix.rstrip('/')}/" if prefix else ""
        below = (name[len(above) :] for name in self._files if name.startswith(above))
        for name in sorted({each.split("/")[0] for each in below}):
            yield name

    @property
    def supports_writes(self) -> bool:
        """No: what is published is never changed."""
        return False

    @property
    def supports_deletes(self) -> bool:
        """No."""
        return False

    @property
    def supports_listing(self) -> bool:
        """Yes: by the record."""
        return True

    async def set(self, key: str, value: Buffer) -> None:
        """Refuse: what is published is never changed."""
        raise NotImplementedError(f"{key} is published and is never changed")

    async def delete(self, key: str) -> None:
        """Refuse: what is published is never changed."""
        raise NotImplementedError(f"{key} is published and is never changed")

    def _read(self, key: str, wanted: ByteRequest | None) -> bytes:
        """Return a file, or a part of it, once it is known to be what was published."""
        path, size = f"{self._folder}/{key}", self._files[key]["bytes"]
        start, end = _span(wanted, size)
        try:
            if key in self._compared:
                return read_range(self._place, path, start, end)
            content = read_file(self._place, path)
        except FileNotFoundError:
            raise self._damaged(f"{path} is missing") from None
        if len(content) != size or digest_bytes(content) != self._files[key]["sha256"]:
            raise self._damaged(f"{path} has changed since it was published")
        self._compared.add(key)
        return content if wanted is None else content[start:end]

    def _damaged(self, what: str) -> ArchiveError:
        """Return the error that says so."""
        take = self._folder.split("/")[1]
        return ArchiveError(
            f"take {take!r} is damaged, or was replaced and collected since it was opened: {what}; "
            "open it again, and see `shosa verify` for all that is damaged"
        )


def _span(wanted: ByteRequest | None, size: int) -> tuple[int, int]:
    """Return the first byte of a part of a file, and the one after its last."""
    match wanted:
        case RangeByteRequest(start=start, end=end):
            return start, min(end, size)
        case OffsetByteRequest(offset=offset):
            return offset, size
        case SuffixByteRequest(suffix=suffix):
            return max(0, size - suffix), size
    return 0, size
