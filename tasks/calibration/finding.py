"""The views of a board in what cameras filmed: which moments are looked at, and what is seen."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError, UnknownNameError
from storage.formats.calibration.board_footage import FLOOR, BoardFootage, read_frames_at
from storage.formats.pictures.decoding import decode_picture
from storage.formats.pictures.video import Video, read_frames
from storage.formats.reading import listed
from tasks.calibration.boards import Board, find_checkers_slowly, find_corners
from tasks.calibration.rigs import View
from tasks.engine.threads import side_by_side

_MOST_SAMPLES = 240
"""How many frames of a film are looked at [frames]. Chosen: two a second of a film of two
minutes."""
_SHORTEST_STEP_S = 0.2
"""Time between two of them, at least [s]. In less a board that is moved by hand hardly changes."""
_FEW = 15
"""With fewer views than this a camera's pictures are searched again, by a search that takes ten
times as long [views]. Chosen: so many fix a lens well."""
_MOST_SLOW = 60
"""How many pictures of a camera are searched so [pictures]. Chosen: half a minute at 1080p."""
_MOST_SHOWN = 6
"""How many pictures without a board are kept, to find out why [pictures]. Chosen: a board that is
cut off differs from picture to picture."""
_MOST_TO_RECOGNIZE = 24
"""How many pictures of all cameras are looked at for what board there is [pictures]. Chosen: three
that agree are enough, and a board is not in every picture."""

Source = tuple[int, int | Path | Video]
"""A moment, and the frame of the camera's film, the picture or the film that shows it."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """What a camera saw of a board."""

    size: tuple[int, int]
    """Width and height of its picture."""
    views: list[View]
    looked_at: int
    """How many pictures were looked at."""
    picture: NDArray[np.uint8]
    """(row, column) the last of them, gray."""
    missed: tuple[NDArray[np.uint8], ...] = ()
    """Some of those in which there is none, where there is none in any."""
    fault: str = ""
    """Why its pictures cannot be used together."""


def plan_moments(
    footage: Sequence[BoardFootage], floor: tuple[str, str] | None = None
) -> tuple[list[list[Source]], list[str], int | None]:
    """Return what to look at in each camera, the names of the moments, and the floor's moment.

    Parameters
    ----------
    footage
        What the cameras filmed.
    floor
        The camera and the frame, or the name of the picture, in which the board lies on the floor.

    Raises
    ------
    UnknownNameError
        There is no such camera, frame or picture.
    """
    times = _times(footage)
    on_floor: str | float = ""
    if floor is not None:
        on_floor = _floor_moment(footage, *floor)
        if isinstance(on_floor, float):
            times = sorted({*times, on_floor})
    names: list[str] = [*dict.fromkeys(name for each in footage for name in each.pictures)]
    if any(each.floor is not None for each in footage) and FLOOR not in names:
        names.append(FLOOR)
    numbers = {name: len(times) + n for n, name in enumerate(names)}
    plan: list[list[Source]] = []
    for each in footage:
        sources: list[Source] = [(numbers[name], path) for name, path in each.pictures.items()]
        sources += [
            (n, frame)
            for n, time in enumerate(times)
            if (frame := _frame_at(each, time)) is not None
        ]
        if each.floor is not None:
            sources.append((numbers[FLOOR], each.floor))
        plan.append(sources)
    labels = [f"{time:.2f} s" for time in times] + names
    if isinstance(on_floor, float):
        return plan, labels, times.index(on_floor)
    return plan, labels, numbers.get(str(on_floor or FLOOR))


