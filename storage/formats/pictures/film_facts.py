"""Look through a film file: how many frames, when, how large, how turned, and whether combed.

What a file says is compared with what is decoded, and where they differ the frames are believed.
"""

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.pictures.combing import EVEN_FIRST, measure_leans, order_of_fields
from storage.formats.pictures.film_decoding import (
    FAULTS,
    Key,
    RgbReader,
    cannot_be_opened,
    decode,
    film,
    frames_from,
    read_packets,
)

LARGEST_RATE_HZ = 10_000.0
"""How fast a film may be [Hz]. Beyond any camera; a faster one is damage."""

_LARGEST_PX = 1 << 27
"""How many pixels a frame may have [px]. Four times 8K: more is damage, or takes all memory."""

_UNEVEN = 0.25
"""How far the time from a frame to the next may be from the usual [share of it]. Clocks round by
0.03 of it; a frame left out is 1."""

_CLOCK_US = 1000.0
"""By how much any clock may round [microseconds]. MKV counts milliseconds."""

_RATE_TOLERANCE = 0.01
"""How far the rate that a film says may be from that of its dates [share]. Clocks of milliseconds
round it; fields counted as frames double it."""

_SQUARE = 0.005
"""How far from square pixels may be and pass for square [share]. Roundings of converters are
smaller; the least of television is 0.02."""

_FIRST = 20
"""How many frames are decoded to see whether their dates are those of the packets [frames].
B-frames reach over 16 at most."""

_PLACES = 8
"""At how many places of a film it is looked whether it is combed [places]. Chosen by eye."""

_PAIRS = 24
"""How many pairs of frames with motion tell it [pairs]. All windows of five did on 16 films."""

_LOOKED_AT = 120
"""How many frames are decoded for it where the film does not say that it is interlaced [frames].
Four seconds in all; a film that says so is read until enough has moved."""

_FROM_THE_BEGINNING = (
    "The file does not say when each frame is shown, so every part is read from the beginning: the "
    "frames are right, but a long film takes longer; converted to MP4 it would not."
)


@dataclass(frozen=True)
class FilmFacts:
    """What was found; `Video` says what each means."""

    frames: int
    size: tuple[int, int]
    rate_hz: float
    notes: tuple[str, ...]
    dates: tuple[int, ...]
    keys: tuple[Key, ...]
    quarter_turns: int
    fields: str
    pixel_aspect: float
    timecode: str = ""
    created: str = ""


def look_through(path: Path) -> FilmFacts:
    """Read every packet of a film, and decode some frames.

    Raises
    ------
    InputError
        It is no film, cannot be decoded, or its frames do not follow each other evenly.
    """
    with film(path) as (container, stream):
        rates = (stream.guessed_rate, stream.average_rate)
        tick_s = float(stream.time_base or 0)
        aspect = float(stream.sample_aspect_ratio or 1)
        timecode, created = _clocks(container)
        wide, high = stream.codec_context.width, stream.codec_context.height
        if wide * high > _LARGEST_PX:
            raise InputError(
                f"{path} says that its frames are {wide} x {high}, larger than any camera's; it is "
                "damaged, copy or convert it again"
            )
        try:
            packets = read_packets(container, stream)
        except FAULTS as error:
            raise cannot_be_opened(path) from error
    first, shown = _look_at_frames(path, packets)
    times_us = np.array([date or 0 for date in shown], np.float64) * tick_s * 1e6
    in_packets = sorted(
        ((date, checksum) for date, checksum in packets if date is not None), key=_date
    )
    dates: tuple[int, ...] = ()
    keys: tuple[Key, ...] = ()
    notes = []
    if shown == [date for date, _ in in_packets]:
        _check_even(path, times_us)
        dates = tuple(date for date, _ in in_packets)
        keys = tuple(
            Key(n, date, checksum)
            for n, (date, checksum) in enumerate(in_packets)
            if checksum is not None
        )
    else:
        notes.append(_FROM_THE_BEGINNING)
        found = [date for date in shown if date is not None]
        if found == shown and all(a < b for a, b in pairwise(found)):
            _check_even(path, times_us)
            dates = tuple(found)
            notes += _lost(sum(date < dates[0] for date, _ in in_packets))
    fields = order_of_fields(_leans(path, dates, keys, flagged=first.interlaced_frame))
    if abs(aspect - 1.0) <= _SQUARE:
        aspect = 1.0
    turned = first.rotation if first.rotation % 90 == 0 else 0
    size = (first.height, first.width)
    if turned % 180:
        size, aspect = (first.width, first.height), 1.0 / aspect
    notes += _notes(size, -turned % 360, aspect, fields=fields, flagged=first.interlaced_frame)
    rate_hz = _rate(path, rates, times_us if dates else times_us[:0])
    return FilmFacts(
        len(shown),
        size,
        rate_hz,
        tuple(notes),
        dates,
        keys,
        turned // 90 % 4,
        fields,
        aspect,
        timecode,
        created,
    )


def _clocks(container: InputContainer) -> tuple[str, str]:
    """Return the timecode and the time of creation that a file says, empty where it does not."""
    said: dict[str, str] = {}
    for metadata in (*(stream.metadata for stream in container.streams), container.metadata):
        said |= {key.lower(): value for key, value in metadata.items() if value}
    return said.get("timecode", ""), said.get("creation_time", "")


def _date(packet: tuple[int, int | None]) -> int:
    return packet[0]


