"""What runs show on the dashboard: progress, a page a take, tables. Nothing here can harm a run."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from prefect.artifacts import (
    create_markdown_artifact,
    create_progress_artifact,
    create_table_artifact,
    update_progress_artifact,
)

from flows.artifacts import shown
from flows.links import artifact_key, viewer_url
from flows.progress import Estimate, Moment, show_watcher
from storage.archive import Take
from tasks.exporting.addresses import clip_address, match_address
from tasks.exporting.day_pages import day_line, summarize_day
from tasks.exporting.markdown import escaped, linked
from tasks.exporting.take_pages import take_line, take_page
from tasks.retrieval.answering import Answer
from tasks.takes.beginning import Blocks

logger = logging.getLogger(__name__)

_EVERY_S = 3.0
"""How often the progress of a take is shown at most [s]. A call costs the server some 10 ms."""
_LOGGED_EVERY_S = 15.0
"""How often a long stage logs how far it is [s]. Chosen: a line for each few percent of a take."""
_COUNTED_FROM = 9
"""After how many takes a time is told: they differ, and the first ones wait for the program."""
_STATUSES = ("failed", "refused", "ingested", "unchanged")
"""What becomes of recordings, what a person has to see first."""


def progress_teller(take: str, frames: int) -> Callable[[str, float], None]:
    """Return what tells how far a take is: the log, the dashboard, and who watches.

    Parameters
    ----------
    take
        How it is called.
    frames
        Of the take.
    """
    estimate = Estimate(take, frames)
    artifact = shown(create_progress_artifact, progress=0.0, description=f"{take}: begun")
    logged: dict[str, float] = {}
    shown_s = logged_s = time.monotonic()

    def tell(stage: str, frame: float) -> None:
        nonlocal shown_s, logged_s
        moment = estimate.move(stage, frame)
        show_watcher(moment)
        now_s = time.monotonic()
        is_block = isinstance(frame, int) and frame > logged.get(stage, 0)  # else inside a stage
        if is_block or now_s - logged_s > _LOGGED_EVERY_S:
            logged[stage], logged_s = frame, now_s
            logger.info("    %s: %s", take, moment.said())
        if artifact and (moment.share == 1.0 or now_s - shown_s > _EVERY_S):
            shown_s = now_s
            _show_progress(artifact, moment, take)

    return tell


def count_teller(what: str, total: int) -> Callable[[int], None]:
    """Return what tells how many of a run's recordings or takes are done.

    Parameters
    ----------
    what
        What is done, and where: "3 recordings into ARCHIVE".
    total
        How many there are.
    """
    artifact = shown(create_progress_artifact, progress=0.0, description=what)
    begun_s = shown_s = time.monotonic()

    def tell(done: int) -> None:
        nonlocal shown_s
        now_s = time.monotonic()
        left_s = (now_s - begun_s) * (total - done) / done if done > _COUNTED_FROM else None
        moment = Moment("", "", done, total, done / total, left_s)
        show_watcher(moment)
        if artifact and (done == total or now_s - shown_s > _EVERY_S):
            shown_s = now_s
            _show_progress(artifact, moment, what)

    return tell


def _show_progress(artifact: Any, moment: Moment, what: str) -> None:
    """Show how far something is, in the artifact of its progress."""
    shown(
        update_progress_artifact,
        artifact_id=artifact,
        progress=round(100.0 * moment.share, 1),
        description=_progress_line(moment, what),
    )


def _progress_line(moment: Moment, what: str) -> str:
    """Return what stands beside the progress of something: the list of a run's shows its start."""
    first = ", ".join(filter(None, [f"{moment.share:.0%}", moment.left()]))
    return f"{first}: {what}, {moment.done()}" if moment.share < 1 else f"done: {what}"


def show_digitized(take: Take, blocks: Blocks) -> None:
    """Show the page of a take that was digitized; one that cannot be drawn is told in the log."""
    seconds = {stage: sum(part.seconds for part in parts) for stage, parts in blocks.items()}
    try:
        page, line = take_page(take, seconds, viewer_url()), take_line(take)
    except Exception as error:  # the take is published: a page is not worth a failed run
        logger.warning("%s: its page cannot be made: %s", take.name, error)
        return
    shown(
        create_markdown_artifact,
        key=artifact_key("digitized", take.name),
        markdown=page,
        description=line,
    )


