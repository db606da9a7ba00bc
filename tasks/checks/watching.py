"""Look through the films of a capture once: frames from all over them, and passages in a row.

Each film is decoded from its beginning, as one with a single key frame has to be, and only for the
first minute. Of the passages no picture is kept, but where each silhouette is touched.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.formats.capture.capture import Capture
from storage.formats.pictures.video import open_masks, open_video, read_blocks
from tasks.capture.films import compared_frames, of_camera, projection_of
from tasks.capture.tangency import Outline, find_outline, find_touches, join_outlines
from tasks.checks.compared import Seeing
from tasks.checks.offsets import Passage
from tasks.engine.threads import side_by_side

_WITHIN_S = 60.0
"""How much of a film is looked through [s]. One with one key frame is decoded from its beginning
to each frame."""

_BLOCK = 16
"""Frames that are decoded at a time [frames]. Few, so that films of any size fit into memory."""

_MOST_WATCHED = 600
"""Of how many frames silhouettes are found at most, of pictures of 640 x 480 [frames]. Twenty
seconds at 30 Hz, some of which move."""

_LEAST_WATCHED = 160
"""Of how many frames silhouettes are found at least, however large pictures are [frames]. Two
passages that can each be judged by itself."""

_PASSAGE = 80
"""How long a passage is at least where a film is not looked at whole [frames]."""

_MOST_PASSAGES = 4
"""In how many places a film is looked at [passages]. Between two of them lost frames are told."""

_USUAL_PX = 640 * 480
"""How large the pictures are that `_MOST_WATCHED` is of [px]."""


@dataclass(frozen=True, eq=False)
class Watched:
    """What was seen of a capture's films."""

    frames: list[NDArray[np.uint8]]
    """Of each camera (time, row, column, 3), all of the same moments."""
    numbers: list[int]
    """Which frames of the take they are, ascending."""
    passages: list[Passage]
    outlines: list[Outline]
    """Of each camera, in all passages; none where no passages were looked at."""


def watch_films(capture: Capture, seeing: Seeing, step: int, *, passages: bool = True) -> Watched:
    """Look through the films of a capture.

    Parameters
    ----------
    capture
        Whose films begin where it says.
    seeing
        How silhouettes are found in them.
    step
        How many frames are between those of a passage.
    passages
        Whether passages are looked at, or single frames only.

    Raises
    ------
    InputError
        A film, or its masks, cannot be decoded; the camera is named.
    """
    end = min(capture.frames, max(int(_WITHIN_S * capture.fps), 1))
    chosen = compared_frames(end)
    ranges = list(_ranges(capture, end, step)) if passages else []
    projection = projection_of(capture.cameras)

    def watch(c: int) -> tuple[NDArray[np.uint8], list[Outline]]:
        videos = [open_video(capture.videos[c])]
        if capture.masks and passages:
            videos.append(open_masks(capture.masks[c]))
        firsts = [capture.first_frames[c]] * len(videos)
        kept: list[NDArray[np.uint8]] = []
        found: list[list[Outline]] = [[] for _ in ranges]
        blocks = read_blocks(videos, block=_BLOCK, end=end, firsts=firsts)
        for start, (frames, *masks) in blocks:
            kept += [frames[n - start].copy() for n in chosen if 0 <= n - start < len(frames)]
            for outlines, wanted in zip(found, ranges, strict=True):
                inside = [n - start for n in wanted if 0 <= n - start < len(frames)]
                if inside:
                    of_frames = masks[0][inside] if masks else None
                    bits = seeing.silhouettes(c, frames[inside], of_frames)
                    outlines.append(find_outline(np.packbits(bits, axis=-1), projection, c))
        return np.stack(kept), [join_outlines(outlines) for outlines in found]

    seen = side_by_side(
        lambda c: of_camera(capture.cameras[c], lambda: watch(c)), range(len(capture.cameras))
    )
    return Watched(
        [frames for frames, _ in seen],
        chosen,
        [
            Passage(wanted[0], find_touches([outlines[n] for _, outlines in seen], projection))
            for n, wanted in enumerate(ranges)
        ],
        [join_outlines(outlines) for _, outlines in seen if outlines],
    )


def _ranges(capture: Capture, end: int, step: int) -> Iterator[range]:
    """Yield the frames of each passage: the whole film, or places all over it."""
    pixels = max(camera.width * camera.height for camera in capture.cameras)
    most = max(_LEAST_WATCHED, min(_MOST_WATCHED, _MOST_WATCHED * _USUAL_PX // pixels))
    if end <= most * step:
        yield range(0, end, step)
        return
    count = min(most // _PASSAGE, _MOST_PASSAGES)
    long = most // count * step
    for n in range(count):
        start = (2 * n + 1) * end // (2 * count) - long // 2
        yield range(start, start + long, step)
