"""What told the performer from the stage, and whether that can be: masks, backgrounds, screens.

Silhouettes that all agree may still be wrong together: where the performer stands in every
background, each frame has a ghost there, and masks may be inverted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.formats.capture.capture import Capture
from storage.formats.reading import listed
from tasks.capture.empty_stages import unsure_notes
from tasks.reconstruction.regions.rims import shrinking, too_narrow_px
from tasks.reconstruction.regions.stale_outlines import outline_of

By = Literal["background", "film", "key", "mask"]

_MOST_GRAY = 0.15
"""Of how much of a picture a mask is neither black nor white [share]. Soft edges of a performer are
some hundredths; a film has more than half. Chosen, not measured."""
_MOST_WHITE = 0.5
"""Of how much of a picture a mask may be white [share]. As `most_of_picture` of agreement."""
_DARK = 25.0
"""Largest value of a mask that is wholly black [levels of 0 to 255]. What codecs change."""
_HALF = 128.0
"""Smallest value that is of a silhouette [levels of 0 to 255]."""
_IN_FRAMES = 0.4
"""In how many frames an outline is at one place where it is of a background [share]. The performer
may cover it in some."""
_FRAMES = 3
"""In how many frames at least [frames]. What moves is at one place in two."""
_MOST_STALE = 0.03
"""How much of the silhouettes' outline may be edges of the background alone [share]. With the empty
stage it is 0.000 in nine rendered captures and 0.015 in a real one. With the performer in its
picture it is 0.07 to 0.14 in a rendered one, where he passes before himself, 0.30 to 0.36 in the
real one, and in the worst camera 0.05 to 0.2 of one who sways in his place."""

_FILLED = 0.003
"""From which share of a camera's silhouettes on holes that were filled are told [share]. It is a
tenth of a print on a chest; some gaps between limbs and cloth that the other cameras do not see are
less."""

_NARROW_PX = 0.6
"""From how far before the film's edge on a mask is too narrow [px of a picture of 240 rows]. A
pixel costs a ninth of the joints there. Measured 0.98 to 1.09 in each camera of five rendered
captures whose masks were eroded by a pixel, -0.12 to -0.05 with the true ones, and -1.4 to -1 of a
real one, whose own masks are wider than the dancer."""

_DO = {
    "background": "film the empty stage again, or write background = \"film\" under [silhouettes] "
    "of digitize.toml",
    "film": "every place has to be left at some time: bring a picture of the empty stage, masks, "
    "or a longer film",
    "key": "the performer has to move before the screen: bring a picture of the empty stage, or "
    "masks",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Telling:
    """What told the performer from the stage in some frames of a take."""

    by: By
    masks: NDArray[np.float64] | None = None
    """(time, camera, 4) of `tasks.reconstruction.regions.masks.mask_facts`, where masks told."""
    edges: NDArray[np.float64] | None = None
    """(time, camera, distance) of `tasks.reconstruction.regions.rims.edge_profile`, of masks."""
    stale: NDArray[np.bool_] | None = None
    """(time, camera, row, column) of `tasks.reconstruction.regions.stale_outlines`, else."""
    sure: Sequence[float] = ()
    """Of each camera, the share of the picture in which its background is no guess."""
    keys: Sequence[str] = ()
    """Of each camera, the color of the screen, where there is one."""


def told_by(capture: Capture, background: str, key: str) -> By:
    """Return what tells the performer, by a capture and the settings of silhouettes."""
    if capture.masks:
        return "mask"
    return "key" if key else "film" if background == "film" else "background"


def judge_telling(
    telling: Telling, capture: Capture, silhouettes: NDArray[np.bool_]
) -> tuple[list[str], list[str]]:
    """Return what is wrong with what told the performer, and what should be known.

    Parameters
    ----------
    telling
        In the frames of the silhouettes.
    capture
        Its cameras are those of the silhouettes.
    silhouettes : (time, camera, row, column) bool
        Of some frames all over the take.
    """
    names = [camera.name for camera in capture.cameras]
    if telling.masks is not None:
        rows = [camera.height for camera in capture.cameras]
        notes = [] if telling.edges is None else narrow_notes(telling.edges, rows, names)
        return judge_masks(telling.masks, names), notes
    notes = []
    if telling.by in ("film", "key"):
        notes = unsure_notes(capture.cameras, telling.sure, before_screen=telling.by == "key")
    if telling.by == "key" and telling.keys:
        said = ", ".join(f"{name} {key}" for name, key in zip(names, telling.keys, strict=True))
        notes.append(f"The screen has these colors: {said}.")
    if telling.stale is None:
        return [], notes
    share = stale_shares(telling.stale, silhouettes)
    ghosts = [name for name, each in zip(names, share, strict=True) if each > _MOST_STALE]
    if not ghosts:
        return [], notes
    found = " that was found in the film" if telling.by != "background" else ""
    return [
        f"the performer, or something that is not in the film, stands in the background{found} of "
        f"camera {listed(ghosts)}: {share.max():.0%} of the silhouettes' outline stays at one "
        f"place, where the background has an edge and the film has none; {_DO[telling.by]}"
    ], notes


def filled_notes(
    filled: NDArray[np.integer], pixels: NDArray[np.integer], names: Sequence[str], *, kept: bool
) -> list[str]:
    """Say in which cameras' silhouettes there are holes that the others contradict.

    Parameters
    ----------
    filled, pixels : (time, camera) int
        How many pixels of each silhouette were such holes, and how many it has.
    names
        What the cameras are called.
    kept
        Whether such holes were not filled.
    """
    share = filled.sum(axis=0) / np.maximum(pixels.sum(axis=0), 1)
    told = [
        f"{name!r} ({each:.1%})" for name, each in zip(names, share, strict=True) if each >= _FILLED
    ]
    if not told:
        return []
    done = (
        'write holes = "fill" under [silhouettes] of digitize.toml, if it is no gap'
        if kept
        else "they were filled"
    )
    return [
        "There are holes in silhouettes behind which the other cameras see a body (share of the "
        f"silhouette): camera {', '.join(told)}. Something of the performer's has the color of the "
        f"stage, or there is a gap that only one camera sees: {done}."
    ]


def all_faults(telling: Telling, wrong: Sequence[str], found: Sequence[str]) -> tuple[str, ...]:
    """Return what is wrong of what told the performer, and of the silhouettes.

    Where masks are none, what is wrong of the silhouettes follows from that, and is left out.
    """
    return tuple(wrong) if wrong and telling.by == "mask" else (*wrong, *found)


def stale_shares(stale: NDArray[np.bool_], silhouettes: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return (camera,) how much of the silhouettes' outline is of the background and stays.

    Parameters
    ----------
    stale, silhouettes : (time, camera, row, column) bool
        Which pixels of the outlines are edges of the background alone, and the silhouettes.
    """
    least = max(_FRAMES, _IN_FRAMES * len(stale))
    shares = np.zeros(stale.shape[1])
    for c in range(stale.shape[1]):
        near = [cv2.dilate(each.view(np.uint8), np.ones((3, 3), np.uint8)) for each in stale[:, c]]
        stays = np.sum(near, axis=0, dtype=np.int64) >= least
        length = np.median([outline_of(silhouette).sum() for silhouette in silhouettes[:, c]])
        shares[c] = (stale[:, c] & stays).sum(axis=(1, 2)).mean() / max(length, 1)
    return shares


