"""Read films frame by frame, exactly.

A film is a file of any of the usual containers or a folder of numbered pictures. Its frames are
counted and dated by reading every packet without decoding it, and a seek is believed only when the
decoded frame carries the date of the frame that was wanted.
"""

import os
import re
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import NotRegularError, open_regular
from storage.formats.pictures.combing import mended
from storage.formats.pictures.decoding import decode_picture
from storage.formats.pictures.film_decoding import FAULTS, Key, RgbReader, frames_from
from storage.formats.pictures.film_facts import look_through
from storage.formats.pictures.masks import MASK_SUFFIXES, MaskReader, decode_mask

VIDEO_SUFFIXES = (
    ".mp4", ".m4v", ".mov", ".3gp", ".avi", ".mkv", ".webm", ".mts", ".m2ts", ".m2t", ".ts", ".mpg",
    ".mpeg", ".vob", ".mod", ".tod", ".mxf", ".wmv", ".asf", ".flv", ".dv", ".ogv",
)  # fmt: skip
"""How the names of films end, in small letters."""

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
"""How the names of pictures end, in small letters."""

_WANTED = f"a film ({', '.join(VIDEO_SUFFIXES)}) or a folder of numbered pictures (.png, .jpg)"


@dataclass(frozen=True)
class Video:
    """A film that was looked through; `read_frames` and `read_blocks` read it."""

    path: Path
    frames: int
    """How many there are: packets that are shown, or frames decoded where packets have no dates,
    or pictures."""
    size: tuple[int, int]
    """Rows and columns, turned upright where the film says how it was held."""
    rate_hz: float | None
    """Frames a second; None for a folder."""
    notes: tuple[str, ...]
    """What the user should know, a sentence each."""
    dates: tuple[int, ...]
    """The date of each frame in ticks of the film; empty for a folder, and where no frame has
    one that can be believed."""
    keys: tuple[Key, ...]
    """The frames that need no other to be decoded, ascending; empty where each part is read
    from the beginning."""
    pictures: tuple[Path, ...] = ()
    """The pictures of a folder, in the order of their numbers; empty for a file."""
    quarter_turns: int = 0
    """How often a frame is turned to the left to be upright."""
    fields: str = ""
    """Which lines of a frame are of the earlier moment where frames are combed, else empty."""
    pixel_aspect: float = 1.0
    """How many times as wide as high a pixel is shown, upright."""
    timecode: str = ""
    """Of the first frame, by the clock of the camera, where the file says it."""
    created: str = ""
    """When the film was made, where the file says it."""
    masks: bool = False
    """Whether its frames are masks: (row, column), 255 where a pixel is wholly the performer."""

    @property
    def frame_shape(self) -> tuple[int, ...]:
        """Of the array of a frame."""
        return self.size if self.masks else (*self.size, 3)


def open_masks(path: str | Path) -> Video:
    """Look through a film of masks or a folder of pictures of them; as `open_video`."""
    path = Path(path)
    return (
        _open_folder(path, masks=True) if path.is_dir() else replace(open_video(path), masks=True)
    )


def open_video(path: str | Path) -> Video:
    """Look through a film or a folder of pictures, and decode its first frame.

    Parameters
    ----------
    path : str or Path
        A file whose name ends in one of `VIDEO_SUFFIXES`, or a folder of PNG or JPEG pictures
        whose names end in numbers.

    Returns
    -------
    Video

    Raises
    ------
    InputError
        It is no film, cannot be decoded, or its frames do not follow each other evenly.
    """
    path = Path(path)
    if path.is_dir():
        return _open_folder(path)
    if path.suffix.lower() not in VIDEO_SUFFIXES:
        raise InputError(f"{path} is not a film that can be read; bring {_WANTED}")
    try:
        with open_regular(path) as file:
            head = file.read(8)
            about = os.fstat(file.fileno())
    except NotRegularError as error:
        raise InputError(f"{path} is no regular file, but {error.kind}; bring {_WANTED}") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); bring {_WANTED}") from error
    if not head:
        raise InputError(f"{path} is empty; bring {_WANTED}")
    # its decoders make up the rest of a frame that is cut in two
    if head.startswith(b"RIFF") and int.from_bytes(head[4:8], "little") + 8 > about.st_size:
        raise InputError(f"{path} is cut off: it says that it is longer; copy it again")
    return _open_file(path, (about.st_ino, about.st_size, about.st_mtime_ns))


