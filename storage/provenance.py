"""Where an array comes from: the stage, its version and settings, what it read, when, how long."""

import hashlib
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from storage.files import open_regular

_BLOCK = 1 << 20


@dataclass
class Provenance:
    """What is written as the attribute `provenance` of every group of a take."""

    stage: str
    settings: dict[str, Any]
    """What was set, as JSON can hold it."""
    inputs: dict[str, str]
    """Digest of each thing read, by its name."""
    shosa: str = field(default_factory=lambda: shosa_version())
    started: str = field(default_factory=lambda: now())
    seconds: float = 0.0

    def attributes(self) -> dict[str, Any]:
        """Return the provenance as Zarr attributes hold it."""
        return asdict(self)


@contextmanager
def recorded(
    stage: str, *, settings: Mapping[str, Any], inputs: Mapping[str, str]
) -> Iterator[Provenance]:
    """Give the provenance of a stage that runs in the block; `seconds` counts up to its reading."""
    provenance = Provenance(stage, dict(settings), dict(inputs))
    begin = time.monotonic()
    yield provenance
    provenance.seconds = round(time.monotonic() - begin, 3)


def now() -> str:
    """Return the present in UTC as ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def shosa_version() -> str:
    """Return the version of the program that writes."""
    try:
        return version("shosa")
    except PackageNotFoundError:
        return "unknown"


def digest_bytes(content: bytes | memoryview) -> str:
    """Return the SHA-256 of `content` in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def digest_file(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal, whatever its size."""
    digest = hashlib.sha256()
    with open_regular(path) as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()