def judge_masks(facts: NDArray[np.float64], names: Sequence[str]) -> list[str]:
    """Return what is wrong with masks, a sentence each.

    Parameters
    ----------
    facts : (time, camera, 4) float64
        Of `tasks.reconstruction.regions.masks.mask_facts`, of some frames.
    names
        What the cameras are called.
    """
    white, border, gray = np.median(facts[..., :3], axis=0).T
    brightest = facts[..., 3].max(axis=0)
    pictures = gray > _MOST_GRAY
    filled = ~pictures & (white > _MOST_WHITE)
    faint = ~pictures & (brightest > _DARK) & (brightest < _HALF)
    faults = []
    if pictures.any():
        faults.append(
            f"the masks of camera {_of(names, pictures)} are pictures, not masks: "
            f"{gray[pictures].max():.0%} of them is neither black nor white; make the performer "
            "white and all else black, or all else transparent (a film without transparency that "
            "shows the performer on black is no mask)"
        )
    if filled.any():
        which = "are inverted" if border[filled].min() > _MOST_WHITE else "cannot be right"
        faults.append(
            f"the masks of camera {_of(names, filled)} {which}: white, as the performer should be, "
            f"is {white[filled].min():.0%} of the picture and {border[filled].min():.0%} of its "
            "border; invert them"
        )
    if faint.any():
        faults.append(
            f"the masks of camera {_of(names, faint)} are too dark: their largest value is "
            f"{brightest[faint].max():.0f} of 255, and from {_HALF:.0f} on a pixel is the "
            "performer; write 255"
        )
    return faults


def narrow_notes(
    edges: NDArray[np.float64], rows: Sequence[int], names: Sequence[str]
) -> list[str]:
    """Say which cameras' masks end before the performer does in their films.

    Masks that are too wide are not told: they cost nothing that could be measured.

    Parameters
    ----------
    edges : (time, camera, distance) float64
        Of `tasks.reconstruction.regions.rims.edge_profile`.
    rows
        How high each camera's picture is.
    names
        What the cameras are called.
    """
    narrow = [too_narrow_px(edges[:, c]) for c in range(len(names))]
    by_px = {
        name: round(each * shrinking(high))
        for name, each, high in zip(names, narrow, rows, strict=True)
        if each >= _NARROW_PX
    }
    if not by_px:
        return []
    said = ", ".join(f"{name!r} ({each})" for name, each in by_px.items())
    grow = int(np.median([*by_px.values()]))
    return [
        "Masks end before the performer does in the film, where its colors change (by so many "
        f"pixels): camera {said}. Hands and forearms will be missing or too short: make the masks "
        f"wider, or write grow_px = {grow} under [silhouettes] of digitize.toml."
    ]


def filled_fault(name: str, share: NDArray[np.float64], by: By) -> str:
    """Say that a silhouette is most of its picture."""
    why = {
        "background": "its background is of another scene, exposure or camera; film it again with "
        "the same settings",
        "film": "the stage changes all over the film; film the empty stage, or bring masks",
        "key": "the screen does not fill the picture, or its color is another; bring a picture of "
        "the empty stage, or masks",
        "mask": "no performer fills so much",
    }[by]  # fmt: skip
    return f"the silhouette of camera {name!r} is {np.median(share):.0%} of its picture: {why}"


def blind_why(by: By) -> str:
    """Say why a camera may see nobody where it should."""
    return {
        "background": "its film or its background is of something else, or its background was "
        "filmed with the performer in it",
        "film": "the performer does not move in its film, or it is of something else",
        "key": "its film is of something else, or the performer has the color of the screen",
        "mask": "its masks are empty, or of another film; make them again, white where the "
        "performer is",
    }[by]  # fmt: skip


def _of(names: Sequence[str], chosen: NDArray[np.bool_]) -> str:
    return listed([name for name, each in zip(names, chosen, strict=True) if each])
