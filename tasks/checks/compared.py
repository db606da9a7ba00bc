"""The silhouettes of the few frames of a take that are compared, and what told them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.archive import Archive
from storage.blocks import Block, read_block
from storage.formats.capture.capture import Capture
from storage.formats.pictures.video import open_masks, pick_frames
from tasks.capture.backgrounds import Background, measure_gain, smooth
from tasks.capture.empty_stages import check_telling, read_backgrounds
from tasks.capture.films import (
    compared_frames,
    grid_of,
    largest_image,
    of_camera,
    projection_of,
)
from tasks.capture.tangency import Touches, join_touches, touches_of
from tasks.checks.telling import By, Telling, told_by
from tasks.reconstruction.regions.holes import fill_holes
from tasks.reconstruction.regions.masks import mask_facts, silhouettes_of
from tasks.reconstruction.regions.rims import edge_profile
from tasks.reconstruction.regions.stale_outlines import stale_outline
from tasks.reconstruction.silhouettes import (
    SilhouetteSettings,
    expected_of_all,
    extract_silhouettes,
)


@dataclass(frozen=True, eq=False)
class Compared:
    """What is compared of a capture that is examined."""

    silhouettes: NDArray[np.bool_]
    """(time, camera, row, column)."""
    telling: Telling
    gains: tuple[float, ...]
    """Of each camera, how many times as bright as its background its film is; 1 with masks."""
    behind: tuple[NDArray[np.uint8], ...]
    """(row, column, 3) of each camera, its background; with masks a frame of its film."""
    filled: NDArray[np.int64]
    """(time, camera) how many pixels are, or were, holes that the other cameras contradict."""


@dataclass(frozen=True, eq=False)
class Seeing:
    """How silhouettes are found in the films of a capture that is examined."""

    by: By
    backgrounds: list[Background]
    """Of each camera; none with masks."""
    settings: SilhouetteSettings

    def silhouettes(
        self, camera: int, frames: NDArray[np.uint8], masks: NDArray[np.uint8] | None
    ) -> NDArray[np.bool_]:
        """Return (time, row, column) silhouettes of a camera in frames, or of their masks.

        No other camera is asked, as it may have begun later.
        """
        if masks is not None:
            return silhouettes_of(masks, self.settings.grow_px)
        return extract_silhouettes(frames, self.backgrounds[camera], self.settings)


def prepare_seeing(capture: Capture, settings: SilhouetteSettings) -> Seeing:
    """Return how silhouettes are found in a capture.

    Parameters
    ----------
    capture
        Its files.
    settings
        What tells the performer from the stage, and how.

    Raises
    ------
    InputError
        If nothing does, or a background cannot be read; its camera is named.
    """
    check_telling(capture, settings.background, settings.key)
    by = told_by(capture, settings.background, settings.key)
    if by == "mask":
        return Seeing(by, [], settings)
    backgrounds = read_backgrounds(capture, settings.background, settings.key)
    return Seeing(by, backgrounds, settings)


def see_silhouettes(
    capture: Capture, frames: Sequence[NDArray[np.uint8]], numbers: Sequence[int], seeing: Seeing
) -> Compared:
    """Return the silhouettes of some frames of a capture.

    Parameters
    ----------
    capture
        With its films.
    frames : sequence of (time, row, column, 3) uint8
        Of each camera.
    numbers
        Which frames of the take they are, ascending.
    seeing
        How silhouettes are found in them.

    Raises
    ------
    InputError
        If masks cannot be read; their camera is named.
    """
    rows, columns = (max(each.shape[axis] for each in frames) for axis in (1, 2))
    silhouettes = np.zeros((len(numbers), len(frames), rows, columns), np.bool_)
    if seeing.by == "mask":
        grow_px = seeing.settings.grow_px
        facts = np.stack(
            [_see_masks(capture, c, numbers, silhouettes, grow_px) for c in range(len(frames))]
        )
        edges = np.stack(
            [_see_edges(film, silhouettes[:, c]) for c, film in enumerate(frames)], axis=1
        )
        telling = Telling(seeing.by, masks=facts.swapaxes(0, 1), edges=edges)
        shown = tuple(each[0] for each in frames)
        filled = np.zeros(silhouettes.shape[:2], np.int64)  # masks are taken as they are
        return Compared(silhouettes, telling, (1.0,) * len(frames), shown, filled)
    backgrounds = seeing.backgrounds
    stale = np.zeros_like(silhouettes)
    gains = []
    expected = expected_of_all(frames, backgrounds, capture, seeing.settings)
    for c, (film, background) in enumerate(zip(frames, backgrounds, strict=True)):
        room = np.s_[:, c, : film.shape[1], : film.shape[2]]
        silhouettes[room] = extract_silhouettes(film, background, seeing.settings, expected[c])
        found = zip(silhouettes[room], film, strict=True)
        stale[room] = [stale_outline(each, frame, background.color) for each, frame in found]
        gains.append(float(np.median([measure_gain(smooth(frame), background) for frame in film])))
    telling = Telling(
        seeing.by, stale=stale, sure=[each.sure for each in backgrounds],
        keys=[each.key for each in backgrounds],
    )  # fmt: skip
    behind = tuple(each.color.round().astype(np.uint8) for each in backgrounds)
    # what is kept is told, too
    into = silhouettes if seeing.settings.holes == "fill" else silhouettes.copy()
    return Compared(silhouettes, telling, tuple(gains), behind, _fill_holes(capture, into))


def _fill_holes(capture: Capture, silhouettes: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Fill holes as `extract_block` does; return (time, camera) how many pixels."""
    projection, grid = projection_of(capture.cameras), grid_of(capture)
    return np.array([fill_holes(frame, projection, grid) for frame in silhouettes])


