"""What is noted of some frames while their silhouettes are found, for checks that see no film.

In these frames the films are compared with their backgrounds, or with the masks that were given.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.reconstruction.regions.masks import MASK_FACTS, mask_facts
from tasks.reconstruction.regions.rims import DISTANCES, edge_profile
from tasks.reconstruction.regions.stale_outlines import stale_outline


@dataclass(frozen=True, eq=False)
class Noted:
    """What is noted of each of the frames, before each camera."""

    frames: Sequence[int]
    """Of the take."""
    stale: NDArray[np.uint8]
    """(frame, camera, row, column / 8) the outlines that are of the background alone, packed."""
    masks: NDArray[np.float64]
    """(frame, camera, 4) of `mask_facts`."""
    edges: NDArray[np.float64]
    """(frame, camera, distance + 1) of `edge_profile`."""


def nothing_noted(frames: Sequence[int], cameras: int, image: tuple[int, int]) -> Noted:
    """Return room for what is noted of some frames; `image` is rows and columns of the largest."""
    rows, columns = image
    shape = len(frames), cameras
    return Noted(
        frames,
        np.zeros((*shape, rows, -(-columns // 8)), np.uint8),
        np.zeros((*shape, MASK_FACTS)),
        np.zeros((*shape, len(DISTANCES) + 1)),
    )


def note_masks(
    noted: Noted,
    camera: int,
    first: int,
    film: NDArray[np.uint8],
    masks: NDArray[np.uint8],
    silhouettes: NDArray[np.bool_],
) -> None:
    """Note what tells whether the masks of a camera are masks, and fit its film.

    Parameters
    ----------
    camera, first
        The camera, and the frame of the take at which what follows begins.
    film : (time, row, column, 3) uint8
        RGB, as filmed.
    masks : (time, row, column) uint8
        As they were given.
    silhouettes : (time, row, column) bool
        As they were taken from them.
    """
    for n, frame in _among(noted, first, len(film)):
        noted.masks[n, camera] = mask_facts(masks[frame])
        noted.edges[n, camera] = edge_profile(film[frame], silhouettes[frame])


def note_outlines(
    noted: Noted,
    camera: int,
    first: int,
    film: NDArray[np.uint8],
    color: NDArray[np.float32],
    silhouettes: NDArray[np.bool_],
) -> None:
    """Note which outlines of a camera's silhouettes are of its background alone.

    Parameters are those of `note_masks`; `color` (row, column, 3) is the background, smoothed.
    """
    for n, frame in _among(noted, first, len(film)):
        stale = np.packbits(stale_outline(silhouettes[frame], film[frame], color), axis=-1)
        noted.stale[n, camera, : stale.shape[0], : stale.shape[1]] = stale


def _among(noted: Noted, first: int, count: int) -> Iterator[tuple[int, int]]:
    """Yield which of the noted frames are among `count` from `first` on, and which of these."""
    for n, frame in enumerate(noted.frames):
        if 0 <= frame - first < count:
            yield n, frame - first
