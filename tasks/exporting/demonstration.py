"""The files of the demo: recordings of generated performances, and pictures of what is found."""

from pathlib import Path

from storage import open_archive
from storage.archive import take_name
from storage.files import write_beside
from storage.formats.pictures.pictures import write_png
from storage.places import told
from tasks.exporting.joints import write_joint_track
from tasks.rendering.figures import draw_overlay, draw_stick_figures
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.searching import Match
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import DemoSearch, DemoTake

_SUFFIXES = (".bvh", ".c3d", ".trc")
_FILMED = "radio-tk-filmed"
_FILM_HZ = 30.0
"""Frames a second of the films. A divisor of the performances' rate, as cameras usually have."""
_CLIP = 1
"""Number of the movement of a take that is filmed and drawn."""
_FIGURES = 8
"""How many figures show a movement. Chosen by eye; not measured."""


def write_recordings(folder: Path, takes: tuple[DemoTake, ...]) -> Path:
    """Write the performances as motion files and films; return the folder with the recordings.

    Parameters
    ----------
    folder
        Of the demo; it and a folder for pictures are made where they are not there.
    takes
        The formats follow each other in turn, and of the first a movement is filmed.
    """
    recordings = folder / "recordings"
    with told(f"make the directory {recordings}"):
        recordings.mkdir(parents=True, exist_ok=True)
        pictures_folder(folder).mkdir(exist_ok=True)
    for number, take in enumerate(takes):
        _write_recording(recordings, take, _SUFFIXES[number % len(_SUFFIXES)])
    _film(recordings / _FILMED, takes[0])
    return recordings


def pictures_folder(folder: Path) -> Path:
    """Return where the demo's pictures are."""
    return folder / "pictures"


def draw_match(archive: str, search: DemoSearch, match: Match, folder: Path) -> None:
    """Write a picture of a match over its query."""
    takes = open_archive(archive)
    asked, other = takes.take(search.take), takes.take(match.take)
    image = draw_overlay(
        asked.motion["position"].values[search.start : search.end + 1],
        other.motion["position"].values[match.start : match.end + 1],
        title=search.question,
        query_stature_m=asked.motion.attrs["stature_m"],
        match_stature_m=other.motion.attrs["stature_m"],
        joints=PARTS[search.part],
        starts=(search.start, match.start),
        names=(
            f"{search.take} {search.start}-{search.end}",
            f"{match.take} {match.start}-{match.end}",
        ),
    )
    write_png(pictures_folder(folder) / f"{take_name(search.question)}.png", image)


def draw_takes(archive: str, takes: tuple[DemoTake, ...], folder: Path) -> None:
    """Write a picture of one movement of each of three takes, one of each format."""
    opened = open_archive(archive)
    for take in takes[: len(_SUFFIXES)]:
        motion = opened.take(take.take).motion
        clip = take.performance.clips[_CLIP]
        length = clip.end - clip.start
        frames = [clip.start + length * step // (_FIGURES - 1) for step in range(_FIGURES)]
        image = draw_stick_figures(
            motion["position"].values,
            frames,
            title=f"{take.title}: {clip.movement}",
            rate_hz=float(motion.attrs["rate_hz"]),
        )
        write_png(pictures_folder(folder) / f"take-{take.take}.png", image)


def _write_recording(folder: Path, take: DemoTake, suffix: str) -> None:
    """Write a performance as a motion file, with its metadata beside it."""
    performance = take.performance
    path = folder / f"{take.take}{suffix}"
    write_joint_track(path, performance.position, performance.rate_hz)
    about = {
        "title": take.title,
        "performer": take.performer.name,
        "date": f"day {take.day}",
        "rights": "CC0-1.0",
    }
    lines = [f'{key} = "{value}"' for key, value in about.items()]
    write_beside(path.with_suffix(".toml"), "\n".join(["[take]", *lines, ""]).encode())


def _film(folder: Path, take: DemoTake) -> None:
    """Film a movement of a performance with eight cameras, unless it was filmed before."""
    if (folder / "capture.toml").exists():
        return
    clip = take.performance.clips[_CLIP]
    danced = take.performance.position[clip.start : clip.end + 1]
    step = round(take.performance.rate_hz / _FILM_HZ)
    about = {
        "title": f"{take.title}: {clip.movement}, filmed",
        "performer": take.performer.name,
        "rights": "CC0-1.0",
    }
    film_capture(
        folder,
        stretch_arms_first(danced[::step], _FILM_HZ),
        _FILM_HZ,
        settings=FilmSettings(clothes="kimono"),
        metadata=about,
    )