def read_frames(video: Video, start: int, end: int) -> NDArray[np.uint8]:
    """Return the frames `start` to `end`, the last not included.

    Returns
    -------
    (time, row, column, 3) uint8
        RGB, of masks (time, row, column); the same frames, bit for bit, however the film is cut.

    Raises
    ------
    ValueError
        The film has no such frames.
    InputError
        A frame cannot be decoded.
    """
    if not 0 <= start <= end <= video.frames:
        raise ValueError(
            f"frames {start} to {end} are asked of {video.path}, which has {video.frames}; "
            "ask for a range within them"
        )
    frames = np.empty((end - start, *video.frame_shape), np.uint8)
    for into, frame in zip(frames, _frames_from(video, start, end), strict=True):
        into[:] = frame
    return frames


def read_blocks(
    videos: Sequence[Video], *, block: int = 32, start: int = 0, end: int | None = None,
    firsts: Sequence[int] = (), workers: int = 1,
) -> Iterator[tuple[int, list[NDArray[np.uint8]]]]:  # fmt: skip
    """Yield the same frames of several films, a block at a time, each film decoded once.

    Two blocks of every film are in memory at most, however long it is.

    Parameters
    ----------
    videos
        The films of the cameras; they may differ in size.
    block
        Frames in a block; the last block may be shorter.
    start, end
        The frames wanted; all that every film has where `end` is not given.
    firsts
        The frame of each film that counts as its frame 0, where they did not begin together.
    workers
        Threads that decode side by side, a film each.

    Yields
    ------
    start : int
        The first frame of the block.
    frames : list of (time, row, column, 3) uint8
        RGB, an array a film, of masks (time, row, column); the caller may keep it.

    Raises
    ------
    ValueError
        A film has no such frames, or there is no film.
    InputError
        A frame cannot be decoded.
    """
    if not videos or block < 1 or workers < 1:
        raise ValueError(
            f"{len(videos)} films, blocks of {block} and {workers} workers are given; "
            "one of each at least is wanted"
        )
    firsts = firsts or (0,) * len(videos)
    shortest = min(video.frames - n for video, n in zip(videos, firsts, strict=True))
    end = shortest if end is None else end
    if not 0 <= start <= end <= shortest:
        raise ValueError(
            f"frames {start} to {end} are asked of films of which the shortest has {shortest}; "
            "ask for a range within them"
        )
    sources = [
        _frames_from(video, n + start, n + end) for video, n in zip(videos, firsts, strict=True)
    ]
    try:
        with ThreadPoolExecutor(workers) as pool:
            for first in range(start, end, block):
                count = min(block, end - first)
                yield first, list(pool.map(_take, sources, videos, [count] * len(videos)))
    finally:
        for source in sources:
            source.close()


def pick_frames(video: Video, numbers: Sequence[int]) -> Iterator[NDArray[np.uint8]]:
    """Yield some frames of a film, in ascending order of their numbers.

    Between two of them the film is decoded on, or left where a key frame is nearer to the next.

    Raises
    ------
    InputError
        A frame cannot be decoded.
    """
    keys = [key.frame for key in video.keys]
    source, at = None, 0
    for n in numbers:
        if source is None or any(at < key <= n for key in keys) or (video.pictures and n > at):
            if source is not None:
                source.close()
            source, at = _frames_from(video, n, numbers[-1] + 1), n
        yield next(islice(source, n - at, None))
        at = n + 1
    if source is not None:
        source.close()


def _take(source: Iterator[Any], video: Video, count: int) -> NDArray[np.uint8]:
    """Return the next frames of a film."""
    if count == 1:  # as it was decoded: large pictures come one at a time
        return np.ascontiguousarray(next(source))[None]
    frames = np.empty((count, *video.frame_shape), np.uint8)
    for n in range(count):
        frames[n] = next(source)
    return frames


def quiet_cv2() -> Any:
    """Return OpenCV, silent: what goes wrong with a film is said in our own words."""
    # OpenCV reads it when it opens its first film, and has no other way to be told
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    import cv2  # here, because only who reads or writes a film should wait for it

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2