def _look_at_frames(
    path: Path, packets: Sequence[tuple[int | None, int | None]]
) -> tuple[VideoFrame, list[int | None]]:
    """Return the first frame, and the date of each in the order in which they are shown.

    Where the first frames have the dates of the packets, all are taken to have them.
    """
    dates = [date for date, _ in packets]
    known = sorted(date for date in dates if date is not None)
    first: VideoFrame | None = None
    shown: list[int | None] = []
    with film(path) as (container, stream):
        try:
            for frame in decode(container.demux(stream)):
                first = first or frame
                shown.append(frame.pts)
                # where frames change places and the dates of packets do not, packets were counted
                counted = dates == known and stream.codec_context.has_b_frames
                if len(shown) == _FIRST and not counted and _begin(shown, known, dates):
                    break
        except FAULTS as error:
            raise _cannot_be_decoded(path, len(shown)) from error
    if first is None or first.is_corrupt:
        raise _cannot_be_decoded(path, 0)
    # frames that are lacking at the end are missed when they are read
    return first, [*known] if _begin(shown, known, dates) else shown


def _lost(frames: int) -> Iterator[str]:
    """Say how many frames at the beginning of a film cannot be decoded."""
    if frames:
        yield (
            f"The first {frames} frames need others that the file does not hold, and are left out: "
            "it was cut out of a longer film. Look whether it still begins with the others."
        )


def _begin(shown: Sequence[int | None], known: Sequence[int], dates: Sequence[int | None]) -> bool:
    """Return whether the frames shown begin as the packets do, which all have dates."""
    return len(known) == len(dates) and list(shown) == list(known[: len(shown)])


def _cannot_be_decoded(path: Path, frame: int) -> InputError:
    which = f"frame {frame}" if frame else "the first frame"
    return InputError(
        f"{which} of {path} cannot be decoded: it is damaged or of a codec that is not known; copy "
        "it again, or convert it to H.264 in MP4"
    )


def _check_even(path: Path, times_us: NDArray[np.float64]) -> None:
    """Refuse a film whose frames do not come at a constant rate."""
    step = np.diff(times_us)
    if not step.size:
        return
    usual = float(np.median(step))
    uneven = np.abs(step - usual) > max(_UNEVEN * usual, _CLOCK_US)
    if usual <= 0.0 or uneven.any():
        at = int(np.argmax(np.abs(step - usual)))
        raise InputError(
            f"the frames of {path} do not come at a constant rate: from frame {at} to {at + 1} it "
            f"takes {step[at] / usual if usual > 0 else 0:.2f} times as long as usual, at "
            f"{int(uneven.sum())} places in all; record or convert it with a constant rate"
        )


def _rate(path: Path, said: Sequence[Fraction | None], times_us: NDArray[np.float64]) -> float:
    """Return the first rate said that agrees with the dates, else that of the dates."""
    rates_hz = [float(rate) for rate in said if rate]
    if times_us.size > 1 and times_us[-1] > times_us[0]:
        dated_hz = 1e6 * (times_us.size - 1) / float(times_us[-1] - times_us[0])
        agreeing = [hz for hz in rates_hz if abs(hz / dated_hz - 1.0) <= _RATE_TOLERANCE]
        rates_hz = [*agreeing, dated_hz]
    rate_hz = rates_hz[0] if rates_hz else 0.0
    if not 0.0 < rate_hz <= LARGEST_RATE_HZ:
        raise InputError(
            f"{path} gives a rate of {rate_hz:g} frames a second, where one above 0 to "
            f"{LARGEST_RATE_HZ:g} is wanted; convert it with a constant rate"
        )
    return rate_hz


def _leans(path: Path, dates: Sequence[int], keys: Sequence[Key], *, flagged: bool) -> list[float]:
    """Return what tells whether a film is combed, from places all over it."""
    places = [0]
    if len(keys) > 1 and not flagged:
        chosen = np.linspace(0, len(keys) - 1, min(_PLACES, len(keys)))
        places = [keys[n].frame for n in chosen.round().astype(int)]
    frames = None if flagged else _LOOKED_AT // len(places)
    pairs = -(-_PAIRS // len(places))
    leans = []
    for place in places:
        with closing(frames_from(path, dates, keys, place)) as found:
            leans += islice(measure_leans(_brightness(islice(found, frames))), pairs)
    return leans


def _brightness(frames: Iterator[tuple[int, VideoFrame]]) -> Iterator[NDArray[np.uint8] | None]:
    """Yield the brightness of frames; what cannot be decoded is said when it is read."""
    read = RgbReader()
    try:
        for _, frame in frames:
            yield None if frame.is_corrupt else read.brightness(frame)
    except FAULTS:
        return


def _notes(
    size: tuple[int, int], degrees: int, aspect: float, *, fields: str, flagged: bool
) -> Iterator[str]:
    """Say what the user should know of the shape of a film and of its fields."""
    rows, columns = size
    if degrees:
        yield (
            f"The film says that the camera was held turned by {degrees} degrees; it is read "
            f"upright, {columns} x {rows}."
        )
    if aspect != 1.0:
        yield (
            f"Pixels are {aspect:.4g} times as wide as high: the film is read as it is stored, "
            f"{columns} x {rows}, where players show {round(columns * aspect)} x {rows}; the "
            "calibration has to be of pictures as they are stored."
        )
    if fields:
        first = "even" if fields == EVEN_FIRST else "odd"
        yield (
            "The film is interlaced: each frame holds two moments, in even and in odd lines. It is "
            f"read as one whole picture of the earlier moment (that of the {first} lines, counted "
            "from 0), so that frames and rate stay those of the film, as for cameras that film "
            "whole frames."
        )
    elif flagged:
        yield (
            "The film says that it is interlaced, but no frame that moves holds two moments: it is "
            "read as it is."
        )
