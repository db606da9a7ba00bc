"""The body-model page: correct the joints and boundaries that a take is digitized by."""

from asyncio import to_thread
from typing import Any

from fastapi import Request
from nicegui import ui

from storage.archive import Take
from storage.errors import InputError
from storage.schema import SEGMENTS
from tasks.rendering.views import SEGMENT_COLORS
from viewer.body_model import BOUNDARIES, Start, capture_folder, start_of
from viewer.holdings import Holdings
from viewer.pages.components import BodyEditor, made, tag
from viewer.pages.shell import Shell, Site, begin_page
from viewer.pairing import BODY, shown_motion


async def body_page(site: Site, request: Request) -> None:
    """Build the page for one visitor."""
    shell = begin_page(site, request, "body_model")
    place = tag("main", classes="body-page")
    await ui.context.client.connected()
    values = request.query_params
    with shell.telling():
        filmed = await to_thread(_filmed, site.holdings)
        name = values.get("take", "") or next(iter(filmed), "")
        if not name:
            with place:
                tag("p", shell.texts["none_filmed"], "found-note")
            return
        frame = int(values["frame"]) if values.get("frame", "").isdigit() else None
        take = await to_thread(site.holdings.take, name)
        if "voxels" not in take.record.stages:
            raise InputError(shell.text("no_voxels", take=name))
        start = await to_thread(start_of, take, frame)
        with place:
            _show(shell, site.holdings, take, start, filmed)


def _filmed(holdings: Holdings) -> dict[str, str]:
    """Return the takes that have voxels, by name, with their titles."""
    records, _ = holdings.records()
    return {
        record.take: str(record.metadata.get("title") or record.take)
        for record in records
        if "voxels" in record.stages
    }


def _show(
    shell: Shell, holdings: Holdings, take: Take, start: Start, filmed: dict[str, str]
) -> None:
    """Show the editor of a take."""
    motion = holdings.motion(take.name, take.record.version)
    folder = capture_folder(take)
    content: dict[str, Any] = {
        "motion": shown_motion(motion, 0, motion.frames - 1),
        "frame": start.frame,
        "joints": [
            [round(float(v), 5) for v in place] if all(v == v for v in place) else None
            for place in start.position.tolist()
        ],
        "source": start.source,
        "digest": start.digest,
        "labeled": start.labeled,
        "boundaries": list(BOUNDARIES),
        "segments": list(SEGMENTS),
        "colors": SEGMENT_COLORS.tolist(),
        "capture": str(folder) if folder else "",
        "filmed": filmed,
        "command": f"shosa ingest {holdings.location} {folder}" if folder else "",
    }
    made(BodyEditor, content=content, body=BODY, texts=dict(shell.texts))