@lru_cache(maxsize=64)
def _open_file(path: Path, _state: tuple[int, int, int]) -> Video:
    """Look through a file; `_state` says that it is still the one that was looked through."""
    facts = look_through(path)
    return Video(
        path, facts.frames, facts.size, facts.rate_hz, facts.notes, facts.dates, facts.keys,
        quarter_turns=facts.quarter_turns, fields=facts.fields, pixel_aspect=facts.pixel_aspect,
        timecode=facts.timecode, created=facts.created,
    )  # fmt: skip


def _open_folder(path: Path, *, masks: bool = False) -> Video:
    numbered: dict[int, Path] = {}
    suffixes = MASK_SUFFIXES if masks else PICTURE_SUFFIXES
    for picture in sorted(path.iterdir()):
        number = re.search(r"(\d+)$", picture.stem)
        if picture.suffix.lower() not in suffixes or picture.name.startswith("."):
            continue
        if number is None:
            raise InputError(f"{picture} has no number at the end of its name; number its frames")
        other = numbered.setdefault(int(number[1]), picture)
        if other is not picture:
            raise InputError(
                f"{other.name} and {picture.name} in {path} have the same number; keep one of them"
            )
    if not numbered:
        raise InputError(f"the folder {path} holds no pictures; bring {_WANTED}")
    order = sorted(numbered)
    missing = order[-1] - order[0] + 1 - len(order)
    notes = ()
    if missing:
        gap = next(a + 1 for a, b in pairwise(order) if b > a + 1)
        notes = (
            f"{missing} numbers are missing among the pictures of {path}, the first is {gap}; "
            "the pictures are taken as following each other.",
        )
    pictures = tuple(numbered[number] for number in order)
    size = _read_picture(pictures[0], masks=masks).shape[:2]
    return Video(path, len(pictures), size, None, notes, (), (), pictures, masks=masks)


def _read_picture(path: Path, *, masks: bool) -> NDArray[np.uint8]:
    try:
        return decode_mask(path) if masks else decode_picture(path)
    except InputError as error:
        raise InputError(
            f"{path} is not a picture that can be read; write it again as PNG or JPEG ({error})"
        ) from error


def _frames_from(video: Video, start: int, end: int) -> Generator[NDArray[np.uint8], None, None]:
    """Yield the frames of a film from `start` on, checked for size."""
    source = _pictures(video, start, end) if video.pictures else _decoded(video, start, end)
    for n, frame in enumerate(source, start):
        if frame.shape[:2] != video.size:
            raise InputError(
                f"frame {n} of {video.path} is {frame.shape[1]} x {frame.shape[0]} where the first "
                f"is {video.size[1]} x {video.size[0]}; bring frames of one size"
            )
        yield frame


def _pictures(video: Video, start: int, end: int) -> Iterator[NDArray[np.uint8]]:
    for picture in video.pictures[start:end]:
        yield _read_picture(picture, masks=video.masks)


def _decoded(video: Video, start: int, end: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a file from `start` on."""
    if start == end:
        return
    read = MaskReader() if video.masks else RgbReader()
    if video.fields:  # the filter looks at the neighbors of each frame
        before = min(start, 1)
        frames = _checked(video, start - before, min(end + 1, video.frames))
        chosen = islice(mended(frames, video.fields), before, before + end - start)
    else:
        chosen = _checked(video, start, end)
    for frame in chosen:
        yield np.rot90(read(frame), video.quarter_turns)


def _checked(video: Video, start: int, end: int) -> Iterator[VideoFrame]:
    """Yield the decoded frames from `start` on; each has to be sound and to carry its date."""
    frames = frames_from(video.path, video.dates, video.keys, start)
    with closing(frames):
        n = -1
        while n + 1 < end:
            try:
                n, frame = next(frames)
            except InputError:
                raise
            except (StopIteration, *FAULTS) as error:
                raise _cut_off(video, max(n + 1, 0)) from error
            if frame.is_corrupt:
                raise _cut_off(video, n)
            if video.dates and frame.pts != video.dates[n]:
                raise InputError(
                    f"frame {n} of {video.path} is missing or out of order when decoded; the file "
                    "is damaged, copy or convert it again"
                )
            if n >= start:
                yield frame


def _cut_off(video: Video, frame: int) -> InputError:
    return InputError(
        f"frame {frame} of the {video.frames} of {video.path} cannot be decoded; the file is "
        "damaged or cut off, copy it again"
    )
