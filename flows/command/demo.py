"""The demo: generated performances become an archive that is searched and drawn.

Everything goes the way of a user's recordings: motion files of three formats and a capture of
eight cameras, ingested by the flow, searched as by `shosa search`. What each search should find
is known, and is counted.
"""

from pathlib import Path

from flows.command import printing
from flows.command.terminal import bars
from flows.ingestion import run_ingestion
from tasks.exporting.demonstration import (
    draw_match,
    draw_takes,
    pictures_folder,
    write_recordings,
)
from tasks.retrieval.answering import answer_query
from tasks.retrieval.searching import Match, SearchSettings
from tasks.studio.performances import DemoSearch, demo_performances

_FOUND_FROM = 0.5
"""How much of the frames of a match and of the truth both cover where it is found [share]. Chosen,
not measured."""
_SHOWN = 5
"""How many matches of a search are printed."""


def run_demo(folder: Path, *, quiet: bool = False) -> bool:
    """Make the demo in `folder`; return whether everything was taken in and found.

    Without bars where it is to be quiet.
    """
    takes, searches = demo_performances()
    archive = str(folder / "archive")
    recordings = write_recordings(folder, takes)
    printing.say(
        f"{len(takes)} performances of three performers, and the films of eight cameras of one of "
        f"them, are in {recordings}"
    )
    with bars(quiet=quiet):
        outcomes = run_ingestion(archive, [str(recordings)])
    printing.print_outcomes(outcomes, as_json=False)
    lost = sum(_show_search(archive, search, folder) for search in searches)
    draw_takes(archive, takes, folder)
    _say_what_to_open(folder, searches[0])
    return not lost and all(each.status in ("ingested", "unchanged") for each in outcomes)


def _show_search(archive: str, search: DemoSearch, folder: Path) -> int:
    """Search, print and draw what was found; return how many known places were not found."""
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
        draw_match(archive, search, other, folder)
    return len(search.finds) - len(found)


def _same_place(place: tuple, match: Match) -> bool:
    """Say whether a match covers a place where the movement was danced."""
    take, clip = place
    shared = min(clip.end, match.end) - max(clip.start, match.start) + 1
    both = max(clip.end, match.end) - min(clip.start, match.start) + 1
    return take == match.take and shared / both > _FOUND_FROM


def _say_what_to_open(folder: Path, search: DemoSearch) -> None:
    """End with what to look at and what to try."""
    archive = folder / "archive"
    printing.print_line(
        f"\nOpen the pictures in {pictures_folder(folder)}, and try:\n"
        f"  shosa takes {archive}\n"
        f"  shosa show {archive} {search.take}\n"
        f"  shosa search {archive} {search.take}:{search.start}-{search.end} --part arms"
    )
