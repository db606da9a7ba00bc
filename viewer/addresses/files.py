"""The addresses that hand out and take in files: reports, exports, motions, body models."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from fastapi import FastAPI, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse, PlainTextResponse

from storage.errors import InputError, UnknownNameError
from tasks.exporting.joints import export_take
from viewer.addresses.telling import saved_as, told
from viewer.answers import find_others
from viewer.asking import read_address
from viewer.body_model import (
    capture_folder,
    file_digest,
    label_frame,
    save_into_capture,
    save_model,
    shares_of,
)
from viewer.digitizing import Digitizations
from viewer.holdings import FILE, Holdings
from viewer.report import make_report
from viewer.texts import choose_language

MOST_BYTES = 1 << 28
"""Longest file that may be dropped on a page [bytes]. An hour of a hundred markers is less."""


def add_files(app: FastAPI, holdings: Holdings, work: Digitizations) -> None:
    """Add the addresses of `holdings` to an app, and of what was started from its pages."""

    @app.get("/report")
    def report(request: Request) -> Response:
        return told(lambda: _report(holdings, request))

    @app.get("/export/{name}")
    def export(name: str) -> Response:
        return told(lambda: _export(holdings, name))

    @app.post("/files")
    async def file(request: Request, name: str) -> Response:
        content = bytearray()
        async for part in request.stream():
            content += part
            if len(content) > MOST_BYTES:
                most = f"{MOST_BYTES >> 20} MB"
                return PlainTextResponse(f"{name[:80]} is larger than {most}; ingest it", 413)
        try:
            motion = await run_in_threadpool(holdings.add_file, name, bytes(content))
        except (InputError, OSError) as error:
            return PlainTextResponse(str(error), 422)
        return JSONResponse({"key": motion.name})

    @app.post("/digitize/{take}")
    def digitize(take: str) -> Response:
        return told(lambda: _digitize(holdings, work, take))

    @app.get("/digitize/{take}")
    def digitizing(take: str) -> Response:
        return JSONResponse(work.state(take))

    @app.post("/body/{what}/{take}/{version}/{frame}")
    async def body(request: Request, what: str, take: str, version: str, frame: int) -> Response:
        content = await _json(request)
        return await run_in_threadpool(
            lambda: told(lambda: _body(holdings, what, (take, version, frame), content))
        )


async def _json(request: Request) -> dict[str, Any]:
    """Return the object in a request, empty where there is none."""
    try:
        content = await request.json()
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _report(holdings: Holdings, request: Request) -> Response:
    """Return the report of the search in the address."""
    asking, _ = read_address(request.query_params)
    motion = holdings.motion(asking.file or asking.take, FILE if asking.file else None)
    clip = (asking.start or 0, motion.frames - 1 if asking.end is None else asking.end)
    answer = find_others(holdings, motion, clip, asking.settings())
    language = choose_language(
        None, request.cookies.get("language"), request.headers.get("accept-language", "")
    )
    content = make_report(holdings, answer, motion, language)
    head = saved_as(f"{motion.title}-{clip[0]}-{clip[1]}.html")
    return Response(content, media_type="text/html; charset=utf-8", headers=head)


def _export(holdings: Holdings, name: str) -> Response:
    """Return a take in a file of the kind that its name ends in."""
    take = Path(name).stem
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"take{Path(name).suffix.lower()}"
        export_take(holdings.location, take, str(path))
        content = path.read_bytes()
    return Response(content, media_type="application/octet-stream", headers=saved_as(name))


def _digitize(holdings: Holdings, work: Digitizations, name: str) -> Response:
    """Start digitizing the capture of a take; tell how it goes."""
    take = holdings.take(name)
    folder = capture_folder(take)
    if folder is None:
        raise InputError(f"the capture {take.record.source['path']} is not on this machine")
    work.start(name, folder)
    return JSONResponse(work.state(name))


def _body(
    holdings: Holdings, what: str, about: tuple[str, str, int], content: dict[str, Any]
) -> Response:
    """Label the voxels of a frame by the joints of a page, or save them."""
    name, version, frame = about
    take = holdings.take(name, version)
    if what == "labels":
        label, is_surface = label_frame(holdings, take, frame, content)
        head = {"x-shares": str(shares_of(label))}
        shown = np.ascontiguousarray(label[is_surface]).tobytes()
        return Response(shown, media_type="application/octet-stream", headers=head)
    if what == "save":
        path = save_into_capture(holdings, take, frame, content)
        return JSONResponse({"path": str(path), "digest": file_digest(take)})
    if what == "download":
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "initial.json"
            save_model(holdings, take, frame, content, into=path)
            return Response(path.read_bytes(), media_type="application/json")
    raise UnknownNameError(f"nothing is done at {what[:40]!r}")
