"""Read films frame by frame, exactly.

A film is a file (MP4, AVI, MKV, MOV) or a folder of numbered pictures. Its frames are counted and
dated by reading every packet without decoding it, and a seek is believed only when the decoded
frame carries the date of the frame that was wanted.
"""

import os
import re
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import open_regular
from storage.formats.pictures.decoding import decode_picture

VIDEO_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov")
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")

_WANTED = "a film (.mp4, .avi, .mkv, .mov) or a folder of numbered pictures (.png, .jpg)"
_UNEVEN = 0.25  # of a frame's time: clocks round by 0.03 of it, a frame left out is 1
LARGEST_RATE_HZ = 10_000.0


@dataclass(frozen=True)
class Video:
    """A film that was looked through; `read_frames` and `read_blocks` read it."""

    path: Path
    frames: int
    """How many there are: packets, or frames decoded where packets have no dates, or pictures."""
    size: tuple[int, int]
    """Rows and columns, turned upright where the film says how it was held."""
    rate_hz: float | None
    """Frames a second; None for a folder."""
    notes: tuple[str, ...]
    """What the user should know, a sentence each."""
    dates: tuple[int, ...]
    """The date of each frame in microseconds; empty for a folder."""
    keys: tuple[int, ...]
    """The frames that need no other to be decoded, ascending; empty where each part is read
    from the beginning."""
    pictures: tuple[Path, ...]
    """The pictures of a folder, in the order of their numbers; empty for a file."""


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
        RGB; the same frames, bit for bit, however the film is cut.

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
    frames = np.empty((end - start, *video.size, 3), np.uint8)
    for into, frame in zip(frames, _frames_from(video, start, end), strict=True):
        into[:] = frame
    return frames


