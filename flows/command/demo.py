"""The demo: generated performances become an archive that is searched and drawn.

Everything goes the way of a user's recordings: motion files of three formats and a capture of
eight cameras, ingested by the flow, searched as by `shosa search`. What each search should find
is known, and is counted.
"""

from pathlib import Path

from flows.command import printing
from flows.ingestion import ingest_archive
from storage import open_archive
from storage.archive import take_name
from storage.formats.motion.writing import write_beside
from storage.formats.pictures.pictures import write_png
from storage.places import told
from tasks.exporting.joints import write_joint_track
from tasks.rendering.figures import draw_overlay, draw_stick_figures
from tasks.retrieval.answering import Answer, answer_query
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.searching import Match, SearchSettings
from tasks.studio.filming import FilmSettings, film_capture, stretch_arms_first
from tasks.studio.performances import DemoSearch, DemoTake, demo_performances

_SUFFIXES = (".bvh", ".c3d", ".trc")
_FOUND_FROM = 0.5  # of the frames that the match and the truth cover together
_SHOWN = 5
_FILMED = "radio-tk-filmed"
_FILM_HZ = 30.0


def run_demo(folder: Path) -> bool:
    """Make the demo in `folder`; return whether everything was taken in and found."""
    takes, searches = demo_performances()
    recordings, archive = folder / "recordings", str(folder / "archive")
    with told(f"make the directory {recordings}"):
        recordings.mkdir(parents=True, exist_ok=True)
        (folder / "pictures").mkdir(exist_ok=True)
    for number, take in enumerate(takes):
        _write_recording(recordings, take, _SUFFIXES[number % len(_SUFFIXES)])
    _film(recordings / _FILMED, takes[0])
    printing.say(
        f"{len(takes)} performances of three performers, and the films of eight cameras of one of "
        f"them, are in {recordings}"
    )
    outcomes = ingest_archive(archive, [str(recordings)])
    printing.print_outcomes(outcomes, as_json=False)
    missed = sum(_show_search(archive, search, folder) for search in searches)
    _draw_takes(archive, takes, folder)
    _say_what_to_open(folder, searches[0])
    return not missed and all(each.status in ("ingested", "unchanged") for each in outcomes)


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
    clip = take.performance.clips[1]
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


def _show_search(archive: str, search: DemoSearch, folder: Path) -> int:
    """Search, print and draw what was found; return how many known places were missed."""
    text = f"{search.take}:{search.start}-{search.end}"
    settings = SearchSettings(
        part=search.part, mirror=search.mirror, path_weight=search.path_weight
    )
    answer = answer_query(archive, text, settings)
    found = [place for place in search.finds if any(_same_place(place, m) for m in answer.matches)]
    options = f" --part {search.part}" * (search.part != "whole") + " --mirror" * search.mirror
    options += f" --path-weight {search.path_weight:g}" * (search.path_weight > 0)
    printing.print_line(f"\n{search.question}\n$ shosa search {archive} {text}{options}")
    printing.print_matches(answer, most=_SHOWN)
    printing.print_line(
        f"danced at {len(search.finds)} other places, {len(found)} of them among the "
        f"{len(answer.matches)} matches"
    )
    other = next((m for m in answer.matches if m.take != search.take and not m.mirrored), None)
    if other:
        _draw_match(archive, search, answer, other, folder)
    return len(search.finds) - len(found)


def _same_place(place: tuple, match: Match) -> bool:
    """Say whether a match covers a place where the movement was danced."""
    take, clip = place
    shared = min(clip.end, match.end) - max(clip.start, match.start) + 1
    both = max(clip.end, match.end) - min(clip.start, match.start) + 1
    return take == match.take and shared / both > _FOUND_FROM


def _draw_match(
    archive: str, search: DemoSearch, answer: Answer, match: Match, folder: Path
) -> None:
    """Draw the best match in another take over its query."""
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
    write_png(folder / "pictures" / f"{take_name(search.question)}.png", image)


def _draw_takes(archive: str, takes: tuple[DemoTake, ...], folder: Path) -> None:
    """Draw one movement of each of three takes, one of each format."""
    opened = open_archive(archive)
    for take in takes[: len(_SUFFIXES)]:
        motion = opened.take(take.take).motion
        clip = take.performance.clips[1]
        frames = [clip.start + (clip.end - clip.start) * step // 7 for step in range(8)]
        image = draw_stick_figures(
            motion["position"].values,
            frames,
            title=f"{take.title}: {clip.movement}",
            rate_hz=float(motion.attrs["rate_hz"]),
        )
        write_png(folder / "pictures" / f"take-{take.take}.png", image)


def _say_what_to_open(folder: Path, search: DemoSearch) -> None:
    """End with what to look at and what to try."""
    archive = folder / "archive"
    printing.print_line(
        f"\nOpen the pictures in {folder / 'pictures'}, and try:\n"
        f"  shosa takes {archive}\n"
        f"  shosa show {archive} {search.take}\n"
        f"  shosa search {archive} {search.take}:{search.start}-{search.end} --part arms"
    )
