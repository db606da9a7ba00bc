"""Decode film files with FFmpeg: packets, seeks, and frames that carry the date wanted.

PyAV is used, because OpenCV tells neither that a frame is interlaced nor that it is corrupt, and
gives black or left-over memory for the one and made-up pictures for the other.
"""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError, InvalidDataError
from av.stream import Disposition
from av.video.format import VideoFormat
from av.video.frame import VideoFrame
from av.video.reformatter import Interpolation, VideoReformatter
from av.video.stream import VideoStream
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.pictures.combing import WholeFrames

_CONTAINERS = "mov,matroska,webm,avi,mpegts,mpeg,mpegvideo,asf,flv,mxf,dv,ogg"
"""The containers that are opened, by FFmpeg's names. Others are lists of files or addresses,
which would be opened in turn."""

_BITS = 8
"""How many bits a channel has that OpenCV's interpolation suits [bits]. Deeper ones come closer to
what was filmed with the nearest color, which is what the eight-bit converter takes: PSNR of 10 bit
H.264 is 34.4 dB, with the other 28.8."""

FAULTS = (FFmpegError, ValueError, MemoryError)
"""What PyAV raises of a file that is damaged."""


@contextmanager
def film(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a file and its film, and close it after use.

    Raises
    ------
    InputError
        It is of no container that is known, or holds no film.
    """
    try:
        container = av.open(
            str(path.absolute()),
            metadata_errors="replace",  # a title in another encoding is none of our business
            options={"format_whitelist": _CONTAINERS, "protocol_whitelist": "file"},
        )
    except FAULTS as error:
        raise cannot_be_opened(path) from error
    with container:
        films = [each for each in container.streams.video if not _is_cover(each)]
        if not films:
            raise InputError(
                f"{path} holds no film (only {_kinds(container)}); bring the file of the camera"
            )
        best = container.streams.best("video")
        stream = best if isinstance(best, VideoStream) and best in films else films[0]
        if stream.codec_context is None:  # PyAV has none without a decoder
            raise cannot_be_opened(path)
        # faster than two where films are small
        stream.thread_count = 1
        stream.thread_type = "NONE"
        yield container, stream


def cannot_be_opened(path: Path) -> InputError:
    """Return what to say of a file that is no film."""
    return InputError(
        f"{path} cannot be opened as a film: it is damaged, cut off, or of a codec that is "
        "not known; copy it again, or convert it to H.264 in MP4"
    )


def _is_cover(stream: VideoStream) -> bool:
    """Return whether it is a picture that goes with a film."""
    return bool(stream.disposition & Disposition.attached_pic)


def _kinds(container: InputContainer) -> str:
    return ", ".join(sorted({stream.type for stream in container.streams})) or "nothing"


def read_packets(container: InputContainer, stream: VideoStream) -> list[tuple[int | None, bool]]:
    """Return date, and whether it is a key, of each frame that is shown, in the order of the file.

    What an edit list hides is left out. Dates are in ticks of the film.
    """
    return [
        (packet.pts, packet.is_keyframe)
        for packet in container.demux(stream)
        if packet.size and not packet.is_discard
    ]


def decode(container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
    """Yield the frames from where the film is, in the order in which they are shown.

    What comes before the first frame that can be decoded is left out: films that were cut out of
    others begin between key frames.
    """
    begun = False
    for packet in container.demux(stream):
        try:
            frames = packet.decode()
        except InvalidDataError:
            if begun:
                raise
            continue
        for frame in frames:
            begun = True
            yield cast(VideoFrame, frame)


def frames_from(
    path: Path, dates: Sequence[int], keys: Sequence[int], start: int
) -> Generator[tuple[int, VideoFrame], None, None]:
    """Yield numbered frames of a film, from `start` or from before it; their dates are not checked.

    Parameters
    ----------
    path
        The film.
    dates
        The date of each frame, in ticks of the film; unused without keys.
    keys
        The frames that can be sought. The last two up to `start` are tried, and one is believed
        if the frame that is decoded carries its date. Without one the film is read from its
        beginning.
    start
        The frame that is wanted.
    """
    for key in sorted((key for key in keys if 0 < key <= start), reverse=True)[:2]:
        with film(path) as (container, stream):
            frames = _from_date(container, stream, dates[key])
            first = next(frames, None)
            if first is not None:
                yield key, first
                yield from enumerate(frames, key + 1)
                return
    with film(path) as (container, stream):
        yield from enumerate(decode(container, stream))


def _from_date(container: InputContainer, stream: VideoStream, date: int) -> Iterator[VideoFrame]:
    """Yield the frames from a key frame's date on; none where it is not met."""
    try:
        container.seek(date, stream=stream)
        frames = decode(container, stream)
        # frames that are shown before a key frame may need what lies before it
        first = next((frame for frame in frames if frame.pts is None or frame.pts >= date), None)
    except FAULTS:
        return
    if first is not None and first.pts == date and not first.is_corrupt:
        yield first
        yield from frames


class RgbReader:
    """Turns the frames of a film into pixels; it is kept for the film, which is faster."""

    def __init__(self) -> None:
        self._reformatter = VideoReformatter()
        self._whole = WholeFrames()

    def __call__(self, frame: VideoFrame) -> NDArray[np.uint8]:
        """Return (row, column, 3) RGB, as the film holds it, not turned."""
        return self._convert(frame, "rgb24")

    def brightness(self, frame: VideoFrame) -> NDArray[np.uint8]:
        """Return (row, column)."""
        return self._convert(frame, "gray")

    def _convert(self, frame: VideoFrame, kind: str) -> Any:
        frame = self._whole(frame)
        converted = self._reformatter.reformat(
            frame, format=kind, interpolation=_interpolation(frame.format.name), threads=1
        )
        return converted.to_ndarray()


@lru_cache(maxsize=64)
def _interpolation(pixels: str) -> Interpolation:
    """Return how colors are interpolated between the pixels that have one."""
    deepest = max(component.bits for component in VideoFormat(pixels).components)
    return Interpolation.POINT if deepest > _BITS else Interpolation.BICUBIC