def _see_masks(
    capture: Capture, camera: int, numbers: Sequence[int], silhouettes: NDArray[np.bool_],
    grow_px: float,
) -> NDArray[np.float64]:  # fmt: skip
    """Write the silhouettes of a camera's masks; return what tells whether they are masks."""

    def read() -> NDArray[np.uint8]:
        in_film = [capture.first_frames[camera] + number for number in numbers]
        return np.stack(list(pick_frames(open_masks(capture.masks[camera]), in_film)))

    masks = of_camera(capture.cameras[camera], read)
    silhouettes[:, camera, : masks.shape[1], : masks.shape[2]] = silhouettes_of(masks, grow_px)
    return np.stack([mask_facts(mask) for mask in masks])


def _see_edges(film: NDArray[np.uint8], silhouettes: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how colors change across the rims of a camera's silhouettes."""
    rows, columns = film.shape[1:3]
    return np.stack(
        [
            edge_profile(frame, silhouette[:rows, :columns])
            for frame, silhouette in zip(film, silhouettes, strict=True)
        ]
    )


def read_silhouettes(
    opened: Archive, source: Capture, blocks: Sequence[Block], by: By, step: int
) -> tuple[NDArray[np.bool_], Telling, Touches, NDArray[np.int64]]:
    """Return the silhouettes that are compared, what told them, where all are touched, and holes.

    Parameters
    ----------
    opened, source
        Where the blocks are, and the capture.
    blocks
        What `extract_block` wrote, in the order of the frames.
    by
        What told the performer from the stage.
    step
        How many frames are between those whose touches are looked for.

    Returns
    -------
    silhouettes : (time, camera, row, column) bool
    telling
        In the frames of the silhouettes.
    touches
        Of each `step`-th frame of the take.
    holes : (2, camera) int
        How many pixels of the take's silhouettes were holes that were filled, and how many they
        have.
    """
    compared = np.array(compared_frames(source.frames))
    projection = projection_of(source.cameras)
    _, columns = largest_image(source.cameras)
    parts: dict[str, list[NDArray]] = {"silhouette": [], "stale": [], "masks": [], "edges": []}
    sure: list[float] = []
    touches: list[Touches] = []
    holes = np.zeros((2, len(source.cameras)), np.int64)
    for block in blocks:
        inside = compared[(compared >= block.start) & (compared < block.end)] - block.start
        wanted = [*parts, "sure"] if len(inside) else ["silhouette"]
        held = read_block(opened.place, block, [*wanted, "filled"])
        bits = held["silhouette"]
        holes[0] += held["filled"].sum(axis=0)
        holes[1] += np.bitwise_count(bits).sum(axis=(0, 2, 3), dtype=np.int64)
        touches.append(touches_of(bits[-block.start % step :: step], projection))
        if len(inside):
            sure = held["sure"].tolist()
            held["silhouette"] = bits[inside]
            for name, those in parts.items():
                those.append(held[name])
    silhouettes, stale = (
        np.unpackbits(np.concatenate(parts[name]), axis=-1, count=columns).astype(np.bool_)
        for name in ("silhouette", "stale")
    )
    if by == "mask":
        masks, edges = (np.concatenate(parts[name]) for name in ("masks", "edges"))
        telling = Telling(by, masks=masks, edges=edges)
    else:
        telling = Telling(by, stale=stale, sure=sure)
    return silhouettes, telling, join_touches(touches), holes
