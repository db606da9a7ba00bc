"""The page of a digitized take: what was measured, what to look at, and pictures of it."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from storage.archive import Take
from storage.records import Record
from tasks.exporting.addresses import clip_address
from tasks.exporting.markdown import drawing, escaped, linked, picture, table
from tasks.geometry.runs import runs
from tasks.rendering.figures import FigureSettings, draw_stick_figures
from tasks.rendering.overviews import draw_contact_sheet, draw_quality
from tasks.rendering.views import picture_frame

_BODY = (200, 254)
"""Columns and rows of the picture of a body [px]. Chosen by eye: two stand side by side."""
_AROUND = 12
"""What is left around a body, where its surroundings are cut away [px]. Chosen by eye."""
_FIGURES = FigureSettings(width=480, figure_height=100)
"""How the strip of figures is drawn: as wide as the plot of quality below it."""
_INSTANTS = 6
"""How many figures it has. Chosen by eye."""
_RANGES = 40
"""How many ranges of doubtful frames are listed. Chosen: a paragraph."""


def take_page(take: Take, seconds: Mapping[str, float], viewer_url: str | None = None) -> str:
    """Return the page of a take from a capture as markdown, its pictures inside.

    Parameters
    ----------
    take
        As published.
    seconds
        How long each stage took, by its name; those that were found done took nothing.
    viewer_url
        Where the viewer of this archive answers; without it there are no links.

    Raises
    ------
    ArchiveError
        If the take is damaged.
    """
    record = take.record
    doubtful = _doubtful(take)
    frame = _shown_frame(take.voxel_counts(), doubtful)
    title = escaped(record.metadata.get("title") or record.take)
    return "\n\n".join(
        [
            f"# {title}",
            _status(take, doubtful),
            table(("measured", ""), [*_measured(take, doubtful)]),
            "## Doubtful frames",
            _doubtful_ranges(take, doubtful, viewer_url),
            "## Notes",
            "\n".join(f"- {escaped(note)}" for note in record.notes) or "None.",
            *_pictures(take, doubtful, frame),
            "## Times",
            _times(seconds),
            "## In the archive",
            table(("kept", ""), [*_kept(take)]),
        ]
    )


def take_line(take: Take) -> str:
    """Return what a list of pages says of a take: its length, and whether it wants a look."""
    record = take.record
    length = f"{record.frames} frames at {record.rate_hz:g} Hz"
    if "pose" not in record.stages:
        return f"{record.take}: {length}, no pose"
    doubts = int(_doubtful(take).sum())
    return f"{record.take}: {length}, {f'{doubts} of them doubtful' if doubts else 'none doubtful'}"


def _status(take: Take, doubtful: NDArray[np.bool_]) -> str:
    """Say in a sentence or two whether all went well."""
    record = take.record
    if "pose" not in record.stages:
        return "**In the archive, without a pose**: it is not searched; the notes say why."
    if not doubtful.any():
        return "**In the archive, with its pose**; no frame is doubtful."
    share = doubtful.mean()
    return (
        f"**In the archive, with its pose; please look at {int(doubtful.sum())} doubtful frames** "
        f"({share:.0%}), listed below with their reasons in the notes."
    )


def _measured(take: Take, doubtful: NDArray[np.bool_]) -> Iterator[tuple[str, str]]:
    """Yield what was measured, and its numbers."""
    record, counts = take.record, take.voxel_counts()
    if performer := record.metadata.get("performer"):
        yield "performer", escaped(performer)
    yield "length", f"{record.frames} frames at {record.rate_hz:g} Hz, {_length(record)}"
    cameras = take.cameras.attrs["cameras"]
    yield "cameras", f"{len(cameras)}: {escaped(', '.join(cameras))}"
    voxel_m = float(take.voxels(0).attrs["voxel_m"])
    middle = int(np.median(counts))
    yield (
        "voxels",
        f"{middle:,} in a frame (median), {voxel_m * 1000:g} mm each: "
        f"{middle * voxel_m**3 * 1000:.1f} liters",
    )
    if empty := int((counts == 0).sum()):
        yield "frames without voxels", str(empty)
    if "pose" not in record.stages:
        return
    motion, body = take.motion.attrs, take.body.attrs
    yield "stature", f"{motion['stature_m']:.3f} m, {escaped(motion['stature_source'])}"
    yield "body", f"measured in frame {body['initial_frame']}, confidence {body['confidence']:.2f}"
    yield "joints", f"{len(record.joints_present)} present in most frames"
    yield "doubtful frames", f"{int(doubtful.sum())} of {record.frames}"


def _length(record: Record) -> str:
    """Return how long a take is, as a person says it."""
    seconds = record.frames / record.rate_hz
    return f"{seconds:.1f} s" if seconds < 60 else f"{seconds // 60:.0f} min {seconds % 60:.0f} s"


def _pictures(take: Take, doubtful: NDArray[np.bool_], frame: int) -> Iterator[str]:
    """Yield the pictures of a take, each under what it shows."""
    names = list(take.cameras.attrs["cameras"])
    sheet = draw_contact_sheet(take.silhouettes[frame].values, names)
    yield f"## Frame {frame}"
    posed = "labels" in take.record.stages
    body, said = picture_frame(take, frame, size=_BODY), f"the body in frame {frame}, as filmed"
    if posed:
        segments = picture_frame(take, frame, size=_BODY, color="segments")
        body, said = _side_by_side(body, segments), f"{said}, and its segments"
    yield picture(body, said)
    yield "What each camera saw of the performer:"
    yield drawing(sheet, f"silhouettes of all cameras in frame {frame}")
    if not posed:
        return
    yield "## Over time"
    last = take.record.frames - 1
    instants = np.unique(np.linspace(0, last, min(_INSTANTS, last + 1)).round().astype(int))
    position = take.motion["position"].values
    strip = draw_stick_figures(
        position, instants.tolist(), rate_hz=take.record.rate_hz, settings=_FIGURES
    )
    yield drawing(strip, "the pose at some instants")
    yield "How much of its voxels each segment has, 0 to 1:"
    quality = draw_quality(take.pose["quality"].values, doubtful, take.record.rate_hz)
    yield drawing(quality, "quality over time, doubtful frames shaded")


def _side_by_side(body: NDArray[np.uint8], segments: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return two pictures of one body beside each other, without most of what is around it."""
    rows, columns = ((body != segments).any(axis=2).any(axis=axis) for axis in (1, 0))
    high, wide = (
        slice(
            max(int(np.argmax(each)) - _AROUND, 0), len(each) - int(np.argmax(each[::-1])) + _AROUND
        )
        for each in (rows, columns)
    )
    return np.concatenate([each[high, wide] for each in (body, segments)], axis=1)