def read_blocks(
    videos: Sequence[Video], *, block: int = 32, start: int = 0, end: int | None = None,
    workers: int = 1,
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
    workers
        Threads that decode side by side, a film each.

    Yields
    ------
    start : int
        The first frame of the block.
    frames : list of (time, row, column, 3) uint8
        RGB, an array a film; the caller may keep it.

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
    shortest = min(video.frames for video in videos)
    end = shortest if end is None else end
    if not 0 <= start <= end <= shortest:
        raise ValueError(
            f"frames {start} to {end} are asked of films of which the shortest has {shortest}; "
            "ask for a range within them"
        )
    sources = [_frames_from(video, start, end) for video in videos]
    try:
        with ThreadPoolExecutor(workers) as pool:
            for first in range(start, end, block):
                count = min(block, end - first)
                yield first, list(pool.map(_take, sources, videos, [count] * len(videos)))
    finally:
        for source in sources:
            source.close()


def _take(source: Iterator[Any], video: Video, count: int) -> NDArray[np.uint8]:
    """Return the next frames of a film."""
    frames = np.empty((count, *video.size, 3), np.uint8)
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


def _decoder(path: Path) -> Any:
    """Return an open decoder on one thread, which is faster than two where films are small."""
    cv2 = quiet_cv2()
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    if not capture.isOpened():
        raise InputError(
            f"{path} cannot be opened as a film: it is damaged, cut off, or of a codec that is "
            "not known; copy it again, or convert it to H.264 in MP4"
        )
    return capture


@lru_cache(maxsize=64)
def _open_file(path: Path, _state: tuple[int, int, int]) -> Video:
    """Look through a file; `_state` says that it is still the one that was looked through."""
    cv2 = quiet_cv2()
    capture = _decoder(path)
    rate_hz = capture.get(cv2.CAP_PROP_FPS)
    angle = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360
    decoded, first = capture.read()
    date = _date(capture)
    dates, keys = _packets(path)
    notes: tuple[str, ...] = ()
    if decoded and dates and date != dates[0]:
        dates, keys = (date, *_decoded_dates(capture)), ()
        notes = ("The film does not date its frames; each part is read from its beginning.",)
    elif decoded:
        _check_even(path, dates)
    capture.release()
    if not decoded or not dates:
        raise InputError(
            f"the first frame of {path} cannot be decoded: it is damaged or of a codec that is "
            "not known; copy it again, or convert it to H.264 in MP4"
        )
    if not 0.0 < rate_hz <= LARGEST_RATE_HZ:
        raise InputError(
            f"{path} gives a rate of {rate_hz:g} frames a second, where one above 0 to "
            f"{LARGEST_RATE_HZ:g} is wanted; convert it with a constant rate"
        )
    if angle:
        notes += (
            f"The film says that the camera was held turned by {angle} degrees; it is read "
            f"upright, {first.shape[1]} x {first.shape[0]}.",
        )
    return Video(path, len(dates), first.shape[:2], rate_hz, notes, dates, keys, ())


def _packets(path: Path) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the dates of the frames in the order they are shown, and which are key frames."""
    cv2 = quiet_cv2()
    capture = _decoder(path)
    capture.set(cv2.CAP_PROP_FORMAT, -1)  # packets as they are
    found = []
    while capture.grab():
        key = capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME) > 0
        found.append((_date(capture), key))
    capture.release()
    found.sort(key=lambda packet: packet[0])
    dates = tuple(date for date, _ in found)
    return dates, tuple(n for n, (_, key) in enumerate(found) if key)


def _decoded_dates(capture: Any) -> Iterator[int]:
    """Yield the date of each frame that is still to be decoded."""
    while capture.grab():
        yield _date(capture)


def _date(capture: Any) -> int:
    """Return the date of the packet or frame just grabbed, microseconds."""
    import cv2

    return round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e3)


def _check_even(path: Path, dates: tuple[int, ...]) -> None:
    """Refuse a film whose frames do not come at a constant rate."""
    step = np.diff(np.array(dates, np.float64))
    if not step.size:
        return
    usual = float(np.median(step))
    # a clock of milliseconds, as in MKV, rounds every date
    uneven = np.abs(step - usual) > max(_UNEVEN * usual, 1000.0)
    if usual <= 0.0 or uneven.any():
        at = int(np.argmax(np.abs(step - usual)))
        raise InputError(
            f"the frames of {path} do not come at a constant rate: from frame {at} to {at + 1} it "
            f"takes {step[at] / usual if usual > 0 else 0:.2f} times as long as usual, at "
            f"{int(uneven.sum())} places in all; record or convert it with a constant rate"
        )


def _open_folder(path: Path) -> Video:
    numbered: dict[int, Path] = {}
    for picture in sorted(path.iterdir()):
        number = re.search(r"(\d+)$", picture.stem)
        if picture.suffix.lower() not in PICTURE_SUFFIXES or picture.name.startswith("."):
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
    size = _read_picture(pictures[0]).shape[:2]
    return Video(path, len(pictures), size, None, notes, (), (), pictures)


def _read_picture(path: Path) -> NDArray[np.uint8]:
    try:
        return decode_picture(path)
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
        yield _read_picture(picture)


def _decoded(video: Video, start: int, end: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a file from `start` on."""
    if start == end:
        return
    cv2 = quiet_cv2()
    capture, at = _seek(video, start)
    try:
        for n in range(at, end):
            if n > at and not capture.grab():
                raise _cut_off(video, n)
            date = _date(capture)
            if date != video.dates[n]:
                raise InputError(
                    f"frame {n} of {video.path} is missing or out of order when decoded; the file "
                    "is damaged, copy or convert it again"
                )
            if n >= start:
                ok, frame = capture.retrieve()
                if not ok:
                    raise _cut_off(video, n)
                yield cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
    finally:
        capture.release()


def _seek(video: Video, start: int) -> tuple[Any, int]:
    """Return a decoder that grabbed a frame at or before `start`, and which frame that is."""
    cv2 = quiet_cv2()
    capture = _decoder(video.path)
    for key in sorted((key for key in video.keys if 0 < key <= start), reverse=True)[:2]:
        capture.set(cv2.CAP_PROP_POS_FRAMES, key)
        date = _date(capture) if capture.grab() else -1
        at = int(np.searchsorted(video.dates, date))
        if at <= start and video.dates[at] == date:
            return capture, at
    capture.release()
    capture = _decoder(video.path)
    if not capture.grab():
        raise _cut_off(video, 0)
    return capture, 0


def _cut_off(video: Video, frame: int) -> InputError:
    return InputError(
        f"frame {frame} of the {video.frames} of {video.path} cannot be decoded; the file is "
        "damaged or cut off, copy it again"
    )
