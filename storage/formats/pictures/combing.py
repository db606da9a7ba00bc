"""Tell whether the frames of a film are combed, and mend them.

An interlaced film holds two moments in a frame, one in the even lines and one in the odd. Flags do
not tell: whole frames are flagged as interlaced, and combed ones are not. So it is measured. Let
the even lines of a frame be replaced by those of the next one, or the odd lines instead. In a film
of whole frames both mixtures are equally rough where something moves. In an interlaced film one
mixture holds two moments that follow each other, the other two that are three times as far apart.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from av.filter import Graph
from av.video.frame import VideoFrame
from numpy.typing import NDArray

EVEN_FIRST, ODD_FIRST = "tff", "bff"
"""Which lines of a frame are of the earlier moment, in the words of the filter `bwdif`."""

_MOVED = 12.0
"""How much a blurred pixel changes where something moves [levels]. As in the measurements on which
the choice of the method stands."""

_BLURRED_PX = 5
"""How wide the blur is that takes off noise before motion is looked for [px]. With noise of ten
levels the still part of a film does not move."""

_FEWEST_PX = 50
"""How many pixels must have moved for two frames to tell something [px]."""

_FEWEST_PAIRS = 3
"""How many pairs of frames with motion must agree, beyond those that disagree [pairs]. Chosen by
eye. In a film of whole frames at 120 Hz little moved in three pairs, of factors 1.8, 0.65 and 1.3;
their median alone would have it combed."""

_LEAN = 1.3
"""How many times as rough the one mixture is as the other in a combed film, at least [factor].
Medians of 24 films of whole frames were 0.98 to 1.02, of five pairs 0.84 to 1.23; of the same films
woven and coded in H.264 at crf 28, 1.78 to 2.14, of five pairs 1.3 to 3.1."""


def measure_leans(frames: Iterable[NDArray[np.uint8] | None]) -> Iterator[float]:
    """Yield how the even and the odd lines of frames follow each other, wherever something moves.

    Parameters
    ----------
    frames : (row, column) uint8 or None
        The brightness of frames that follow each other; None where one cannot be used.

    Yields
    ------
    float
        Logarithm of the roughness of a frame with the even lines of the next one, against that
        with its odd lines: below 0 where even lines are of the earlier moment, about 0 where
        frames are whole.
    """
    import cv2  # here, because only who looks into a film should wait for it

    before, blurred_before = None, None
    for frame in frames:
        blurred = None if frame is None else cv2.blur(frame, (_BLURRED_PX, _BLURRED_PX))
        if (
            frame is not None and before is not None and blurred is not None
            and blurred_before is not None and frame.shape == before.shape
        ):  # fmt: skip
            changed = (cv2.absdiff(blurred_before, blurred) > _MOVED).astype(np.uint8)
            if changed.any():
                moved = np.asarray(cv2.dilate(changed, np.ones((3, 3), np.uint8))) > 0
                if np.count_nonzero(moved) >= _FEWEST_PX:
                    yield _lean(before, frame, moved)
        before, blurred_before = frame, blurred


def order_of_fields(leans: Sequence[float]) -> str:
    """Return which lines of a combed film come first: `EVEN_FIRST`, `ODD_FIRST`.

    It is "" where the frames are whole, or too little moves to tell.
    """
    if abs(np.sign(leans).sum()) < _FEWEST_PAIRS:
        return ""
    lean = float(np.median(leans))
    if abs(lean) < np.log(_LEAN):
        return ""
    return EVEN_FIRST if lean < 0.0 else ODD_FIRST


def mended(frames: Iterable[VideoFrame], order: str) -> Iterator[VideoFrame]:
    """Yield each frame of a combed film as it was at its earlier moment.

    The first and the last are made from one neighbor only; read one more on either side.
    """
    graph = None
    for frame in frames:
        graph = graph or _graph(frame, "bwdif", f"mode=send_frame:parity={order}:deint=all")
        graph.vpush(frame)
        yield from _finished(graph)
    if graph is not None:
        graph.vpush(None)
        yield from _finished(graph)


class WholeFrames:
    """Takes off frames the flag that says that they are interlaced, which would mix up colors."""

    def __init__(self) -> None:
        self._graph: Graph | None = None

    def __call__(self, frame: VideoFrame) -> VideoFrame:
        """Return the same frame without the flag."""
        if not frame.interlaced_frame:
            return frame
        self._graph = self._graph or _graph(frame, "setfield", "mode=prog")
        self._graph.vpush(frame)
        return self._graph.vpull()


def _graph(frame: VideoFrame, name: str, settings: str) -> Graph:
    """Return a filter for frames like this one, on one thread."""
    graph = Graph()
    graph.threads = 1
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    graph.link_nodes(source, graph.add(name, settings), graph.add("buffersink")).configure()
    return graph


def _finished(graph: Graph) -> Iterator[VideoFrame]:
    """Yield the frames that a filter has finished."""
    while True:
        try:
            yield graph.vpull()
        except (BlockingIOError, EOFError):  # it wants more; there are no more
            return


def _lean(this: NDArray[np.uint8], following: NDArray[np.uint8], moved: NDArray[np.bool_]) -> float:
    """Return the lean of two frames, measured where something moved."""
    rows, columns = np.flatnonzero(moved.any(axis=1)), np.flatnonzero(moved.any(axis=0))
    top = rows[0] // 2 * 2  # so that even lines stay even
    part = np.s_[top : rows[-1] + 2, columns[0] : columns[-1] + 1]
    even, odd = (
        _roughness(_woven(even[part], odd[part]), moved[part])
        for even, odd in ((following, this), (this, following))
    )
    return float(np.log((even + 1.0) / (odd + 1.0)))


def _woven(even: NDArray[np.uint8], odd: NDArray[np.uint8]) -> NDArray[np.uint8]:
    frame = even.copy()
    frame[1::2] = odd[1::2]
    return frame


def _roughness(frame: NDArray[np.uint8], moved: NDArray[np.bool_]) -> float:
    """Return the squares of the differences of neighboring lines, summed where something moves."""
    step = np.diff(frame.astype(np.int32), axis=0)
    return float((step * step)[moved[:-1]].sum())
