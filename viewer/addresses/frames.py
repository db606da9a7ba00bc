"""The addresses from which a page gets frames: joint tracks and voxels, packed and compressed."""

import gzip
import logging
from collections.abc import Callable

import numpy as np
from fastapi import FastAPI, Response
from fastapi.responses import PlainTextResponse
from numpy.typing import NDArray

from storage.archive import Take
from storage.errors import ArchiveError, InputError, UnknownNameError
from viewer.holdings import Holdings, Motion
from viewer.tracks import make_palette, pack_track, pack_voxel_frame, pack_voxels_head

logger = logging.getLogger(__name__)

MOST_ROWS = 4096
"""How many rows of a track one answer has at most [frames]. Pages ask for pieces."""
MOST_VOXEL_FRAMES = 60
"""How many frames of voxels one answer has at most [frames]."""
_LEVEL = 6
"""Level of gzip. Chosen: 9 is a third slower and 1 % smaller on tracks."""
_PALETTE_FRAMES = 5
"""From how many frames of a take its colors are chosen [frames]."""
_KEPT = "private, max-age=86400"  # a version never changes


def add_data(app: FastAPI, holdings: Holdings) -> None:
    """Add the addresses of `holdings` to an app."""

    @app.get("/data/track/{take}/{version}")
    def track(take: str, version: str, start: int = 0, end: int = 0, step: int = 1) -> Response:
        return _answer(lambda: _track(holdings.motion(take, version), start, end, step))

    @app.get("/data/voxels/{take}/{version}")
    def voxels(take: str, version: str, start: int = 0, count: int = 1) -> Response:
        return _answer(lambda: _voxels(holdings, holdings.take(take, version), start, count))


def _answer(make: Callable[[], bytes]) -> Response:
    """Return what `make` makes, compressed, or a sentence about what is wrong."""
    try:
        content = gzip.compress(make(), _LEVEL, mtime=0)
    except (UnknownNameError, ArchiveError, InputError, OSError, IndexError) as error:
        status = 404 if isinstance(error, UnknownNameError) else 409
        return PlainTextResponse(str(error), status)
    except Exception as error:  # what Zarr raises where a chunk was changed is no class of ours
        logger.warning("frames could not be read", exc_info=error)
        return PlainTextResponse(
            f"the data of this take cannot be decoded ({type(error).__name__}); `shosa verify` on "
            "the archive names what is damaged",
            500,
        )
    head = {"content-encoding": "gzip", "cache-control": _KEPT}
    return Response(content, media_type="application/octet-stream", headers=head)


def _track(motion: Motion, start: int, end: int, step: int) -> bytes:
    """Return rows of a motion, packed; raises an InputError if they cannot be sent."""
    if motion.position is None:
        raise InputError(f"take {motion.name!r} has no joints: its pose was not fitted")
    first, last, by = max(0, start), min(end, motion.frames - 1), max(1, step)
    if not first <= last or (last - first) // by >= MOST_ROWS:
        raise InputError(
            f"frames {start}-{end} by {step} cannot be sent; ask for {MOST_ROWS} at most, "
            f"within 0-{motion.frames - 1}"
        )
    return pack_track(np.asarray(motion.position[first : last + 1 : by]), first, by)


def _voxels(holdings: Holdings, take: Take, start: int, count: int) -> bytes:
    """Return the surface voxels of some frames, packed."""
    end = min(start + min(count, MOST_VOXEL_FRAMES), take.record.frames)
    if not 0 <= start < end:
        raise InputError(f"take {take.name!r} has the frames 0-{take.record.frames - 1}")

    def palette() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        chosen = np.unique(np.linspace(0, take.record.frames - 1, _PALETTE_FRAMES).astype(int))
        found = [take.surfaces(frame, frame + 1)[0][1] for frame in chosen.tolist()]
        return make_palette(np.concatenate(found))

    colors, place = holdings.palette(take, palette)
    shape, origin, voxel_m = take.grid
    parts = [pack_voxels_head(shape, origin, voxel_m, colors, end - start, start)]
    for frame, (number, color, label) in enumerate(take.surfaces(start, end), start):
        red, green, blue = (color >> 3).astype(np.int32).T
        parts.append(pack_voxel_frame(frame, number, place[red << 10 | green << 5 | blue], label))
    return b"".join(parts)
