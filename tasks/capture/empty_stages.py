"""Read of a capture what its cameras see where nobody dances.

    given    pictures or films of the empty stage, in the folder `background`
    film     the film itself, in which the performer leaves every place at some time
    a key    the film itself, before a screen of a color

A capture with masks needs none of them.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from storage.errors import InputError
from storage.formats.calibration.camera import Camera
from storage.formats.capture.capture import Capture
from storage.formats.capture.capture_files import NOTHING_TELLS
from storage.formats.capture.footage import read_picture
from storage.formats.pictures.video import PICTURE_SUFFIXES, open_video, pick_frames, read_frames
from tasks.capture.backgrounds import Background, make_background
from tasks.capture.estimating import estimate_background
from tasks.capture.films import frames_all_over, of_camera
from tasks.capture.screens import NoScreenError, estimate_screen

_BACKGROUND_FRAMES = 25
"""How many frames of a film of the empty stage make a background [frames]. A median of 25 leaves
out who walks through; chosen by eye, not measured."""

_FILM_FRAMES = 48
"""How many frames of a performer's film a background is found in [frames]. Chosen by eye on the
shared captures; not measured."""

_LEAST_FRAMES = 12
"""How many at least, however large the images are [frames]. Fewer tell no most frequent color."""

_HELD_BYTES = 1 << 28
"""How large the frames are that a background is found in, at most [bytes]."""

_MOST_UNSURE = 0.005
"""How much of a picture is a guess without its camera being named [share]. A tenth of a performer
who is a twentieth of it; chosen, not measured."""


def check_telling(capture: Capture, background: str, key: str) -> None:
    """Refuse a capture in which nothing, or more than one thing, tells the performer.

    Parameters
    ----------
    background, key
        As of the settings of silhouettes.

    Raises
    ------
    InputError
        What is missing, or what excludes each other.
    """
    said = f'key = "{key}"' if key else f'background = "{background}"'
    if capture.masks and (key or background != "given"):
        raise InputError(
            f"{capture.folder} has masks in `silhouettes`, and {said} stands under [silhouettes]: "
            "remove one of them"
        )
    if not (capture.masks or capture.backgrounds or key or background != "given"):
        raise InputError(f"{capture.folder} cannot be used as a capture:\n- {NOTHING_TELLS}")


def read_backgrounds(
    capture: Capture, background: str = "given", key: str = ""
) -> list[Background]:
    """Return the background of each camera; it is kept for the blocks of a take that follow.

    Parameters
    ----------
    background, key
        As of the settings of silhouettes: where to look.

    Raises
    ------
    InputError
        A background or film cannot be read, or has no such screen; its camera is named.
    """
    if key or background == "film":
        paths, how = capture.videos, key or background
    else:
        paths, how = capture.backgrounds, ""
    return [
        of_camera(camera, lambda path=path: _kept(path, how, _state(path)))
        for camera, path in zip(capture.cameras, paths, strict=True)
    ]


def unsure_notes(
    cameras: Sequence[Camera], sure: Sequence[float], *, before_screen: bool
) -> list[str]:
    """Return how sure backgrounds are that were found in films, as a sentence.

    Parameters
    ----------
    cameras
        Of a capture.
    sure
        Of each, the share of the picture in which its background is no guess.
    before_screen
        Whether they were found by the color of a screen.
    """
    why = "the screen is never seen" if before_screen else "the performer never leaves"
    unsure = [
        f"{camera.name} {1 - share:.1%}"
        for camera, share in zip(cameras, sure, strict=True)
        if 1 - share > _MOST_UNSURE
    ]
    said = "The backgrounds were found in the films"
    if not unsure:
        return [f"{said}, and are sure in {min(sure):.1%} of a picture at least."]
    return [
        f"{said}; they are a guess in this much of a picture: {', '.join(unsure)}, where {why}."
    ]


@lru_cache(maxsize=16)  # the cameras of a take, or of two: each holds 16 bytes a pixel
def _kept(path: Path, how: str, _: tuple[int, ...]) -> Background:
    """Read a background, or find it in a film as `how` says."""
    if not how:
        return _of_background(path)
    video = open_video(path)
    rows, columns = video.size
    most = max(_LEAST_FRAMES, min(_FILM_FRAMES, _HELD_BYTES // (3 * rows * columns)))
    chosen = frames_all_over(video.frames, most)
    images = np.empty((len(chosen), *video.frame_shape), np.uint8)
    for into, frame in zip(images, pick_frames(video, chosen), strict=True):
        into[:] = frame
    if how == "film":
        return estimate_background(images)
    try:
        return estimate_screen(images, how)
    except NoScreenError as error:
        raise InputError(str(error)) from error


def _of_background(path: Path) -> Background:
    """Return the background of a camera, from a picture or from frames all over a film."""
    if path.suffix.lower() in PICTURE_SUFFIXES and not path.is_dir():
        return make_background(read_picture(path)[None])
    video = open_video(path)
    chosen = frames_all_over(video.frames, _BACKGROUND_FRAMES)
    return make_background(np.concatenate([read_frames(video, n, n + 1) for n in chosen]))


def _state(path: Path) -> tuple[int, ...]:
    """Return what changes when a file, or a picture of a folder, does."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    about = [file.stat() for file in files]
    return tuple(n for a in about for n in (a.st_ino, a.st_size, a.st_mtime_ns))
