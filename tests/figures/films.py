"""Films of every kind, made with FFmpeg, and frames that a test can tell apart."""

from fractions import Fraction

import av
import numpy as np


def moving(count, *, rows=96, columns=128, step=3.0):
    """Gray frames (time, row, column, 3) of a bright, round body before a still wall; it moves."""
    row, column = np.mgrid[:rows, :columns]
    wall = np.repeat((90 + 40 * np.sin(column / 9) + 20 * np.cos(row / 7))[..., None], 3, axis=2)
    frames = np.empty((count, rows, columns, 3), np.uint8)
    for n, frame in enumerate(frames):
        center = columns / 2 + columns / 4 * np.sin(n * step / 40), rows / 2
        away = np.hypot(column - center[0], (row - center[1]) * 0.7) - 18
        inside = np.clip(0.5 - away, 0.0, 1.0)[..., None]
        frame[:] = wall * (1 - inside) + 220.0 * inside
    return frames


def woven(frames, order="tff"):
    """Each two frames as one: the even lines of the one, the odd ones of the other."""
    first, second = frames[::2], frames[1::2]
    even, odd = (first, second) if order == "tff" else (second, first)
    whole = even.copy()
    whole[:, 1::2] = odd[:, 1::2]
    return whole


def write_film(
    path, frames, codec="libx264", *, pixels="yuv420p", rate=30, options=None, aspect=None,
    metadata=None,
):  # fmt: skip
    """Write a film (time, row, column, 3) of any codec; `path` tells the container."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(rate), options=options or {})
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = pixels
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = Fraction(aspect)
        container.metadata.update(metadata or {})
        for frame in frames:
            picture = av.VideoFrame.from_ndarray(frame, format="rgb24").reformat(format=pixels)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    return path