def sample_pictures(
    footage: Sequence[BoardFootage], plan: Sequence[Sequence[Source]]
) -> Iterator[NDArray[np.uint8]]:
    """Yield some gray pictures, from the middle of what the cameras show, one of each in turn."""
    each_count = -(-_MOST_TO_RECOGNIZE // max(len(plan), 1))
    for turn in range(each_count):
        for camera, sources in zip(footage, plan, strict=True):
            if sources:
                _, source = sources[int((turn + 0.5) / each_count * len(sources))]
                yield _gray(_picture(camera, source))


def find_views(
    footage: Sequence[BoardFootage], plan: Sequence[Sequence[Source]], board: Board
) -> list[Sighting]:
    """Return what each camera sees of a board.

    Raises
    ------
    InputError
        With all pictures and films that cannot be read.
    """
    cameras = list(range(len(footage)))
    found = side_by_side(lambda n: _look(n, footage[n], plan[n], board), cameras)
    faults = [each for each in found if isinstance(each, str)]
    if faults:
        raise InputError("\n".join(faults))
    return [each for each in found if isinstance(each, Sighting)]


def pictures_of(
    footage: BoardFootage, sources: Sequence[Source]
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield moment and RGB picture of each source, a film read through once.

    Raises
    ------
    InputError
        A film or a picture cannot be read.
    """
    frames = {source: moment for moment, source in sources if isinstance(source, int)}
    if footage.video is not None:
        for number, frame in read_frames_at(footage.video, sorted(frames)):
            yield frames[number], frame
    for moment, source in sources:
        if not isinstance(source, int):
            yield moment, _picture(footage, source)


def _look(
    camera: int, footage: BoardFootage, sources: Sequence[Source], board: Board
) -> Sighting | str:
    """Return what a camera sees, or why its pictures cannot be read."""
    views: list[View] = []
    missed: list[tuple[int, NDArray[np.uint8]]] = []
    sizes: dict[tuple[int, int], str] = {}
    gray = np.zeros((1, 1), np.uint8)
    every = max(1, len(sources) // _MOST_SLOW)
    try:
        for number, (moment, name, gray, after) in enumerate(_pictures(footage, sources)):
            sizes.setdefault(_size_of(gray), name)
            found = find_corners(gray, board)
            if found is not None:
                motion = 0.0 if after is None else _motion_px(gray, after, found[1])
                views.append(View(camera, moment, *found, motion))
            elif number % every == 0 and len(missed) < _MOST_SLOW:
                missed.append((moment, gray))
    except InputError as error:
        return f"camera {footage.name!r}: {error}"
    fault = ""
    if len(sizes) > 1:
        (one, first), (other, second), *_ = sizes.items()
        fault = (
            f"camera {footage.name!r} has pictures of different sizes: {first} is "
            f"{one[0]}x{one[1]}, {second} is {other[0]}x{other[1]}; bring those of one size, as "
            "the camera films"
        )
    elif len(views) < _FEW and not board.dictionary:
        for moment, picture in missed:
            found = find_checkers_slowly(picture, board)
            if found is not None:
                views.append(View(camera, moment, *found))
    every = max(1, -(-len(missed) // _MOST_SHOWN))
    some = () if views else tuple(picture for _, picture in missed[::every])
    return Sighting(_size_of(gray), views, len(sources), gray, some, fault)


def _pictures(
    footage: BoardFootage, sources: Sequence[Source]
) -> Iterator[tuple[int, str, NDArray[np.uint8], NDArray[np.uint8] | None]]:
    """Yield moment, name and gray picture of each source, and the next frame of a film."""
    if footage.video is not None:
        frames = {source: moment for moment, source in sources if isinstance(source, int)}
        last = footage.video.frames - 1
        wanted = {*frames, *(min(frame + 1, last) for frame in frames)}
        before: tuple[int, NDArray[np.uint8]] | None = None
        for number, frame in read_frames_at(footage.video, sorted(wanted)):
            gray = _gray(frame)
            if before is not None and before[0] in frames:
                following = gray if number == before[0] + 1 else None
                yield frames[before[0]], f"frame {before[0]}", before[1], following
            before = number, gray
        if before is not None and before[0] in frames:
            yield frames[before[0]], f"frame {before[0]}", before[1], None
    for moment, source in sources:
        if not isinstance(source, int):
            name = source.name if isinstance(source, Path) else source.path.name
            yield moment, name, _gray(_picture(footage, source)), None


def _picture(footage: BoardFootage, source: int | Path | Video) -> NDArray[np.uint8]:
    """Return what a source shows; of a film of the floor, where nothing moves, its middle."""
    if isinstance(source, Path):
        return decode_picture(source)
    if isinstance(source, Video):
        return read_frames(source, source.frames // 2, source.frames // 2 + 1)[0]
    assert footage.video is not None, "only films have frames"
    return read_frames(footage.video, source, source + 1)[0]


def _times(footage: Sequence[BoardFootage]) -> list[float]:
    """Return the times at which films are looked at, those of their frames where all agree."""
    films = [each for each in footage if each.video is not None]
    if not films:
        return []
    begin = min(each.offset_s for each in films)
    end = max(each.offset_s + each.video.frames / _rate(each.video) for each in films if each.video)
    rate = max(_rate(each.video) for each in films if each.video)
    step = (
        max(round((end - begin) / _MOST_SAMPLES * rate), round(_SHORTEST_STEP_S * rate), 1) / rate
    )
    count = max(int(np.ceil((end - begin) / step - 1e-9)), 1)
    return [begin + n * step for n in range(count)]


def _frame_at(footage: BoardFootage, time: float) -> int | None:
    """Return the frame that a film shows at a time, None where it shows none."""
    if footage.video is None:
        return None
    frame = round((time - footage.offset_s) * _rate(footage.video))
    return frame if 0 <= frame < footage.video.frames else None


def _floor_moment(footage: Sequence[BoardFootage], name: str, frame: str) -> str | float:
    """Return the name or the time of the moment in which the board lies on the floor."""
    camera = next((each for each in footage if each.name == name), None)
    if camera is None:
        raise UnknownNameError(
            f"--floor-frame names a camera {name!r}, and there are "
            f"{listed([e.name for e in footage])}"
        )
    if camera.video is None:
        if frame not in camera.pictures:
            raise UnknownNameError(
                f"--floor-frame names a picture {frame!r} of camera {name!r}, which has "
                f"{listed([*camera.pictures])}"
            )
        return frame
    if not frame.isdecimal() or int(frame) >= camera.video.frames:
        raise UnknownNameError(
            f"--floor-frame names a frame {frame!r} of camera {name!r}, whose film has the frames "
            f"0 to {camera.video.frames - 1}"
        )
    return camera.offset_s + int(frame) / _rate(camera.video)


def _rate(video: Video) -> float:
    return video.rate_hz or 30.0  # films have one; pictures are no films


def _size_of(picture: NDArray[np.uint8]) -> tuple[int, int]:
    rows, columns = picture.shape
    return columns, rows


def _gray(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)


def _motion_px(
    gray: NDArray[np.uint8], after: NDArray[np.uint8], pixel: NDArray[np.float64]
) -> float:
    """Return how far the median corner moves from one picture to the next."""
    start = np.ascontiguousarray(pixel[:, None], np.float32)
    moved, followed, _ = cv2.calcOpticalFlowPyrLK(gray, after, start, np.empty_like(start))
    good = np.ravel(followed) == 1
    if not good.any():
        return float(gray.shape[1])  # faster than can be followed
    return float(np.median(np.linalg.norm((moved - start)[:, 0][good], axis=1)))
