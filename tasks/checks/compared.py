"""The silhouettes of the few frames of a take that are compared, and what told them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.archive import Archive
from storage.blocks import Block, read_block
from storage.formats.capture.capture import Capture
from storage.formats.pictures.video import open_masks, pick_frames
from tasks.capture.backgrounds import measure_gain, smooth
from tasks.capture.empty_stages import check_telling, read_backgrounds
from tasks.capture.films import compared_frames, largest_image, of_camera
from tasks.checks.telling import By, Telling, told_by
from tasks.reconstruction.regions.masks import mask_facts, silhouettes_of
from tasks.reconstruction.regions.stale_outlines import stale_outline
from tasks.reconstruction.silhouettes import SilhouetteSettings, extract_silhouettes


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


def see_silhouettes(
    capture: Capture,
    frames: Sequence[NDArray[np.uint8]],
    numbers: Sequence[int],
    settings: SilhouetteSettings,
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
    settings
        What tells the performer from the stage, and how.

    Raises
    ------
    InputError
        If nothing does, or masks or backgrounds cannot be read; their camera is named.
    """
    check_telling(capture, settings.background, settings.key)
    by = told_by(capture, settings.background, settings.key)
    rows, columns = (max(each.shape[axis] for each in frames) for axis in (1, 2))
    silhouettes = np.zeros((len(numbers), len(frames), rows, columns), np.bool_)
    if by == "mask":
        facts = np.stack([_see_masks(capture, c, numbers, silhouettes) for c in range(len(frames))])
        telling = Telling(by, masks=facts.swapaxes(0, 1))
        shown = tuple(each[0] for each in frames)
        return Compared(silhouettes, telling, (1.0,) * len(frames), shown)
    backgrounds = read_backgrounds(capture, settings.background, settings.key)
    stale = np.zeros_like(silhouettes)
    gains = []
    for c, (film, background) in enumerate(zip(frames, backgrounds, strict=True)):
        room = np.s_[:, c, : film.shape[1], : film.shape[2]]
        silhouettes[room] = extract_silhouettes(film, background, settings)
        found = zip(silhouettes[room], film, strict=True)
        stale[room] = [stale_outline(each, frame, background.color) for each, frame in found]
        gains.append(float(np.median([measure_gain(smooth(frame), background) for frame in film])))
    telling = Telling(
        by, stale=stale, sure=[each.sure for each in backgrounds],
        keys=[each.key for each in backgrounds],
    )  # fmt: skip
    behind = tuple(each.color.round().astype(np.uint8) for each in backgrounds)
    return Compared(silhouettes, telling, tuple(gains), behind)


def _see_masks(
    capture: Capture, camera: int, numbers: Sequence[int], silhouettes: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Write the silhouettes of a camera's masks; return what tells whether they are masks."""

    def read() -> NDArray[np.uint8]:
        return np.stack(list(pick_frames(open_masks(capture.masks[camera]), numbers)))

    masks = of_camera(capture.cameras[camera], read)
    silhouettes[:, camera, : masks.shape[1], : masks.shape[2]] = silhouettes_of(masks)
    return np.stack([mask_facts(mask) for mask in masks])


def read_silhouettes(
    opened: Archive, source: Capture, blocks: Sequence[Block], by: By
) -> tuple[NDArray[np.bool_], Telling]:
    """Return the silhouettes (time, camera, row, column) that are compared, and what told them.

    Parameters
    ----------
    opened, source
        Where the blocks are, and the capture.
    blocks
        What `extract_block` wrote, in the order of the frames.
    by
        What told the performer from the stage.
    """
    compared = np.array(compared_frames(source.frames))
    _, columns = largest_image(source.cameras)
    parts: dict[str, list[NDArray]] = {"silhouette": [], "stale": [], "masks": []}
    sure: list[float] = []
    for block in blocks:
        inside = compared[(compared >= block.start) & (compared < block.end)]
        if not len(inside):
            continue
        held = read_block(opened.place, block, [*parts, "sure"])
        sure = held["sure"].tolist()
        held["silhouette"] = held["silhouette"][inside - block.start]
        for name, those in parts.items():
            those.append(held[name])
    silhouettes, stale = (
        np.unpackbits(np.concatenate(parts[name]), axis=-1, count=columns).astype(np.bool_)
        for name in ("silhouette", "stale")
    )
    if by == "mask":
        return silhouettes, Telling(by, masks=np.concatenate(parts["masks"]))
    return silhouettes, Telling(by, stale=stale, sure=sure)