def _doubtful(take: Take) -> NDArray[np.bool_]:
    """Return (time,) which frames a person should look at; none where there is no pose."""
    if "pose" not in take.record.stages:
        return np.zeros(take.record.frames, np.bool_)
    return take.pose["doubtful"].values.astype(np.bool_)


def _shown_frame(counts: NDArray[np.int64], doubtful: NDArray[np.bool_]) -> int:
    """Return the frame nearest to the middle that has voxels, and if possible no doubts."""
    away = np.abs(np.arange(len(counts)) - len(counts) // 2)
    worse = len(counts) * (2 * (counts == 0) + doubtful)
    return int(np.argmin(away + worse))


def _doubtful_ranges(take: Take, doubtful: NDArray[np.bool_], viewer_url: str | None) -> str:
    """Return the doubtful frames as ranges, the first of them where there are many."""
    if "pose" not in take.record.stages:
        return "There is no pose to doubt."
    ranges = [(first, end - 1) for first, end in runs(doubtful)]
    if not ranges:
        return "None."
    said = []
    for first, last in ranges[:_RANGES]:
        text = f"{first}-{last}" if last > first else f"{first}"
        said.append(
            linked(text, clip_address(viewer_url, take.name, first, last)) if viewer_url else text
        )
    more = len(ranges) - _RANGES
    return ", ".join(said) + (f", and {more} ranges more" if more > 0 else "")


def _times(seconds: Mapping[str, float]) -> str:
    """Return how long each stage took."""
    rows = [(stage.replace("_", " "), f"{each:.1f}") for stage, each in seconds.items()]
    return table(("stage", "seconds"), [*rows, ("together", f"{sum(seconds.values()):.1f}")])


def _kept(take: Take) -> Iterator[tuple[str, str]]:
    """Yield where a take is, and what it was made from."""
    record = take.record
    size = sum(each["bytes"] for each in record.files.values())
    yield "take", escaped(record.take)
    yield "version", f"{record.number}, published {escaped(record.published)}"
    yield "in", escaped(take.path)
    yield "on disk", f"{size / 1e6:.1f} MB"
    yield "from", escaped(record.source["path"])
    yield "digest", escaped(record.source["digest"])
    for name, value in record.settings.items():
        yield "set", f"{escaped(name)} = {escaped(value)}, not the default"
    for name, value in record.metadata.items():
        yield escaped(name), escaped(value)
