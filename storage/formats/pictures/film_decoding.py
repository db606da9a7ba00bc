"""Decode film files with FFmpeg: packets, seeks, and frames that carry the date wanted.

PyAV is used, because OpenCV tells neither that a frame is interlaced nor that it is corrupt, and
gives black or left-over memory for the one and made-up pictures for the other.
"""

from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, cast
from zlib import crc32

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError, InvalidDataError
from av.packet import Packet
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


@dataclass(frozen=True)
class Key:
    """A frame that needs no other to be decoded."""

    frame: int
    date: int
    """In ticks of the film."""
    checksum: int
    """Of its packet: after a seek, containers without an index give dates to the wrong packets."""


def read_packets(
    container: InputContainer, stream: VideoStream
) -> list[tuple[int | None, int | None]]:
    """Return the date of each frame that is shown, and the checksum of keys, in the file's order.

    What an edit list hides is left out. Dates are in ticks of the film.
    """
    return [
        (packet.pts, crc32(packet) if packet.is_keyframe else None)
        for packet in container.demux(stream)
        if packet.size and not packet.is_discard
    ]


def decode(packets: Iterable[Packet]) -> Iterator[VideoFrame]:
    """Yield the frames of a film in the order in which they are shown.

    What comes before the first frame that can be decoded is left out: films that were cut out of
    others begin between key frames.
    """
    begun = False
    for packet in packets:
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
    path: Path, dates: Sequence[int], keys: Sequence[Key], start: int
) -> Generator[tuple[int, VideoFrame], None, None]:
    """Yield numbered frames of a film, from `start` or from before it.

    Parameters
    ----------
    path
        The film.
    dates
        The date of each frame, in ticks of the film; empty where frames have none.
    keys
        The frames that can be sought. The last two up to `start` are tried, and one is believed
        if its packet and the frame decoded are those of its date. Without one, and from where a
        frame does not carry its date, the film is read from its beginning. Dates of what is read
        from the beginning are not checked.
    start
        The frame that is wanted.
    """
    for key in [key for key in reversed(keys) if 0 < key.frame <= start][:2]:
        at = key.frame
        with film(path) as (container, stream):
            for frame in _from_key(container, stream, key):
                if at == len(dates) or frame.pts != dates[at]:
                    break
                yield at, frame
                at += 1
        if at > key.frame:
            break
    else:
        at = 0
    if dates and at == len(dates):
        return
    with film(path) as (container, stream):
        for n, frame in enumerate(decode(container.demux(stream))):
            if n >= at:
                yield n, frame


def _from_key(container: InputContainer, stream: VideoStream, key: Key) -> Iterator[VideoFrame]:
    """Yield the frames from a key frame on; none where it is not met."""
    try:
        container.seek(key.date, stream=stream)
        frames = decode(_only_with(container.demux(stream), key))
        # frames that are shown before a key frame may need what lies before it
        first = next((frame for frame in frames if (frame.pts or 0) >= key.date), None)
    except FAULTS:
        return
    if first is not None and not first.is_corrupt:
        yield first
        yield from frames


def _only_with(packets: Iterable[Packet], key: Key) -> Iterator[Packet]:
    """Yield packets, up to one with the date of a key frame that is another packet."""
    for packet in packets:
        if packet.pts == key.date and crc32(packet) != key.checksum:
            return
        yield packet


class RgbReader:
    """Turns the frames of a film into pixels; it is kept for the film, which is faster."""

    def __init__(self) -> None:
        self._reformatter = VideoReformatter()
        self._whole = WholeFrames()

    def __call__(self, frame: VideoFrame) -> NDArray[np.uint8]:
        """Return (row, column, 3) RGB, as the film holds it, not turned."""
        if frame.height % 2:  # FFmpeg's paths for odd rows differ; this one is OpenCV's
            return self._convert(frame, "bgr24")[..., ::-1]
        return self._convert(frame, "rgb24")

    def brightness(self, frame: VideoFrame) -> NDArray[np.uint8]:
        """Return (row, column)."""
        return self._convert(frame, "gray")

    def opacity(self, frame: VideoFrame) -> NDArray[np.uint8] | None:
        """Return (row, column), 255 where a pixel is opaque; None where the film does not say."""
        if not any(component.is_alpha for component in frame.format.components):
            return None
        return self._convert(frame, "rgba")[..., 3]

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