def show_ingested(archive: str, outcomes: Sequence[Mapping[str, Any]]) -> None:
    """Show what became of each recording of a run, what failed or was refused first.

    Parameters
    ----------
    archive
        Where they went.
    outcomes
        The fields of each `Outcome`.
    """
    counts = {
        status: sum(each["status"] == status for each in outcomes) for status in _known(outcomes)
    }
    said = ", ".join(f"{count} {status}" for status, count in counts.items()) or "nothing to do"
    shown(
        create_table_artifact,
        key=artifact_key("ingested", archive),
        table=ingested_rows(outcomes),
        description=f"{said}, into {escaped(archive)}",
    )


def ingested_rows(outcomes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of the table of `show_ingested`."""
    order = list(_known(outcomes))
    return [
        {
            "status": each["status"],
            "take": escaped(each["take"] or ""),
            "reason": escaped(_without_folder(each["reason"], each["path"])),
            "frames": each["frames"] or "",
            "Hz": f"{each['rate_hz']:g}" if each["frames"] else "",
            "joints": each["joints"] if each["frames"] else "",
            "notes": escaped("; ".join(each["notes"])),
            "from": escaped(each["path"]),
        }
        for each in sorted(outcomes, key=lambda each: order.index(each["status"]))
    ]


def show_matches(archive: str, query: str, answer: Answer) -> None:
    """Show what a search has found, with links into the viewer where its address is known."""
    shown(
        create_table_artifact,
        key=artifact_key("matches", archive),
        table=match_rows(answer, viewer_url()),
        description=f"{escaped(query)} in {escaped(archive)}: {len(answer.matches)} matches in "
        f"{answer.searched_takes} takes, {answer.seconds:.2f} s",
    )


def show_day(
    archive: str, *, inboxes: Sequence[str], hours: float, failed: Sequence[tuple[str, str]]
) -> str:
    """Show the page of `summarize_day`, whose arguments these are; return it."""
    page = summarize_day(archive, inboxes=inboxes, hours=hours, failed=failed)
    shown(
        create_markdown_artifact,
        key=artifact_key("day", archive),
        markdown=page,
        description=day_line(archive, page),
    )
    return page


def match_rows(answer: Answer, viewer: str | None) -> list[dict[str, Any]]:
    """Return the rows of the table of `show_matches`.

    Parameters
    ----------
    answer
        Of a search.
    viewer
        Where the viewer answers, or None.
    """
    rows = []
    for rank, match in enumerate(answer.matches, start=1):
        record = answer.records[match.take]
        clip = beside = ""
        if viewer:
            clip = clip_address(viewer, match.take, match.start, match.end)
            beside = match_address(viewer, answer, rank) or ""
        rows.append(
            {
                "rank": linked(rank, beside),
                "take": linked(match.take, clip),
                "seconds": f"{match.start / record.rate_hz:.2f}-{match.end / record.rate_hz:.2f}",
                "distance": f"{match.distance:.4f}",
                "level": answer.meaning(match)["level"] or "",
                "by chance": answer.chance.in_words(match.distance),
                "performer": escaped(record.metadata.get("performer", "")),
                "title": escaped(record.metadata.get("title", "")),
                "mirrored": "yes" if match.mirrored else "",
                "frames": f"{match.start}-{match.end}",
            }
        )
    empty = {
        name
        for name in ("level", "performer", "title", "mirrored")
        if not any(row[name] for row in rows)
    }
    return [{name: cell for name, cell in row.items() if name not in empty} for row in rows]


def _without_folder(reason: str, path: str) -> str:
    """Return a reason with the name of a recording in place of its path, which is in the table."""
    short = reason.replace(path, path.rstrip("/").rsplit("/", 1)[-1])
    return short.replace(":\n- ", ": ").replace("\n- ", "; ")  # a list, which a cell cannot show


def _known(outcomes: Sequence[Mapping[str, Any]]) -> dict[str, None]:
    """Return the statuses there are, in order; one that is not known comes first."""
    there = {each["status"] for each in outcomes}
    return dict.fromkeys(
        [*sorted(there - {*_STATUSES}), *(each for each in _STATUSES if each in there)]
    )
